"""One plate cell reduced (Craig-Bampton), assembled into lattices and plates."""
