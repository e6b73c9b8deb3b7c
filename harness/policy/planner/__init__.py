"""Planners that think between two steps: simulations from the exact belief, on the policy's own copy of the model."""
