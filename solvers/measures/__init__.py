"""What is measured on a motion: confinement, the wanted mode, mode mixing, fields compared."""
