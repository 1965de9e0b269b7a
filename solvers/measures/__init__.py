"""What is measured on a motion: confinement, the target mode, mode mixing, fields compared."""
