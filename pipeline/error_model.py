"""The error that a way's mesh is expected to make in a frequency, said in the log and kept with the result."""

from __future__ import annotations

from dataclasses import replace

from geometry.layout import Design
from pipeline import calibration, planner
from pipeline.case import Case
from pipeline.logs import Log
from pipeline.ways import SUPERELEMENT, TET, Way


def expected_error(way: Way, design: Design) -> float | None:
    """Relative error of a frequency that the way's mesh is expected to make; None where nothing like it was measured."""
    if way.kind == TET:
        # a joined plate is as good as its pieces with a pillar
        measured = "cell" if way.model == SUPERELEMENT else way.part
        return calibration.by_tetrahedra(measured, _smallest_m(way, design) / (way.edge_m or 1.0))
    assert way.hexahedra and way.rung
    return planner.expected_error(way.part, replace(way.rung, layers=way.hexahedra.layers))


def told(way: Way, case: Case, log: Log) -> float | None:
    """The expected error, said in the log; with what to do where the case asks for less."""
    error = expected_error(way, case.design)
    if error is None:
        log.info(f"no error was measured for {way.name} of the {way.part}: compare with a finer solve.accuracy")
        return None
    short = f"; solve.accuracy asks for {case.solve.accuracy:.2%}" if error > case.solve.accuracy else ""
    log.info(f"expected error of a frequency by the mesh {error:.2%} or less{short}")
    return error


def _smallest_m(way: Way, design: Design) -> float:
    """What the reference part's tetrahedra are counted across: the thinner of plate and pillar; the zone's two thicknesses."""
    if way.part == "zone" or design.pillar is None:
        return 2.0 * design.thickness_m
    return design.pillar.tip_m if way.part == "pillar" else min(design.thickness_m, design.pillar.tip_m)
