"""The closed loop of the emulated board: what the sensor shows after a step of the reference, and the drive it takes."""

from __future__ import annotations

from typing import Any

from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.records.record import BoardRecord
from pipeline.records.study import StoredCase

MS = 1e3


def board(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """The step response of a case's record; None when the board was not run or ended in a fault."""
    record = case.record.board
    return step(record, arrays) if isinstance(record, BoardRecord) and "board_time_s" in arrays else None


def step(record: BoardRecord, arrays: dict[str, Any]) -> ReportFigure:
    """Both axes of the rotating frame with the reference, and the size of the drive, over time."""
    figure = style.new_figure(style.WIDTH_IN, 4.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    time = MS * arrays["board_time_s"]
    upper.step(time, arrays["board_reference"], where="post", color=style.GREY, lw=0.9, ls="--", label="reference")
    upper.plot(time, arrays["board_u_d"], color=style.BLUE, marker=".", label="in phase, d")
    upper.plot(time, arrays["board_u_q"], color=style.VERMILION, marker=".", label="in quadrature, q")
    if record.t95_s is not None:
        upper.axvline(MS * record.t95_s, color=style.GREEN, lw=0.8, ls=":", label="95 %")
    upper.set_ylabel("sensor (full scale)")
    upper.set_title(_title(record))
    upper.legend(fontsize=8, loc="center right")
    lower.step(time, arrays["board_drive"], where="post", color=style.ORANGE)
    lower.set_ylabel("drive (full scale)")
    lower.set_xlabel("time after the step (ms)")
    for axes in (upper, lower):
        axes.grid(True)
    return ReportFigure("board", "Closed loop of the emulated board", _alt(record), figure, vector=True)


def _reached(record: BoardRecord) -> str:
    return "95 % not reached" if record.t95_s is None else f"95 % after {MS * record.t95_s:.2f} ms"


def _title(record: BoardRecord) -> str:
    return f"{_reached(record)}, at {record.frequency_hz / MS:.3f} kHz"


def _alt(record: BoardRecord) -> str:
    origin = "identified by the image's own sweep" if record.swept else "taken from the table"
    return (
        f"Step of the reference to {record.reference:.4g} of full scale, run by the unmodified firmware image on "
        "an emulated "
        f"board with noise: {_reached(record)}, largest overshoot {100.0 * record.overshoot:.1f} % with the noise in it; "
        "the "
        f"mode at {record.frequency_hz / MS:.3f} kHz with a time constant of {MS * record.tau_s:.2f} ms was {origin}"
    )
