"""Velocity feedback on a beam."""
