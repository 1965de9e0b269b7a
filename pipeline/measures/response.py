"""The forced response to the patches and what was measured beside it; rows and patches together."""

from __future__ import annotations

from operator import attrgetter
from typing import TYPE_CHECKING

from pipeline.errors import InputError
from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan
from pipeline.records.tables import Column, figures_of

if TYPE_CHECKING:
    from pipeline.analysis.response import Response


def _compute(work: Work) -> None:
    import numpy as np

    from pipeline.analysis.response import solve
    from pipeline.measured import comparison

    case, log = work.case, work.log
    measured = comparison.read(case, None, None, None)
    result = solve(case, log, points=plan.RESPONSE_POINTS)
    shape = {"response_xy": result.shape_points.astype(np.float32), "response_uz": result.shape.astype(np.complex64)}
    work.keep(result.meshes, shape, response=result.record)
    if measured:
        beside = comparison.compare(case, result, measured, log)
        work.keep(arrays=beside.arrays, measured=beside.record)
    work.solved["forced"] = result.forced
    _write_table(work, result)


def _write_table(work: Work, result: Response) -> None:
    """The patched plate's mode table, in the place of the bare one's."""
    from pipeline.board.export import write_patched

    if result.wanted_hz is None:
        work.log.warning("TABLE", "no mode of the plate with its patches has the wanted shape: it has no mode table")
        return
    try:
        write_patched(work.case, result.forced, work.folder, work.log)
    except InputError as error:
        work.log.warning("TABLE", error.lines[0])


_wanted = figures_of(lambda r: r.response.wanted_peak if r.response else None)
_highest = figures_of(lambda r: r.response.highest_peak if r.response else None)
_sweep = figures_of(lambda r: r.measured.sweep if r.measured else None)
_map = figures_of(lambda r: r.measured.map if r.measured else None)
_tone_error, _zone_error = attrgetter("frequency_error"), attrgetter("zone_error_nm_per_V")
COLUMNS = (
    Column(
        "wanted_peak_hz", "wanted mode's peak, driven", _wanted(lambda p: p.frequency_hz), "Hz", _wanted(_tone_error)
    ),
    Column(
        "wanted_peak_nm_per_v", "zone at that peak", _wanted(lambda p: p.zone_nm_per_V), "nm/V", _wanted(_zone_error)
    ),
    Column(
        "wanted_peak_db",
        "confinement at that peak",
        _wanted(lambda p: p.confinement_db),
        "dB",
        _wanted(lambda p: p.confinement_error_db),
    ),
    Column(
        "highest_peak_hz",
        "highest peak of the response",
        _highest(lambda p: p.frequency_hz),
        "Hz",
        _highest(_tone_error),
    ),
    Column(
        "highest_peak_nm_per_v",
        "zone at the highest",
        _highest(lambda p: p.zone_nm_per_V),
        "nm/V",
        _highest(_zone_error),
    ),
    Column(
        "highest_peak_db",
        "confinement at the highest",
        _highest(lambda p: p.confinement_db),
        "dB",
        _highest(lambda p: p.confinement_error_db),
    ),
    Column(
        "measured_hz",
        "measured resonance",
        _sweep(lambda s: s.frequency_hz),
        "Hz",
        _sweep(_tone_error),
    ),
    Column(
        "measured_shift_hz",
        "measured less computed",
        _sweep(lambda s: s.frequency_shift_hz),
        "Hz",
        _sweep(lambda s: s.frequency_shift_error_hz),
        is_difference=True,
        is_signed=True,
    ),
    Column(
        "measured_quality_factor",
        "measured quality factor",
        _sweep(lambda s: s.quality_factor),
        "",
        _sweep(lambda s: s.quality_error),
    ),
    Column("measured_db", "measured confinement", _map(lambda m: m.confinement_db), "dB"),
    Column("measured_mac", "MAC, measured to computed", _map(lambda m: m.mac_operating), ""),
)

RESPONSE = Measure(
    "response",
    plan=lambda case: plan.response_step(case, None, plan.RESPONSE_POINTS),
    compute=_compute,
    needs=("patches",),
    drives=True,
    columns=COLUMNS,
    pictures=("plots.response.response", "plots.measured.measured"),
)
