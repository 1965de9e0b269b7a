"""Analogy and control models, their figures, compared with the thesis."""
