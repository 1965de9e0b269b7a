"""One plate cell reduced (Craig-Bampton), tied to its images or assembled."""
