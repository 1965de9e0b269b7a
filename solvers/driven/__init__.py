"""A plate driven by several patches, and the error bars of its response."""
