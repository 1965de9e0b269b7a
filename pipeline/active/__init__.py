"""The analogy and control models, their figures, beside the thesis."""
