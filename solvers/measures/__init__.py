"""What is measured on a motion: confinement, mode mixing, mode tracking, a vibrometer's map."""
