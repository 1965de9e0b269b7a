"""Pictures over a study: confinement and frequency against what was swept."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import level as level_text
from pipeline.records import tables
from pipeline.records.study import StoredCase, StoredStudy
from pipeline.records.tables import Tracked, axis_label, lines_along, main_key, swept
from pipeline.units import KHZ
from solvers.measures.confinement import CONFINED_DB

MAX_TICKS = 12
MAX_PANELS = 3  # beside one another
ROWS_LOOKS: dict[str, dict[str, Any]] = {
    "finite plate": {"color": style.BLUE, "marker": "o"},
    "endless lattice: rows times decay per row": {"color": style.VERMILION, "marker": "s", "mfc": "white", "ls": "--"},
    "endless rows: power let through": {"color": style.GREY, "marker": "^", "mfc": "white", "ls": ":"},
}


def against_sweep(study: StoredStudy) -> ReportFigure | None:
    """Confinement and the target mode's frequency against the most varied numeric key, one line per set of the others."""
    cases = [case for case in swept(list(study.cases)) if case.record.target or _live(case)]
    key = main_key(study, cases) if cases else None
    if key is None:
        return None
    figure, (level, tone) = style.panels(5.2, 2, 1, sharex=True)
    lines, tracked = lines_along(study, cases, key), tables.along_sweep(study)
    for index, (name, line) in enumerate(lines.items()):
        look = {"color": style.CYCLE[index % len(style.CYCLE)], "marker": style.MARKERS[index % len(style.MARKERS)]}
        solved = [case for case in line if case.record.target]
        if solved:
            _draw_line((level, tone), solved, key, _same_mode(solved, tracked), look | {"label": name or "target mode"})
        _draw_live((level, tone), line, key, f"{name}, live" if name else "live answer", look["color"])
    _finish(level, tone, key)
    _bending_at_m(tone, list(lines.values()), key)
    handles, labels = tone.get_legend_handles_labels()
    if len(labels) > 1 or any(map(_live, cases)):
        style.legend_below(figure, handles, labels, 4, 8)
    title = f"Confinement and frequency against {axis_label(key)}"
    return ReportFigure("against_sweep", title, _alt(study, cases, key), figure, vector=True)


def _draw_line(
    panels: tuple[Any, Any], line: list[StoredCase], key: str, stretches: list[tuple[int, int]], look: dict[str, Any]
) -> None:
    """Levels and frequencies of a line: connected over `stretches` of one mode, filled where it is confined."""
    level, tone = panels
    x = np.array([case.sweep[key] for case in line], dtype=float)
    levels = np.array([case.record.confinement_db for case in line], dtype=float)
    khz = np.array([case.record.target.frequency_hz / KHZ for case in line if case.record.target])
    for axes, values in ((level, levels), (tone, khz)):
        for first, last in stretches:
            axes.plot(x[first:last], values[first:last], color=look["color"], lw=1.1)
    for filled in (True, False):
        marked = np.array([bool(case.record.confined) for case in line]) == filled
        fill = look["color"] if filled else "white"
        level.plot(x[marked], levels[marked], look["marker"], color=look["color"], mfc=fill, ms=6)
    tone.plot(x, khz, ms=5, ls="none", **look)


def _live(case: StoredCase) -> Any:
    """What the explorer's bases answer of a case, where they know its target mode."""
    live = case.record.held("live")
    return live if live and live.frequency_hz is not None else None


def _draw_live(panels: tuple[Any, Any], line: list[StoredCase], key: str, name: str, color: str) -> None:
    """Levels and frequencies that the explorer's bases answer, as crosses; their column lacks the plate's two ends."""
    known = [(case.sweep[key], live) for case in line if (live := _live(case))]
    x = np.array([value for value, _ in known], dtype=float)
    levels = np.array([live.confinement_db for _, live in known], dtype=float)
    khz = np.array([live.frequency_hz for _, live in known], dtype=float) / KHZ
    for axes, values in zip(panels, (levels, khz), strict=True):
        if known:
            axes.plot(x, values, "x", color=color, ms=5, label=name)


def _same_mode(line: list[StoredCase], tracked: dict[str, Tracked]) -> list[tuple[int, int]]:
    """Stretches of a line over which the target mode is one and the same, tracked by its shape: slices of two or more."""
    same = [getattr(tracked.get(case.case_id), "tracking", "") in ("start", "kept") for case in line]
    edges = [i for i in range(len(line) + 1) if i in (0, len(line)) or same[i] != same[i - 1]]
    return [(a, b) for a, b in pairwise(edges) if same[a] and b - a > 1]


def _finish(level: Any, tone: Any, key: str) -> None:
    low, high = level.get_ylim()
    low, high = min(0.0, low), max(CONFINED_DB + 3.0, high)
    level.axhspan(CONFINED_DB, high, color=style.GREEN, alpha=0.10, lw=0)
    level.axhline(CONFINED_DB, color=style.GREEN, lw=1.0, ls="--")
    title = f"At least {CONFINED_DB:g} dB as a mode (shaded); filled where confined, as driven too"
    level.set(ylim=(low, high), ylabel="confinement (dB)", title=title)
    title = "Target mode (connected by a line where it is the same one, tracked by its shape)"
    tone.set(xlabel=axis_label(key), ylabel="frequency (kHz)", title=title)
    for axes in (level, tone):
        axes.grid(True)
    values = sorted({float(value) for line in tone.lines for value in line.get_xdata()})
    if len(values) <= MAX_TICKS:
        tone.set_xticks(values, [f"{value:g}" for value in values])


