"""Modules that questions compute and draw with, each loaded at its first use: help stays quick."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

    from pipeline.planning import foresight, simplifications
    from pipeline.planning import plan as plans
    from pipeline.plots import fields, style
    from pipeline.records import outputs
    from solvers.measures import confinement
else:

    class _Late:
        """A module by its name, loaded when something of it is asked for."""

        def __init__(self, name: str) -> None:
            self._name = name

        def __getattr__(self, name: str) -> Any:
            return getattr(import_module(self._name), name)

    np, confinement, outputs = map(_Late, ("numpy", "solvers.measures.confinement", "pipeline.records.outputs"))
    fields, style = map(_Late, ("pipeline.plots.fields", "pipeline.plots.style"))
    foresight, plans = map(_Late, ("pipeline.planning.foresight", "pipeline.planning.plan"))
    simplifications = _Late("pipeline.planning.simplifications")

__all__ = ["confinement", "fields", "foresight", "np", "outputs", "plans", "simplifications", "style"]
