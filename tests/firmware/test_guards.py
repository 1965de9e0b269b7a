"""Moments that seldom come: orders while a job waits, damaged words, values at the ends of their ranges; of both builds."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from firmware.mode_table import Mode, ModeTable, Pattern, Shape, to_bytes
from firmware.protocol import Column, Fault, Flag, Identity, Kind, SingleStatus, SixStatus, parse
from tests.firmware.test_link import SIX, Linked, answer, upload

IDLE, IDENTIFY, RUN, FAULT = range(4)
OK, UNKNOWN, BAD_VALUE, NOT_NOW, TABLE_REFUSED, STORE_FAILED = (bytes([code]) for code in range(6))
ROWS = tuple(tuple(0.5 * (i == j) for j in range(6)) for i in range(6))
ALL = Pattern("all", (1,) * 6)
KNOWN_SIX = to_bytes(ModeTable(40e3, bytes(16), (), shapes=(Shape(2400.0, 5e-3, (ALL,), ROWS),)))
KNOWN_MODE = Mode(31e3, 3e-3, 0.5 - 0.5j, frequency_identified=True)
KNOWN_SINGLE = to_bytes(ModeTable(250e3, bytes(16), (KNOWN_MODE,)))
STARTS = {"single": struct.pack("<ff", 0.1, 0.0), "six": struct.pack("<If", 0, 0.1)}


@pytest.fixture(params=[("single", KNOWN_SINGLE, 250e3), ("six", KNOWN_SIX, 40e3)], ids=["single", "six"])
def linked(core, request) -> Linked:
    """A board at rest whose plate has been measured."""
    made = Linked(core, *request.param)
    made.window()
    return made


@pytest.fixture
def running(linked) -> Linked:
    """The same board in its closed loop, started by a host."""
    assert answer(linked, Kind.START, STARTS["single" if linked.single else "six"]) == OK
    linked.window()
    assert linked.app.base.supervisor.state == RUN
    return linked


def at_rest(linked: Linked) -> bool:
    """Whether the drives of the coming window are zero."""
    fast = linked.app.fast
    drives = [fast.command.drive] if linked.single else [fast.drive[fast.command.bank][i] for i in range(6)]
    return all(drive.re == drive.im == 0.0 for drive in drives)


def pass_by(linked: Linked, seconds: float) -> None:
    """Let time pass without a window."""
    windows = round(seconds * linked.build.moment(linked.base).window_hz)
    linked.app.fast.window.count += windows
    linked.app.fast.command.count += windows


def test_while_a_job_waits_nothing_is_cleared_or_started(linked) -> None:
    """The other job is the active one: whoever wrote to it would drive with half of what was asked."""
    linked.lib.an_application_fail(linked.base, linked.build, Fault.FLASH)
    assert answer(linked, Kind.CLEAR) == NOT_NOW and linked.app.base.supervisor.state == FAULT
    linked.window()
    assert answer(linked, Kind.CLEAR) == OK and linked.app.base.supervisor.state == IDLE
    start = STARTS["single" if linked.single else "six"]
    for kind, payload in ((Kind.START, start), (Kind.IDENTIFY, b"")):
        assert answer(linked, kind, payload) == NOT_NOW and linked.app.base.supervisor.state == IDLE
    linked.window()
    assert answer(linked, Kind.START, start) == OK and linked.app.base.supervisor.state == RUN


def test_a_fault_that_meets_a_waiting_job_rests_at_once_and_the_job_never_drives(linked) -> None:
    assert answer(linked, Kind.START, STARTS["single" if linked.single else "six"]) == OK
    assert not linked.lib.an_handover_vacant(linked.ffi.addressof(linked.app.slow, "hand"))
    linked.lib.an_application_fail(linked.base, linked.build, Fault.FLASH)
    assert linked.app.base.supervisor.state == FAULT and linked.app.fast.faults == Fault.FLASH
    for _ in range(4):
        linked.window()
        assert at_rest(linked)
    assert linked.app.base.supervisor.first == Fault.FLASH


def test_a_second_stop_does_not_lengthen_the_first(core) -> None:
    linked = Linked(core, "six", KNOWN_SIX, 40e3)
    linked.window()
    assert answer(linked, Kind.START, STARTS["six"]) == OK
    linked.window()
    assert answer(linked, Kind.STOP) == OK and linked.app.base.fade_s == 0.5
    linked.window()
    left_s = linked.app.base.fade_s
    assert answer(linked, Kind.STOP) == OK and 0.0 < linked.app.base.fade_s == left_s < 0.5


def corrupt(linked: Linked, path: str, value: object) -> None:
    """Put a value where the application keeps it."""
    where = linked.app
    *parts, name = path.split(".")
    for part in parts:
        where = getattr(where, part)
    setattr(where, name, value)


@pytest.mark.parametrize(
    ("field", "value", "flag"),
    [
        ("base.retry.waits", True, Flag.RETRIES),
        ("base.retry.due", True, Flag.RETRIES),
        ("base.retry.gave_up", Fault.MISMATCH, Flag.GAVE_UP),
        ("base.eased", True, Flag.EASED),
    ],
)
def test_the_status_tells_of_retries_and_eased_drives(linked, field: str, value: int, flag: int) -> None:
    kind = SingleStatus if linked.single else SixStatus
    before = parse(kind, answer(linked, Kind.STATUS)[1:]).flags
    corrupt(linked, field, value)
    assert parse(kind, answer(linked, Kind.STATUS)[1:]).flags == before | flag != before


def test_the_status_tells_of_a_drive_at_its_limit(running) -> None:
    kind = SingleStatus if running.single else SixStatus
    for limited in (0, 1):
        corrupt(running, "track.limited" if running.single else "slow.limited", limited)
        assert parse(kind, answer(running, Kind.STATUS)[1:]).limited == bool(limited)


def test_a_board_without_a_table_says_so_and_keeps_nothing(core) -> None:
    linked = Linked(core, "single", KNOWN_SINGLE[:-1] + b"\0", 250e3)
    assert linked.app.base.supervisor.faults == Fault.TABLE
    found = parse(Identity, answer(linked, Kind.IDENTITY)[1:])
    assert found.count == 0 and found.design == bytes(16) and found.drive_limit == 0.0
    keeping = core.ffi.new("an_keeping *")
    memory = core.ffi.new("uint8_t []", core.lib.AN_SLOTS * core.lib.AN_KEEP_BYTES)
    linked.app.base.measured = 1
    core.lib.an_application_keep(linked.base, linked.build, memory, keeping)
    assert keeping.state == core.lib.AN_KEEP_NONE and not any(memory)


def test_no_table_is_stored_at_a_low_supply(linked) -> None:
    """The flash memory would take it wrongly."""
    table = KNOWN_SINGLE if linked.single else KNOWN_SIX
    linked.app.fast.faults |= Fault.SUPPLY
    assert upload(linked, table) == NOT_NOW
    linked.app.fast.faults = 0
    assert upload(linked, table) == OK


def test_a_retry_whose_pattern_has_gone_leaves_the_board_at_rest(core) -> None:
    """A host chose a shape of fewer patterns in the moment between clear and start; it need not stay in contact."""
    shapes = (Shape(2400.0, 5e-3, (ALL, Pattern("two", (1,) * 6)), ROWS), Shape(500.0, 5e-3, (ALL,), ROWS))
    linked = Linked(core, "six", to_bytes(ModeTable(40e3, bytes(16), (), shapes=shapes)), 40e3)
    linked.window()
    linked.app.pattern = 1
    retry = linked.app.base.retry
    retry.due = retry.host_drives = True
    assert answer(linked, Kind.PATTERN, struct.pack("<II", 1, 0)) == OK
    for _ in range(3):
        linked.window()
    supervisor = linked.app.base.supervisor
    assert supervisor.state == IDLE and not supervisor.host_drives and not retry.due


def test_a_retry_that_never_confirmed_the_values_checks_them_again(linked) -> None:
    linked.app.base.confirmed = False
    start = STARTS["single" if linked.single else "six"]
    assert answer(linked, Kind.START, start) == OK and linked.app.base.supervisor.state == IDENTIFY
    linked.window()
    linked.app.fast.faults |= Fault.MISMATCH
    linked.window()
    linked.window()
    assert linked.app.base.supervisor.state == FAULT and linked.app.base.retry.waits
    for _ in range(3):
        pass_by(linked, 0.4)
        assert answer(linked, Kind.STATUS)[:1] == OK
        linked.window()
    for _ in range(3):
        linked.window()
    assert linked.app.base.supervisor.state == IDENTIFY and not linked.app.base.confirmed


DAMAGED = {
    "single": ("track.shift", -2.0 * math.pi * 30.9e3, Fault.IDENTIFY),
    "six": ("step", 0, Fault.SHAPING),
}


def test_a_tone_that_no_window_can_measure_is_never_driven(linked) -> None:
    """A damaged word gives it."""
    name = "single" if linked.single else "six"
    word, value, fault = DAMAGED[name]
    corrupt(linked, word, value)
    assert answer(linked, Kind.START, STARTS[name]) == OK
    supervisor = linked.app.base.supervisor
    assert supervisor.state == FAULT and supervisor.faults == fault
    linked.window()
    assert at_rest(linked)


def test_a_measurement_at_such_a_tone_ends_in_a_fault(linked) -> None:
    assert answer(linked, Kind.IDENTIFY) == OK
    corrupt(linked, "ident.centre" if linked.single else "step", 0)
    for _ in range(600):
        linked.window()
        linked.app.base.supervisor.heard = linked.app.fast.window.count
    assert linked.app.base.supervisor.state == FAULT and at_rest(linked)
    assert linked.app.base.supervisor.first == Fault.IDENTIFY


def test_references_that_are_none_change_nothing_and_great_ones_are_clipped(running) -> None:
    set_reference = getattr(running.lib, f"an_{'single' if running.single else 'six'}_set_reference")
    most = 0.9 * running.app.mode.amplitude_limit if running.single else running.app.reachable
    for given, held in ((0.05, 0.05), (-0.1, 0.05), (math.nan, 0.05), (1.0, most), (0.0, 0.0)):
        set_reference(running.app, given)
        assert running.app.slow.reference == pytest.approx(held)


@pytest.mark.parametrize("level", [0.0, 0.03])
def test_a_retry_returns_to_the_last_reference_even_to_none(running, level: float) -> None:
    """Zero at a start would choose a level of the board's own. Six channels check the plate before."""
    assert answer(running, Kind.REFERENCE, struct.pack("<f", level)) == OK
    assert answer(running, Kind.STOP) == OK
    while running.app.base.supervisor.state == RUN:
        running.window()
    running.window()
    running.app.base.retry.due = True
    running.window()
    running.window()
    state = running.app.base.supervisor.state
    if running.single:
        assert state == RUN and running.app.slow.reference == pytest.approx(level, abs=1e-6)
    else:
        assert state == IDENTIFY and running.app.checking and not running.app.half_reach
        assert running.app.target_reference == pytest.approx(level, abs=1e-6)


