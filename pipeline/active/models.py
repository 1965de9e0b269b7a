"""The command `antinode active`: circuit, pillar, active beam, shaping and dq loop, each with its figures."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, Any

from pipeline.active.options import compared, frequencies_hz, number, only_frequency_hz, quality_factor, seconds
from pipeline.case.limits import span
from pipeline.case.model import Case, load_case
from pipeline.case.quantities import parse_band
from pipeline.errors import InputError
from pipeline.logs import Log, TerminalLog
from pipeline.paths import STUDIES
from pipeline.quantity import figure, frequency, interval
from pipeline.records.reading import reading_table
from pipeline.units import KHZ, MM
from pipeline.views.answer import Answer, emit, of_case
from solvers.errors import SolverError

if TYPE_CHECKING:
    from solvers.resonators.mason_study import MasonStudy

TAKES = {
    "mason": ("frequency", "quality-factor", "band"),
    "pillar": ("quality-factor", "band", "cell"),
    "beam": ("frequency", "gain", "quality-factor", "delay"),
    "shaping": ("frequency",),
    "dq": ("frequency", "quality-factor", "delay", "settling-time", "table", "sweep"),
}
COMPARED = ("quantity", "thesis", "ours", "agreement")
MASON_HIGHEST = 100  # of the mode to confine: the wavelength of 5/3 cells is 2 mm, the bar's thickness, for the default
GAIN_N_M = (1e-3, 1e12)  # from a millionth of any strip's own stiffness to beyond that of solid blocks of metal


def run(arguments: Namespace) -> int:
    """Run one model: text or JSON on standard output; JSON, figures and files into --out."""
    _refuse_foreign_options(arguments)
    case, log = _case(arguments), TerminalLog(arguments.quiet)
    if case:
        of_case(arguments, case)
    try:
        answer = _models()[arguments.model](arguments, case, log)
    except SolverError as error:  # these models have no meshes and no iterations: what stops them is what was asked
        raise InputError(f"active {arguments.model}: {' '.join(str(error).split())}") from error
    if not answer.head:
        compared_rows = [[*entry.values()] for entry in answer.document["comparison"]]
        answer = replace(answer, head=COMPARED, rows=compared_rows)
    return emit(arguments, f"active_{arguments.model}", answer)


def _models() -> dict[str, Callable[[Namespace, Case | None, Log], Answer]]:
    from pipeline.active.loop import dq

    return {"mason": _mason, "pillar": _pillar, "beam": _beam, "shaping": _shaping, "dq": dq}


def _refuse_foreign_options(arguments: Namespace) -> None:
    takes = TAKES[arguments.model]
    for name in sorted({option for options in TAKES.values() for option in options}):
        if getattr(arguments, name.replace("-", "_")) and name not in takes:
            listed = ", ".join(f"--{option}" for option in takes)
            raise InputError(f"--{name}: active {arguments.model} does not take it; it takes {listed}")


def _case(arguments: Namespace) -> Case | None:
    if arguments.case is None and arguments.model == "pillar":
        return load_case(STUDIES / "three-rows.toml", arguments.set)
    if arguments.case is None:
        if arguments.set:
            raise InputError("--set: needs a CASE to change")
        return None
    return load_case(arguments.case, arguments.set)


def _mason(arguments: Namespace, case: Case | None, log: Log) -> Answer:
    import numpy as np

    from pipeline.active import plots, thesis_models
    from pipeline.active.thesis import beside
    from solvers.resonators.mason_study import MasonData, mason_study

    data = MasonData(target_hz=only_frequency_hz(arguments, MasonData.target_hz))
    data = replace(data, quality_factor=quality_factor(arguments, case.quality_factor if case else data.quality_factor))
    if case is not None:
        data = replace(data, material=case.design.material)
    whole = study = mason_study(data)
    if arguments.band:
        study = mason_study(data, np.linspace(*_mason_band(arguments.band, data.target_hz), 3121))
        _refuse_empty(arguments.band, study, whole)
    entries = beside("mason", thesis_models.mason(whole))
    cell, one = data.cell, data.filter
    lines = [
        f"five cells of {data.material.name}, each {figure(cell.length_m / MM)} mm long, section {cell.area_m2 / MM**2:g} mm2, "
        f"quality factor {data.quality_factor:g}; 1 N in the middle one",
        f"filter: L = {figure(one.inductance_kg)} kg, C = {figure(one.capacitance_m_n)} m/N, "
        f"rejects {frequency(one.rejected_hz)}",
        *(
            f"modes, {name}: {', '.join(map(figure, modes)) + ' Hz' if len(modes) else 'none in the band'}"
            for name, modes in study.modes_hz.items()
        ),
        *compared(entries),
    ]
    return Answer(study.to_dict() | {"comparison": entries}, lines, pictures=lambda: [plots.mason(study)])


def _mason_band(text: str, target_hz: float) -> tuple[float, float]:
    """The band to show, Hz. Raises InputError beyond the range of a one-dimensional bar."""
    low, high = parse_band(text, "--band")
    if high > MASON_HIGHEST * target_hz:
        highest = f"{MASON_HIGHEST * target_hz / KHZ:g} kHz or below, {MASON_HIGHEST} times the mode to confine"
        raise InputError(
            f"--band = {text!r}: must end at {highest}: the waves beyond are shorter than the bar is thick"
        )
    return low, high


def _refuse_empty(text: str, study: MasonStudy, whole: MasonStudy) -> None:
    """Raise InputError naming where the modes are, when none of the three lines has one in the band."""
    if not any(len(modes) for modes in study.modes_hz.values()):
        every = [float(mode) for modes in whole.modes_hz.values() for mode in modes]
        listed = f"from {interval(min(every), max(every))}, {len(every)} of them"
        raise InputError(f"--band = {text!r}: holds no mode of the three bars; they have modes {listed}")


def _pillar(arguments: Namespace, case: Case | None, log: Log) -> Answer:
    import numpy as np

    from pipeline.active import plots, thesis_models
    from pipeline.active.thesis import beside
    from solvers.resonators.pillar_row import pillar_filter
    from solvers.resonators.point_load import point_force

    assert case is not None
    case.require("plate", "pillar", "array.pitch_mm", command="active pillar")
    case.require_lattice("active pillar is")
    band = parse_band(arguments.band, "--band") if arguments.band else None
    loss = 1.0 / quality_factor(arguments, case.quality_factor if "damping" in case.given else inf)
    low, high = band or _pillar_window(case)
    pillar_row = pillar_filter(case.design, np.linspace(low, high, 801), loss)
    point = point_force()
    cell = _computed_cell(case, log, (low, high)) if arguments.cell else None
    entries = beside("pillar", thesis_models.pillar(pillar_row, point, cell))
    document = pillar_row.to_dict() | {"point_force": point.to_dict(), "cell": cell, "comparison": entries}
    return Answer(document, compared(entries), pictures=lambda: plots.pillar(pillar_row, point, cell))


def _pillar_window(case: Case) -> tuple[float, float]:
    """From half to half as much again of the pillar's clamped frequency."""
    from solvers.analytic.predesign import pillar_frequencies_hz

    assert case.design.pillar is not None
    clamped = float(pillar_frequencies_hz(case.design.pillar, "timoshenko")[0])
    return 0.5 * clamped, 1.5 * clamped


