"""Quadratic tetrahedra of CAD bodies."""