def test_a_measurement_for_half_the_reach_is_tried_again_for_half_the_reach(core) -> None:
    linked = Linked(core, "six", SIX, 40e3)
    linked.window()
    assert answer(linked, Kind.START, struct.pack("<If", 0, 0.0)) == OK and linked.app.half_reach
    answer(linked, Kind.STOP)
    for _ in range(3):
        linked.window()
    assert linked.app.base.supervisor.state == IDLE
    linked.app.half_reach, linked.app.base.retry.due = True, True
    linked.window()
    assert linked.app.base.supervisor.state == IDENTIFY and linked.app.half_reach


def test_values_kept_for_another_program_are_refused(linked) -> None:
    """As many as this one does not have, though build, slot, protocol and table are its own."""
    lib, ffi = linked.lib, linked.ffi
    memory, keeping = ffi.new("uint8_t []", lib.AN_SLOTS * lib.AN_KEEP_BYTES), ffi.new("an_keeping *")
    name = linked.build.number | lib.AN_PROTOCOL << 16
    lib.an_keep_write(memory, name, ffi.addressof(linked.app.table), bytes(300), 24)
    lib.an_application_keep(linked.base, linked.build, memory, keeping)
    assert keeping.state == lib.AN_KEEP_REFUSED


def test_a_kept_matrix_that_cannot_be_inverted_is_refused(core) -> None:
    linked = Linked(core, "six", SIX, 40e3)
    memory = core.ffi.new("uint8_t []", core.lib.AN_SLOTS * core.lib.AN_KEEP_BYTES)
    keeping = core.ffi.new("an_keeping *")
    name = linked.build.number | core.lib.AN_PROTOCOL << 16
    core.lib.an_keep_write(memory, name, core.ffi.addressof(linked.app.table), bytes(288), 288)
    core.lib.an_application_keep(linked.base, linked.build, memory, keeping)
    assert keeping.state == core.lib.AN_KEEP_REFUSED and not linked.app.identified


