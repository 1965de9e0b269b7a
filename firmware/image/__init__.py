"""Analysis of a built image: its contents, its registers for debuggers, its longest paths."""
