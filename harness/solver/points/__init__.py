"""Solving point by point, for hidden factors that are large: alpha vectors below, a sawtooth above, trials between."""
