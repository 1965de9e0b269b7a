"""The amplitude loop of one mode in the rotating frame."""
