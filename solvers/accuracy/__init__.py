"""Errors of meshes and of reductions, and the errors measured once on reference parts."""
