"""Factorisations with inertia."""
