"""Finite elements: assembly, constraints, eigenvalue problems."""
