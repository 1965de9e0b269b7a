"""A page that answers while a design is dragged."""
