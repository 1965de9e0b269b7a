"""Meshes in other programs' formats."""
