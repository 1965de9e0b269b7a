"""Vibrometer data read, compared, synthesised."""
