"""Forced response of a case to its patches: curves over frequency, the plate behind them, and the error bars of its peaks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models.patched_plate import forced_plate
from pipeline.planning.error_bar import WidestBar
from pipeline.planning.model_choice import ModelChoice
from pipeline.quantity import frequency
from pipeline.records.record import MeshRecord
from solvers.piezo.forced import Curve, ForcedPlate
from solvers.piezo.peak_errors import frequency_errors
from solvers.piezo.responses import Peak, curve_about, driven_hz, highest_hz, own_or, peak_of, resonances_hz
from solvers.threads import one_thread

GRID = 160


@dataclass(frozen=True)
class SolvedResponse:
    """The response curve, the wanted mode's peak (None where the band has none), the highest peak, and the plate behind them.

    widest_bar is that of the frequencies in the band.
    """

    forced: ForcedPlate
    curve: Curve
    wanted: Peak | None
    highest: Peak
    widest_bar: WidestBar

    @property
    def expected_error(self) -> float | None:
        """The largest half-width of a frequency's bar in the band, relative: mesh, reduction and bonding together."""
        return self.widest_bar.error

    @property
    def peak(self) -> Peak:
        """The wanted mode's peak; the highest one where there is none."""
        return self.wanted or self.highest


@one_thread()
def solve(
    case: Case, choice: ModelChoice | None, log: Log, band_hz: tuple[float, float] | None, points: int,
    meshes: list[MeshRecord],
) -> SolvedResponse:  # fmt: skip
    """Compute the response of the patched plate over a band. Raises InputError for a model that cannot carry patches."""
    forced = forced_plate(case, log, band_hz, meshes, choice=choice)
    low, high = forced.band_hz
    with log.step("sum the modes"):
        tone, highest = driven_hz(forced), highest_hz(forced, low, high, points, resonances_hz(forced))
        peaks_hz = [highest]
        if tone and low <= tone <= high:
            peaks_hz = [own_or(forced, tone, highest), highest]
        curve = curve_about(forced, low, high, points, peaks_hz)
    wanted = peak_of(curve, peaks_hz[0]) if len(peaks_hz) > 1 else None
    return SolvedResponse(forced, curve, wanted, peak_of(curve, highest), _widest_bar(forced, low, high))


def _widest_bar(forced: ForcedPlate, low_hz: float, high_hz: float) -> WidestBar:
    """Find the widest bar of the resonances in a band, and what it is made of; unknown where one of them has none."""
    known = []
    for basis in forced.modes:
        errors, tones = frequency_errors(basis), basis.frequency_hz
        inside = (tones >= low_hz) & (tones <= high_hz)
        known.append(np.array([tones, errors.mesh, errors.reduction, errors.bonding])[:, inside])
    every = np.hstack(known) if known else np.zeros((4, 0))
    total = every[1:].sum(axis=0)
    if not total.size or np.isnan(total).any():
        return WidestBar(None)
    tone, *parts = every[:, int(np.argmax(total))].tolist()
    of = f"the resonance at {frequency(tone, sum(parts))}"
    return WidestBar(sum(parts), of, dict(zip(("mesh", "reduction", "bonding"), parts, strict=True)))


def gridded(points: FloatArray, values: ComplexArray) -> dict[str, Any]:
    """Return a field on the touch face at an even grid of about GRID points along its longer side, as a picture draws it."""
    from scipy.spatial import cKDTree

    low, high = points.min(axis=0), points.max(axis=0)
    step = float((high - low).max()) / GRID
    lines = [np.linspace(a, b, max(2, round((b - a) / step)) + 1) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    nearest = values[cKDTree(points).query(grid)[1]]
    return {"response_xy": grid.astype(np.float32), "response_uz": nearest.astype(np.complex64)}
