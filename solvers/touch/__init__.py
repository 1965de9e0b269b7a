"""A fingertip on a driven plate: what it leaves of the motion, what it feels, what the patches draw."""
