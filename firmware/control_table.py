"""Robustness of the closed loop: settled, slow or tripped, for plates that differ from the mode table.

`python -m firmware.control_table` prints the tables of docs/bring-up.md in Markdown; --write inserts them there,
between the marks that name this command. Each entry is a second of the single-mode application on the rig of
firmware.host.rig.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from firmware.emulate.plant import Plate, Resonance
from firmware.host import NoCompiler
from firmware.host.rig import SingleRig
from firmware.mode_table import Mode, ModeTable, hold, to_bytes
from firmware.protocol import RUN

TRUE_HZ, GAIN, DELAY_S, RATE_HZ = 31437.3, 0.8, 7.3e-6, 250e3
QUALITIES = (50, 100, 200, 300, 400, 600, 1000, 1500, 2000)
SHARE = 0.2  # of the amplitude at full drive
SLOW_S, UNSTEADY = 5e-3, 0.05
PAGE = Path(__file__).parent.parent / "docs" / "bring-up.md"
END = "<!-- end -->\n"


@dataclass(frozen=True)
class Case:
    """Deviations of the plate from the table; neighbour is the relative gain of a mode at +200 Hz."""

    off_hz: float = 0.0
    detuning_hz: float = 0.0
    sensitivity: float = 1.0
    late_s: float = 0.0
    neighbour: float = 0.0


ROWS = (
    ("resonance offset from the table, Hz", "off_hz", (-300.0, -100.0, -30.0, 30.0, 100.0, 300.0), 1.0),
    ("requested detuning, Hz", "detuning_hz", (-500.0, -300.0, -100.0, 100.0, 300.0, 500.0), 1.0),
    ("sensor sensitivity, times nominal", "sensitivity", (0.3, 0.5, 0.7, 1.3, 2.0, 3.0), 1.0),
    ("delay missing from the table, us", "late_s", (-6.0, -4.0, 4.0, 6.0, 7.0, 8.0), 1e-6),
    ("unknown neighbour at +200 Hz, times the mode", "neighbour", (-1.0, -0.5, -0.2, 0.2, 0.5, 1.0), 1.0),
)  # title, field of Case, values, unit


def mode_table(quality_factor: float) -> bytes:
    """Make a table with one measured mode."""
    gain, delay_s = -1j * GAIN * abs(hold(TRUE_HZ, RATE_HZ)), DELAY_S + 0.5 / RATE_HZ
    measured = {"gain": gain, "delay_s": delay_s, "tau_identified": True, "frequency_identified": True}
    mode = Mode.from_quality_factor(TRUE_HZ, quality_factor, amplitude_limit=0.9, **measured)
    return to_bytes(ModeTable(RATE_HZ, bytes(16), (mode,)))


def held_plate(quality_factor: float, noise: float = 1e-4) -> tuple[bytes, Plate]:
    """Make a table and the plate that it describes."""
    own = Resonance(TRUE_HZ, quality_factor / math.pi / TRUE_HZ, GAIN)
    return mode_table(quality_factor), Plate((own,), delay_s=DELAY_S, noise=noise)


def entry(quality_factor: float, case: Case) -> str:
    """Simulate one case and return its entry in the table.

    Examples: "1.9" (ms until the envelope stays within 5 %), "slow 12", "at limit 0.6", "unsteady", or "trip 20" (ms
    after the step).
    """
    table, plate = held_plate(quality_factor)
    own = replace(plate.resonances[0], frequency_hz=TRUE_HZ + case.off_hz)
    tau_s = plate.resonances[0].tau_s
    others = (Resonance(TRUE_HZ + 200.0, tau_s, case.neighbour * GAIN),) if case.neighbour else ()
    rig = SingleRig(table, replace(plate, resonances=(own, *others), delay_s=max(DELAY_S + case.late_s, 0.0)))
    rig.rig.plate.sensitivity = case.sensitivity
    reference = SHARE * GAIN * abs(hold(TRUE_HZ, RATE_HZ))
    if case.detuning_hz:
        reference /= abs(1.0 + 2j * math.pi * case.detuning_hz * tau_s)
    rig.run(5e-3)
    rig.start(reference, case.detuning_hz)
    seen = rig.windows(1.0)
    return _outcome(np.abs(seen["measured"]), seen["state"] == RUN, reference, rig)


def _outcome(size: np.ndarray, runs: np.ndarray, reference: float, rig: SingleRig) -> str:
    window_s = rig.lib.AN_PERIOD / RATE_HZ
    if not runs.all():
        return f"trip {1e3 * window_s * int(np.argmin(runs)):.0f}"
    end = size[-1000:] / reference
    if rig.lib.an_single_is_limited(rig.pointer):
        return f"at limit {end.mean():.2f}"
    if end.std() > UNSTEADY:
        return "unsteady"
    off = np.flatnonzero(np.abs(size / reference - 1.0) > 0.05)
    settled_s = window_s * (int(off[-1]) + 1 if off.size else 0)
    return f"{1e3 * settled_s:.1f}" if settled_s <= SLOW_S else f"slow {1e3 * settled_s:.0f}"


def markdown() -> str:
    """Return all tables."""
    lines = []
    for title, name, values, unit in ROWS:
        lines += [f"| {title} | " + " | ".join(f"Q {quality_factor}" for quality_factor in QUALITIES) + " |"]
        lines += ["|---" * (len(QUALITIES) + 1) + "|"]
        for value in values:
            entries = [entry(quality_factor, replace(Case(), **{name: value * unit})) for quality_factor in QUALITIES]
            lines.append(f"| {value:g} | " + " | ".join(entries) + " |")
        lines.append("")
    return "\n".join(lines)


def write_into_page(command: str, text: str) -> None:
    """Replace the part of docs/bring-up.md between the mark that names the command and the next end mark."""
    mark = f"<!-- {command} -->\n"
    before, rest = PAGE.read_text().split(mark, 1)
    PAGE.write_text(before + mark + "\n" + text.rstrip() + "\n" + rest[rest.index(END) :])
    print(f"{PAGE.name}: written")


def print_or_write(module: str, about: str | None, text: Callable[[], str], arguments: list[str] | None) -> int:
    """Run the command line of a module whose table is part of docs/bring-up.md; return the exit code."""
    parser = argparse.ArgumentParser(prog=f"python -m {module}", description=about)
    parser.add_argument("--write", action="store_true", help="write the output to docs/bring-up.md")
    chosen = parser.parse_args(arguments)
    try:
        table = text()
    except NoCompiler as missing:
        print(f"{module}: {missing}", file=sys.stderr)
        return 5
    if chosen.write:
        write_into_page(f"python -m {module} --write", table)
    else:
        print(table)
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    return print_or_write("firmware.control_table", __doc__, markdown, arguments)


if __name__ == "__main__":
    sys.exit(main())