def test_kept_values_wait_for_the_end_of_a_job(running) -> None:
    lib, ffi = running.lib, running.ffi
    memory, keeping = ffi.new("uint8_t []", lib.AN_SLOTS * lib.AN_KEEP_BYTES), ffi.new("an_keeping *")
    keep = lambda: lib.an_application_keep(running.base, running.build, memory, keeping)  # noqa: E731
    keep()
    assert keeping.state == lib.AN_KEEP_NONE
    assert answer(running, Kind.STOP) == OK
    while running.app.base.supervisor.state == RUN:
        running.window()
    keep()
    assert keeping.state == lib.AN_KEEP_EMPTY and keeping.chosen == running.app.base.chosen
    keeping.state = lib.AN_KEEP_NONE
    keep()
    assert keeping.state == lib.AN_KEEP_NONE  # once for each choice


def test_the_strongest_other_mode_of_a_table_bounds_the_loop(core) -> None:
    modes = tuple(Mode(30e3 + 500.0 * n, 3e-3, gain) for n, gain in enumerate((0.2, 0.5j, -0.3j, 0.1)))
    linked = Linked(core, "single", to_bytes(ModeTable(250e3, bytes(16), modes, target=1)), 250e3)
    assert linked.app.neighbour == pytest.approx(0.3)


