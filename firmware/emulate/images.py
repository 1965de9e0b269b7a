"""The images of both builds on the emulated board, connected by their converters to a simulated plate and a simulated beam."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from firmware.emulate.board import Chip, EmulatedBoard
from firmware.emulate.plant import (
    CHANNELS,
    Beam,
    BeamSimulation,
    Plate,
    PlateSimulation,
    Structure,
    adc_code,
    adc_codes,
    dac_level,
)
from firmware.host import load
from firmware.protocol import RUN

TIM2, ADC_SR, ADC_DR, DAC_RD = 0x40000000, 0x40012000, 0x4001204C, 0x40007420
OVERRUN = 1 << 5
GPIOB_MODER, GPIOB_ODR = 0x40020400, 0x40020414

TIM1, TIM8 = 0x40010000, 0x40010400
CR1, DIER, SR, ARR, CCR1, BDTR = 0x00, 0x0C, 0x10, 0x2C, 0x34, 0x44
BREAK_ENABLED, BREAK_HIGH = 1 << 12, 1 << 13
BREAK_PULLS = {TIM1: (0x4002040C, 24), TIM8: (0x4002000C, 12)}  # PUPDR of PB12 and of PA6, first bit
BREAK_LINES = {TIM1: 24, TIM8: 43}
BREAK_HANDLERS = {TIM1: "TIM1_BRK_TIM9_IRQHandler", TIM8: "TIM8_BRK_TIM12_IRQHandler"}
DMA_FLAGS, DMA_CLEAR = 0x40026400, 0x40026408  # DMA2
SCAN_LEFT, SCAN_MEMORY = 0x40026410 + 0x04, 0x40026410 + 0x0C  # stream 0 of DMA2
HALF_WAY, COMPLETE = 1 << 4, 1 << 5  # of the stream's two scans
GATES, BREAK_SEEN = 1 << 15, 1 << 7
SWING = 1080 / 1125  # of the supply, at full drive


class EmulatedPort:
    """Serial port of an emulated board, for a Client; each read waits one millisecond of the board's time."""

    def __init__(self, board: EmulatedBoard) -> None:
        self.board = board

    def write(self, data: bytes) -> int:
        """Send bytes to the board."""
        self.board.send(data)
        return len(data)

    def read(self, size: int = 1) -> bytes:
        """Return bytes sent by the board, at most `size`."""
        self.board.run(1e-3)
        taken = bytes(self.board.received[:size])
        del self.board.received[:size]
        return taken


class EmulatedSingle(EmulatedBoard):
    """Board with the application as `app`; reports holds (measured, drive, reference) for each window."""

    WORLD = ("plate",)

    def __init__(self, image: Path, plate: Plate, seed: int = 1, **options: Any) -> None:
        self.plate = PlateSimulation(plate, seed)
        self.codes: list[int] | None = None
        self.stalls: list[tuple[bool, int]] = []  # while the flash memory is busy: timer on, DAC code
        self.reports: list[tuple[complex, complex, float]] = []
        super().__init__(image, plate.sample_rate_hz, Chip(**options))
        ffi, _ = load()
        self.app = ffi.cast("an_single *", self.pointer("app"))
        self.on_window = self._report
        self.dac, self.adc, self.timer = self.word(DAC_RD), self.word(ADC_DR), self.word(TIM2)

    def sense(self) -> float:
        """Return the signal at the converter; a test may substitute a failed sensor."""
        return self.plate.sense()

    @property
    def enabled(self) -> bool:
        """True while PB0, an output, enables the amplifier."""
        return self.word(GPIOB_MODER).value & 3 == 1 and bool(self.word(GPIOB_ODR).value & 1)

    @property
    def at_rest(self) -> bool:
        """True while both DAC channels are at mid-scale."""
        return self.dac.value == 2048 | 2048 << 16

    def start(self, reference: float = 0.0, detuning_hz: float = 0.0) -> bool:
        """Start as the button or a host would."""
        return self.call("an_single_start", self.symbol("app"), reference, detuning_hz) == 1

    def _exchange(self) -> bool:
        if not self.timer.value & 1:
            raise RuntimeError("the image stopped its timer, so that no interrupt can wake it")
        sample = adc_code(self.sense())
        code = self.dac.value & 0xFFF
        self.plate.drive(dac_level(code))
        if self.codes is not None:
            self.codes.append(code)
        self.adc.value = sample
        if self.fast_lost:  # the next sample overwrites this one before it is read
            self.word(ADC_SR).value |= OVERRUN
        return True

    def _stall(self, seconds: float) -> None:
        self.stalls.append((bool(self.timer.value & 1), self.dac.value & 0xFFF))
        super()._stall(seconds)

    def _report(self) -> None:
        slow, running = self.app.slow, self.state == RUN
        measured, drive = slow.measured.tone, slow.pi.drive
        self.reports.append(
            (
                complex(measured.re, measured.im),
                complex(drive.re, drive.im) if running else 0j,
                slow.pi.reference if running else 0.0,
            )
        )


