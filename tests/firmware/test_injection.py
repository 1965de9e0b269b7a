"""What goes wrong, let go wrong at many moments of a run: the outputs rest in time, and stay at rest until somebody clears it.

Here at every 199th tick of a tenth of a second on the rig, a number without a common divisor with the ticks of a window and of
a look of the guard; the slow test, as `python -m firmware.injection` does, at every single one.
"""

from __future__ import annotations

import pytest

from firmware import injection
from firmware.injection import WORDS
from firmware.protocol import FAULT, IDLE, RUN
from tests.helpers.hosted_boards import restore, save


@pytest.fixture
def rig(core):
    return injection.held()


def check(seconds: float, stride: int) -> None:
    rows = list(injection.rig_rows(seconds, stride))
    assert len(rows) == len(injection.TRIPS) + 2 * len(injection.SENSORS)  # three of them also while the level swings
    for row in rows:
        assert row.moments == -(-round(seconds * 250e3) // stride) and row.is_sound, row.text
    assert rows[-1].latched and rows[-1].held  # bits of both kinds were among them


def test_whatever_breaks_at_whatever_moment_ends_at_rest(core) -> None:
    check(0.1, 199)


@pytest.mark.slow
def test_whatever_breaks_at_every_tick_ends_at_rest(core) -> None:
    check(1.0, 1)


def test_an_output_that_passes_its_middle_is_not_taken_for_rest(core, rig) -> None:
    """The rig's own judgement: what no guard stops is told as unsafe."""
    result = injection.inject(rig, rig.lib.RIG_TRIP, [0], 0.01, 37, injection.SOON)
    assert result.latched == result.held == 0 and result.unsafe == 68


@pytest.mark.parametrize("word", WORDS)
def test_no_flipped_bit_of_a_state_word_leaves_a_job_that_cannot_be_ended(rig, word: str) -> None:
    """The plate is held as before, or everything rests in a latched fault; either way a stop ends it."""
    saved, reference = save(rig), 0.15
    *path, name = word.split(".")
    for bit in range(32):
        restore(rig, saved)
        rig.run(bit * 7 * 4e-6)
        place = rig.app
        for part in path:
            place = getattr(place, part)
        setattr(place, name, int(getattr(place, name)) ^ 1 << bit)
        sizes = abs(rig.windows(40e-3)["measured"])
        assert sizes.max() < 0.9, bit
        if rig.state == RUN:
            assert sizes[-20:].mean() == pytest.approx(reference, rel=0.02), bit
            rig.lib.an_application_stop(rig.ffi.addressof(rig.app, "base"))
            rig.run(1e-3)
            assert rig.state == IDLE, bit
        else:
            assert rig.state == FAULT and rig.faults, bit
        rig.run(1e-3)
        assert rig.rig.code == 2048, bit
