"""Which model and mesh, and what error to expect."""
