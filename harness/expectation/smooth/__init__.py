"""The expected return as a smooth function of a policy's constants, with its gradient: forward-mode differentiation."""
