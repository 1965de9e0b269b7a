"""The error that a way's mesh is expected to make, said in the log and kept with the result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.planning import calibration, mesh_rules
from pipeline.planning.calibration import TET_ORDER
from pipeline.planning.model_choice import SUPERELEMENT, TET, Way
from pipeline.planning.simplifications import khz


@dataclass(frozen=True)
class ErrorBar:
    """What a result may be off by: a frequency by its mesh and by the reduction, relative, and a confinement, dB.

    None where nothing like the mesh was measured, the body was not reduced, or nothing is confined.
    """

    mesh: float | None
    reduction: float | None = None
    confinement_db: float | None = None

    @property
    def frequency(self) -> float | None:
        """Mesh and reduction together."""
        return None if self.mesh is None else self.mesh + (self.reduction or 0.0)

    def text(self) -> str:
        """In words."""
        held = "" if self.confinement_db is None else f", {self.confinement_db:.2f} dB of its confinement"
        return (
            "none measured" if self.frequency is None else f"{self.frequency:.2%} of the wanted mode's frequency{held}"
        )

    def json(self) -> dict[str, Any]:
        """As results and records keep it."""
        return {"frequency": self.frequency, "confinement_db": self.confinement_db}


def expected_error(way: Way, design: Design, highest_hz: float = 0.0) -> float | None:
    """Relative error that the way's mesh is expected to make in frequencies up to one; None where none was measured.

    Beyond what was measured it grows as `calibration.by_hexahedra` tells; of tetrahedra as (k h)^2p, k as the frequency's root.
    """
    growth = max(1.0, highest_hz / way.good_to_hz)
    if way.kind == TET:
        # a joined plate is as good as its pieces with a pillar
        measured = "cell" if way.model == SUPERELEMENT else way.part
        error = calibration.by_tetrahedra(measured, _smallest_m(way, design) / (way.edge_m or 1.0))
        return None if error is None else error * growth**TET_ORDER
    assert way.rung
    whole = way.part == "plate" and way.model != SUPERELEMENT
    return mesh_rules.expected_error("whole" if whole else way.part, way.rung, growth)


def told(way: Way, case: Case, log: Log, highest_hz: float = 0.0) -> float | None:
    """The expected error up to a frequency, said in the log; with what to do where the case asks for less."""
    error = expected_error(way, case.design, highest_hz)
    if error is None:
        log.info(f"no error was measured for {way.name} of the {way.part}: compare with a finer solve.accuracy")
        return None
    short = f"; solve.accuracy asks for {case.solve.accuracy:.2%}" if error > case.solve.accuracy else ""
    beyond = f"; measured up to {khz(way.good_to_hz)}, foreseen beyond" if highest_hz > way.good_to_hz else ""
    log.info(f"expected error of a frequency by the mesh {error:.2%} or less{short}{beyond}")
    return error


def _smallest_m(way: Way, design: Design) -> float:
    """What the reference part's tetrahedra are counted across: the thinner of plate and pillar; the zone's two thicknesses."""
    if way.part == "zone" or design.pillar is None:
        return 2.0 * design.thickness_m
    return design.pillar.tip_m if way.part == "pillar" else min(design.thickness_m, design.pillar.tip_m)
