"""Figures from stored records."""
