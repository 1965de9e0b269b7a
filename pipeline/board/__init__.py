"""The mode table and the emulated board."""
