"""The single-mode application on this machine, joined to a simulated plate: the board's code without the board."""

from __future__ import annotations

from typing import Any

from firmware.emulate.plant import Plate, PlateSimulation, adc_code, dac_level
from firmware.host.hosted import Hosted


class HostedSingle(Hosted):
    """an_single and a plate in lock step: run(ticks) advances both, reports holds (measured, drive, reference) a window."""

    def __init__(self, table: bytes, plate: Plate, seed: int = 1, faults: int = 0, flags: tuple[str, ...] = ()) -> None:
        super().__init__("an_single", "an_single_build", plate.sample_rate_hz, flags)
        self.table = self.ffi.from_buffer("uint8_t[]", table)
        self.fast = self.ffi.addressof(self.app, "fast")
        self.slow = self.ffi.addressof(self.app, "slow")
        self.plate = PlateSimulation(plate, seed)
        self.code = self.lib.AN_DAC_MIDDLE
        self.codes: list[int] | None = None
        self.reports: list[tuple[complex, complex, float]] = []
        self.lib.an_single_boot(self.app, self.table, len(table), plate.sample_rate_hz, faults)

    def tick(self) -> None:
        """One sample period: the converters act together, then the interrupts, then the main loop, woken by any of them."""
        sample = adc_code(self.sense())
        self.plate.drive(dac_level(self.code))
        self.code = self.lib.an_fast_tick(self.fast, sample)
        if self.codes is not None:
            self.codes.append(self.code)
        if self.fast.tick == 0:
            self.lib.an_single_slow(self.app)
        self.poll()
        if self.fast.tick == 0:
            view = self.lib.an_single_view(self.app)
            self.reports.append((_complex(view.measured), _complex(view.drive), view.reference))

    def sense(self) -> float:
        """What reaches the converter; a test may put a broken sensor here."""
        return self.plate.sense()

    def start(self, reference: float = 0.0, detuning_hz: float = 0.0) -> bool:
        """Starts as the application's user would."""
        return self.lib.an_single_start(self.app, reference, detuning_hz)

    @property
    def gain(self) -> complex:
        """The gain the application works with."""
        return _complex(self.app.mode.gain)


def _complex(value: Any) -> complex:
    return complex(value.re, value.im)
