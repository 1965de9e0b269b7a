"""Studies: many cases, resumable."""
