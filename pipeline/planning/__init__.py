"""Choice of model and mesh, resource estimates and expected errors."""