def test_a_tone_too_low_for_a_faster_converter_is_refused(core) -> None:
    """A window of 46 samples at 1 MHz holds a tenth of a period of 2 kHz."""
    slow, quick = (to_bytes(ModeTable(1e6, bytes(16), (Mode(hz, 3e-3, 0.5),))) for hz in (2e3, 200e3))
    assert Linked(core, "single", slow, 1e6).app.base.supervisor.faults == Fault.TABLE
    linked = Linked(core, "single", quick, 1e6)
    linked.window()
    for hz, result in ((2e3, NOT_NOW), (200e3, OK)):
        assert answer(linked, Kind.CHIRP, struct.pack("<2f5I", hz, 0.1, 0, 0, 128, 1, 128)) == result


@pytest.mark.parametrize("part", ["re", "im"])
def test_a_drive_that_nobody_commanded_is_found(core, part: str) -> None:
    linked = Linked(core, "single", KNOWN_SINGLE, 250e3)
    linked.window()
    while linked.app.fast.tick < 10:
        core.lib.an_fast_tick(core.ffi.addressof(linked.app, "fast"), 2048)
    assert core.lib.an_single_check(linked.app) == 0
    setattr(linked.app.fast.drive, part, 100.0)
    assert core.lib.an_single_check(linked.app) == Fault.MEMORY


def test_a_response_beyond_full_scale_is_recorded_as_full_scale(core) -> None:
    linked = Linked(core, "single", KNOWN_SINGLE, 250e3)
    core.lib.an_capture_begin_chirp(linked.capture, 5)
    linked.app.slow.chirp.begun = 7
    linked.app.slow.measured.tone = {"re": 1.5, "im": -1.5}
    core.lib.an_single_capture(linked.app, linked.capture)
    assert list(linked.capture.words[0:2]) == [32767, 65536 - 32767] and linked.capture.used == 2


def six_of(core, rows: tuple, **changes) -> Linked:
    """Six channels with a matrix from the table."""
    shape = Shape(2400.0, changes.get("tau_s", 5e-3), (ALL, Pattern("two", (0.2, 1.0, 0.5, 0, 0, 0))), rows)
    linked = Linked(core, "six", to_bytes(ModeTable(40e3, bytes(16), (), shapes=(shape,))), 40e3)
    linked.window()
    return linked


def test_a_lively_plate_is_held_at_no_more_than_its_sensors_show(core) -> None:
    """A tenth of the limit would move its sensors to half of full scale: the check aims at a tenth of that scale."""
    rows = tuple(tuple(5.0 * (i == j) for j in range(6)) for i in range(6))
    linked = six_of(core, rows)
    assert answer(linked, Kind.START, struct.pack("<If", 0, 0.0)) == OK
    assert linked.app.reachable == pytest.approx(0.9) and linked.app.slow.reference == pytest.approx(0.45)
    linked = six_of(core, rows)
    linked.app.base.confirmed = False
    assert answer(linked, Kind.START, struct.pack("<If", 0, 0.0)) == OK
    assert linked.app.checking and linked.app.probe_level == pytest.approx(0.1)


def test_a_table_whose_matrix_cannot_be_inverted_is_measured(core) -> None:
    linked = six_of(core, ((0.5,) * 6,) * 6)
    assert not linked.app.identified and answer(linked, Kind.COLUMN, struct.pack("<I", 0)) == NOT_NOW
    assert answer(linked, Kind.START, struct.pack("<If", 0, 0.1)) == OK
    assert linked.app.base.supervisor.state == IDENTIFY and not linked.app.checking


