"""Beside other programs: the same parts solved by what users would take instead, error against processor seconds."""
