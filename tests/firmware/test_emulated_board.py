"""The unmodified image on the emulated board, joined to a plate with neighbours, noise, dead time and 12 bits."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from firmware.emulate.plant import Plate, Resonance
from firmware.injection import BOARD_KINDS, WORDS, bits_of, break_single, breaking, flipping, image_rows, sensor_kinds
from firmware.mode_table import Mode, ModeTable, hold, to_bytes
from firmware.protocol import FAULT, IDENTIFY, IDLE, RUN, Fault

GUESS, TRUE, QUALITY, GAIN = 31400.0, 31437.3, 300.0, 0.8
TAU = QUALITY / math.pi / TRUE
DROOP = abs(hold(TRUE, 250e3))
PERIOD, HALF_WINDOW = 200e-6, 92e-6
NEIGHBOURS = (Resonance(TRUE - 800.0, TAU, 0.03), Resonance(TRUE + 1100.0, TAU, -0.04))
PLATE = Plate((Resonance(TRUE, TAU, GAIN), *NEIGHBOURS), delay_s=7.3e-6, noise=1e-3, offset=0.03)
UNKNOWN = to_bytes(ModeTable(250e3, bytes(16), (Mode.from_quality_factor(GUESS, 260.0, delay_s=2e-6),)))
MEASURED = Mode(TRUE, TAU, -1j * GAIN * DROOP, 9.3e-6, frequency_identified=True)
KNOWN = to_bytes(ModeTable(250e3, bytes(16), (MEASURED,)))


@pytest.fixture
def make_single(make_image, core):
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    from firmware.emulate.images import EmulatedSingle

    def make(table: bytes = KNOWN, plate: Plate = PLATE, **options):
        return EmulatedSingle(make_image(table).elf, plate, **options)

    return make


def test_image_boots_to_rest(make_single) -> None:
    board = make_single()
    board.run(2e-3)
    assert board.state == IDLE and board.faults == 0
    assert bytes(board.received) == b""
    assert board.dac.value == 2048 | 2048 << 16
    assert board.resets == 0


def test_timer_triggers_both_converters_every_four_microseconds(make_single) -> None:
    board = make_single()
    tim2, adc1, dac = 0x40000000, 0x40012000, 0x40007400
    assert (board.word(tim2 + 0x2C).value + 1) * (board.word(tim2 + 0x28).value + 1) == 90e6 * 4e-6
    assert board.word(tim2 + 0x04).value >> 4 & 7 == 2  # its update goes out as the trigger
    assert board.word(adc1 + 0x08).value >> 24 & 0x3F == 0b010110  # rising edge of TIM2_TRGO
    assert board.word(dac).value & 0x3F == board.word(dac).value >> 16 == 0b100101  # on, triggered, by TIM2_TRGO
    assert board.clock.words[0x04] & 0x7FFF == 4 | 180 << 6 and board.clock.words[0x08] & 3 == 2


def test_the_guard_looks_behind_the_fast_interrupt(make_single) -> None:
    """Between the ADC's end of conversion, 216 cycles behind the trigger, with its interrupt, and the next trigger at 720."""
    from tests.helpers.board_probes import record_writes

    board = make_single()
    timer, systick = 0x40000000, 0xE000E010
    writes = record_writes(board, board.reset, (timer, timer + 4), (systick, systick + 12))
    (begun, *_), *own = [write for write in writes if write[1] != timer or write[2] & 1][-5:]
    enabled = next(count for count, address, _ in own if address == systick)
    reloads = [(count, value) for count, address, value in own if address == systick + 4]
    assert [count < enabled for count, _ in reloads] == [True, False] and reloads[1][1] == 10 * 720 - 1
    first = reloads[0][1] + 1 + 2 * (enabled - begun)  # an instruction of code not yet cached takes some two cycles
    assert 216 + 220 < first % 720 < 620


def test_the_amplifier_is_enabled_while_the_board_drives_alone(make_single) -> None:
    """Not at rest, not after a stop, and within a window of a fault; the pin is an output from the start."""
    board = make_single()
    board.run(2e-3)
    board.app.base.confirmed = True
    assert not board.enabled and board.word(0x40020400).value & 3 == 1
    assert board.start(0.1)
    board.run(5e-3)
    assert board.state == RUN and board.enabled
    board.call("an_application_stop", board.symbol("app"))
    board.run(1e-3)
    assert board.state == IDLE and not board.enabled
    assert board.start(0.1)
    board.run(5e-3)
    board.app.fast.faults |= Fault.NOT_FINITE
    board.run(2 * PERIOD)
    assert board.state == FAULT and not board.enabled
    board.run(2e-3)
    assert not board.enabled and board.clear()


def test_the_amplifier_is_disabled_though_the_main_loop_hangs(make_single) -> None:
    board = running(make_single)
    assert board.enabled
    board.main_stuck = True
    board.sense = lambda: 2.0
    board.run(2 * PERIOD)
    assert board.state == RUN and board.app.fast.faults and not board.enabled


