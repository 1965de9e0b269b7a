"""Structured hexahedra for scenes of boxes."""
