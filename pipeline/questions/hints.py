"""Names that stand in annotations of questions alone: what they mean is loaded by type checkers only."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from geometry.elements import ComplexArray, FloatArray
    from pipeline.case.model import Case
    from pipeline.planning.plan import Plan
    from pipeline.planning.simplifications import Simplification
    from pipeline.plots.style import ReportFigure
else:
    Axes = Case = ComplexArray = FloatArray = Plan = ReportFigure = Simplification = Any

__all__ = ["Axes", "Case", "ComplexArray", "FloatArray", "Plan", "ReportFigure", "Simplification"]
