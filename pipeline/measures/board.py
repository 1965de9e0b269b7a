"""The case's mode table played by the firmware on the emulated board: the patched plate's where its response was solved."""

from __future__ import annotations

from typing import Any

from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan

NAME = "closed loop on the emulated board"


def _compute(work: Work) -> None:
    from pipeline.board import emulation

    if not work.wanted:
        work.log.left_out(NAME, "no mode of the wanted shape: there is no mode table")
        return
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
    pictures=("plots.board.board",),
)
