"""Lazy imports for questions: modules load at first use, types only for type checkers, so that help stays quick."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.axes import Axes

    from geometry.elements import ComplexArray, FloatArray
    from pipeline.case.model import Case
    from pipeline.planning import plan as plans
    from pipeline.planning import resource_estimate, simplifications
    from pipeline.planning.plan import Plan
    from pipeline.planning.simplifications import Simplification
    from pipeline.plots import fields, style
    from pipeline.plots.style import ReportFigure
    from pipeline.records import outputs
    from solvers.measures import confinement
else:

    class _Late:
        """Module that loads when one of its attributes is first used."""

        def __init__(self, name: str) -> None:
            self._name = name

        def __getattr__(self, name: str) -> Any:
            return getattr(import_module(self._name), name)

    np, confinement, outputs = map(_Late, ("numpy", "solvers.measures.confinement", "pipeline.records.outputs"))
    fields, style = map(_Late, ("pipeline.plots.fields", "pipeline.plots.style"))
    resource_estimate, plans = map(_Late, ("pipeline.planning.resource_estimate", "pipeline.planning.plan"))
    simplifications = _Late("pipeline.planning.simplifications")
    Axes = Case = ComplexArray = FloatArray = Plan = ReportFigure = Simplification = Any


def named(place: str) -> Any:
    """Return what has a dotted name in the pipeline, such as report.gallery.dispersion, from a module that loads only now."""
    module, _, name = place.rpartition(".")
    return getattr(import_module(f"pipeline.{module}"), name)


__all__ = ["Axes", "Case", "ComplexArray", "FloatArray", "Plan", "ReportFigure", "Simplification", "confinement"]
__all__ += ["fields", "named", "np", "outputs", "plans", "resource_estimate", "simplifications", "style"]
