"""What always holds in the core: a state that breaks it ends the host's program, each assertion seen to fire."""

from __future__ import annotations

import faulthandler
import math
import os
import resource
import signal
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

from firmware.closed_loop import held_plate
from firmware.emulate.plant import Beam, measured_table
from firmware.injection_rig import held
from firmware.mode_table import Mode, ModeTable, Pattern, Shape, to_bytes
from tests.helpers.hosted_boards import HostedSix, Rig

IDLE, IDENTIFY, RUN, FAULT = range(4)


def ends_by(call: Callable[[], Any]) -> int:
    """The signal that ends a copy of this process which calls something; 0 when none does."""
    child = os.fork()
    if child == 0:
        faulthandler.disable()
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        try:
            call()
        finally:  # whatever else goes wrong, the copy never returns into the tests
            os._exit(sys.exc_info()[0] is not None)
    status = os.waitpid(child, 0)[1]
    assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0, "the call failed in Python"
    return os.WTERMSIG(status)


class Broken(NamedTuple):
    """An object of a type, what is put into it, and a function called with it and with more."""

    kind: str
    values: dict[str, Any]
    call: str
    more: tuple[Any, ...] = ()


def state(of: int, **more: Any) -> dict[str, Any]:
    return {"state": of, "inverse": ~of & 0xFFFFFFFF, **more}


BREAKS = {
    "out of a fault into a run": Broken("an_supervisor", state(FAULT), "an_supervisor_enter", (RUN,)),
    "out of a fault into a measurement": Broken("an_supervisor", state(FAULT), "an_supervisor_enter", (IDENTIFY,)),
    "a measurement of a plate that is driven": Broken("an_supervisor", state(RUN), "an_supervisor_enter", (IDENTIFY,)),
    "a start with a fault": Broken("an_supervisor", state(IDLE, faults=1), "an_supervisor_begin", (RUN,)),
    "a failure without a fault": Broken("an_supervisor", state(RUN), "an_supervisor_fail", (0,)),
    "a clear of what may not be cleared": Broken("an_supervisor", state(FAULT, faults=1), "an_supervisor_clear"),
    "a job over one that waits": Broken("an_handover", {"active": 1, "posted": 0}, "an_handover_post"),
    "a factor above one": Broken("an_texture", {"kind": 1, "depth": -1.0, "phase": 2**31}, "an_texture_step"),
    "a mode beyond the table": Broken("an_table", {"mode_count": 1}, "an_table_mode", (1, None)),
    "a shape beyond the table": Broken("an_table", {"shape_count": 1}, "an_table_shape", (1, None)),
    "an actuator beyond the matrix": Broken("an_shaping", {"channels": 2}, "an_shaping_set", (2, None, 1.0)),
}


def made(core: Any, one: Broken) -> Any:
    item = core.ffi.new(f"{one.kind} *")
    for name, value in one.values.items():
        setattr(item, name, value)
    return item


@pytest.mark.parametrize("what", BREAKS)
def test_a_broken_invariant_ends_the_program(core, what: str) -> None:
    one = BREAKS[what]
    arguments = [core.ffi.NULL if value is None else value for value in one.more]
    assert ends_by(lambda: getattr(core.lib, one.call)(made(core, one), *arguments)) == signal.SIGILL


def test_what_is_allowed_goes_on(core) -> None:
    for before, after in ((IDLE, RUN), (IDLE, IDENTIFY), (IDENTIFY, RUN), (RUN, RUN), (RUN, IDLE), (FAULT, IDLE)):
        supervisor = made(core, Broken("an_supervisor", state(before), ""))
        assert ends_by(lambda own=supervisor, to=after: core.lib.an_supervisor_enter(own, to)) == 0


def test_more_than_is_kept_ends_the_program(core) -> None:
    nothing = core.ffi.NULL
    assert ends_by(lambda: core.lib.an_keep_write(nothing, 0, nothing, nothing, 301)) == signal.SIGILL


@pytest.fixture(scope="module")
def boards(core) -> dict[str, Any]:
    """Both builds at work."""
    unknown = ModeTable(250e3, bytes(16), (Mode.from_quality_factor(31400.0, 300.0),))
    measuring, beam = Rig(to_bytes(unknown), held_plate(300.0)[1]), Beam()
    shape = Shape(beam.frequency_hz, beam.slowest_s, (Pattern("all", (1,) * 6),))
    six = [
        HostedSix(table, beam)
        for table in (measured_table(beam), to_bytes(ModeTable(beam.sample_rate_hz, bytes(16), (), shapes=(shape,))))
    ]
    for board in (measuring, *six):
        board.run(5e-3)
    assert measuring.start() and all(board.lib.an_six_start(board.app, 0, 0.1) for board in six)
    for board in (measuring, *six):
        board.run(5e-3)
    return {"one mode": held(), "one mode, measuring": measuring, "six": six[0], "six, measuring": six[1]}


WRONG = {
    "a reference beyond the sensor": ("one mode", "slow", "reference", 1.1),
    "a block of more windows than it has": ("one mode", "track.block", "count", 17),
    "a sweep beyond the drive's limit": ("one mode, measuring", "ident", "level", 1.1),
    "a reference that is no number": ("six", "slow", "reference", math.nan),
    "a probe beyond the drive's limit": ("six, measuring", "shape", "drive_limit", -1.0),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_value_out_of_its_range_ends_the_program(boards, what: str) -> None:
    name, path, field, value = WRONG[what]
    board, where = boards[name], boards[name].app
    for part in path.split("."):
        where = getattr(where, part)

    def go_on() -> None:
        setattr(where, field, value)
        board.run(1.0)

    assert ends_by(go_on) == signal.SIGILL
