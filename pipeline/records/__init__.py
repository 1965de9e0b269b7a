"""Files that a run writes, and reading them back."""