def _bending_at_m(tone: Any, lines: list[list[StoredCase]], key: str) -> None:
    """The cell's lower bending frequency at M, where the cases computed bands: in a line's colour where the lines differ."""
    known = [{case.sweep[key]: khz for case in line if (khz := _bending_khz(case))} for line in lines]
    shared = {x: khz for curve in known for x, khz in curve.items()}
    if not shared:
        return
    look = {"ls": ":", "marker": "x", "ms": 5}
    alike = all(shared[x] == khz for curve in known for x, khz in curve.items())
    for index, curve in enumerate([] if alike else known):
        colour = style.CYCLE[index % len(style.CYCLE)]
        tone.plot(sorted(curve), [curve[x] for x in sorted(curve)], color=colour, **look, label="_cell")
    x = sorted(shared) if alike else []
    tone.plot(x, [shared[at] for at in x], color=style.GREY, **look, label="unit cell: bending at M")


def _bending_khz(case: StoredCase) -> float | None:
    bands = case.record.answers.get("bands")
    pair = bands.bending_at_m_hz if bands else []
    return min(pair) / KHZ if pair else None


def _alt(study: StoredStudy, cases: list[StoredCase], key: str) -> str:
    levels = [(level, case) for case in cases if (level := case.record.confinement_db) is not None]
    if not levels:
        return f"Frequency of the target mode against {axis_label(key)} over {len(cases)} cases of {study.name}."
    worst, *_, best = sorted([*levels, levels[0]], key=lambda pair: pair[0])
    return (
        f"Confinement in dB and frequency in kHz of the target mode against {axis_label(key)} over {len(cases)} cases of "
        f"{study.name}: from {_level(worst[1])} ({worst[1].case_id}) to {_level(best[1])} ({best[1].case_id}); "
        f"{sum(level >= CONFINED_DB for level, _ in levels)} of {len(levels)} reach {CONFINED_DB:g} dB."
    )


def _level(case: StoredCase) -> str:
    """The level of a case's target mode with the digits of its bar."""
    return level_text(
        case.record.confinement_db, case.record.target.confinement_error_db if case.record.target else None
    )


def how_many_rows(study: StoredStudy) -> ReportFigure | None:
    """Decibels from zone to extension: rows times the decay per row (infinite rows) against the finite plates."""
    known = [(case, case.record.held("prediction")) for case in study.cases]
    levels = {
        case.case_id: (each.zone_to_extension_db, each.rows_db, each.transmission_db)
        for case, each in known
        if each and each.rows_db is not None and each.zone_to_extension_db is not None
    }
    cases = [case for case in study.cases if case.case_id in levels]
    if len(cases) < 2 or "array.rows" not in study.swept:
        return None
    lines = lines_along(study, cases, "array.rows")
    figure = _panel_a_line(
        {name: [(case.sweep["array.rows"], levels[case.case_id]) for case in each] for name, each in lines.items()}
    )
    title = "How many rows: prediction and finite plates"
    predicted = {case.case_id: each and level_text(each.rows_db, each.rows_error_db) for case, each in known}
    parts = "; ".join(f"{name}: {level_text(one[0])}, predicted {predicted[name]}" for name, one in levels.items())
    return ReportFigure("how_many_rows", title, f"{title}. {parts}", figure, vector=True)


def _panel_a_line(lines: dict[str, list[tuple[int, tuple[Any, ...]]]]) -> Any:
    """A panel for each line of (rows, levels), all with the same axes, one legend below."""
    columns = min(len(lines), MAX_PANELS)
    deep = -(-len(lines) // columns)
    figure, panels = style.panels(0.6 + 2.6 * deep, deep, columns, sharex=True, sharey=True, squeeze=False)
    for axes, (name, line) in zip(panels.flat, lines.items(), strict=False):
        rows = [count for count, _ in line]
        for (label, look), series in zip(
            ROWS_LOOKS.items(), np.array([each for _, each in line], dtype=float).T, strict=True
        ):
            axes.plot(rows, series, label=label, **look)
        axes.set(xticks=sorted({count for each in lines.values() for count, _ in each}), title=name)
        axes.axhline(CONFINED_DB, color=style.GREEN, lw=1.0, ls="--")
        axes.grid(True)
    for axes in panels.flat[len(lines) :]:
        axes.set_visible(False)
    for axes in panels.flat[max(0, len(lines) - columns) : len(lines)]:  # those with nothing beneath
        axes.set_xlabel("rows on each side")
        axes.tick_params(labelbottom=True)
    for axes in panels[:, 0]:
        axes.set_ylabel("zone to extension (dB)")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    style.legend_below(figure, handles, labels, 3, 8)
    return figure
