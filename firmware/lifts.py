"""Overshoot of a plate when a finger lifts off.

`python -m firmware.lifts` prints the table of docs/bring-up.md in Markdown; --write inserts it there, between the marks
that name this command. Each entry comes from the single-mode application on the rig of firmware.host.rig. A finger
multiplies the damping of the plate by six, the loop adapts, and the damping then falls linearly to that of the free
plate.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import replace

from firmware.control_table import GAIN, RATE_HZ, TRUE_HZ, held_plate, print_or_write
from firmware.emulate.plant import Plate
from firmware.host.rig import SingleRig
from firmware.mode_table import hold
from firmware.protocol import RUN

QUALITIES = (30, 100, 300, 600, 1000, 2000)
LIFTS_S = (2e-3, 5e-3, 10e-3, 20e-3, 50e-3)
SHARES = (0.05, 0.1, 0.2, 0.4)  # of the free plate's amplitude at full drive
PHASES = range(0, 50, 10)  # tick of the window at which the finger starts to lift
TOUCHED = 6.0  # times the damping of the free plate
SETTLES_S, AFTER_S, STEP_S = 0.3, 15e-3, 40e-6


def damped(plate: Plate, times: float) -> Plate:
    """Multiply the damping of a plate's first resonance, at constant modal force and mass."""
    own = plate.resonances[0]
    touched = replace(own, tau_s=own.tau_s / times, gain=own.gain / times)
    return replace(plate, resonances=(touched, *plate.resonances[1:]))


def peaks(quality_factor: float, share: float, lift_s: float, noise: float = 1e-3) -> Iterator[float]:
    """Simulate lift-offs and yield the peak motion over the reference for each phase of the window.

    Parameters
    ----------
    quality_factor : float
        Of the free plate.
    share : float
        Reference as a fraction of the free plate's amplitude at full drive.
    lift_s : float
        Duration of the lift-off, in s.
    noise : float, optional
        RMS noise of the sensor, as a fraction of full scale.

    Yields
    ------
    float

    Raises
    ------
    RuntimeError
        If the application stops with a fault.
    """
    table, plate = held_plate(quality_factor, noise)
    rig = SingleRig(table, plate)
    reference = share * GAIN * abs(hold(TRUE_HZ, RATE_HZ))
    rig.run(10e-3)
    rig.start(reference)
    for part in range(1, 26):
        rig.set_plate(damped(plate, 1.0 + (TOUCHED - 1.0) * part / 25))
        rig.run(2e-3)
    rig.run(SETTLES_S)
    settled = bytes(rig.ffi.buffer(rig.rig))
    for phase in PHASES:
        rig.ffi.buffer(rig.rig)[:] = settled
        rig.run(phase / RATE_HZ)
        yield _peak(rig, plate, lift_s) / reference


def _peak(rig: SingleRig, plate: Plate, lift_s: float) -> float:
    largest, steps = 0.0, round(lift_s / STEP_S)
    for step in range(1, steps + round(AFTER_S / STEP_S)):
        if step <= steps:
            rig.set_plate(damped(plate, TOUCHED - (TOUCHED - 1.0) * step / steps))
        rig.run(STEP_S)
        mode = rig.rig.plate
        largest = max(largest, math.hypot(*mode.state[0]) * math.hypot(*mode.residue[0]))
    if rig.state != RUN:
        raise RuntimeError(f"stopped with faults {rig.faults:#x}")
    return largest


def markdown() -> str:
    """Return the table, with the worst case over all levels and phases."""
    lines = ["| lift-off time, ms | " + " | ".join(f"Q {quality_factor}" for quality_factor in QUALITIES) + " |"]
    lines.append("|---" * (len(QUALITIES) + 1) + "|")
    for lift_s in LIFTS_S:
        cells = []
        for quality_factor in QUALITIES:
            cells.append(f"{max(each for share in SHARES for each in peaks(quality_factor, share, lift_s)):.2f}")
        lines.append(f"| {1e3 * lift_s:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(print_or_write("firmware.lifts", __doc__, markdown, None))
