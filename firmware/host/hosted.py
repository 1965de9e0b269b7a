"""What the hosted applications share: time, and the orders that anybody may give."""

from __future__ import annotations

from typing import Any

from firmware.host import load

IDLE, IDENTIFY, RUN, FAULT = range(4)


class Hosted:
    """An application of either build on this machine, `app` a pointer to its state."""

    def __init__(self, app: str, build: str, sample_rate_hz: float, flags: tuple[str, ...] = ()) -> None:
        self.ffi, self.lib = load(*flags)
        self.app: Any = self.ffi.new(f"{app} *")
        self.build = self.ffi.addressof(self.lib, build)
        self.sample_rate_hz = sample_rate_hz

    @property
    def base(self) -> Any:
        """What both builds have, for calls."""
        return self.ffi.addressof(self.app, "base")

    @property
    def state(self) -> int:
        """IDLE, IDENTIFY, RUN or FAULT."""
        return int(self.app.base.supervisor.state)

    @property
    def faults(self) -> int:
        """The bits of the latched faults."""
        return int(self.app.base.supervisor.faults)

    def tick(self) -> None:
        """One sample period."""
        raise NotImplementedError

    def run(self, seconds: float) -> None:
        """Advances by a time."""
        for _ in range(round(seconds * self.sample_rate_hz)):
            self.tick()

    def run_while(self, state: int, seconds: float) -> float:
        """Advances while the application stays in a state, at most so long; returns the time that passed."""
        ticks = 0
        while self.state == state and ticks < round(seconds * self.sample_rate_hz):
            self.tick()
            ticks += 1
        return ticks / self.sample_rate_hz

    def poll(self) -> None:
        """One pass of the main loop."""
        self.lib.an_application_poll(self.base, self.build)

    def stop(self) -> None:
        """Back to rest."""
        self.lib.an_application_stop(self.base)

    def clear(self) -> bool:
        """Leaves the fault state; false when it may not be left."""
        return bool(self.lib.an_application_clear(self.base, self.build))

    def identify(self) -> bool:
        """Measures the plate anew."""
        return bool(self.lib.an_application_identify(self.base, self.build))
