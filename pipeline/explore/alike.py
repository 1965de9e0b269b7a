"""Plates of a batch: the pillars of one plate are alike, those of the next differ, as a printer's settings drift.

Every sample is a design answered from the parametric cell (`pipeline.explore.answer`). Pillars that differ within one plate are
no cells of it: they have families of reductions of their own (`pipeline.models.tolerance`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geometry.elements import FloatArray
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.explore.answer import Explorer, Scene
from pipeline.logs import Log
from pipeline.models.parametric import cell_model, resized, sizes_of
from pipeline.models.tolerance_parts import SampleRecord
from pipeline.planning.simplifications import Simplification
from solvers.variation.samples import CUT, Deviations

FIXED = Simplification(
    "alike_position", "where the pillars stand", "pillars that all stand off alike are the same plate, moved"
)


def check(case: Case) -> None:
    """InputError without [tolerance], without pillars, or where no size of theirs differs."""
    case.require_plate(command="tolerance --alike")
    case.require("tolerance", "pillar", command="tolerance --alike")
    if not _deviations(case).sizes_m.any():
        raise InputError(f"{case.name}: tolerance --alike: tolerance.height_mm or tolerance.side_mm must be above 0")


def _deviations(case: Case) -> Deviations:
    assert case.tolerance is not None
    return Deviations(case.tolerance.height_m, case.tolerance.side_m, 0.0)


def solve(case: Case, log: Log) -> tuple[SampleRecord, list[SampleRecord], float]:
    """The nominal plate, the samples with all pillars off by the same each, and the error of a frequency, relative.

    InputError outside the bases.
    """
    given, deviations = case.tolerance, _deviations(case)
    assert given is not None
    explorer = Explorer(Scene(case, {}, ()), cell_model(case, log))
    _require_inside(case, deviations, explorer)
    with log.step("nominal plate"):
        answer = explorer.document(case, {})
        nominal = _sample(answer["plate"])
    if nominal.peak_hz is None:
        raise InputError(f"{case.name}: tolerance --alike: {answer['plate'].get('why_not', 'no target mode')}")
    for text in answer["warnings"]:
        log.warning("LIVE", text)
    samples = []
    for number, change in enumerate(deviations.draw(1, given.samples, given.seed)[:, 0, :2], start=1):
        with log.step(f"plate {number} of {given.samples}"):
            samples.append(_sample(explorer.plate(printed(case, change))))
    return nominal, samples, answer["plate"]["frequency_error"]


def printed(case: Case, change_m: FloatArray) -> Case:
    """The case with every pillar's height and width off by (2,) m."""
    thickness, height, width, pitch = sizes_of(case.design)
    sizes = thickness, height + float(change_m[0]), width + float(change_m[1]), pitch
    return replace(case, design=resized(case.design, sizes))


def _require_inside(case: Case, deviations: Deviations, explorer: Explorer) -> None:
    """InputError, a line a size, where the largest deviations leave the box of the bases."""
    reach, said = np.array(deviations.reach_m[:2]), []
    for signs in ((1.0, 1.0), (-1.0, -1.0)):
        sizes = sizes_of(printed(case, reach * signs).design)
        for fault in explorer.model.cell.box.faults(sizes):
            said.append(f"{case.name}: tolerance --alike: {CUT:g} standard deviations reach {fault}")
    if said:
        raise InputError(list(dict.fromkeys(said)))


def _sample(plate: dict) -> SampleRecord:
    return SampleRecord(
        peak_hz=plate.get("frequency_hz"),
        zone_rms=None,
        confinement_db=plate.get("confinement_db"),
        quality_factor=None,
        tracking=plate.get("status", "none"),
    )
