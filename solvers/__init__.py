"""Numbers in, numbers out: no case file, no log."""
