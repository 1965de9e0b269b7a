"""The forced response to the patches and what was measured beside it; rows and patches together."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from pipeline.errors import InputError
from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan
from pipeline.records.record import Record
from pipeline.records.tables import Column, figures_of
from pipeline.units import MM

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
COLUMNS = (
    Column("wanted_peak_hz", "wanted mode's peak, driven", _wanted(lambda p: p.frequency_hz), ".2f", "Hz"),
    Column("wanted_peak_nm_per_v", "zone at that peak", _wanted(lambda p: p.zone_nm_per_V), ".4g", "nm/V"),
    Column("wanted_peak_db", "confinement at that peak", _wanted(lambda p: p.confinement_db), ".2f", "dB"),
    Column("highest_peak_hz", "highest peak of the response", _highest(lambda p: p.frequency_hz), ".2f", "Hz"),
    Column("highest_peak_nm_per_v", "zone at the highest", _highest(lambda p: p.zone_nm_per_V), ".4g", "nm/V"),
    Column("highest_peak_db", "confinement at the highest", _highest(lambda p: p.confinement_db), ".2f", "dB"),
    Column("measured_hz", "measured resonance", _sweep(lambda s: s.frequency_hz), ".2f", "Hz"),
    Column("measured_shift_hz", "measured less computed", _sweep(lambda s: s.frequency_shift_hz), "+.2f", "Hz"),
    Column("measured_quality_factor", "measured quality factor", _sweep(lambda s: s.quality_factor), ".1f"),
    Column("measured_db", "measured confinement", _map(lambda m: m.confinement_db), ".2f", "dB"),
    Column("measured_mac", "MAC, measured to computed", _map(lambda m: m.mac_operating), ".4f"),
)

RESPONSE = Measure(
    "response",
    plan=lambda case: plan.response_step(case, None, plan.RESPONSE_POINTS),
    compute=_compute,
    needs=("patches",),
    drives=True,
    columns=COLUMNS,
    pictures=("response.response", "measured.measured"),
)


def _compute_hybrid(work: Work) -> None:
    from pipeline.driven import hybrid

    meshes = [] if "forced" in work.solved else work.meshes
    work.keep(hybrid=hybrid.solve(work.case, work.log, forced=work.solved.get("forced"), meshes=meshes))


def _of_method(name: str) -> list[Column]:
    """Columns of a way of confining, at the wanted mode's peak."""

    figure = figures_of(lambda record: record.hybrid)

    def at(values: str) -> Callable[[Record], float | None]:
        return figure(lambda hybrid: hybrid.at_wanted(name, values))

    words = {"rows": "rows alone", "patches": "patches alone", "both": "rows and patches"}[name]
    return [
        Column(f"hybrid_{name}_db", f"confinement by {words}", at("confinement_db"), ".2f", "dB"),
        Column(f"hybrid_{name}_off_db", f"{words}, all off by 2 %", at("off_db"), ".2f", "dB"),
        Column(f"hybrid_{name}_rows_off_db", f"{words}, pillars off by 2 %", at("rows_off_db"), ".2f", "dB"),
        Column(f"hybrid_{name}_v_per_um", f"drive for 1 um, {words}", at("volts_per_um"), ".4g", "V"),
    ]


HYBRID = Measure(
    "hybrid",
    plan=plan.hybrid_step,
    compute=_compute_hybrid,
    needs=("patches",),
    drives=True,
    columns=tuple(column for name in ("rows", "patches", "both") for column in _of_method(name)),
    pictures=("response.hybrid",),
)


def _compute_travel(work: Work) -> None:
    from pipeline.driven import played, travelling

    record, wave = travelling.solve(work.case, work.log, meshes=work.meshes)
    work.keep(travel=record.model_copy(update=played.board_outcome(wave, work.log, work.folder, played=False)))


_travel = figures_of(lambda r: r.travel)
TRAVEL = Measure(
    "travel",
    plan=plan.travel_step,
    compute=_compute_travel,
    needs=("patches",),
    drives=True,
    columns=(
        Column("travel_hz", "travelling wave", _travel(lambda t: t.frequency_hz), ".2f", "Hz"),
        Column("travel_twr", "travelling-wave ratio", _travel(lambda t: t.twr), ".3f"),
        Column("travel_best_twr", "the same with any voltages", _travel(lambda t: t.best_twr), ".3f"),
        Column("travel_db", "confinement, travelling", _travel(lambda t: t.confinement_db), ".2f", "dB"),
        Column("travel_v_per_um", "drive for 1 um, travelling", _travel(lambda t: t.drive_V_at_1um), ".4g", "V"),
        Column(
            "travel_mw",
            "power along the zone for 1 um",
            _travel(lambda t: 1e3 * max(t.flow_W, key=abs) if t.inner_sections != 0 else None),
            ".4g",
            "mW",
        ),
        Column(
            "travel_crest_mm_s",
            "crests under the finger",
            _travel(lambda t: t.shear and 1e3 * t.shear.fastest_m_s),
            ".4g",
            "mm/s",
        ),
    ),
    pictures=("response.travelling", "touch.sheared"),
)


def _compute_crosstalk(work: Work) -> None:
    from pipeline.driven import crosstalk

    work.keep(crosstalk=crosstalk.solve(work.case, work.log, meshes=work.meshes))


_crosstalk = figures_of(lambda r: r.crosstalk)
CROSSTALK = Measure(
    "crosstalk",
    plan=plan.crosstalk_step,
    compute=_compute_crosstalk,
    needs=("patches",),
    drives=True,
    columns=(
        Column("crosstalk_gap_mm", "gap between zones", _crosstalk(lambda c: c.gap_m / MM), ".2f", "mm"),
        Column("crosstalk_db", "largest cross-talk", _crosstalk(lambda c: c.worst_db), ".2f", "dB"),
        Column("crosstalk_hz", "peak of the first zone, driven", _crosstalk(lambda c: c.zones[0].peak_hz), ".2f", "Hz"),
        Column(
            "crosstalk_passive_db",
            "passive face, first zone driven",
            _crosstalk(lambda c: c.zones[0].passive_db),
            ".2f",
            "dB",
        ),
    ),
    pictures=("response.crosstalk",),
)
