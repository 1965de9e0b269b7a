"""A result's document as rows of a table and as a figure."""
