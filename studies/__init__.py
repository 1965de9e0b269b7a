"""Study files, and the few studies that need a script."""
