"""The single-mode application with a plate simulated in C: a second of the board's time takes some ten milliseconds.

The rig serves studies with many runs: the tables of docs/bring-up.md, fault injection, fingers and drifting plates.
Where host and board are compared bit for bit, tests/helpers/hosted_boards.py and the emulated board share a plate in
Python instead.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware.emulate.plant import Plate, PlateSimulation
from firmware.host import Supervised, load

SOUND, DEAD, STUCK, REVERSED, CLIPPED = range(5)
FIELDS = ("measured_re", "measured_im", "drive_re", "drive_im", "reference", "motion")


class SingleRig(Supervised):
    """an_single and a Plate in lock step; windows() returns the values at the end of each window."""

    def __init__(self, table: bytes, plate: Plate, seed: int = 1, faults: int = 0) -> None:
        self.ffi, self.lib = load()
        self.sample_rate_hz = plate.sample_rate_hz
        self.table = self.ffi.from_buffer("uint8_t[]", table)
        self.rig: Any = self.ffi.new("rig_single *")
        self.app = self.rig.app
        self.plate = plate
        self.rig.code = self.lib.AN_DAC_MIDDLE
        self.rig.plate.random = 88172645463325252 + seed
        self.rig.plate.sensitivity = 1.0
        self.set_plate(plate)
        self.lib.an_single_boot(self.ffi.addressof(self.app), self.table, len(table), plate.sample_rate_hz, faults)

    @property
    def pointer(self) -> Any:
        """Pointer to the application, for calls."""
        return self.ffi.addressof(self.app)

    def set_plate(self, plate: Plate) -> None:
        """Replace the coefficients of the plate; its motion continues."""
        simulation, target = PlateSimulation(plate), self.rig.plate
        target.count = len(plate.resonances)
        target.whole = len(simulation.line) - 2
        columns = {
            "decay": simulation.decays,
            "fresh": simulation.push_new,
            "stale": simulation.push_old,
            "residue": simulation.residues,
        }
        for name, values in columns.items():
            for index, value in enumerate(values):
                getattr(target, name)[index] = [value.real, value.imag]
        target.feedthrough, target.offset, target.noise = plate.feedthrough, plate.offset, plate.noise
        self.plate = plate

    def run(self, seconds: float) -> None:
        """Advance by a time."""
        self.lib.rig_run(self.rig, round(seconds * self.plate.sample_rate_hz), self.ffi.NULL, 0)

    def windows(self, seconds: float) -> dict[str, NDArray[Any]]:
        """Advance by a time and record every window.

        Returns
        -------
        dict of str to ndarray, shape (windows,)
            measured and drive (complex), reference and motion as fractions of full scale, state, limited.
        """
        ticks = round(seconds * self.plate.sample_rate_hz)
        room = ticks // self.lib.AN_PERIOD + 2
        buffer = self.ffi.new("rig_window []", room)
        count = self.lib.rig_run(self.rig, ticks, buffer, room)
        kind = np.dtype([*((name, "f8") for name in FIELDS), ("state", "u4"), ("limited", "u4")])
        rows = np.frombuffer(self.ffi.buffer(buffer), kind, count)
        return {
            "measured": rows["measured_re"] + 1j * rows["measured_im"],
            "drive": rows["drive_re"] + 1j * rows["drive_im"],
            **{name: rows[name].copy() for name in ("reference", "motion", "state", "limited")},
        }

    def start(self, reference: float = 0.0, detuning_hz: float = 0.0) -> bool:
        """Start as a user of the application would."""
        return bool(self.lib.an_single_start(self.pointer, reference, detuning_hz))
