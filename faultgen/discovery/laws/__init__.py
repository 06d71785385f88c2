"""Friction laws, learned laws and other patterns of a residual."""
