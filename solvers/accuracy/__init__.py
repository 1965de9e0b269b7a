"""How far off a number may be: by a mesh, by a reduction, and as measured once on reference parts."""
