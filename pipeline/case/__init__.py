"""The case file: typed tables, each checked by itself and against the others, read in SI units."""