@pytest.mark.slow
def test_unidentified_mode_is_swept_and_then_held_at_the_lowest_useful_level(make_single, core) -> None:
    """And the whole sweep, its fits included, is on this machine what it is on the Cortex-M4, bit for bit."""
    from tests.helpers.hosted_boards import HostedSingle

    tau_s = TAU / 3.0  # the sweep takes as long as the plate rings
    unknown = to_bytes(ModeTable(250e3, bytes(16), (Mode.from_quality_factor(GUESS, 87.0, delay_s=2e-6),)))
    plate = replace(PLATE, resonances=(replace(PLATE.resonances[0], tau_s=tau_s),))
    board, hosted = make_single(unknown, plate), HostedSingle(unknown, plate)
    board.run(2e-3)
    hosted.run(2e-3)
    assert board.start()
    assert hosted.start()
    assert board.state == IDENTIFY
    assert board.run_until(lambda: board.state != IDENTIFY, 3.0)
    hosted.run_while(IDENTIFY, 3.0)
    app = board.app
    assert app.base.supervisor.state == RUN, hex(app.base.supervisor.faults)
    assert app.centre / 2**32 * 250e3 == pytest.approx(TRUE, abs=0.1)
    assert app.mode.tau_s == pytest.approx(tau_s, rel=5e-3)
    assert abs(complex(app.mode.gain.re, app.mode.gain.im)) == pytest.approx(GAIN * DROOP, rel=5e-3)
    assert app.mode.delay_s == pytest.approx(9.3e-6, abs=5e-8)
    assert image_of(core, app.ident) == image_of(core, hosted.app.ident)
    board.run(20e-3)
    settled = [measured for measured, _, _ in board.reports[-25:]]
    assert sum(settled) / 25 == pytest.approx(0.2 * GAIN * DROOP, rel=2e-3)


def image_of(core, struct) -> bytes:
    return bytes(core.ffi.buffer(core.ffi.addressof(struct)))


def running(make_single, **options):
    board = make_single(**options)
    board.run(2e-3)
    assert board.start()
    board.app.slow.reference = 0.0
    board.run(30e-3)
    board.reports.clear()
    return board


def test_small_step_of_the_clean_plate(make_single) -> None:
    board = running(make_single, plate=replace(PLATE, resonances=PLATE.resonances[:1], noise=0.0))
    reference = 0.2 * GAIN * DROOP
    board.app.slow.reference = reference
    board.run(20e-3)
    size = [abs(measured) for measured, _, _ in board.reports]
    first = next(i for i, value in enumerate(size) if value >= 0.95 * reference)
    assert (first + 1) * PERIOD - HALF_WINDOW <= 2.0e-3  # from the change of the reference to the middle of the window
    assert max(size) <= 1.02 * reference
    assert size[-1] == pytest.approx(reference, rel=1e-3)


def test_recovery_from_saturation(make_single) -> None:
    board = running(make_single, plate=replace(PLATE, noise=0.0))
    reference = 0.6 * GAIN * DROOP
    board.app.slow.reference = reference
    board.run(20e-3)
    size = [abs(measured) for measured, _, _ in board.reports]
    settled = max(i for i, value in enumerate(size) if abs(value - reference) > 0.05 * reference) + 1
    assert settled * PERIOD <= 1.5 * -TAU * math.log(1.0 - 0.95 * 0.6)
    assert max(abs(drive) for _, drive, _ in board.reports) <= 1.0 + 1e-6


def test_a_lost_sensor_puts_the_output_to_rest(make_single) -> None:
    board = running(make_single)
    board.app.slow.reference = 0.12
    board.run(20e-3)
    board.sense = lambda: 0.0
    assert board.run_until(lambda: board.state == FAULT, 0.1)
    board.run(1e-3)
    assert board.faults == Fault.MISMATCH
    assert board.dac.value == 2048 | 2048 << 16


def test_a_slow_step_that_hangs_rests_the_output_and_then_resets_the_chip(make_single) -> None:
    board = running(make_single)
    board.app.slow.reference = 0.12
    board.run(20e-3)
    board.slow_stuck = True
    board.run(60 * 4e-6)
    assert board.dac.value == 2048 | 2048 << 16
    board.run(15e-3)
    assert board.resets == 1
    assert board.state == FAULT and board.app.base.supervisor.first == Fault.WATCHDOG
    board.slow_stuck = False
    board.run(1e-3)
    assert board.clear()
    board.run(1e-3)
    assert board.state == IDLE and board.faults == 0


def test_a_lost_sample_trips(make_single) -> None:
    board = running(make_single)
    board.word(0x40012000).value = 1 << 5
    board.run(1e-3)
    assert board.state == FAULT and board.faults == Fault.FAST_LATE


def test_a_dead_crystal_ends_in_a_fault_that_cannot_be_cleared(make_single) -> None:
    board = make_single(dead_crystal=True)
    board.run(2e-3)
    assert not board.clear() and not board.start()
    assert board.state == FAULT and board.faults == Fault.CLOCK
    assert board.dac.value == 2048 | 2048 << 16


