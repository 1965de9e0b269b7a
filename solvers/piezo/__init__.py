"""Piezo patches bonded to a plate, and the forced response to them."""
