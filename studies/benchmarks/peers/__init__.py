"""Comparison with other programs: the same parts solved by their users' choices, error against processor seconds."""
