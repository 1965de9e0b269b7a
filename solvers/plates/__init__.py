"""Models of one plate: a strip, a column of cells, the plate assembled from them; a cell sampled over its waves."""