def test_an_unexpected_interrupt_rests_the_outputs(make_single) -> None:
    board = running(make_single)
    board.app.slow.reference = 0.12
    board.run(10e-3)
    board.uc.emu_start(board.symbol("Unexpected_Handler") | 1, 0, count=100)
    assert board.dac.value == 2048 | 2048 << 16


@pytest.mark.slow
def test_the_stack_is_large_enough(make_single) -> None:
    """The deepest use by the main loop leaves room for both interrupts, their frames of 104 bytes included."""
    from tests.helpers.board_probes import count_instructions, peek, stack_pointer

    board = make_single(UNKNOWN)
    top, size, frame = board.symbol("stack_top"), 2048, 104
    idle = stack_pointer(board)
    paint = bytes([0xA5]) * (idle - (top - size) - 256)
    board.poke(top - size, paint)
    board.run(2e-3)
    assert board.start()
    board.run_until(lambda: board.app.ident.stage == 2 and board.app.ident.index == 32, 3.0)
    counts = count_instructions(
        board, lambda: board.run_until(lambda: board.app.ident.stage == 3, 0.05), "an_ident_answer"
    )
    assert board.app.ident.stage == 3  # behind the fit, which is what goes deepest, and takes the longest
    assert 100_000 < max(counts["an_ident_answer"]) < 400_000  # the watchdog at its fastest allows 1 487 000 cycles
    board.send(bytes(range(1, 120)) + b"\0")
    board.run(5e-3)
    left = peek(board, top - size, len(paint))
    untouched = len(left) - len(left.lstrip(b"\xa5"))
    assert untouched < len(paint)
    assert untouched > 2 * frame + 300


@pytest.mark.slow
def test_instructions_a_tick(make_single) -> None:
    """Counted on the Cortex-M4 code of the image, calls included, no fused contraction."""
    from tests.helpers.board_probes import count_instructions

    board = running(make_single)
    board.app.slow.reference = 0.6  # begins on the drive's limit, ends away from it
    counts = count_instructions(board, lambda: board.run(12e-3), "an_fast_tick", "an_slow_step")
    fast, slow = counts["an_fast_tick"], counts["an_slow_step"]
    assert max(fast) <= 90, fast
    assert max(slow) <= 380, slow
    assert min(fast) > 50 and min(slow) > 100


def test_no_code_is_translated_twice(make_single) -> None:
    """Translating takes five times as long as running: a loop in its steady state needs none."""
    from tests.helpers.board_probes import count_translations

    board = running(make_single)
    board.run(5e-3)  # meets what the noise decides for the first time
    assert count_translations(board, 5e-3) == 0


@pytest.mark.parametrize("detuning_hz", [0.0, 300.0])
def test_host_and_cortex_m4_agree_bit_for_bit(make_single, core, detuning_hz: float) -> None:
    """Identification begun, loop closed, steps up and down: every DAC code and every byte of the state."""
    from tests.helpers.hosted_boards import HostedSingle

    board, hosted = make_single(), HostedSingle(KNOWN, PLATE)
    board.codes, hosted.codes = [], []
    board.run(2e-3)
    hosted.run(2e-3)
    board.app.base.confirmed = True
    assert board.start(0.3, detuning_hz)
    assert hosted.start(0.3, detuning_hz)
    for reference in (0.3, 0.05, 0.7):
        board.app.slow.reference = hosted.app.slow.reference = reference
        board.run(15e-3)
        hosted.run(15e-3)
    assert board.codes[1:] == hosted.codes[: len(board.codes) - 1]
    assert len(set(board.codes)) > 1000
    bytes_alike = core.ffi.offsetof("an_single", "neighbour") + 4  # what follows holds a pointer
    assert bytes(core.ffi.buffer(board.app, bytes_alike)) == bytes(core.ffi.buffer(hosted.app, bytes_alike))


GO_WRONG = BOARD_KINDS | sensor_kinds(break_single)


@pytest.mark.parametrize("what", GO_WRONG)
def test_the_output_rests_within_100_us_of_what_an_interrupt_can_see(make_single, what: str) -> None:
    """At seven ticks of a window; main loop and slow step may be busy."""
    board = running(make_single)
    board.app.slow.reference = 0.12
    board.run(5e-3)
    (row,) = image_rows(board, {what: breaking(GO_WRONG[what])}, 7 * 9 * board.sample_s, 9)
    assert row.moments == 7 and row.is_sound, row.text


def test_no_flipped_bit_leaves_the_image_a_job_that_cannot_be_ended(make_single, core) -> None:
    board = running(make_single)
    board.app.slow.reference = 0.12
    board.run(5e-3)
    flips = {"flipped bit": flipping(bits_of(core.ffi, "an_single", WORDS))}
    (row,) = image_rows(board, flips, 12 * 9 * board.sample_s, 9)
    assert row.moments == 12 and row.is_sound, row.text
    assert row.latched and row.held  # both kinds were among them
