"""Numbers: finite elements, waves, beams and plates. Reads meshes, writes nothing."""
