"""The case file: one typed table each, checked alone and across tables, asked in SI."""
