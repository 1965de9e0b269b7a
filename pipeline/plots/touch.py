"""The tactile map: what a finger finds at each place of the touch face; and what designs draw for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.plots import places as of_places
from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import figure as figure_text
from pipeline.quantity import frequency, with_bar
from pipeline.records.record import TouchMapRecord, TouchRecord
from pipeline.records.study import StoredCase
from pipeline.units import MM, UM


def tactile(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The tactile map of a case's record."""
    record, design = case.record.touch, case.record.design
    return tactile_map(record, design.width_m if design else None) if record and record.map else None


def tactile_map(record: TouchRecord, width_m: float | None = None) -> ReportFigure:
    """Amplitude and friction under the finger over its place, nodes of the free plate as lines; the drive of the loop."""
    places = record.map
    assert places is not None
    count = 1 + (places.friction is not None) + (places.needed_V is not None)
    figure, panels = of_places.panels(count, width_m)
    rows = iter(panels)
    _amplitude(next(rows), record, places)
    if places.friction is not None:
        title = "Friction, where it can be told"
        of_places.field(next(rows), places.x_m, places.y_m, places.friction, "friction over that at rest", title)
    if places.needed_V is not None:
        title = "Drive that holds the sensor's amplitude"
        of_places.field(next(rows), places.x_m, places.y_m, places.needed_V, "drive (V)", title)
    return ReportFigure("tactile", "Tactile map", _alt(record, places), figure)


def draw(axes: Any, record: TouchRecord) -> None:
    """The amplitude's panel alone; the states' amplitudes where there is no map."""
    if record.map:
        _amplitude(axes, record, record.map)
        return
    axes.barh(
        [state.state for state in record.states], [state.finger_m / UM for state in record.states], color=style.BLUE
    )
    axes.set(xlabel="amplitude at the finger (µm)")


def _amplitude(axes: Any, record: TouchRecord, places: TouchMapRecord) -> None:
    title = f"Finger at each place, {_tone(record, places)}; lines: nodes of the free plate"
    of_places.field(axes, places.x_m, places.y_m, np.array(places.touched_m) / UM, "amplitude (µm)", title)
    x, y = (np.array(ticks) / MM for ticks in (places.x_m, places.y_m))
    if len(x) > 1 and len(y) > 1:
        axes.contour(x, y, np.array(places.displacement_m).T, levels=[0.0], colors="white", linewidths=0.8)
    axes.plot(record.at_m[0] / MM, record.at_m[1] / MM, "+", color=style.VERMILION, ms=9)


def _tone(record: TouchRecord, places: TouchMapRecord) -> str:
    """The map's frequency, the free mode's."""
    return frequency(places.frequency_hz, record.mode.free_error if record.mode else None)


def _alt(record: TouchRecord, places: TouchMapRecord) -> str:
    touched = np.array(places.touched_m) / UM
    best = np.unravel_index(int(np.argmax(touched)), touched.shape)
    there = f"({figure_text(places.x_m[best[0]] / MM)}, {figure_text(places.y_m[best[1]] / MM)}) mm"
    state, here = record.state("touched"), ""
    half = None if places.touched_error_m is None else places.touched_error_m[best[0]][best[1]] / UM
    if state is not None:
        bar = None if state.finger_error_m is None else state.finger_error_m / UM
        here = f"; {with_bar(state.finger_m / UM, bar, 'µm')} where the case puts the finger"
    return (
        f"Amplitude under {record.fingertip} at {touched.size} places of the touch face, {_tone(record, places)}: "
        f"at most {with_bar(touched[best], half, 'µm')}, at {there}{here}"
    )


def power_by_design(records: Sequence[tuple[str, TouchRecord]], place: Any) -> None:
    """Write a figure: power at 1 um under the finger of each design, all patches in phase and with shaped voltages."""
    with style.style():
        figure, axes = style.panels(2.8)
        for offset, (name, label) in zip(
            (-0.2, 0.2), (("touched", "in phase"), ("shaped", "shaped for contrast")), strict=True
        ):
            states = [record.state(name) for _, record in records]
            known = [(i, s.drawn_mW_at_1um) for i, s in enumerate(states) if s and s.drawn_mW_at_1um is not None]
            colour = style.BLUE if name == "touched" else style.VERMILION
            axes.bar([i + offset for i, _ in known], [watts for _, watts in known], 0.38, color=colour, label=label)
        axes.set_xticks(range(len(records)), [design.replace(", ", ",\n") for design, _ in records])
        axes.set(ylabel="power at 1 µm (mW)", yscale="log")
        axes.legend()
        figure.savefig(place, format="svg", bbox_inches="tight", metadata={"Date": None})
