"""Design: façades and surfaces as parameters, and their gradients."""
