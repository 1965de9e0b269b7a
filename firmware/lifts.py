"""How far a plate overshoots when a finger leaves it.

`python -m firmware.lifts` prints the table of docs/bring-up.md in Markdown; --write puts it there, between the marks that name
this command. Each entry is the single-mode application on the rig of firmware.host.rig: a finger makes the damping six times
the plate's own, the loop has followed it, and the damping falls evenly to the plate's own.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import replace

from firmware.control_table import DELAY_S, GAIN, RATE_HZ, TRUE_HZ, held_plate, write_into_page
from firmware.emulate.plant import Plate, hold
from firmware.host import NoCompiler
from firmware.host.rig import SingleRig
from firmware.protocol import RUN

QUALITIES = (30, 100, 300, 600, 1000, 2000)
LIFTS_S = (2e-3, 5e-3, 10e-3, 20e-3, 50e-3)
SHARES = (0.05, 0.1, 0.2, 0.4)  # of what full drive holds without a finger
PHASES = range(0, 50, 10)  # ticks of a window at which the finger begins to leave
TOUCHED = 6.0  # times the plate's own damping
SETTLES_S, AFTER_S, STEP_S = 0.3, 15e-3, 40e-6


def damped(plate: Plate, times: float) -> Plate:
    """A plate whose first resonance has so many times its damping, force and mass as they were."""
    own = plate.resonances[0]
    touched = replace(own, tau_s=own.tau_s / times, gain=own.gain / times)
    return replace(plate, resonances=(touched, *plate.resonances[1:]))


def peaks(quality_factor: float, share: float, lift_s: float, noise: float = 1e-3) -> Iterator[tuple[float, float]]:
    """Return the largest motion over the reference, and the least that is possible, for each phase of the window.

    Raises RuntimeError where the application stops.
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
        yield _peak(rig, plate, lift_s) / reference, least(quality_factor, share, lift_s, phase)


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


def least(quality_factor: float, share: float, lift_s: float, phase: int) -> float:
    """Return the motion, over the reference, when the first answer to the lift can act: no controller keeps it lower.

    tau dU/dt = V - d U with the drive V that held the touched plate, until the window in which the damping d begins to fall
    has been measured and its answer has passed the gap and the delay.
    """
    tau_s = quality_factor / math.pi / TRUE_HZ
    drive, size = min(TOUCHED * share, 1.0), min(share, 1.0 / TOUCHED)
    until_s, step_s = (50 - phase + 4) / RATE_HZ + DELAY_S, 1e-6
    for i in range(round(until_s / step_s)):
        damping = TOUCHED - (TOUCHED - 1.0) * min(i * step_s / lift_s, 1.0)
        size += step_s / tau_s * (drive - damping * size)
    return max(size / share, 1.0)


def markdown() -> str:
    """The table: the worst of all levels and phases, and where that is more than 1.2 the least possible there."""
    lines = [
        "| the finger leaves within, ms | " + " | ".join(f"Q {quality_factor}" for quality_factor in QUALITIES) + " |"
    ]
    lines.append("|---" * (len(QUALITIES) + 1) + "|")
    for lift_s in LIFTS_S:
        cells = []
        for quality_factor in QUALITIES:
            peak, possible = max(each for share in SHARES for each in peaks(quality_factor, share, lift_s))
            cells.append(f"{peak:.2f}" if peak <= 1.2 else f"{peak:.2f} (least possible {possible:.2f})")
        lines.append(f"| {1e3 * lift_s:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m firmware.lifts", description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the table into docs/bring-up.md")
    chosen = parser.parse_args(arguments)
    try:
        text = markdown()
    except NoCompiler as missing:
        print(f"lifts: {missing}", file=sys.stderr)
        return 5
    if chosen.write:
        write_into_page("python -m firmware.lifts --write", text)
    else:
        print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
