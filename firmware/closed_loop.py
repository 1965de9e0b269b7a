"""Closed loop of the single-mode build with a plate simulated in C: plates unlike the mode table, fingers that lift off.

A second of the board's time takes some ten milliseconds. It serves studies with many runs: the tables of docs/board/loop.md,
fault injection, fingers and drifting plates. Where host and board are compared bit for bit, tests/helpers/hosted_boards.py and
the emulated board share a plate in Python instead.

`python -m firmware.closed_loop unlike` (or `lifts`) prints a table in Markdown. docs/board/loop.md sums up the first; --write
inserts the others there, between the marks that name this command. Each entry of the first is a second from rest. In the second
a finger multiplies the damping of the plate by six, the loop adapts, and then either the damping falls linearly to that of the
free plate, or the quality factor rises linearly, which frees the plate six times as fast at first.

`least` gives the smallest possible peak. The drive can change only with the answer to a window, and no law can react to a lift
that noise hides: while a window's amplitude has risen by less than SIGMAS standard deviations, the drive stays as it was. A law
that mistook less for a lift would do so more often than once in six seconds.

`python -m firmware.closed_loop steps` prints the time from a step of the reference to 95 % of the motion.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware.emulate.plant import Plate, PlateSimulation, Resonance
from firmware.host import NoCompiler, Supervised, load
from firmware.mode_table import PERIOD, WINDOW, Mode, ModeTable, hold, to_bytes
from firmware.protocol import RUN

SOUND, DEAD, STUCK, REVERSED, CLIPPED = range(5)
FIELDS = ("measured_re", "measured_im", "drive_re", "drive_im", "reference", "motion")

TRUE_HZ, GAIN, DELAY_S, RATE_HZ = 31437.3, 0.8, 7.3e-6, 250e3
QUALITIES = (50, 100, 200, 300, 400, 600, 1000, 1500, 2000)
SHARE = 0.2  # of the amplitude at full drive
SLOW_S, UNSTEADY = 5e-3, 0.05
PAGE = Path(__file__).parent.parent / "docs" / "board" / "loop.md"
END = "<!-- end -->\n"

ROWS = (
    ("resonance offset from the table, Hz", "off_hz", (-300.0, -100.0, -30.0, 30.0, 100.0, 300.0), 1.0),
    ("requested detuning, Hz", "detuning_hz", (-500.0, -300.0, -100.0, 100.0, 300.0, 500.0), 1.0),
    ("sensor sensitivity, times nominal", "sensitivity", (0.3, 0.5, 0.7, 1.3, 2.0, 3.0), 1.0),
    ("delay missing from the table, us", "late_s", (-6.0, -4.0, 4.0, 6.0, 7.0, 8.0), 1e-6),
    ("unknown neighbour at +200 Hz, times the mode", "neighbour", (-1.0, -0.5, -0.2, 0.2, 0.5, 1.0), 1.0),
)  # title, field of Case, values, unit

LIFTED_QUALITIES = (30, 100, 300, 600, 1000, 2000)
LIFTS_S = (2e-3, 5e-3, 10e-3, 20e-3, 50e-3)
SHARES = (0.05, 0.1, 0.165, 0.2, 0.4)  # of the free plate's amplitude at full drive; at 1/6 the drive reaches its limit
PHASES = range(0, 50, 12)  # tick of the window at which the finger starts to lift, or the reference steps
TOUCHED = 6.0  # times the damping of the free plate
SETTLES_S, AFTER_S, STEP_S = 0.3, 15e-3, 40e-6
PEAK_MOST = 1.2  # of the reference
LIFTS = ("damping", "quality factor")  # which changes linearly
NOISE, SIGMAS = 1e-3, 4.0
STEP_QUALITIES = (30, 50, 100, 300, 600, 800, 1000, 2000)
STEP_SHARES = (0.1, 0.2, 0.4)  # of the amplitude at full drive
REACHED, SLOW_STEP_S = 0.95, 2e-3


class SingleRig(Supervised):
    """an_single and a Plate in lock step; windows() returns the values at the end of each window."""

    def __init__(self, table: bytes, plate: Plate, seed: int = 1, faults: int = 0, confirmed: bool = True) -> None:
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
        self.app.base.confirmed = confirmed  # otherwise the first start checks the table's values

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

    def coefficients(self, plates: list[Plate]) -> list[bytes]:
        """Return the coefficients of the modes of each plate, for `use`; the last plate is set."""
        saved = []
        for plate in plates:
            self.set_plate(plate)
            saved.append(bytes(self.ffi.buffer(*self._modes)))
        return saved

    def use(self, coefficients: bytes) -> None:
        """Replace the coefficients of the modes, faster than `set_plate`."""
        self.ffi.buffer(*self._modes)[:] = coefficients

    @property
    def _modes(self) -> tuple[Any, int]:
        mode = self.rig.plate
        start, end = (self.ffi.cast("char *", self.ffi.addressof(mode, name)) for name in ("decay", "state"))
        return start, end - start

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


@dataclass(frozen=True)
class Case:
    """Deviations of the plate from the table; neighbour is the relative gain of a mode at +200 Hz."""

    off_hz: float = 0.0
    detuning_hz: float = 0.0
    sensitivity: float = 1.0
    late_s: float = 0.0
    neighbour: float = 0.0


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


def table_of_unlike_plates() -> str:
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


def write_into_page(page: Path, command: str, text: str) -> None:
    """Replace the part of a page between the mark that names the command and the next end mark."""
    mark = f"<!-- {command} -->\n"
    before, rest = page.read_text().split(mark, 1)
    page.write_text(before + mark + "\n" + text.rstrip() + "\n" + rest[rest.index(END) :])
    print(f"{page.name}: written")


def damped(plate: Plate, times: float) -> Plate:
    """Multiply the damping of a plate's first resonance, at constant modal force and mass."""
    own = plate.resonances[0]
    touched = replace(own, tau_s=own.tau_s / times, gain=own.gain / times)
    return replace(plate, resonances=(touched, *plate.resonances[1:]))


