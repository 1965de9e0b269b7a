"""Bloch waves in the infinite lattice."""
