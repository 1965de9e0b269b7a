"""Applications compiled for this machine in lock step with a simulated beam: rows of the fault injection, and tests."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np

from firmware.emulate.images import SixView
from firmware.emulate.plant import CHANNELS, Beam, BeamSimulation, Structure, adc_codes
from firmware.host import Supervised, load


class Orders(Supervised):
    """Commands common to the applications of both builds."""

    ffi: Any
    lib: Any
    build: Any
    main_stuck = False

    @cached_property
    def base(self) -> Any:
        """State common to both builds, for calls."""
        return self.ffi.addressof(self.app, "base")

    def poll(self) -> None:
        """One pass of the main loop, unless it is busy."""
        if self.main_stuck:
            return
        self.lib.an_application_poll(self.base, self.build)

    def stop(self) -> None:
        """Return to rest."""
        self.lib.an_application_stop(self.base)

    def clear(self) -> bool:
        """Leave the fault state; false if that is not allowed."""
        return bool(self.lib.an_application_clear(self.base, self.build))

    def identify(self) -> bool:
        """Measure the plate again."""
        return bool(self.lib.an_application_identify(self.base, self.build))


class Hosted(Orders):
    """An application of either build on this machine, `app` a pointer to its state."""

    def __init__(self, app: str, build: str, sample_rate_hz: float, flags: tuple[str, ...] = ()) -> None:
        self.ffi, self.lib = load(*flags)
        self.app: Any = self.ffi.new(f"{app} *")
        self.build = self.ffi.addressof(self.lib, build)
        self.sample_rate_hz, self.sample_s = sample_rate_hz, 1.0 / sample_rate_hz
        self.hung = False

    def tick(self) -> None:
        """One sample period."""
        raise NotImplementedError

    def run(self, seconds: float) -> None:
        """Advance by a time."""
        for _ in range(round(seconds * self.sample_rate_hz)):
            self.tick()

    def run_while(self, state: int, seconds: float) -> float:
        """Advance while the application stays in a state, up to a limit; returns the time that passed."""
        ticks = 0
        while self.state == state and ticks < round(seconds * self.sample_rate_hz):
            self.tick()
            ticks += 1
        return ticks / self.sample_rate_hz


class HostedSix(SixView, Hosted):
    """an_six and a beam in lock step: run(seconds) advances both."""

    def __init__(
        self, table: bytes, beam: Beam | Structure, seed: int = 1, faults: int = 0, confirmed: bool = True
    ) -> None:
        super().__init__("an_six", "an_six_build", beam.sample_rate_hz)
        self.table = self.ffi.from_buffer("uint8_t[]", table)
        self.fast = self.ffi.addressof(self.app, "fast")
        self.beam = BeamSimulation(beam, seed)
        self.middle, self.swing = self.lib.AN_SIX_DUTY_MIDDLE, self.lib.AN_SIX_DUTY_SWING
        self.samples = self.ffi.new("uint16_t []", CHANNELS)
        self.duties = self.ffi.new("uint16_t []", [self.middle] * CHANNELS)
        self.history: list[list[int]] | None = None
        self.lib.an_six_boot(self.app, self.table, len(table), beam.sample_rate_hz, faults)
        self.app.base.confirmed = confirmed

    def tick(self) -> None:
        """One sample period: sensors and drives together, then the interrupts, then the main loop, woken by any of them."""
        sensed = self.sense()
        self.beam.drive((np.array(list(self.duties), float) - self.middle) / self.swing)
        self.samples[0:CHANNELS] = adc_codes(sensed)
        self.lib.an_six_tick(self.fast, self.samples, self.duties)
        if self.history is not None:
            self.history.append(list(self.duties))
        self.fast.faults |= self.lib.an_six_check(self.app) | self.lib.an_six_look(self.app, self.samples)
        if self.fast.tick == 0:
            self.lib.an_six_window_end(self.app)
        self.poll()

    def pointer(self, _: str) -> int:
        """Address of the application."""
        return int(self.ffi.cast("uintptr_t", self.app))

    @property
    def at_rest(self) -> bool:
        """True while all drives are at the middle of their range."""
        return list(self.duties) == [self.middle] * CHANNELS

    @contextmanager
    def undone(self) -> Iterator[None]:
        """Restore application and beam at the end of the context."""
        app, duties, beam = bytes(self.ffi.buffer(self.app)), list(self.duties), copy.deepcopy(vars(self.beam))
        own = {name: value for name, value in vars(self).items() if name == "sense"}
        yield
        self.ffi.buffer(self.app)[:], self.duties[0:CHANNELS] = app, duties
        vars(self.beam).clear()
        vars(self.beam).update(beam)
        vars(self).pop("sense", None)
        vars(self).update(own)
