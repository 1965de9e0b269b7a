"""What a built image holds: its contents, its registers for debuggers, its longest paths."""
