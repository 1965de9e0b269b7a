"""Shapes, layouts and meshes: where things stand, before any physics."""
