"""A fingertip on a driven plate: the motion under it, the friction it feels, and the power of the patches."""
