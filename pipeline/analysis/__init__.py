"""One computation a module, on a case."""
