"""Measures of a motion: confinement, the target mode, mode mixing, correlation of fields."""
