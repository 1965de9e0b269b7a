"""Print files and other programs."""
