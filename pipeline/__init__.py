"""From a case file to result files; the top-level modules are shared by all folders."""
