"""Pictures of a case and of a study, drawn from records and reused while these are unchanged; sketch of a plate."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import PICTURES, ReportFigure, StoredFigure, save
from pipeline.quantity import KHZ, MM, MS, frequency, percentage
from pipeline.quantity import figure as figure_text
from pipeline.quantity import level as level_text
from pipeline.questions.attenuation import AttenuationResult
from pipeline.questions.bands import LEGEND_COLUMNS, MARKS, WHITE, BandsResult
from pipeline.questions.study import draws
from pipeline.records import record as records
from pipeline.records import store, tables
from pipeline.records.record import DesignRecord
from pipeline.records.store import canonical_json, file_hash
from pipeline.records.study import StoredCase, StoredStudy
from pipeline.records.tables import Tracked, axis_label, lines_along, main_key, swept
from pipeline.report.heat_map import grid_of, over_grid
from solvers.measures.confinement import CONFINED_DB

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.axes import Axes

MAX_TICKS = 12
MAX_CURVES = 7  # with a colour each
MAX_PANELS = 3  # next to each other

ROWS_LOOKS: dict[str, dict[str, Any]] = {
    "finite plate": {"color": style.BLUE, "marker": "o"},
    "infinite array: rows times attenuation per row": {
        "color": style.VERMILION,
        "marker": "s",
        "mfc": "white",
        "ls": "--",
    },
    "infinite array: transmitted power": {"color": style.GREY, "marker": "^", "mfc": "white", "ls": ":"},
}

ZOOM = 1.6  # relative to the bending frequency at M

INDEX = "index.json"
OF_THE_BEST = ("report_figures",)  # drawn for the best case of a sweep, unless all are requested
OF_A_CELL = ("dispersion",)  # identical for all cases of one cell
MARGIN = 14.0  # mm of margin on each side, for dimensions
LETTERS = 0.033  # of a sketch's width: 11 pixels on a phone
LETTER = 0.55  # of a letter's height: its mean width
WIDE = 150.0  # mm of plate drawn 1:1; other plates are scaled so that text stays readable
PLATE = 'fill="#f3f6f8" stroke="#55606b" stroke-width=".4"'  # without a style sheet
ZONE, PILLARS = 'fill="#009e73" fill-opacity=".22"', 'fill="#0072b2"'
SUPPORT, YIELDS = 'fill="none" stroke="#1b1f23" stroke-width="1"', ' stroke-dasharray="1.2 1.2"'


@dataclass(frozen=True)
class FigureSet:
    """Pictures, reasons for undrawn ones, and whether some were left out."""

    pictures: list[StoredFigure]
    troubles: list[str] = field(default_factory=list)
    is_brief: bool = False


def against_sweep(study: StoredStudy) -> ReportFigure | None:
    """Draw confinement and target frequency against the most varied numeric key, one line per set of the others."""
    cases = [case for case in swept(list(study.cases)) if case.record.target or _live(case)]
    key = main_key(study, cases) if cases else None
    if key is None:
        return None
    lines, tracked = lines_along(study, cases, key), tables.along_sweep(study)
    if len(lines) > MAX_CURVES and grid_of(study):  # the heat map shows them
        return None
    figure, (level, tone) = style.panels(5.2, 2, 1, sharex=True)
    for index, (name, line) in enumerate(lines.items()):
        look = {"color": style.CYCLE[index % len(style.CYCLE)], "marker": style.MARKERS[index % len(style.MARKERS)]}
        solved = [case for case in line if case.record.target]
        if solved:
            _draw_line((level, tone), solved, key, _same_mode(solved, tracked), look | {"label": name or "target mode"})
        _draw_live((level, tone), line, key, f"{name}, explorer" if name else "explorer", look["color"])
    _finish(level, tone, key)
    _bending_at_m(tone, list(lines.values()), key)
    handles, labels = tone.get_legend_handles_labels()
    if len(labels) > 1 or any(map(_live, cases)):
        style.legend_below(figure, handles, labels, 4, 9)
    title = f"Confinement and frequency against {axis_label(key)}"
    return ReportFigure("against_sweep", title, _sweep_alt(study, cases, key), figure, vector=True)


def how_many_rows(study: StoredStudy) -> ReportFigure | None:
    """Draw dB from zone to margin: rows times attenuation per row (infinite array) against the finite plates."""
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
    title = "Number of rows: prediction and finite plates"
    predicted = {case.case_id: each and level_text(each.rows_db, each.rows_error_db) for case, each in known}
    parts = "; ".join(f"{name}: {level_text(one[0])}, predicted {predicted[name]}" for name, one in levels.items())
    return ReportFigure("how_many_rows", title, f"{title}. {parts}", figure, vector=True)


def shear_speed(case: StoredCase) -> float | None:
    """Return the shear wave speed of the plate's material, sqrt(G/rho), m/s; None if the input lacks it."""
    stored = case.read("input.json") or {}
    material = ((stored.get("case") or stored).get("design") or {}).get("material") or {}
    try:
        shear = material["young_pa"] / (2 * (1 + material["poisson"]))
        return float(np.sqrt(shear / material["density_kg_m3"]))
    except (KeyError, TypeError, ZeroDivisionError):
        return None


