"""The closed loop of the emulated board: what the sensor shows after a step of the reference, and the drive it takes."""

from __future__ import annotations

from typing import Any

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import figure as figure_text
from pipeline.quantity import frequency
from pipeline.records.study import StoredCase
from pipeline.units import MS


def board(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The step response of a case's record; None when the board was not run or ended in a fault."""
    record = case.record.held("board")
    return step(record, arrays) if record and "board_time_s" in arrays else None


def step(record: Any, arrays: dict[str, Any]) -> ReportFigure:
    """Both axes of the rotating frame with the reference, and the size of the drive, over time."""
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
    upper.legend(fontsize=8, loc="center right")
    lower.step(time, arrays["board_drive"], where="post", color=style.ORANGE)
    lower.set(ylabel="drive (full scale)", xlabel="time after the step (ms)")
    for axes in (upper, lower):
        axes.grid(True)
    origin = "identified by the image's own sweep" if record.swept else "taken from the table"
    alt = (
        f"Step of the reference to {figure_text(record.reference)} of full scale, run by the unmodified firmware image on an "
        f"emulated board with noise: {reached}, largest overshoot {figure_text(100.0 * record.overshoot)} % with the noise in "
        f"it; the mode {mode} with a time constant of {figure_text(record.tau_s / MS)} ms was {origin}"
    )
    return ReportFigure("board", "Closed loop of the emulated board", alt, figure, vector=True)
