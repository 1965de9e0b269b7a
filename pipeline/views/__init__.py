"""What a command answers: its document, and that as rows of a table and as a figure."""
