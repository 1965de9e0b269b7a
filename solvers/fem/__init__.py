"""Three-dimensional linear elasticity by finite elements."""
