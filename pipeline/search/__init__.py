"""Multi-fidelity design search."""
