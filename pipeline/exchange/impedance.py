"""What an amplifier sees of the patches: a Touchstone file (.s1p) or CSV of their impedance over frequency."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.case.model import Case
from pipeline.logs import Log

REFERENCE_OHM = 50.0
POINTS = 801


def write(case: Case, path: Path, log: Log) -> Path:
    """Compute the impedance of the driven patches in parallel, sensors open, and write it as the ending says."""
    from pipeline.models.forced import forced_plate
    from pipeline.records import outputs
    from solvers.piezo.responses import admittance

    case.require("patches", command="export impedance")
    forced = forced_plate(case, log, None, [])
    frequency = np.linspace(*forced.band_hz, POINTS)
    impedance = 1.0 / admittance(forced, frequency)
    outputs.write_file(path, (touchstone if path.suffix.lower() == ".s1p" else table)(frequency, impedance).encode())
    return path


def touchstone(frequency_hz: Any, impedance_ohm: Any) -> str:
    """One port's reflection S11 against 50 ohm, real and imaginary."""
    reflection = (impedance_ohm - REFERENCE_OHM) / (impedance_ohm + REFERENCE_OHM)
    lines = ["! driven patches of a plate in parallel, dielectric losses left out", f"# Hz S RI R {REFERENCE_OHM:g}"]
    lines += [f"{f:.6f} {s.real:.12e} {s.imag:.12e}" for f, s in zip(frequency_hz, reflection, strict=True)]
    return "\n".join(lines) + "\n"


def table(frequency_hz: Any, impedance_ohm: Any) -> str:
    """Impedance as resistance and reactance."""
    from pipeline.records.outputs import csv_bytes

    head = ("frequency_Hz", "resistance_ohm", "reactance_ohm")
    rows = ((f"{f:.6f}", f"{z.real:.9e}", f"{z.imag:.9e}") for f, z in zip(frequency_hz, impedance_ohm, strict=True))
    return csv_bytes(head, rows).decode()