def lifting(lift: str, done: float) -> float:
    """Damping over that of the free plate, from TOUCHED to 1, when a part of the lift is done."""
    if lift == "damping":
        return TOUCHED + (1.0 - TOUCHED) * done
    return 1.0 / (1.0 / TOUCHED + (1.0 - 1.0 / TOUCHED) * done)


def least(quality_factor: float, share: float, lift_s: float, lift: str) -> float:
    """Return the smallest possible peak motion over the reference, for the worst phase of a window.

    Parameters
    ----------
    quality_factor : float
        Of the free plate.
    share : float
        Reference as a fraction of the free plate's amplitude at full drive.
    lift_s : float
        Duration of the lift-off, in s.
    lift : str
        One of LIFTS.

    Returns
    -------
    float
    """
    tick_s, tau_s = 1.0 / RATE_HZ, quality_factor / math.pi / TRUE_HZ
    motion = min(share, 1.0 / TOUCHED) * GAIN * abs(hold(TRUE_HZ, RATE_HZ))
    visible = SIGMAS * NOISE * math.sqrt(2.0 / WINDOW) / motion
    u = [1.0]
    for i in range(PERIOD * 20):
        damping = lifting(lift, min(i * tick_s / lift_s, 1.0))
        u.append(u[-1] + (TOUCHED - damping * u[-1]) * tick_s / tau_s)
    late = PERIOD - WINDOW + round((DELAY_S + 0.5 * tick_s) / tick_s)
    ends = []
    for end in range(1, PERIOD + 1):
        while end + late < len(u) and np.mean([u[max(i, 0)] for i in range(end - WINDOW, end)]) - 1.0 < visible:
            end += PERIOD
        ends.append(min(end + late, len(u) - 1))
    return max(max(u[: end + 1]) for end in ends) * min(1.0, 1.0 / (TOUCHED * share))


def peaks(
    quality_factor: float, share: float, lift_s: float, noise: float = NOISE, lift: str = LIFTS[0]
) -> Iterator[float]:
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
    lift : str, optional
        One of LIFTS.

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
    steps = round(lift_s / STEP_S)
    lifted = rig.coefficients([damped(plate, lifting(lift, step / steps)) for step in range(1, steps + 1)])
    for phase in PHASES:
        rig.ffi.buffer(rig.rig)[:] = settled
        rig.run(phase / RATE_HZ)
        yield _peak(rig, lifted) / reference


