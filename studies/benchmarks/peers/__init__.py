"""Comparison with other programs on the same parts: error against processor seconds."""
