"""The single-mode image on the emulated board, connected to a simulated plate by ADC and DAC."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from firmware.emulate.board import Chip, EmulatedBoard
from firmware.emulate.plant import Plate, PlateSimulation, adc_code, dac_level
from firmware.host import load
from firmware.protocol import RUN

TIM2, ADC_SR, ADC_DR, DAC_RD = 0x40000000, 0x40012000, 0x4001204C, 0x40007420
OVERRUN = 1 << 5


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
