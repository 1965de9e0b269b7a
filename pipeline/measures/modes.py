"""The modes of the plate, how well the zone confines the wanted one, and a cross-check of both by other meshes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.errors import InputError
from pipeline.measures.measure import Measure, Work
from pipeline.models.mode_parts import RivalRecord
from pipeline.planning import plan
from pipeline.planning.request import of_case
from pipeline.quantity import HZ, frequency_figure
from pipeline.questions.bands import BandsResult
from pipeline.questions.modes import ModesResult
from pipeline.records.record import Record
from pipeline.records.tables import Column, figures_of
from solvers.measures.levels import CONFINED_DB

if TYPE_CHECKING:
    from pipeline.models.modes import PartModes

FIELDS = tuple(f"plots.fields.{name}" for name in ("touch_face", "side_view", "pillars_in_plane", "neighbours"))
SHAPES = 4  # of the modes nearest the wanted one, in a record: what a page draws and moves


def _compute(work: Work) -> None:
    from pipeline.board.export import write_table
    from pipeline.models import mode_fields, modes
    from pipeline.models.wanted_text import warn_of_wanted
    from pipeline.records import store

    case, log = work.case, work.log
    result = modes.solve_modes(case, of_case(case), log).whole_window
    work.keep(result.meshes, modes=ModesResult.of_solved(result, case))
    assert result.wanted
    work.solved["modes"] = result
    index = result.index(result.wanted.row)
    warn_of_wanted(result.wanted, case, log)
    if index is not None:
        work.keep(shapes=mode_fields.shapes_record(result, case.design))
        with log.step("fields"):
            work.keep(arrays=mode_fields.kept_arrays(result, nearest_rows(result, index)[:SHAPES]))
        try:
            write_table(case, result, index, work.folder)
        except InputError as error:
            log.warning("TABLE", error.lines[0])
    if work.all_fields:
        with log.step("fields in full"):
            store.save_arrays(work.folder, mode_fields.full_fields(result), store.FIELDS)


def nearest_rows(result: PartModes, index: int) -> list[int]:
    """All modes by their distance in frequency from one of them, which comes first."""
    own = result.rows[index].frequency_hz
    return sorted(range(len(result.rows)), key=lambda i: abs(result.rows[i].frequency_hz - own))


def _count_check(record: Record) -> str | None:
    check = record.modes and record.modes.count_check
    if not check:
        return None
    return "holds" if check.holds else f"{check.found} of {check.expected}"


def _confined(record: Record) -> str | None:
    return None if record.confined is None else "yes" if record.confined else "no"


def _named(rivals: list[RivalRecord]) -> str | None:
    return "; ".join(f"{frequency_figure(rival.frequency_hz, rival.error, HZ)} Hz" for rival in rivals) or None


def _dof(record: Record) -> int | None:
    solved = record.modes or record.of(BandsResult)
    return solved.dof if solved else None


_wanted = figures_of(lambda r: r.wanted)
_level_error = _wanted(lambda w: w.confinement_error_db)
COLUMNS = (
    Column("wanted_status", "wanted mode: single, split or none", lambda r: r.wanted_status),
    Column("wanted_hz", "wanted mode", _wanted(lambda w: w.frequency_hz), "Hz", _wanted(lambda w: w.frequency_error)),
    Column("wanted_error", "expected error of the wanted mode", _wanted(lambda w: w.frequency_error), "%"),
    Column(
        "confinement_db",
        "confinement",
        lambda r: r.confinement_db,
        "dB",
        _level_error,
    ),
    Column(
        "confinement_error_db",
        "expected error of the confinement",
        _level_error,
        "dB",
        _level_error,
    ),
    Column("confined", f"confined (at least {CONFINED_DB:g} dB)", _confined),
    Column(
        "zone_to_extension_db",
        "zone to extension",
        _wanted(lambda w: w.extension_db),
        "dB",
        _wanted(lambda w: w.extension_error_db),
    ),
    Column("mac", "MAC", _wanted(lambda w: w.mac), "", _wanted(lambda w: w.mac_error)),
    Column("zone_share", "zone share", _wanted(lambda w: w.zone_share), "", _wanted(lambda w: w.zone_share_error)),
    Column(
        "pillar_share",
        "pillars' share of energy",
        _wanted(lambda w: w.pillar_energy_share),
        "",
        _wanted(lambda w: w.pillar_energy_share_error),
    ),
    Column(
        "strength",
        "strength in the wanted shape",
        _wanted(lambda w: w.strength),
        "",
        _wanted(lambda w: w.strength_error),
    ),
    Column("shape_share", "share of the wanted shape", _wanted(lambda w: w.share), ""),
    Column("rivals", "other modes that carry it", _wanted(lambda w: _named(w.rivals))),
    Column("count_check", "count check", _count_check),
    Column("dof", "degrees of freedom", _dof, ""),
)

MODES = Measure(
    "modes",
    plan=lambda case: plan.modes_step(case, of_case(case)),
    compute=_compute,
    aliases=("confinement",),
    columns=COLUMNS,
    pictures=("plots.mesh.report_figures", *FIELDS),
)


def _cross_check(work: Work) -> None:
    from pipeline.analysis import cross_check

    for meshes, arrays, result in cross_check.solve(work.case, work.log, work.solved.get("modes")):
        work.keep(meshes, arrays, **result)


TETRAHEDRA = Measure(  # the same plate and cell through CAD and pytetwild
    "tetrahedra", plan=plan.tetrahedra_step, compute=_cross_check, pictures=("plots.fields.mode_on_both_meshes",)
)
