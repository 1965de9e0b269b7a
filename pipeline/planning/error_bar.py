"""The error that the mesh of a model choice is expected to make, said in the log and kept with the result."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.planning.calibration import TET
from pipeline.planning.model_choice import ModelChoice


@dataclass(frozen=True)
class ErrorBar:
    """Half-width of a result's error: the frequency's by mesh and reduction, relative, and the confinement's in dB.

    None where nothing like the mesh was measured, the body was not reduced, or nothing is confined.
    """

    mesh: float | None
    reduction: float | None = None
    confinement_db: float | None = None

    @property
    def frequency(self) -> float | None:
        """Error by mesh and reduction together, relative."""
        return None if self.mesh is None else self.mesh + (self.reduction or 0.0)

    def text(self) -> str:
        """Return the error bar in words."""
        allowed = "" if self.confinement_db is None else f", {self.confinement_db:.2f} dB of its confinement"
        return (
            "none measured"
            if self.frequency is None
            else f"{self.frequency:.2%} of the wanted mode's frequency{allowed}"
        )

    def to_dict(self) -> dict[str, float | None]:
        """As results keep it."""
        return {"frequency": self.frequency, "confinement_db": self.confinement_db}


def log_mesh_error(choice: ModelChoice, case: Case, log: Log, error: float | None) -> float | None:
    """Log the largest half-width of the frequencies' bars by the mesh, and where the case asks for less; returns it.

    None where nothing tells it.
    """
    if error is None:
        log.info(f"nothing tells the error of {choice.name} of the {choice.part}: compare with a finer solve.accuracy")
        return None
    by = "its stresses" if choice.kind == TET else "coarser meshes"
    short = f"; solve.accuracy asks for {case.solve.accuracy:.2%}" if error > case.solve.accuracy else ""
    log.info(f"error of a frequency by the mesh {error:.2%} or less, as {by} tell{short}")
    return error
