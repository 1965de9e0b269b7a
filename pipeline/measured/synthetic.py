"""Synthetic vibrometer files, made from a computed response with seeded noise and marked as synthetic.

The "measured" plate is the case with the changes of --set: compared with the case itself, it shows a shift.
"""

from __future__ import annotations

from itertools import pairwise
from math import ceil, pi
from pathlib import Path

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.measured.comparison import operating_field
from pipeline.measured.files import SYNTHETIC
from pipeline.models.forced import SolvedResponse
from pipeline.quantity import MM
from pipeline.records import outputs
from pipeline.records.outputs import folder, write_file
from solvers.piezo.responses import loudest_point, point_response

SWEEP, FIELD = "sweep.csv", "field.csv"
TONES, REACH = 241, 8.0  # number of frequencies, and half-power widths on each side of the peak
SPACING_M = 2 * MM  # of the map's points, or an eighth of the zone's width if that is less
NOISE = 0.01  # of the peak, rms per point


def write(
    case: Case, response: SolvedResponse, place: Path, made_by: str, seed: int, noise: float = NOISE
) -> list[Path]:
    """Write sweep.csv and field.csv, with the command in their header, into a folder; InputError if it cannot be written."""
    random = np.random.default_rng(seed)
    head = f"# {SYNTHETIC}, not measured: made by {made_by}\n"
    texts = {SWEEP: _sweep(case, response, noise, random), FIELD: _field(case, response, noise, random)}
    for name, text in texts.items():
        write_file(folder(str(place)) / name, (head + text).encode())
    return [place / name for name in texts]


def _scattered(values: ComplexArray, noise: float, random: np.random.Generator) -> ComplexArray:
    parts = random.normal(size=(2, len(values))) / np.sqrt(2.0)
    return np.asarray(values + noise * np.abs(values).max() * (parts[0] + 1j * parts[1]))


def _sweep(case: Case, response: SolvedResponse, noise: float, random: np.random.Generator) -> str:
    """Write velocity per volt where the zone moves most, as amplitude and phase."""
    tone = tones(response.peak.frequency_hz, case.one_quality_factor("--synthetic-data"))
    place = loudest_point(response.forced, response.peak.frequency_hz)
    seen = _scattered(2j * pi * tone * point_response(response.forced, place, tone), noise, random)
    lines = [f"# a laser at x = {place[0] / MM:.2f} mm, y = {place[1] / MM:.2f} mm of the touch face"]
    head = ("frequency_Hz", "velocity_amplitude_m_per_s_per_V", "velocity_phase_deg")
    rows = ((f"{f:.3f}", f"{abs(v):.6e}", f"{np.degrees(np.angle(v)):.4f}") for f, v in zip(tone, seen, strict=True))
    return "\n".join(lines) + "\n" + outputs.csv_bytes(head, rows).decode()


def _field(case: Case, response: SolvedResponse, noise: float, random: np.random.Generator) -> str:
    """Write velocity per volt over the touch face at the peak, as real and imaginary parts."""
    peak = response.peak.frequency_hz
    points = grid(case.design)
    seen = _scattered(2j * pi * peak * operating_field(response, points), noise, random)
    head = ("x_mm", "y_mm", "velocity_real_m_per_s_per_V", "velocity_imag_m_per_s_per_V")
    both = zip((1.0 / MM) * points, seen, strict=True)
    rows = ((f"{x:.3f}", f"{y:.3f}", f"{v.real:.4e}", f"{v.imag:.4e}") for (x, y), v in both)
    return f"# at {peak:.3f} Hz\n" + outputs.csv_bytes(head, rows).decode()


def tones(peak_hz: float, quality_factor: float) -> FloatArray:
    """Evenly spaced frequencies around a peak, Hz."""
    reach = REACH * peak_hz / quality_factor / 2.0
    return np.linspace(peak_hz - reach, peak_hz + reach, TONES)


def grid(design: Design) -> FloatArray:
    """Centres of equal cells over the touch face, (n, 2) in m; no cell crosses the zone's border."""
    step = min(SPACING_M, design.width_m / 8.0)
    half = design.width_m / 2.0
    borders = (design.centre_m[1] - half, design.centre_m[1] + half)
    x, y = _between(design.zone_ends_m, design.half_length_m, step), _between(borders, design.half_span_m, step)
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


def _between(borders: tuple[float, float], edge: float, step: float) -> FloatArray:
    """Middles of cells from one edge of the plate to the other, in each of the parts that the borders make."""
    slack = 1e-6 * (borders[1] - borders[0])
    parts = [(low, high) for low, high in pairwise((-edge, *borders, edge)) if high - low > slack]
    return np.concatenate([_middles(low, high, step) for low, high in parts])


def _middles(low: float, high: float, step: float) -> FloatArray:
    lines = np.linspace(low, high, max(1, ceil((high - low) / step - 1e-9)) + 1)
    return np.asarray((lines[1:] + lines[:-1]) / 2.0)
