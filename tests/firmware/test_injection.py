"""What goes wrong, let go wrong at many moments of a run: the outputs rest in time, and stay at rest until somebody clears it.

Here at every so-many-th tick; `python -m firmware.injection` does it at every single one.
"""

from __future__ import annotations

import math

import pytest

from firmware.emulate.plant import Plate, Resonance, hold
from pipeline.board.table_file import Mode, ModeTable, to_bytes

TRUE, TAU = 31437.3, 300.0 / math.pi / 31437.3
DROOP = abs(hold(TRUE, 250e3))
PLATE = Plate((Resonance(TRUE, TAU, 0.8),), delay_s=7.3e-6, noise=1e-3)
KNOWN = to_bytes(ModeTable(250e3, bytes(16), (Mode(TRUE, TAU, -0.8j * DROOP, 9.3e-6, frequency_identified=True),)))
IDLE, IDENTIFY, RUN, FAULT = range(4)
TICKS_100_US, MISMATCH_TICKS, WINDOW_TICKS = 25, round(20e-3 * 250e3), 54


@pytest.fixture
def rig(core):
    from firmware.host.rig import SingleRig

    made = SingleRig(KNOWN, PLATE)
    made.run(5e-3)
    assert made.start(0.15)
    made.run(50e-3)
    assert made.state == RUN
    return made


@pytest.mark.parametrize("fault", [1, 7, 12, 15])
def test_what_an_interrupt_finds_rests_the_output_within_100_us(rig, fault: int) -> None:
    """Clock, lost interrupts, break, supply: as the board's handlers report them."""
    worst = rig.lib.rig_inject(rig.rig, rig.lib.RIG_TRIP, 1 << fault, 25000, 37, TICKS_100_US, 200)
    assert worst <= TICKS_100_US


@pytest.mark.parametrize(
    ("sensor", "most"),
    [("DEAD", MISMATCH_TICKS), ("STUCK", MISMATCH_TICKS), ("REVERSED", MISMATCH_TICKS), ("CLIPPED", 2 * WINDOW_TICKS)],
)
def test_a_broken_sensor_is_found_whenever_it_breaks(rig, sensor: str, most: int) -> None:
    worst = rig.lib.rig_inject(rig.rig, rig.lib.RIG_SENSOR, getattr(rig.lib, f"RIG_{sensor}"), 25000, 211, most, 200)
    assert worst <= most


WORDS = """
    supervisor.state supervisor.inverse supervisor.faults slow.hand.active slow.hand.posted slow.hand.trips
    slow.hand.outside fast.tick fast.phase fast.step fast.faults fast.window.count fast.command.count
    fast.command.step slow.tracking slow.noted track.read probing
"""


@pytest.mark.parametrize("word", WORDS.split())
def test_no_flipped_bit_of_a_state_word_leaves_a_job_that_cannot_be_ended(rig, word: str) -> None:
    """The plate is held as before, or everything rests in a latched fault; either way a stop ends it."""
    saved, reference = rig.save(), 0.15
    *path, name = word.split(".")
    for bit in range(32):
        rig.restore(saved)
        rig.run(bit * 7 * 4e-6)
        place = rig.app
        for part in path:
            place = getattr(place, part)
        setattr(place, name, int(getattr(place, name)) ^ 1 << bit)
        sizes = abs(rig.windows(40e-3)["measured"])
        assert sizes.max() < 0.9, bit
        if rig.state == RUN:
            assert sizes[-20:].mean() == pytest.approx(reference, rel=0.02), bit
            rig.lib.an_single_stop(rig.pointer)
            rig.run(1e-3)
            assert rig.state == IDLE, bit
        else:
            assert rig.state == FAULT and rig.faults, bit
        rig.run(1e-3)
        assert rig.rig.code == 2048, bit
