"""Bloch waves and their lower bounds, gaps and complex bands."""
