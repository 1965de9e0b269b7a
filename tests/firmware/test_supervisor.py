"""The state machine that both builds share, and the button in front of it."""

from __future__ import annotations

import pytest

from firmware.protocol import Fault

IDLE, IDENTIFY, RUN, FAULT = range(4)
REST, DWELL, TRACK = range(3)
NONE, TO_REST, MEASURE = range(3)
NO_ORDER, START, STOP, CLEAR = range(4)
LOOKS = 25000


@pytest.fixture
def supervisor(core):
    made = core.ffi.new("an_supervisor *")
    core.lib.an_supervisor_boot(made, 0)
    return made


@pytest.mark.parametrize(("fault", "clearable"), [(0, False), (1, False), (6, True), (13, True), (16, True)])
def test_a_fault_rests_is_latched_and_left_only_when_it_can_be(core, supervisor, fault: int, clearable: bool) -> None:
    core.lib.an_supervisor_begin(supervisor, RUN)
    assert core.lib.an_supervisor_decide(supervisor, TRACK, 1 << fault, 1, 2e-4) == TO_REST
    assert supervisor.state == FAULT and supervisor.first == 1 << fault
    assert core.lib.an_supervisor_decide(supervisor, REST, Fault.AMPLITUDE, 2, 2e-4) == NONE
    assert supervisor.faults == 1 << fault | Fault.AMPLITUDE and supervisor.first == 1 << fault
    assert core.lib.an_supervisor_may_clear(supervisor) == clearable
    if clearable:
        core.lib.an_supervisor_clear(supervisor)
        assert supervisor.state == IDLE and supervisor.faults == 0 and supervisor.cleared == 1
    assert not core.lib.an_supervisor_may_clear(supervisor)


def test_a_host_that_started_must_keep_talking_one_at_the_board_need_not(core, supervisor) -> None:
    core.lib.an_supervisor_begin(supervisor, RUN)
    assert core.lib.an_supervisor_decide(supervisor, TRACK, 0, 10**6, 2e-4) == NONE
    core.lib.an_supervisor_bind_host(supervisor, 10**6)
    assert core.lib.an_supervisor_decide(supervisor, TRACK, 0, 10**6 + 2499, 2e-4) == NONE
    assert core.lib.an_supervisor_decide(supervisor, TRACK, 0, 10**6 + 2502, 2e-4) == TO_REST
    assert supervisor.faults == Fault.HOST_SILENT


@pytest.mark.parametrize(
    ("state", "kind"), [(IDLE, TRACK), (IDLE, DWELL), (RUN, REST), (RUN, DWELL), (IDENTIFY, TRACK), (RUN, 3)]
)
def test_a_job_that_the_state_does_not_know_is_a_fault(core, supervisor, state: int, kind: int) -> None:
    core.lib.an_supervisor_enter(supervisor, state)
    assert core.lib.an_supervisor_decide(supervisor, kind, 0, 1, 2e-4) == TO_REST
    assert supervisor.faults == Fault.MEMORY


@pytest.mark.parametrize("bit", range(32))
def test_a_state_word_with_a_flipped_bit_is_a_fault(core, supervisor, bit: int) -> None:
    supervisor.inverse ^= 1 << bit
    assert core.lib.an_supervisor_decide(supervisor, REST, 0, 1, 2e-4) == TO_REST
    assert supervisor.state == FAULT and supervisor.faults == Fault.MEMORY


@pytest.mark.parametrize(("state", "kind", "faults"), [(RUN, TRACK, 8), (IDLE, REST, 2**31), (FAULT, REST, 0)])
def test_faults_without_the_fault_state_or_the_other_way_round_are_a_fault(
    core, supervisor, state: int, kind: int, faults: int
) -> None:
    core.lib.an_supervisor_enter(supervisor, state)
    supervisor.faults = faults
    assert core.lib.an_supervisor_decide(supervisor, kind, 0, 1, 2e-4) == TO_REST
    assert supervisor.state == FAULT and supervisor.faults == faults | Fault.MEMORY


def test_stop_ends_a_measurement_and_does_nothing_at_rest(core, supervisor) -> None:
    core.lib.an_supervisor_stop(supervisor)
    assert core.lib.an_supervisor_decide(supervisor, REST, 0, 1, 2e-4) == NONE and supervisor.state == IDLE
    core.lib.an_supervisor_begin(supervisor, IDENTIFY)
    assert core.lib.an_supervisor_decide(supervisor, DWELL, 0, 1, 2e-4) == MEASURE
    core.lib.an_supervisor_stop(supervisor)
    assert core.lib.an_supervisor_decide(supervisor, DWELL, 0, 1, 2e-4) == TO_REST and supervisor.state == IDLE


@pytest.mark.parametrize("silent", [False, True])
def test_no_retry_comes_without_the_host_that_started_the_job(core, supervisor, silent: bool) -> None:
    """It heard nothing for half a second: the wait of a second ends without a clear."""
    retry = core.ffi.new("an_retry *")

    def decide(window: int) -> int:
        if not silent:
            supervisor.heard = window
        return int(core.lib.an_retry_decide(retry, supervisor, window, 2e-4))

    core.lib.an_supervisor_begin(supervisor, RUN)
    core.lib.an_supervisor_bind_host(supervisor, 0)
    assert decide(1) == 0
    core.lib.an_supervisor_fail(supervisor, Fault.MISMATCH)
    assert [decide(window) for window in (2, 2400, 5010)] == [0, 0, 0 if silent else 1]
    assert retry.waits is False and retry.due is not silent


class Button:
    """Pressed and let go by the time; keeps the orders."""

    def __init__(self, core) -> None:
        self.lib, self.now, self.orders = core.lib, 0, []
        self.button = core.ffi.new("an_button *")
        self.lib.an_button_init(self.button, LOOKS)

    def hold(self, pressed: bool, seconds: float, state: int) -> None:
        for _ in range(round(seconds * LOOKS)):
            self.now += 1
            order = self.lib.an_button_order(self.button, pressed, self.now, state)
            self.orders += [order] if order != NO_ORDER else []


def test_held_at_power_up_it_orders_nothing_until_it_was_let_go(core) -> None:
    button = Button(core)
    button.hold(True, 1.0, IDLE)
    assert button.orders == []
    button.hold(False, 0.03, IDLE)
    button.hold(True, 0.03, IDLE)
    assert button.orders == [START]


@pytest.mark.parametrize(("state", "order"), [(IDLE, START), (RUN, STOP), (IDENTIFY, STOP), (FAULT, CLEAR)])
def test_a_bouncing_press_is_one_order(core, state: int, order: int) -> None:
    button = Button(core)
    button.hold(False, 0.03, state)
    for pressed, seconds in ((True, 1e-3), (False, 5e-3), (True, 15e-3), (False, 1e-3), (True, 0.1), (False, 2e-3)):
        button.hold(pressed, seconds, state)
    assert button.orders == [order]


def test_nothing_starts_within_half_a_second_of_a_clear(core) -> None:
    button = Button(core)
    button.hold(False, 0.03, FAULT)
    button.hold(True, 0.03, FAULT)
    for gap, orders in ((0.1, [CLEAR]), (0.5, [CLEAR, START])):
        button.hold(False, gap, IDLE)
        button.hold(True, 0.03, IDLE)
        assert button.orders == orders
