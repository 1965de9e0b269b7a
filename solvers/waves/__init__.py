"""Bloch waves, gaps and complex bands."""
