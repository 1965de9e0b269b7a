"""One mode's amplitude loop in the rotating frame, and its identification."""
