"""The case file: read, checked, turned to SI."""
