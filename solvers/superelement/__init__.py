"""One plate cell reduced to its polynomial boundary, and what is built from it."""
