"""Designs, materials and the mesh type."""
