"""A case's parts and cells as models to solve."""
