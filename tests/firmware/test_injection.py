"""What goes wrong, let go wrong at many moments of a run: the outputs rest in time, and stay at rest until somebody clears it.

Here at every 199th tick of a tenth of a second on the rig, a number without a common divisor with the ticks of a window and of
a look of the guard; the slow test, as `python -m firmware.injection` does, at every single one.
"""

from __future__ import annotations

from typing import Any

import pytest

from firmware import injection, injection_jobs, injection_rig, injection_six
from firmware.build import BuildError
from firmware.closed_loop import held_plate
from firmware.emulate.plant import Beam, measured_table
from firmware.injection import SIX_WORDS, WORDS
from firmware.mode_table import Mode, ModeTable, Pattern, Shape, to_bytes
from firmware.protocol import FAULT, IDENTIFY, IDLE, RUN, Fault, fault_names
from tests.helpers.hosted_boards import HostedSix, Rig, restore, save


@pytest.fixture
def rig(core):
    return injection_rig.held()


def check(seconds: float, stride: int) -> None:
    rows = list(injection_rig.rig_rows(seconds, stride))
    flips, swinging = 1, len(injection_rig.LATER) * len(injection_rig.SWINGS)
    assert len(rows) == len(injection_rig.TRIPS) + len(injection_rig.SENSORS) + swinging + flips
    for row in rows:
        assert row.moments == -(-round(seconds * 250e3) // stride) and row.is_sound, row.text
    assert rows[-1].latched and rows[-1].held  # bits of both kinds were among them


def test_whatever_breaks_at_whatever_moment_ends_at_rest(core) -> None:
    check(0.1, 199)


@pytest.mark.slow
def test_whatever_breaks_at_every_tick_ends_at_rest(core) -> None:
    check(1.0, 1)


def check_jobs(seconds: float, stride: int) -> None:
    rows = list(injection_jobs.rows(seconds, stride))
    assert len(rows) == 1 + 2 + len(injection_rig.LATER) + 1 + len(injection_rig.TRIPS) + 2
    for row in rows:
        assert row.moments >= 5 and row.is_sound, row.text
    assert rows[-1].latched and rows[-1].held


@pytest.mark.slow
def test_lifts_softening_plates_retries_and_chirps_end_as_they_should(core) -> None:
    check_jobs(0.01, 37)


@pytest.mark.slow
def test_lifts_softening_plates_retries_and_chirps_at_many_moments(core) -> None:
    check_jobs(1.0, 1)


@pytest.mark.slow
def test_six_channels_end_as_they_should(core) -> None:
    rows = [
        injection_six.lift_row(1, 17),
        injection_six.softening_row("stiffens", -1.0, 1, 17),
        *injection_six.measuring_rows(0.005, 37),
    ]
    for row in rows:
        assert row.moments and row.is_sound, row.text
    assert len(rows) == 2 + len(injection_rig.TRIPS) + 2


@pytest.mark.slow
def test_six_channels_end_as_they_should_at_many_moments(core) -> None:
    rows = list(injection_six.rows(0.25))
    for row in rows:
        assert row.moments and row.is_sound, row.text
    assert len(rows) == 3 + 3 + 1 + len(injection_rig.TRIPS) + 2
    assert rows[-1].latched and rows[-1].held


@pytest.mark.slow
def test_six_channels_that_leave_their_level_are_not_taken_for_held(core, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rows' own judgement: less room than the lift takes, a plate that is lost, a failed sensor and no time."""
    monkeypatch.setattr(injection_six, "LIFTED_MOST", 1.0)
    assert not injection_six.lift_row(1, 17).is_sound
    assert not injection_six.softening_row("softens", 30.0, 1, 17).is_sound
    monkeypatch.setattr(injection_six, "FOUND", 1.0)
    assert not injection_six.retry_row("dead", 1, 17).is_sound


@pytest.mark.slow
def test_a_lift_that_overshoots_is_not_taken_for_held(core, monkeypatch: pytest.MonkeyPatch) -> None:
    """The rows' own judgement: less room than the lift takes, a plate that is lost, a hand that lets no try end in time."""
    monkeypatch.setattr(injection_jobs, "LIFTED_MOST", 1.0)
    assert not injection_jobs.lift_row(3, 199).is_sound
    assert not injection_jobs.softening_row("softens", 30.0, 3, 199).is_sound
    monkeypatch.setattr(injection_jobs, "TRIES_S", 1e-4)
    assert not list(injection_jobs.retry_rows(1e-3, 37))[-1].is_sound


@pytest.mark.slow
def test_whatever_breaks_on_the_images_ends_at_rest(core) -> None:
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    try:
        rows = list(injection.board_rows(0.2, 101, 17))
    except BuildError as missing:
        pytest.skip(str(missing))
    assert len(rows) == 2 * (len(injection.BOARD_KINDS) + len(injection_rig.SENSORS) + 1) + 1  # the break line too
    for row in rows:
        assert row.is_sound, row.text


@pytest.mark.slow
def test_a_bit_that_was_found_at_the_end_of_its_window_is_found_in_time(core) -> None:
    """The bit that chooses the sums of a window, flipped 25 ticks before its end, in a second's injection."""
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    try:
        _, six = injection.held_images()
    except BuildError as missing:
        pytest.skip(str(missing))
    growing = injection_rig.bits_of(core.ffi, "an_six", ["fast.growing"])
    six.run((13107 + 17) * six.sample_s)
    assert six.state == RUN
    with six.undone():
        ending = injection.flipping(growing[1:2])(six, 13107)
    assert ending.latched and ending.late <= 4, ending


def test_an_output_that_passes_its_middle_is_not_taken_for_rest(core, rig) -> None:
    """The rig's own judgement: what no guard stops is told as unsafe."""
    result = injection_rig.inject(rig, rig.lib.RIG_TRIP, [0], 0.01, 37, injection_rig.SOON, injection_rig.FURTHER)
    assert result.latched == result.held == 0 and result.unsafe == 68


def test_a_plate_that_moves_further_than_allowed_is_not_taken_for_safe(core) -> None:
    """The rig's own judgement again, at every moment: less room than the sound run itself has."""
    rig = injection_rig.held(swings=True)
    dead = [rig.lib.RIG_DEAD]
    result = injection_rig.inject(rig, rig.lib.RIG_SENSOR, dead, 0.02, 37, injection_rig.LATER["dead"], 0.5)
    assert result.unsafe and result.latched  # around the swing's top, and around its bottom
    assert result.broken.motion / result.sound.motion == pytest.approx(1.0, abs=0.05)
    assert result.sound.motion == pytest.approx(injection_rig.LEVEL, rel=0.05)
    assert result.sound.drive < result.broken.drive < 1.0


def flip(app: Any, word: str, bit: int) -> None:
    *path, name = word.split(".")
    for part in path:
        app = getattr(app, part)
    setattr(app, name, int(getattr(app, name)) ^ 1 << bit)


@pytest.mark.parametrize("word", WORDS)
def test_no_flipped_bit_of_a_state_word_leaves_a_job_that_cannot_be_ended(rig, word: str) -> None:
    """The plate is held as before, or everything rests in a latched fault; either way a stop ends it."""
    saved, reference = save(rig), 0.15
    for bit in range(32):
        restore(rig, saved)
        rig.run(bit * 7 * 4e-6)
        flip(rig.app, word, bit)
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


MEASURING = [*WORDS, "ident.stage", "ident.index", "ident.points", "ident.rounds", "ident.best"]


@pytest.fixture(scope="module")
def measuring(core):
    """A rig that looks for the resonance, and the moments of its coarse sweep, its fine one and the survey."""
    _, plate = held_plate(100.0, noise=1e-3)
    guess = Mode.from_quality_factor(plate.resonances[0].frequency_hz - 60.0, 90.0, delay_s=2e-6)
    rig, moments = Rig(to_bytes(ModeTable(250e3, bytes(16), (guess,))), plate), []
    rig.run(5e-3)
    assert rig.start()
    for stage in (rig.lib.AN_IDENT_COARSE, rig.lib.AN_IDENT_FINE, rig.lib.AN_IDENT_SURVEY):
        while rig.app.ident.stage != stage or rig.app.ident.index < 2:
            assert rig.state == IDENTIFY
            rig.run(1e-3)
        moments.append(save(rig))
    return rig, moments


@pytest.mark.parametrize("word", MEASURING)
def test_no_flipped_bit_leaves_a_measurement_that_cannot_be_ended(measuring, word: str) -> None:
    rig, moments = measuring
    for saved in moments:
        for bit in range(32):
            restore(rig, saved)
            rig.run(bit * 7 * 4e-6)
            flip(rig.app, word, bit)
            rig.run(30e-3)
            ends_at_rest(rig, lambda: rig.rig.code == 2048, bit)


def ends_at_rest(board: Any, is_at_rest: Any, bit: int) -> None:
    """A stop ends what still drives; what does not is a latched fault."""
    drives = board.state in (RUN, IDENTIFY)
    assert drives or (board.state == FAULT and board.faults), bit
    board.stop()
    board.app.base.fade_s = min(board.app.base.fade_s, 1e-3)
    board.run(5e-3)
    assert is_at_rest(), bit
    assert board.state == (IDLE if drives else FAULT), (bit, hex(board.faults))


@pytest.fixture(scope="module")
def six(core):
    """Six channels that hold a pattern, and that measure their matrix, each at a moment that is come back to."""
    beam, boards = Beam(noise=1e-3), []
    shape = Shape(beam.frequency_hz, beam.slowest_s, (Pattern("all", (1,) * 6),))
    unknown = to_bytes(ModeTable(beam.sample_rate_hz, bytes(16), (), shapes=(shape,)))
    for table, state in ((measured_table(beam), RUN), (unknown, IDENTIFY)):
        board = HostedSix(table, beam)
        board.run(5e-3)
        assert board.lib.an_six_start(board.app, 0, 0.1)
        board.run(60e-3)
        assert board.state == state
        boards.append(board)
    return boards


@pytest.mark.parametrize("word", ["state", "inverse"])
def test_a_damaged_state_is_found_while_a_job_waits(six, word: str) -> None:
    """The main loop decides nothing then, for up to a window of 1.25 ms: outputs rest within 100 us all the same."""
    board = six[1]
    with board.undone():
        while board.lib.an_handover_vacant(board.ffi.addressof(board.app.slow.hand)):
            board.tick()
        flip(board.app, f"base.supervisor.{word}", 2)
        board.run(100e-6)
        assert board.at_rest
        board.run(5e-3)
        assert board.state == FAULT and board.faults == Fault.MEMORY and board.at_rest


@pytest.mark.parametrize("word", SIX_WORDS)
@pytest.mark.parametrize(
    "bits", [(0, 1, 2, 3, 5, 31), pytest.param(range(32), marks=pytest.mark.slow)], ids=["some", "all"]
)
def test_no_flipped_bit_leaves_six_channels_a_job_that_cannot_be_ended(six, word: str, bits: Any) -> None:
    for board in six:
        app, beam, duties = bytes(board.ffi.buffer(board.app)), board.beam.state, list(board.duties)
        drives = board.state
        for bit in bits:
            board.run(bit * 3 * 25e-6)
            assert board.state == drives and board.fast.faults == 0, bit
            flip(board.app, word, bit)
            board.run(5e-3)
            assert not any(abs(z) > 0.9 for z in board.measured) or board.state == FAULT, bit
            ends_at_rest(board, lambda own=board: list(own.duties) == [own.middle] * 6, bit)
            board.ffi.buffer(board.app)[:], board.beam.state, board.duties[0:6] = app, beam, duties


def test_the_page_has_the_rows_of_the_command_all_in_time() -> None:
    """Of every injected fault, at the stride that the page states."""
    text = injection.SAFETY.read_text()
    table = text[text.index(injection_rig.HEAD) : text.index("<!-- end -->")].splitlines()[2:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table]
    names = [name.partition(" (")[0] for name, *_ in rows]
    faults = [fault_names(fault)[0] for fault in injection_rig.TRIPS] + [
        f"sensor {how}" for how in injection_rig.SENSORS
    ]
    assert {*faults} <= {*names} and len(names) == len({*names}) and sum("image, " in name for name in names) > 20
    for _, counts, times, *_ in rows:
        longest, allowed = map(int, times.split("/"))
        assert longest <= allowed and sum(map(int, counts.split("/"))) > 0
