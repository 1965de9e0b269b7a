"""The error that the mesh of a model choice is expected to make, said in the log and kept with the result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.planning.model_choice import ModelChoice
from pipeline.quantity import percent
from solvers.accuracy.calibration import TET


@dataclass(frozen=True)
class WidestBar:
    """The widest error bar of the frequencies asked for.

    Attributes
    ----------
    error : float or None
        Relative half-width; None where the bar of one of them is unknown.
    of : str
        The frequency that has it, in words.
    parts : dict of str to float
        What the bar is made of, relative: `mesh`, `truncation`.
    """

    error: float | None
    of: str = ""
    parts: Mapping[str, float] | None = None

    @property
    def largest_part(self) -> str | None:
        """Name of the part that contributes most; None without parts."""
        return max(self.parts, key=lambda name: (self.parts or {})[name]) if self.parts else None

    def text(self) -> str:
        """Return the bar, what it is of and its largest part in words."""
        if self.error is None:
            return "error of a frequency: unknown for at least one of them; compare with a finer solve.accuracy"
        parts = sorted((self.parts or {}).items(), key=lambda part: -part[1])
        shares = ", ".join(f"{percent(error)} {name}" for name, error in parts if error > 0.0)
        return f"error of a frequency: {percent(self.error)} at most ({self.of})" + (f": {shares}" if shares else "")

    def warn(self, case: Case, log: Log) -> None:
        """Warn where the bar exceeds the accuracy that the case asks for."""
        if self.error is not None and self.error > case.solve.accuracy:
            log.warning(
                "ACCURACY",
                f"the error bar of {self.of} is {percent(self.error)}, most of it {self.largest_part}; "
                f"solve.accuracy asks for {percent(case.solve.accuracy)}",
            )

    def to_dict(self) -> dict[str, Any]:
        """As results keep it."""
        return {"error": self.error, "of": self.of, "parts": dict(self.parts or {}), "largest_part": self.largest_part}


def log_mesh_error(choice: ModelChoice, case: Case, log: Log, error: float | None) -> float | None:
    """Log the largest half-width of the frequencies' bars by the mesh, and where the case asks for less; returns it.

    None where nothing tells it.
    """
    if error is None:
        log.info(f"nothing tells the error of {choice.name} of the {choice.part}: compare with a finer solve.accuracy")
        return None
    by = "its stresses" if choice.kind == TET else "coarser meshes"
    short = f"; solve.accuracy asks for {percent(case.solve.accuracy)}" if error > case.solve.accuracy else ""
    log.info(f"error of a frequency by the mesh {percent(error)} or less, as {by} tell{short}")
    return error
