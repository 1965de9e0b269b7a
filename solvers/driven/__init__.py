"""What patches make of a driven plate together, and the error bars of it."""