def dispersion(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """Draw bands with the complete gaps shaded, and the low bands with the bending ones marked at M."""
    bands = case.record.of(BandsResult)
    if not bands or not bands.points:
        return None
    bending = bands.bending_at_m_hz
    figure = style.new_figure(style.WIDTH_IN, 4.4)
    panels = figure.subplots(1, 2, width_ratios=[1.15, 1]) if bending else [figure.subplots()]
    for axes in panels:
        bands.draw_bands(axes, "structured hexahedra" if case.record.answers.get("tet_bands") else "bands")
        _tetrahedra(axes, case, bands)
    _normalised_axis(panels[0], case)
    panels[0].set_title(_gap_title(bands))
    if bending:
        _bending(panels[1], case, bands, bending)
    _legend(figure, panels[0])
    return ReportFigure(
        "dispersion", "Dispersion diagram of the unit cell", _dispersion_alt(case, bands), figure, vector=True
    )


def attenuation(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """Draw attenuation per row, wavenumbers across the rows and the transmitted power."""
    answer, target = case.record.of(AttenuationResult), case.record.target
    return answer.complex_bands(target.frequency_hz if target else None) if answer else None


def board(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """Return the step response of a record; None if the board was not run or stopped with a fault."""
    record = case.record.held("board")
    return board_step(record, arrays) if record and "board_time_s" in arrays else None


def board_step(record: Any, arrays: dict[str, Any]) -> ReportFigure:
    """Draw both axes of the rotating frame with the reference, and the magnitude of the drive, over time."""
    figure, (upper, lower) = style.panels(4.6, 2, 1, sharex=True, height_ratios=(3, 2))
    time = arrays["board_time_s"] / MS
    upper.step(time, arrays["board_reference"], where="post", color=style.GREY, lw=0.9, ls="--", label="reference")
    upper.plot(time, arrays["board_u_d"], color=style.BLUE, marker=".", label="in phase, d")
    upper.plot(time, arrays["board_u_q"], color=style.VERMILION, marker=".", label="in quadrature, q")
    if record.t95_s is not None:
        upper.axvline(record.t95_s / MS, color=style.GREEN, lw=0.8, ls=":", label="95 %")
    reached = "95 % not reached" if record.t95_s is None else f"95 % after {figure_text(record.t95_s / MS)} ms"
    mode = f"at {frequency(record.frequency_hz)}"
    upper.set(ylabel="sensor (full scale)", title=f"{reached}, {mode}")
    upper.legend(fontsize=9, loc="center right")
    lower.step(time, arrays["board_drive"], where="post", color=style.ORANGE)
    lower.set(ylabel="drive (full scale)", xlabel="time after the step (ms)")
    for axes in (upper, lower):
        axes.grid(True)
    origin = "identified by the firmware's own sweep" if record.swept else "taken from the table"
    alt = (
        f"Step of the reference to {figure_text(record.reference)} of full scale, run by the unmodified firmware image on an "
        f"emulated board with noise: {reached}, largest overshoot {figure_text(100.0 * record.overshoot)} % including "
        f"the noise; the mode {mode} with a time constant of {figure_text(record.tau_s / MS)} ms was {origin}"
    )
    return ReportFigure("board", "Closed loop of the emulated board", alt, figure, vector=True)


def draw_case(case: StoredCase, without: tuple[str, ...] = ()) -> FigureSet:
    """Draw every picture that a case's records allow, or reuse the stored ones if their data are unchanged.

    without: names of drawing functions to skip.
    """
    if (kept := kept_pictures(case, without)) is not None:
        return kept
    arrays, errors = case.read_arrays()
    chosen = [partial(draw, case, arrays) for draw in draws() if draw.__name__ not in without]
    key = _without(_case_key(case), without)
    return replace(_draw(case.folder / PICTURES, key, chosen, errors), is_brief=bool(without))


def kept_pictures(case: StoredCase, without: tuple[str, ...] = ()) -> FigureSet | None:
    """Return the stored pictures of a case, all or all but some; None if they have to be drawn again."""
    if not case.record.answered:
        return FigureSet([])
    key = _case_key(case)
    for left_out in dict.fromkeys(((), without)):
        if (pictures := _kept(case.folder / PICTURES, _without(key, left_out))) is not None:
            return FigureSet(pictures, is_brief=bool(left_out))
    return None


def draw_study(study: StoredStudy) -> FigureSet:
    """Draw the pictures that compare a study's cases, or reuse the stored ones."""
    key = _key([study.about, *(case.record.to_dict() for case in study.cases)], [])
    if (kept := _kept(study.folder / PICTURES, key)) is not None:
        return FigureSet(kept)
    return _draw(
        study.folder / PICTURES,
        key,
        [partial(over_grid, study), partial(against_sweep, study), partial(how_many_rows, study)],
    )


def sketch(design: DesignRecord) -> Markup:
    """Return a sketch of plate, zone and pillars with dimensions in mm."""
    from markupsafe import Markup

    x0, x1, low, high = (end / MM for end in design.ends_m)
    length, breadth, y0 = x1 - x0, high - low, -high  # y points down
    scale = min(1.0, WIDE / length)
    zone, long = design.width_m / MM, design.length_m / MM
    x, y = design.zone_places_m[0] / MM * (1.0, -1.0)
    size = f'width="{long:.2f}" height="{zone:.2f}"'
    zones = "".join(
        f'<rect class="zone" {ZONE} x="{at - long / 2:.2f}" y="{-across - zone / 2:.2f}" {size}/>'
        for at, across in design.zone_places_m / MM
    )
    side = MARGIN / scale
    letters = LETTERS * (length + 2.0 * side)
    pillars = " ".join(
        f"M{x / MM - half:.2f} {-y / MM - half:.2f}h{2 * half:.2f}v{2 * half:.2f}h{-2 * half:.2f}z"
        for (x, y), pillar in zip(design.pillar_centres_m, design.standing, strict=True)
        for half in [pillar.base_m / MM / 2.0]
    )
    box = f"{x0 - side:.2f} {y0 - 0.4 * side:.2f} {length + 2 * side:.2f} {breadth + 1.2 * side:.2f}"
    words = f"{length:g} × {breadth:g} × {design.thickness_m / MM:g} mm"
    named = f"active zone, {zone:g} mm wide"
    if len(named) * LETTER * letters > long:  # wider than the zone: next to it and its rows, towards the plate's middle
        reach = zone / 2.0 + design.rows * (design.pitch_y_m or 0.0) / MM
        y += (reach + letters) * (-1.0 if y > 0.0 else 1.0)
    return Markup(
        f'<svg class="sketch" viewBox="{box}" role="img" aria-label="Sketch of the plate: {words}">'
        f"{_plate(design, x0, y0, length, breadth)}"
        f"{zones}"
        f'<path class="pillars" {PILLARS} d="{pillars}"/>'
        f"{_supports(design)}"
        f'<g font-size="{letters:.2f}" text-anchor="middle">'
        f'<text x="{x:.2f}" y="{y + letters / 3:.2f}">{named}</text>'
        f'<text x="{x0 + length / 2:.2f}" y="{y0 + breadth + 1.6 * letters:.2f}">{words}</text></g></svg>'
    )


def _plate(design: DesignRecord, x0: float, y0: float, length: float, breadth: float) -> str:
    """The plate in a sketch: a rectangle, or the rims of its file."""
    if not design.rims_m:
        return f'<rect class="plate" {PLATE} x="{x0:.2f}" y="{y0:.2f}" width="{length:.2f}" height="{breadth:.2f}"/>'
    sides = (tuple(place / MM for place in side) for side in design.rims_m)
    path = " ".join(f"M{x:.2f} {-y:.2f}L{end:.2f} {-top:.2f}" for x, y, end, top in sides)
    return f'<path class="plate" {PLATE} d="{path}"/>'


def _supports(design: DesignRecord) -> str:
    """The supports in a sketch: thick edges and circles, dashed where they yield."""
    drawn = []
    for support in design.supports:
        look = f'class="support" {SUPPORT}{YIELDS if support.is_elastic else ""}'
        if support.edge:
            (start, end), (lower, upper) = np.array(design.edge_m(support.edge)) / MM
            drawn.append(f'<path {look} d="M{start:.2f} {-lower:.2f}L{end:.2f} {-upper:.2f}"/>')
        else:
            x, y, radius = (size / MM for size in (*support.at_m, support.radius_m))
            drawn.append(f'<circle {look} cx="{x:.2f}" cy="{-y:.2f}" r="{radius:.2f}"/>')
    return "".join(drawn)


def _draw_line(
    panels: tuple[Any, Any], line: list[StoredCase], key: str, stretches: list[tuple[int, int]], look: dict[str, Any]
) -> None:
    """Draw levels and frequencies of a line, connected over `stretches` of one mode, filled where confined."""
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
    """Return the explorer's answer for a case, if it has a target mode."""
    live = case.record.held("live")
    return live if live and live.frequency_hz is not None else None


def _draw_live(panels: tuple[Any, Any], line: list[StoredCase], key: str, name: str, color: str) -> None:
    """Draw the explorer's levels and frequencies as crosses; its column lacks the two ends of the plate."""
    known = [(case.sweep[key], live) for case in line if (live := _live(case))]
    x = np.array([value for value, _ in known], dtype=float)
    levels = np.array([live.confinement_db for _, live in known], dtype=float)
    khz = np.array([live.frequency_hz for _, live in known], dtype=float) / KHZ
    for axes, values in zip(panels, (levels, khz), strict=True):
        if known:
            axes.plot(x, values, "x", color=color, ms=5, label=name)


def _same_mode(line: list[StoredCase], tracked: dict[str, Tracked]) -> list[tuple[int, int]]:
    """Return the slices (two or more cases) of a line over which tracking by shape follows one and the same mode."""
    same = [getattr(tracked.get(case.case_id), "tracking", "") in ("start", "kept") for case in line]
    edges = [i for i in range(len(line) + 1) if i in (0, len(line)) or same[i] != same[i - 1]]
    return [(a, b) for a, b in pairwise(edges) if same[a] and b - a > 1]


def _finish(level: Any, tone: Any, key: str) -> None:
    low, high = level.get_ylim()
    low, high = min(0.0, low), max(CONFINED_DB + 3.0, high)
    level.axhspan(CONFINED_DB, high, color=style.GREEN, alpha=0.10, lw=0)
    level.axhline(CONFINED_DB, color=style.GREEN, lw=1.0, ls="--")
    title = f"Confined from {CONFINED_DB:g} dB upwards (shaded); filled symbols: confined, also when driven"
    level.set(ylim=(low, high), ylabel="confinement (dB)", title=title)
    title = "Target mode (a line connects cases with the same mode, tracked by shape)"
    tone.set(xlabel=axis_label(key), ylabel="frequency (kHz)", title=title)
    for axes in (level, tone):
        axes.grid(True)
    values = sorted({float(value) for line in tone.lines for value in line.get_xdata()})
    if len(values) <= MAX_TICKS:
        tone.set_xticks(values, [f"{value:g}" for value in values])


def _bending_at_m(tone: Any, lines: list[list[StoredCase]], key: str) -> None:
    """Draw the cell's lower bending frequency at M, if bands were computed, in a line's colour where lines differ."""
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


def _sweep_alt(study: StoredStudy, cases: list[StoredCase], key: str) -> str:
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
    """Return the level of a case's target mode with the digits of its error bar."""
    return level_text(
        case.record.confinement_db, case.record.target.confinement_error_db if case.record.target else None
    )


def _panel_a_line(lines: dict[str, list[tuple[int, tuple[Any, ...]]]]) -> Any:
    """Draw a panel for each line of (rows, levels), with common axes and one legend below."""
    columns = min(len(lines), MAX_PANELS)
    deep = -(-len(lines) // columns)
    tall = 2.4 + 0.2 * max(1 + name.count(", ") for name in lines)
    figure, panels = style.panels(0.6 + tall * deep, deep, columns, sharex=True, sharey=True, squeeze=False)
    for axes, (name, line) in zip(panels.flat, lines.items(), strict=False):
        rows = [count for count, _ in line]
        for (label, look), series in zip(
            ROWS_LOOKS.items(), np.array([each for _, each in line], dtype=float).T, strict=True
        ):
            axes.plot(rows, series, label=label, **look)
        axes.set(xticks=sorted({count for each in lines.values() for count, _ in each}))
        axes.set_title(name.replace(", ", "\n"), fontsize=9)
        axes.axhline(CONFINED_DB, color=style.GREEN, lw=1.0, ls="--")
        axes.grid(True)
    for axes in panels.flat[len(lines) :]:
        axes.set_visible(False)
    for axes in panels.flat[max(0, len(lines) - columns) : len(lines)]:  # panels with nothing below
        axes.set_xlabel("rows on each side")
        axes.tick_params(labelbottom=True)
    for axes in panels[:, 0]:
        axes.set_ylabel("zone to margin (dB)")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    style.legend_below(figure, handles, labels, 3, 9)
    return figure


def _tetrahedra(axes: Axes, case: StoredCase, bands: BandsResult) -> None:
    label, places = "tetrahedra (pytetwild)", bands.distance_per_m
    tetrahedra: BandsResult | None = case.record.answers.get("tet_bands")
    for point in tetrahedra.points if tetrahedra else []:
        tones = np.array(point.frequencies_hz) / KHZ
        for x in (x for x, p in zip(places, bands.points, strict=True) if p.label == point.label):
            axes.plot(np.full(tones.size, x), tones, "o", mfc="none", color=style.VERMILION, ms=4.5, label=label)
            label = ""


def _gap_title(bands: BandsResult) -> str:
    gap = bands.widest_gap
    if not gap:
        return f"No complete gap {bands.where_gaps_are_known}"
    return f"Gap: bands {gap.lower_band} to {gap.upper_band}, {percentage(gap.relative_width, gap.width_error)} wide"


def _normalised_axis(axes: Axes, case: StoredCase) -> None:
    speed, design = shear_speed(case), case.record.design
    if not speed or design is None or design.pitch_x_m is None:
        return
    scale: Any = KHZ * design.pitch_x_m / speed
    axes.spines["right"].set_visible(True)
    right = axes.secondary_yaxis("right", functions=(lambda f: f * scale, lambda f: f / scale))
    right.set_ylabel("f a / c$_t$ (no unit)")


def _bending(axes: Axes, case: StoredCase, bands: BandsResult, bending: list[float]) -> None:
    points, tones = bands.points, np.array(bending) / KHZ
    axes.set(ylim=(0, ZOOM * tones.max()), title="Pillar bending bands")
    corner = next(x for x, point in zip(bands.distance_per_m, points, strict=True) if point.label == "M")
    axes.plot([corner] * len(bending), tones, "s", color=style.GREEN, ms=6, mfc="none", mew=1.6)
    text = f"bending at M\n{_listed(bands)}"
    look: dict[str, Any] = {"xytext": (-8, -34), "textcoords": "offset points", "ha": "right", "color": style.GREEN}
    line = {"arrowstyle": "-", "color": style.GREEN, "lw": 0.8}
    axes.annotate(text, (corner, tones.min()), bbox=WHITE, arrowprops=line, **look)
    if target := case.record.target:
        axes.axhline(target.frequency_hz / KHZ, color=style.PURPLE, lw=1.0, ls="--", label="target mode of the plate")


def _listed(bands: BandsResult) -> str:
    return " and ".join(dict.fromkeys(bands.bending_texts))


def _legend(figure: Any, axes: Axes) -> None:
    handles: dict[str, Any] = {}
    for panel in figure.axes:
        handles |= dict(zip(*reversed(panel.get_legend_handles_labels()), strict=True))
    if len(handles) > 1:
        style.legend_below(figure, handles.values(), handles.keys(), LEGEND_COLUMNS, 9)


def _dispersion_alt(case: StoredCase, bands: BandsResult) -> str:
    gap, bending = bands.widest_gap, bands.bending_at_m_hz
    edges = (
        f"the widest complete gap, shaded, lies from {gap.interval} (bands {gap.lower_band} and {gap.upper_band})"
        if gap
        else f"no complete gap opens {bands.where_gaps_are_known}"
    )
    kinds = {name for point in bands.points for name in point.plate_polarisation or ()}
    names_text = ", ".join(name for name in MARKS if name in kinds)
    marked = f"; waves are marked as {names_text}" if names_text else ""
    at_m = f"; the bending bands meet M at {_listed(bands)}" if bending else ""
    return f"Frequency in kHz against wavevector for the unit cell of {case.case_id}: {edges}{at_m}{marked}."


def _without(key: str, names: tuple[str, ...]) -> str:
    """Return the key of a case's pictures without those of some functions."""
    return "-".join((key, *names))


def _case_key(case: StoredCase) -> str:
    folders = (case.folder, *case.siblings)
    return _key(case.record.to_dict(), [folder / name for folder in folders for name in (store.ARRAYS, store.INPUT)])


def _draw(
    folder: Path,
    key: str,
    draws: Sequence[Callable[[], ReportFigure | list[ReportFigure] | None]],
    errors: Sequence[str] = (),
) -> FigureSet:
    """Draw and save each picture; a failure is reported with its reason and does not affect the others."""
    pictures: list[StoredFigure] = []
    troubles = list(errors)
    for draw in draws:
        try:
            with style.style():
                made = draw() or []
            pictures += [save(report_figure, folder) for report_figure in (made if isinstance(made, list) else [made])]
        except (store.StoreError, MemoryError):
            raise
        except Exception as error:
            name = getattr(draw, "func", draw).__name__
            troubles.append(f"{name}: {type(error).__name__}: {error}")
    pictures.sort(key=lambda picture: picture.name.endswith("meshes"))  # the shapes first
    if not troubles and (pictures or folder.exists()):
        folder.mkdir(parents=True, exist_ok=True)
        _remove_others(folder, pictures)
        store.write_json(folder / INDEX, {"key": key, "pictures": [asdict(picture) for picture in pictures]})
    return FigureSet(pictures, troubles)


def _remove_others(folder: Path, pictures: Sequence[StoredFigure]) -> None:
    """Remove pictures of an earlier record."""
    own = {name for picture in pictures for name in (picture.svg, picture.png, picture.shown)}
    for path in folder.iterdir():
        if path.is_file() and path.name not in own and path.suffix in {".svg", ".png", ".webp"}:
            path.unlink(missing_ok=True)


def _kept(folder: Path, key: str) -> list[StoredFigure] | None:
    with suppress(store.BadRecord, TypeError, KeyError):
        index = store.read_json(folder / INDEX)
        pictures = [StoredFigure(**entry) for entry in index["pictures"]]
        files = [folder / name for picture in pictures for name in (picture.svg, picture.png, picture.shown)]
        if index["key"] == key and all(path.is_file() for path in files):
            return pictures
    return None


def _key(visible: Any, files: list[Path]) -> str:
    """Return a hash of the data and the code of the pictures."""
    sources = [Path(__file__), Path(records.__file__), *sorted(Path(style.__file__).parent.glob("*.py"))]
    parts = [canonical_json(visible), metadata.version("matplotlib")]
    parts += [file_hash(path) for path in [*files, *sources] if path.exists()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
