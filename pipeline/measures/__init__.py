"""What a study can measure: one module a measure, each with its plan, its computation, its columns and its pictures."""