class SixView:
    """View of a six-channel application `app` with a simulated `beam`, on the host or on the emulated board."""

    app: Any
    beam: BeamSimulation

    def sense(self) -> np.ndarray:
        """Return the signals at the converters; a test may substitute failed sensors."""
        return self.beam.sense()

    @property
    def measured(self) -> np.ndarray:
        """Six phasors of the last window."""
        return np.array([complex(z.re, z.im) for z in self.app.slow.measured])

    @property
    def drives(self) -> np.ndarray:
        """Six drives of the last command."""
        return np.array([complex(z.re, z.im) for z in self.app.slow.drive])


class EmulatedSix(SixView, EmulatedBoard):
    """Board with the application object accessible as `app`; open bridges drive nothing."""

    FAST_HANDLER = "DMA2_Stream0_IRQHandler"
    BUILD = "an_six_build"
    WORLD = ("beam", "pulled", "unwired")

    def __init__(self, image: Path, beam: Beam | Structure, seed: int = 1, **options: Any) -> None:
        self.beam = BeamSimulation(beam, seed)
        self.history: list[list[int]] | None = None
        self.pulled = dict.fromkeys(BREAK_LINES, 0)  # ticks for which a comparator lets its line go
        self.unwired = dict.fromkeys(BREAK_LINES, False)  # break lines without a comparator
        self.stalls: list[bool] = []  # while the flash memory is busy: bridges driving
        super().__init__(image, beam.sample_rate_hz, Chip(**options))
        ffi, _ = load()
        self.app = ffi.cast("an_six *", self.pointer("app"))
        self.compare = [self.word(timer + CCR1 + 4 * i) for timer in (TIM1, TIM8) for i in range(3)]
        self.gates = [self.word(timer + BDTR) for timer in (TIM1, TIM8)]
        self.pull_ups = {timer: self.word(address) for timer, (address, _) in BREAK_PULLS.items()}
        self.timer, self.top = self.word(TIM1 + CR1), self.word(TIM1 + ARR)
        self.stream = [self.word(at) for at in (SCAN_LEFT, DMA_FLAGS, DMA_CLEAR, SCAN_MEMORY)]
        self.samples = [2048] * CHANNELS  # last scan

    @property
    def driving(self) -> bool:
        """True while the gates of both timers are closed."""
        return all(gate.value & GATES for gate in self.gates)

    @property
    def at_rest(self) -> bool:
        """True while all twelve switches are open."""
        return not any(gate.value & GATES for gate in self.gates)

    def start(self, pattern: int = 0, reference: float = 0.0) -> bool:
        """Start as the button or a host would."""
        return self.call("an_six_start", self.symbol("app"), pattern, reference) & 0xFF == 1

    def pull_break(self, timer: int = TIM1, ticks: int = 1) -> None:
        """Let a break line go, as the power stage's comparator does at overcurrent; the timer opens its gates at once.

        The line stays high for the given ticks, during which the flag cannot be cleared and the gates cannot be
        closed. A comparator holds it low while all is well; without one, only a pull-up makes it high.
        """
        self.pulled[timer] = ticks
        self._serve_breaks()

    def _serve_breaks(self) -> None:
        for (timer, line), gate in zip(BREAK_LINES.items(), self.gates, strict=True):
            if gate.value & BREAK_ENABLED and self._is_high(timer) == bool(gate.value & BREAK_HIGH):
                gate.value &= ~GATES
                self.word(timer + SR).value |= BREAK_SEEN
            seen = self.word(timer + SR).value & self.word(timer + DIER).value & BREAK_SEEN
            if seen and self.is_enabled(line):
                self.interrupt(self.symbol(BREAK_HANDLERS[timer]))

    def _is_high(self, timer: int) -> bool:
        """Level of a break line: its comparator's, or without one, that of the chip's pull-up."""
        pulled_up = self.pull_ups[timer].value >> BREAK_PULLS[timer][1] & 3 == 1
        return pulled_up if self.unwired[timer] else self.pulled[timer] > 0

    def tick(self) -> None:
        super().tick()
        self._serve_breaks()
        if any(self.pulled.values()):
            self.pulled = {timer: max(left - 1, 0) for timer, left in self.pulled.items()}

    def _stall(self, seconds: float) -> None:
        self.stalls.append(self.driving)
        super()._stall(seconds)

    def _exchange(self) -> bool:
        if not self.timer.value & 1:
            raise RuntimeError("the image never started its timers, so that no interrupt can wake it")
        sensed = self.sense()
        duties = [word.value for word in self.compare]
        middle = self.top.value / 2.0
        levels = (np.array(duties) - middle) / (SWING * middle) if self.driving else np.zeros(CHANNELS)
        self.beam.drive(levels)
        if self.history is not None:
            self.history.append(duties)
        return self._scan(adc_codes(sensed))

    def _scan(self, codes: list[int]) -> bool:
        """Fill the next half of the stream's buffer, unless ADC and DMA have stalled."""
        left, flags, clear, memory = self.stream
        if left.value not in (CHANNELS, 2 * CHANNELS):
            return False
        first = left.value == 2 * CHANNELS
        self.poke(memory.value + (0 if first else 2 * CHANNELS), struct.pack("<6H", *codes))
        self.samples = codes
        left.value = CHANNELS if first else 2 * CHANNELS
        flags.value = flags.value & ~clear.value | (HALF_WAY if first else COMPLETE)
        clear.value = 0
        return True
