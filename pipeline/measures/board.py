"""The case's mode table played by the firmware on the emulated board; its gains are computed where the response was."""

from __future__ import annotations

from typing import Any

from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan

NAME = "closed loop on the emulated board"


def _compute(work: Work) -> None:
    from pipeline.board import emulation, export
    from pipeline.board.gains import can_be_computed

    forced = work.solved.get("forced")
    if not work.wanted:
        work.log.left_out(NAME, "no mode of the wanted shape: there is no mode table")
        return
    if forced and can_be_computed(work.case) and forced.wanted_hz():
        export.write_gains(work.case, work.folder, work.log, forced=forced)
    result, arrays = emulation.solve(work.folder, work.log)
    work.keep(arrays=arrays, board=result)


def _inputs() -> dict[str, Any]:
    from pipeline.board import emulation

    return {"firmware": emulation.sources_hash()}


BOARD = Measure(
    "board",
    plan=lambda case: plan.plain_step("board", NAME, "the firmware's image and the mode table"),
    compute=_compute,
    after="modes",
    inputs=_inputs,
    pictures=("board.board",),
)
