"""Models of one plate: a strip, a column of cells, the plate assembled from them, and a rectangle of it that repeats."""
