"""Closed-form and one-dimensional models."""
