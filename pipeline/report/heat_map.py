"""Confinement over two swept keys as a heat map, with one panel for each value of further keys."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import level_figure
from pipeline.records.study import StoredCase, StoredStudy
from pipeline.records.tables import axis_label, numeric_keys
from solvers.measures.confinement import CONFINED_DB

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST = 3  # values of a key along an axis; of three keys or more, 2
MAX_PANELS, ACROSS = 12, 3  # in all, and next to each other
MAX_WRITTEN = 12  # columns of a panel whose cells contain their level
DARK = 0.45  # of the colour scale, below which letters are white


def grid_of(study: StoredStudy) -> tuple[list[StoredCase], str, str] | None:
    """Return the designs with a level and the two numeric keys with the most values; None without two of enough values."""
    cases = [case for case in study.cases if case.sweep and case.record.ranked_db is not None]
    keys = [key for key in numeric_keys(study, cases) if len(_values(cases, key)) > 1]
    if len(keys) < 3:
        keys = [key for key in keys if len(_values(cases, key)) >= LEAST]
    return (cases, keys[0], keys[1]) if len(keys) > 1 else None


def over_grid(study: StoredStudy) -> ReportFigure | None:
    """Draw the level that ranks the designs over two numeric keys; None if fewer than two have enough values.

    The level is that of the driven plate where there are patches, otherwise that of the target mode. Confined designs
    are framed. Further keys have a panel for each of their values.
    """
    known = grid_of(study)
    if known is None:
        return None
    cases, along, down = known
    groups = _groups(cases, [key for key in study.swept if key not in (along, down) and len(_values(cases, key)) > 1])
    shown = dict(list(groups.items())[:MAX_PANELS])
    columns = min(len(shown), ACROSS)
    deep = -(-len(shown) // columns)
    x, y = _values(cases, along), _values(cases, down)
    height = 1.4 + deep * (0.6 + 0.3 * len(y))
    figure, panels = style.panels(height, deep, columns, sharex=True, sharey=True, squeeze=False)
    levels = [case.record.ranked_db for case in cases if case.record.ranked_db is not None]
    scale = {"vmin": min(0.0, *levels), "vmax": max(CONFINED_DB, *levels), "cmap": style.QUALITY}
    for axes, (name, group) in zip(panels.flat, shown.items(), strict=False):
        image = _panel(axes, group, (along, x), (down, y), scale, len(x) * columns <= MAX_WRITTEN)
        axes.set_title(name)
    for axes in panels.flat[len(shown) :]:
        axes.set_visible(False)
    _label(panels, len(shown), axis_label(along), axis_label(down))
    driven = "driven " if any(case.record.driven_db is not None for case in cases) else ""
    bar = f"{driven}confinement (dB); framed: confined"
    figure.colorbar(image, ax=panels, label=bar, location="bottom", shrink=0.6, aspect=40)
    title = f"Confinement over {axis_label(along)} and {axis_label(down)}"
    if len(shown) < len(groups):
        title += f", the first {len(shown)} of {len(groups)} groups of designs"
    return ReportFigure("over_grid", title, _alt(study, cases, groups), figure, vector=True)


def _label(panels: Any, count: int, along: str, down: str) -> None:
    """Label the outer axes of the panels in use."""
    columns = panels.shape[1]
    for axes in panels.flat[max(0, count - columns) : count]:
        axes.set_xlabel(along)
        axes.tick_params(labelbottom=True)
    for axes in panels[:, 0]:
        axes.set_ylabel(down)


def _values(cases: list[StoredCase], key: str) -> list[Any]:
    """Return the different values of a key, numbers in ascending order before words and lists."""
    known = {repr(case.sweep[key]): case.sweep[key] for case in cases if key in case.sweep}
    numbers = [value for value in known.values() if isinstance(value, (int, float))]
    return [*sorted(set(numbers)), *(value for value in known.values() if not isinstance(value, (int, float)))]


def _groups(cases: list[StoredCase], keys: list[str]) -> dict[str, list[StoredCase]]:
    """Group cases by the values of some keys, in the order of these values."""
    found = {}
    for values in product(*(_values(cases, key) for key in keys)):
        group = [
            case for case in cases if all(case.sweep.get(key) == value for key, value in zip(keys, values, strict=True))
        ]
        if group:
            found[", ".join(f"{axis_label(key)} = {value}" for key, value in zip(keys, values, strict=True))] = group
    return found


def _panel(
    axes: Axes, group: list[StoredCase], along: tuple[str, list[Any]], down: tuple[str, list[Any]],
    scale: dict[str, Any], written: bool,
) -> Any:  # fmt: skip
    """Draw one panel: a coloured cell for each design, framed where it is confined."""
    from matplotlib.patches import Rectangle
    from matplotlib.patheffects import withStroke

    (x_key, x), (y_key, y) = along, down
    levels = np.full((len(y), len(x)), np.nan)
    for case in group:
        row, column = y.index(case.sweep[y_key]), x.index(case.sweep[x_key])
        level = case.record.ranked_db
        assert level is not None
        levels[row, column] = level
        if case.record.confined:
            frame = Rectangle((column - 0.46, row - 0.44), 0.92, 0.88, fill=False, ec="white", lw=1.4)
            frame.set_path_effects([withStroke(linewidth=2.8, foreground="black")])  # white alone is lost on yellow
            axes.add_patch(frame)
        if written:
            dark = level < scale["vmin"] + DARK * (scale["vmax"] - scale["vmin"])
            look: dict[str, Any] = {"ha": "center", "va": "center", "color": "white" if dark else "black"}
            axes.text(column, row, level_figure(level, None), **look)
    image = axes.imshow(levels, origin="lower", aspect="auto", **scale)
    axes.set_xticks(range(len(x)), [f"{value:g}" for value in x])
    axes.set_yticks(range(len(y)), [f"{value:g}" for value in y])
    return image


def _alt(study: StoredStudy, cases: list[StoredCase], groups: dict[str, list[StoredCase]]) -> str:
    best = max(cases, key=lambda case: case.record.ranked_db or -np.inf)
    confined = sum(bool(case.record.confined) for case in cases)
    cut = f" {len(groups) - MAX_PANELS} further panels are not drawn." if len(groups) > MAX_PANELS else ""
    return (
        f"Confinement of {len(cases)} designs of {study.name} as colours: {confined} are confined, the best is "
        f"{best.case_id} with {level_figure(best.record.ranked_db, None)} dB.{cut}"
    )