def table_of_lifts() -> str:
    """Return the table, with the worst case over all levels and phases."""
    lines = [
        "| linear in | lift-off time, ms | "
        + " | ".join(f"Q {quality_factor}" for quality_factor in LIFTED_QUALITIES)
        + " |"
    ]
    lines.append("|---" * (len(LIFTED_QUALITIES) + 2) + "|")
    for lift in LIFTS:
        for lift_s in LIFTS_S:
            cells = [_lift_cell(quality_factor, lift_s, lift) for quality_factor in LIFTED_QUALITIES]
            lines.append(f"| {lift} | {1e3 * lift_s:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _lift_cell(quality_factor: float, lift_s: float, lift: str) -> str:
    """Return the largest peak and, where even the least possible one exceeds 1.2, that in parentheses."""
    worst = max(each for share in SHARES for each in peaks(quality_factor, share, lift_s, lift=lift))
    bound = max(least(quality_factor, share, lift_s, lift) for share in SHARES)
    return f"{worst:.2f}" + (f" ({bound:.2f})" if bound > PEAK_MOST else "")


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


def _peak(rig: SingleRig, lifted: list[bytes]) -> float:
    largest = 0.0
    for step in range(len(lifted) + round(AFTER_S / STEP_S)):
        if step < len(lifted):
            rig.use(lifted[step])
        rig.run(STEP_S)
        mode = rig.rig.plate
        largest = max(largest, math.hypot(*mode.state[0]) * math.hypot(*mode.residue[0]))
    if rig.state != RUN:
        raise RuntimeError(f"stopped with faults {rig.faults:#x}")
    return largest


def steps(quality_factor: float, share: float) -> Iterator[float]:
    """Simulate steps from rest and yield the time to 95 % of the motion in s, for each phase of the window.

    Parameters
    ----------
    quality_factor : float
    share : float
        Step as a fraction of the amplitude at full drive.

    Yields
    ------
    float
    """
    table, plate = held_plate(quality_factor, noise=0.0)
    rig = SingleRig(table, plate)
    reference = share * rig.app.mode.drive_limit * GAIN * abs(hold(TRUE_HZ, RATE_HZ))
    rig.run(10e-3)
    rig.start(reference)
    rig.lib.an_single_set_reference(rig.pointer, 0.0)
    rig.run(50e-3)
    rested = bytes(rig.ffi.buffer(rig.rig))
    for phase in PHASES:
        rig.ffi.buffer(rig.rig)[:] = rested
        rig.run(phase / RATE_HZ)
        rig.lib.an_single_set_reference(rig.pointer, reference)
        ticks, mode = 0, rig.rig.plate
        while math.hypot(*mode.state[0]) * math.hypot(*mode.residue[0]) < REACHED * reference and ticks < 25000:
            rig.lib.rig_run(rig.rig, 1, rig.ffi.NULL, 0)
            ticks += 1
        yield ticks / RATE_HZ


def least_step(quality_factor: float, share: float) -> float:
    """Return the smallest possible time to 95 % of a step, in s: full drive from the next answer to a window onwards.

    A reference that changes just after an answer was computed waits for a window and the gap after it; what follows is
    the plate's own response to full drive.
    """
    tau_s = quality_factor / math.pi / TRUE_HZ
    waits_s = (2 * PERIOD - WINDOW) / RATE_HZ + DELAY_S
    return waits_s - tau_s * math.log(1.0 - REACHED * share)


def table_of_steps() -> str:
    """Return the table in ms, with the worst case over the phases and, where it exceeds 2 ms, the least possible time."""
    lines = ["| step, of G Vmax | " + " | ".join(f"Q {quality_factor}" for quality_factor in STEP_QUALITIES) + " |"]
    lines.append("|---" * (len(STEP_QUALITIES) + 1) + "|")
    for share in STEP_SHARES:
        cells = []
        for quality_factor in STEP_QUALITIES:
            worst, bound = max(steps(quality_factor, share)), least_step(quality_factor, share)
            cells.append(f"{1e3 * worst:.2f}" + (f" ({1e3 * bound:.2f})" if worst > SLOW_STEP_S else ""))
        lines.append(f"| {share:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


TABLES = {"unlike": table_of_unlike_plates, "lifts": table_of_lifts, "steps": table_of_steps}


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m firmware.closed_loop", description=__doc__)
    parser.add_argument("table", choices=TABLES, help="plates unlike the mode table, fingers that leave, or steps")
    parser.add_argument("--write", action="store_true", help="write the output to docs/board/loop.md")
    chosen = parser.parse_args(arguments)
    if chosen.write and chosen.table == "unlike":
        parser.error("--write: docs/board/loop.md summarises this table; edit the summary there")
    try:
        text = TABLES[chosen.table]()
    except NoCompiler as missing:
        print(f"firmware.closed_loop: {missing}", file=sys.stderr)
        return 5
    if chosen.write:
        write_into_page(PAGE, f"python -m firmware.closed_loop {chosen.table} --write", text)
    else:
        print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
