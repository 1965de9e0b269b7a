"""The forced response in a study, with the board's mode table of the patched plate; rows and patches together."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter

from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan
from pipeline.records.record import Record
from pipeline.records.tables import Column, figures_of

_tone_error = attrgetter("frequency_error")


def _compute_hybrid(work: Work) -> None:
    from pipeline.driven import hybrid

    meshes = [] if "forced" in work.solved else work.meshes
    work.keep(hybrid=hybrid.solve(work.case, work.log, forced=work.solved.get("forced"), meshes=meshes))


def _of_method(name: str) -> list[Column]:
    """Columns of a way of confining, at the wanted mode's peak."""

    of_hybrid = figures_of(lambda record: record.hybrid)

    def at(values: str) -> Callable[[Record], float | None]:
        return of_hybrid(lambda hybrid: hybrid.at_wanted(name, values))

    words = {"rows": "rows alone", "patches": "patches alone", "both": "rows and patches"}[name]
    return [
        Column(f"hybrid_{name}_{end}", heading, at(figure), unit, at(error))
        for end, heading, figure, unit, error in (
            ("db", f"confinement by {words}", "confinement_db", "dB", "confinement_error_db"),
            ("off_db", f"{words}, all off by 2 %", "off_db", "dB", "off_error_db"),
            ("rows_off_db", f"{words}, pillars off by 2 %", "rows_off_db", "dB", "rows_off_error_db"),
            ("v_per_um", f"drive for 1 um, {words}", "volts_per_um", "V", "volts_error_per_um"),
        )
    ]


HYBRID = Measure(
    "hybrid",
    plan=plan.hybrid_step,
    compute=_compute_hybrid,
    needs=("patches",),
    drives=True,
    columns=tuple(column for name in ("rows", "patches", "both") for column in _of_method(name)),
    pictures=("plots.response.hybrid",),
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
        Column("travel_hz", "travelling wave", _travel(lambda t: t.frequency_hz), "Hz", _travel(_tone_error)),
        Column("travel_twr", "travelling-wave ratio", _travel(lambda t: t.twr), "", _travel(lambda t: t.twr_error)),
        Column(
            "travel_best_twr",
            "the same with any voltages",
            _travel(lambda t: t.best_twr),
            "",
            _travel(lambda t: t.best_twr_error),
        ),
        Column(
            "travel_db",
            "confinement, travelling",
            _travel(lambda t: t.confinement_db),
            "dB",
            _travel(lambda t: t.confinement_error_db),
        ),
        Column(
            "travel_v_per_um",
            "drive for 1 um, travelling",
            _travel(lambda t: t.drive_V_at_1um),
            "V",
            _travel(lambda t: t.drive_error_V_at_1um),
        ),
        Column(
            "travel_mw",
            "power along the zone for 1 um",
            _travel(lambda t: 1e3 * t.largest_flow_W[0] if t.inner_sections != 0 else None),
            "mW",
            _travel(lambda t: None if (error := t.largest_flow_W[1]) is None else 1e3 * error),
        ),
        Column(
            "travel_crest_mm_s",
            "crests under the finger",
            _travel(lambda t: t.shear and 1e3 * t.shear.fastest_m_s),
            "mm/s",
            _travel(lambda t: t.shear and t.shear.fastest_error_m_s and 1e3 * t.shear.fastest_error_m_s),
        ),
    ),
    pictures=("plots.response.travelling", "plots.touch.sheared"),
)
