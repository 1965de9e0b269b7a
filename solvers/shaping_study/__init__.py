"""The thesis' clamped beams under shaping."""
