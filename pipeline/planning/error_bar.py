"""The error that a way's mesh is expected to make, said in the log and kept with the result."""

from __future__ import annotations

from dataclasses import dataclass

from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.planning import calibration, mesh_rules
from pipeline.planning.calibration import TET_ORDER
from pipeline.planning.model_choice import SUPERELEMENT, TET, ModelChoice
from pipeline.planning.simplifications import khz


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


def expected_error(choice: ModelChoice, design: Design, highest_hz: float = 0.0) -> float | None:
    """Relative error that the chosen mesh is expected to make up to a frequency; None where none was measured, and for
    reduced hexahedra, whose own coarser meshes tell it.

    Beyond what was measured it grows as `calibration.by_hexahedra` tells; of tetrahedra as (k h)^2p, k as the frequency's root.
    """
    growth = max(1.0, highest_hz / choice.good_to_hz)
    if choice.kind == TET:
        # an assembled plate is as good as its panels with a pillar
        measured = "cell" if choice.model == SUPERELEMENT else choice.part
        error = calibration.by_tetrahedra(measured, _smallest_m(choice, design) / (choice.edge_m or 1.0))
        return None if error is None else error * growth**TET_ORDER
    if choice.reduction:
        return None  # its own coarser meshes tell
    assert choice.mesh_level
    whole = choice.part == "plate" and choice.model != SUPERELEMENT
    return mesh_rules.expected_error("whole" if whole else choice.part, choice.mesh_level, growth)


def log_expected(
    choice: ModelChoice, case: Case, log: Log, highest_hz: float = 0.0, estimated: float | None = None
) -> float | None:
    """Log the error to expect up to a frequency, and what to change where the case asks for less.

    estimated: half-width that coarser meshes of the same piece tell; without it the calibration does.
    """
    if estimated is not None:
        log.info(
            f"error of a frequency by the mesh {estimated:.2%} or less, as coarser meshes tell{_short(estimated, case)}"
        )
        return estimated
    error = expected_error(choice, case.design, highest_hz)
    if error is None:
        log.info(f"no error was measured for {choice.name} of the {choice.part}: compare with a finer solve.accuracy")
        return None
    beyond = f"; measured up to {khz(choice.good_to_hz)}, foreseen beyond" if highest_hz > choice.good_to_hz else ""
    log.info(f"expected error of a frequency by the mesh {error:.2%} or less{_short(error, case)}{beyond}")
    return error


def _short(error: float, case: Case) -> str:
    return f"; solve.accuracy asks for {case.solve.accuracy:.2%}" if error > case.solve.accuracy else ""


def _smallest_m(choice: ModelChoice, design: Design) -> float:
    """Dimension across which a part's tetrahedra are counted, m: the thinner of plate and pillar, twice the thickness
    for a zone.
    """
    if choice.part == "zone" or design.pillar is None:
        return 2.0 * design.thickness_m
    narrowest = min(pillar.smallest_m for pillar in design.kinds)
    return narrowest if choice.part == "pillar" else min(design.thickness_m, narrowest)
