"""Which factorisations this machine has; loads none of them."""

from __future__ import annotations

import importlib.util
from functools import lru_cache


@lru_cache(maxsize=1)
def available() -> tuple[str, ...]:
    """Factorisations of this machine, the preferred one first."""
    return (*(["rslab"] if importlib.util.find_spec("rslab") else []), "superlu")
