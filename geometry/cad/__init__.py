"""CAD solids, their print and CAD files."""
