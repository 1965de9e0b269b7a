"""Piezoelectric patches and the forced response of a plate."""
