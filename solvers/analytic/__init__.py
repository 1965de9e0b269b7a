"""Closed-form and one-dimensional beams and plates."""
