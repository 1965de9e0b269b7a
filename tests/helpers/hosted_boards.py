"""Firmware applications compiled for this machine, driven by tests with a plate or beam in Python, or on the rig in C."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from firmware.closed_loop import SingleRig
from firmware.emulate.plant import CHANNELS, Plate, PlateSimulation, adc_code, dac_level
from firmware.host.hosted import Hosted, HostedSix, Orders


class HostedSingle(Hosted):
    """an_single and a plate in lock step: run(ticks) advances both; reports holds (measured, drive, reference) per window."""

    def __init__(
        self,
        table: bytes,
        plate: Plate,
        seed: int = 1,
        faults: int = 0,
        flags: tuple[str, ...] = (),
        confirmed: bool = True,
    ) -> None:
        super().__init__("an_single", "an_single_build", plate.sample_rate_hz, flags)
        self.table = self.ffi.from_buffer("uint8_t[]", table)
        self.fast = self.ffi.addressof(self.app, "fast")
        self.slow = self.ffi.addressof(self.app, "slow")
        self.plate = PlateSimulation(plate, seed)
        self.code = self.lib.AN_DAC_MIDDLE
        self.ticks = 0
        self.codes: list[int] | None = None
        self.reports: list[tuple[complex, complex, float]] = []
        self.lib.an_single_boot(self.app, self.table, len(table), plate.sample_rate_hz, faults)
        self.app.base.confirmed = confirmed

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
        self.ticks += 1
        if self.ticks % self.lib.AN_WATCH_TICKS == 0:
            self.fast.faults |= self.lib.an_single_check(self.app)
            self.poll()
        if self.fast.tick == 0:
            view = self.lib.an_single_view(self.app)
            self.reports.append((_complex(view.measured), _complex(view.drive), view.reference))

    def sense(self) -> float:
        """Signal at the converter; a test may replace it by a broken sensor."""
        return self.plate.sense()

    def start(self, reference: float = 0.0, detuning_hz: float = 0.0) -> bool:
        """Start the application."""
        return self.lib.an_single_start(self.app, reference, detuning_hz)

    @property
    def gain(self) -> complex:
        """Gain that the application uses."""
        return _complex(self.app.mode.gain)


def _complex(value: Any) -> complex:
    return complex(value.re, value.im)


class Rig(Orders, SingleRig):
    """Rig with commands, a finger, and saved states."""

    def __init__(self, table: bytes, plate: Plate, seed: int = 1, faults: int = 0, confirmed: bool = True) -> None:
        super().__init__(table, plate, seed, faults, confirmed)
        self.build = self.ffi.addressof(self.lib, "an_single_build")

    def touch(self, quality_factor_share: float, shift_hz: float, first: Plate) -> None:
        """Put a finger on the plate: its first resonance is damped and shifted, force and mass stay."""
        mode = first.resonances[0]
        touched = replace(
            mode,
            frequency_hz=mode.frequency_hz + shift_hz,
            tau_s=mode.tau_s * quality_factor_share,
            gain=mode.gain * quality_factor_share,
        )
        self.set_plate(replace(first, resonances=(touched, *first.resonances[1:])))

    def run_while(self, state: int, seconds: float, every_s: float = 2e-3) -> float:
        """Advance while the application stays in a state, up to a limit; returns the time that passed."""
        elapsed_s = 0.0
        while elapsed_s < seconds and self.state == state:
            self.run(every_s)
            elapsed_s += every_s
        return elapsed_s

    def set_reference(self, reference: float) -> None:
        """Set a new reference while running."""
        self.lib.an_single_set_reference(self.pointer, reference)

    @property
    def frequency_hz(self) -> float:
        """Resonance currently estimated by the application."""
        return float(self.lib.an_single_frequency(self.pointer))


def save(rig: SingleRig) -> bytes:
    """Save the whole state for `restore`."""
    return bytes(rig.ffi.buffer(rig.rig))


def restore(rig: SingleRig, saved: bytes) -> None:
    """Restore a saved state."""
    rig.ffi.buffer(rig.rig)[:] = saved


class RigPort:
    """Serial line of a rig, with the write and read of pyserial: bytes take their time, and a read one millisecond."""

    BYTE_S = 10.0 / 921600.0

    def __init__(self, rig: Rig | HostedSix) -> None:
        ffi, lib = rig.ffi, rig.lib
        self.rig, self.lib, self.link = rig, lib, ffi.new("an_link *")
        self.capture = ffi.addressof(rig.rig, "capture") if isinstance(rig, Rig) else ffi.new("an_capture *")
        lib.an_capture_init(self.capture, 1 if isinstance(rig, Rig) else CHANNELS)
        lib.an_link_init(self.link, rig.base, rig.build, self.capture)
        self.received = b""
        self.elapsed_s = 0.0

    def write(self, data: bytes) -> int:
        """Send bytes to the board."""
        for byte in data:
            self.lib.an_link_feed(self.link, byte)
            if self.link.out_length:
                self.received += bytes(self.link.out[0 : self.link.out_length])
                self.link.out_length = 0
        self._pass(len(data) * self.BYTE_S)
        return len(data)

    def read(self, size: int = 1) -> bytes:
        """Return bytes sent by the board, at most `size`."""
        taken, self.received = self.received[:size], self.received[size:]
        self._pass(1e-3 + len(taken) * self.BYTE_S)
        return taken

    def _pass(self, seconds: float) -> None:
        self.rig.run(seconds)
        self.elapsed_s += seconds
