"""Which factorisations this machine has, and which of them a system takes; loads none of them but MKL, where it is."""

from __future__ import annotations

import importlib.util
from functools import lru_cache

SMALL = (
    8000  # degrees of freedom up to which SuperLU is as fast as PARDISO: python -m studies.benchmarks.factorisations
)


@lru_cache(maxsize=1)
def available() -> tuple[str, ...]:
    """Factorisations of this machine, the preferred one for large matrices first."""
    names = ["rslab"] if importlib.util.find_spec("rslab") else []
    if importlib.util.find_spec("pypardiso"):
        from solvers.fem.factor.pardiso import load

        try:
            load()
            names.append("pardiso")
        except (ImportError, OSError):  # the wheel is there, MKL is not
            pass
    return (*names, "superlu")


def preferred(dofs: int) -> str:
    """The measured choice: rslab at every size; without it PARDISO, but SuperLU for what it does as fast."""
    first = available()[0]
    return "superlu" if first == "pardiso" and dofs <= SMALL else first