def _computed_cell(case: Case, log: Log, band_hz: tuple[float, float]) -> dict[str, Any]:
    """Decay per row of the least attenuated flexural wave of the computed plate cell at normal incidence."""
    from pipeline.questions.attenuation import Attenuation
    from pipeline.questions.question import ask

    solved = ask(case, Attenuation((band_hz[0] / KHZ, band_hz[1] / KHZ), kx_per_m=0.0, points=81), log)
    named = {"frequencies_hz": "frequency_hz", "db_per_row": "db_per_row", "db_error": "db_error"}
    return {"model": solved.model} | {
        key: [getattr(point, name) for point in solved.points] for key, name in named.items()
    }


def _beam(arguments: Namespace, case: Case | None, log: Log) -> Answer:
    from pipeline.active import plots, thesis_models
    from pipeline.active.thesis import beside
    from solvers.active_beam.study import ActiveBeamData, active_beam_study

    data = ActiveBeamData() if case is None else ActiveBeamData(material=case.design.material)
    gains = tuple(number(text) for text in arguments.gain or ()) or data.gains_n_m
    for text, gain in zip(arguments.gain or (), gains, strict=False):
        if not GAIN_N_M[0] <= gain <= GAIN_N_M[1]:
            allowed = f"must be a number above 0 in N/m, {span(GAIN_N_M)} (0 leaves the loops open)"
            raise InputError(f"--gain = {text}: {allowed}")
    delays = tuple(seconds(text, "--delay") for text in arguments.delay or ()) or data.delays_s
    data = replace(
        data,
        frequencies_hz=frequencies_hz(arguments, data.frequencies_hz),
        gains_n_m=gains,
        quality_factor=quality_factor(arguments, case.quality_factor if case else data.quality_factor),
        delays_s=delays,
    )
    study = active_beam_study(data)
    document = study.to_dict() | {"comparison": beside("beam", thesis_models.beam(study))}
    size = f"{data.length_m / MM:g} x {data.width_m / MM:g} x {data.thickness_m / MM:g} mm"
    head = ("layout", "frequency_hz", "gain_n_m", "strength", "ratio_before", "ratio_after", "largest_force_n")
    rows = [[case[key] for key in head] for case in document["cases"]]
    lines = [
        f"free-free {data.material.name} strip {size}, 1 N in the middle, loops {figure(study.left_m / MM)} mm from both ends; "
        f"strength = K'/(4 EI beta^3), ratio = rms between the loops over rms beyond",
        reading_table(head, rows),
        *compared(document["comparison"]),
    ]
    return Answer(document, lines, head, rows, pictures=lambda: plots.beam(study))


def _shaping(arguments: Namespace, case: Case | None, log: Log) -> Answer:
    from pipeline.active import plots_shaping
    from pipeline.active.thesis import beside
    from pipeline.active.thesis_shaping import shaping
    from solvers.shaping_study.document import document as document_of
    from solvers.shaping_study.study import ShapingData, shaping_study

    if case is not None:
        log.info("the case is not used: shaping has its own beams, stated in its document")
    data = ShapingData()
    study = shaping_study(replace(data, frequencies_hz=frequencies_hz(arguments, data.frequencies_hz)))
    document = document_of(study) | {"comparison": beside("shaping", shaping(study))}
    lines = [*(f"assumed: {text}" for text in document["assumptions"]), *compared(document["comparison"])]
    return Answer(document, lines, pictures=lambda: plots_shaping.report_figures(study))