def test_a_column_of_the_matrix_is_told(core) -> None:
    linked = six_of(core, tuple(tuple(complex(i == j, 0.01 * i + 0.1 * j) for j in range(6)) for i in range(6)))
    found = parse(Column, answer(linked, Kind.COLUMN, struct.pack("<I", 3))[1:])
    assert found.responses == pytest.approx([complex(i == 3, 0.01 * i + 0.3) for i in range(6)])
    assert answer(linked, Kind.COLUMN, struct.pack("<I", 6)) == BAD_VALUE


def test_six_channels_refuse_what_they_do_not_have(core) -> None:
    linked = six_of(core, ROWS)
    for pattern, reference in ((2, 0.1), (0, math.nan), (0, 1.1), (0, -0.1)):
        assert answer(linked, Kind.START, struct.pack("<If", pattern, reference)) == BAD_VALUE
        assert not core.lib.an_six_start(linked.app, pattern, reference)
    assert not core.lib.an_six_choose(linked.app, 1)
    assert core.lib.an_six_start(linked.app, 0, 0.1)
    linked.window()
    assert not core.lib.an_six_change(linked.app, 2) and core.lib.an_six_change(linked.app, 1)
    assert not core.lib.an_six_change(linked.app, 0) and linked.app.pattern == 1  # the last one still waits
    linked.window()
    assert core.lib.an_six_change(linked.app, 0)


@pytest.mark.parametrize("rate_hz", [1e3, 40e3, 1e6])
def test_a_window_measures_every_tone_that_a_table_may_have(core, rate_hz: float) -> None:
    """Otherwise the host's program ends."""
    app = core.ffi.new("an_six *")
    for hz in np.geomspace(350.0, 0.4 * rate_hz, 200):
        table = to_bytes(ModeTable(rate_hz, bytes(16), (), shapes=(Shape(float(hz), 5e-3, (ALL,)),)))
        core.lib.an_six_boot(app, core.ffi.from_buffer("uint8_t[]", table), len(table), rate_hz, 0)
        assert app.base.supervisor.faults == 0 and app.slow.jobs[0].demod.sine_sine > 0.0


@pytest.mark.parametrize(("table", "rate_hz"), [(KNOWN_SIX, 41e3), (KNOWN_SIX[:-1] + b"\0", 40e3)])
def test_a_table_of_another_rate_or_damaged_is_no_table(core, table: bytes, rate_hz: float) -> None:
    assert Linked(core, "six", table, rate_hz).app.base.supervisor.faults == Fault.TABLE


def test_six_channels_ease_their_drive_and_take_it_up_again(core) -> None:
    linked = six_of(core, ROWS)
    assert core.lib.an_six_start(linked.app, 0, 0.1)
    linked.window()
    app, slow = linked.app, linked.app.slow
    limit = slow.jobs[slow.hand.active & 1].drive_limit
    for full_s, share in ((10.0, 0.5), (0.0, 1.0)):
        app.base.full_s, app.base.eased = full_s, full_s > 0.0
        linked.window()
        linked.window()
        assert slow.jobs[slow.hand.active & 1].drive_limit == pytest.approx(share * limit)
        assert slow.reference == pytest.approx(share * 0.1)
    app.base.full_s, app.base.eased, app.step = 10.0, True, 0
    linked.window()
    assert slow.reference == pytest.approx(0.1)  # no job, no other reference


@pytest.mark.parametrize(
    ("limit", "found"), [(0.5, 0), (math.nan, Fault.MEMORY), (0.0, Fault.MEMORY), (1.5, Fault.MEMORY)]
)
def test_a_damaged_limit_of_six_channels_is_found_with_the_next_sample(core, limit: float, found: int) -> None:
    """It follows the job's, so that nothing else would renew it."""
    linked = six_of(core, ROWS)
    assert core.lib.an_six_start(linked.app, 0, 0.1)
    linked.window()
    linked.app.slow.limit = limit
    assert core.lib.an_six_check(linked.app) == found


def test_a_plate_that_decays_within_a_window_is_not_waited_for(core) -> None:
    linked = six_of(core, None, tau_s=1e-6)
    assert answer(linked, Kind.IDENTIFY) == OK
    while not linked.app.glanced:
        linked.window()
    assert linked.app.slow.jobs[linked.app.slow.hand.posted & 1].settle == 0


def test_a_log_of_six_channels_shows_the_sensor_that_is_to_move_most(core) -> None:
    linked = six_of(core, ROWS)
    assert core.lib.an_six_start(linked.app, 1, 0.1)
    linked.window()
    for i in range(6):
        linked.app.slow.measured[i] = {"re": 0.1 * i, "im": -0.01}
    assert core.lib.an_six_record(linked.app).measured.re == pytest.approx(0.1)
