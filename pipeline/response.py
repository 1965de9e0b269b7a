"""Forced response of a case to its patches: what the zone and the rest do per volt, and what the sensors hear."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from geometry.elements import FloatArray
from pipeline import error_model
from pipeline.case import Case
from pipeline.logs import Log
from pipeline.patched import forced_plate
from pipeline.ways import way_of
from solvers.measured_sweep import half_power_quality
from solvers.piezo.circuit import CircuitShift, circuit_shift
from solvers.piezo.forced import Curve, ForcedPlate

POINTS = 401
GRID = 160
PER_WIDTH = 6  # points over a resonance's half-power width about the peak


@dataclass(frozen=True)
class Response:
    """The curve, its peak, the quality factor read back from it, the operating shape there, and the plate behind it.

    expected_error is that of a frequency by the plate's mesh, relative; bonding the patches and the reduction add their own.
    """

    model: str
    dof: int
    curve: Curve
    peak: int
    quality: float | None
    quality_given: float
    wanted_hz: float | None
    signs: tuple[int, ...]
    sensors: tuple[int, ...]
    shape_points: FloatArray
    shape: Any
    forced: ForcedPlate
    circuit: CircuitShift | None
    meshes: list[dict[str, Any]] = field(default_factory=list)
    expected_error: float | None = None

    @property
    def confinement_db(self) -> float | None:
        """20 log10 of zone over passive rms at the peak."""
        passive = self.curve.passive_rms_m_per_v
        if passive is None:
            return None
        return float(20.0 * np.log10(self.curve.zone_rms_m_per_v[self.peak] / passive[self.peak]))

    def _circuit(self) -> dict[str, Any]:
        """How the drivers are fed, and what opening every patch does to the wanted mode."""
        shift = self.circuit
        return {
            "drivers": self.forced.circuit,
            "short_hz": shift.short_hz if shift else None,
            "open_hz": shift.open_hz if shift else None,
            "coupling": shift.coupling if shift else None,
        }

    def json(self) -> dict[str, Any]:
        """The contract's fields and what was read from the curve, without times."""
        curve, peak = self.curve, self.peak
        passive = curve.passive_rms_m_per_v
        first = curve.sensor_v_per_v[:, 0] if self.sensors else None
        return {
            "schema": 1,
            "model": self.model,
            "dof": self.dof,
            "frequency_hz": curve.frequency_hz.tolist(),
            "zone_rms_m_per_V": curve.zone_rms_m_per_v.tolist(),
            "passive_rms_m_per_V": None if passive is None else passive.tolist(),
            "sensor_V_per_V": None if first is None else np.column_stack([first.real, first.imag]).tolist(),
            "sensors": list(self.sensors),
            "polarisation_signs": list(self.signs),
            "wanted_hz": self.wanted_hz,
            "quality_given": self.quality_given,
            "expected_error": self.expected_error,
            "circuit": self._circuit(),
            "peak": {
                "frequency_hz": float(curve.frequency_hz[peak]),
                "zone_rms_m_per_V": float(curve.zone_rms_m_per_v[peak]),
                "passive_rms_m_per_V": None if passive is None else float(passive[peak]),
                "confinement_db": self.confinement_db,
                "quality": self.quality,
            },
        }


def solve(case: Case, log: Log, band_hz: tuple[float, float] | None = None, points: int = POINTS) -> Response:
    """Response of the patched plate over a band. InputFault for a case without patches or a model that cannot carry them."""
    case.require_plate(command="response")
    case.require("patches", command="response")
    patches = case.patches
    assert patches is not None
    meshes: list[dict[str, Any]] = []
    forced = forced_plate(case, log, band_hz, meshes)
    plate, (low, high) = forced.plate, forced.band_hz
    with log.step("sum the modes"):
        curve, peak = peaked_curve(forced, low, high, points)
        shape_points, shape = _gridded(*forced.shape(float(curve.frequency_hz[peak])))
    found = Response(
        f"{plate.name} with {patches.count} patches",
        sum(group.pencil.dof for group in plate.groups),
        curve,
        peak,
        half_power_quality(curve.frequency_hz, curve.zone_rms_m_per_v, peak),
        case.quality,
        forced.wanted_hz(),
        tuple(int(sign) for sign in forced.signs),
        patches.sensors,
        shape_points,
        shape,
        forced,
        circuit_shift(forced),
        meshes,
        error_model.told(way_of(case, "plate", high), case, log, high),
    )
    _tell(found, log)
    return found


class Driven(Protocol):
    """What answers a sweep."""

    @property
    def loss(self) -> float:
        """1/Q."""
        ...

    def curve(self, frequency_hz: FloatArray) -> Curve:
        """Response at frequencies in Hz."""
        ...


def peaked_curve(forced: Driven, low: float, high: float, points: int) -> tuple[Curve, int]:
    """An even grid, then a fine one about its highest point, as narrow as the damping makes the peak."""
    even = np.linspace(low, high, points)
    top = float(even[int(np.argmax(forced.curve(even).zone_rms_m_per_v))])
    for reach in (2.0 * (high - low) / points, 2.0 * top * forced.loss):
        fine = np.linspace(max(low, top - reach), min(high, top + reach), 4 * PER_WIDTH + 1)
        top = float(fine[int(np.argmax(forced.curve(fine).zone_rms_m_per_v))])
        even = np.union1d(even, fine)
    curve = forced.curve(even)
    return curve, int(np.argmax(curve.zone_rms_m_per_v))


def _gridded(points: FloatArray, values: Any) -> tuple[FloatArray, Any]:
    """The field on an even grid of about GRID points along the longer side, each taking its nearest value."""
    from scipy.spatial import cKDTree

    low, high = points.min(axis=0), points.max(axis=0)
    step = float((high - low).max()) / GRID
    lines = [np.linspace(a, b, max(2, round((b - a) / step)) + 1) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid, values[cKDTree(points).query(grid)[1]]


def _tell(found: Response, log: Log) -> None:
    top = found.curve.zone_rms_m_per_v[found.peak]
    held = "" if found.confinement_db is None else f", {found.confinement_db:.1f} dB above the passive face"
    tone = found.curve.frequency_hz[found.peak]
    log.info(f"peak at {tone:.1f} Hz: {1e9 * top:.2f} nm/V rms on the zone{held}")
    if found.circuit:
        shift = found.circuit
        log.info(
            f"wanted mode at {shift.short_hz:.1f} Hz with all patches short, {shift.open_hz:.1f} Hz with all open: "
            f"coupling factor squared {shift.coupling:.2e}"
        )
    if found.peak in (0, len(found.curve.frequency_hz) - 1):
        log.alarm("PEAK_AT_END", "the response is largest at the end of the band: widen it")
    if found.quality and abs(found.quality / found.quality_given - 1.0) > 0.2:
        log.alarm(
            "SHARED_PEAK",
            f"the peak's width tells a quality of {found.quality:.0f}, given is {found.quality_given:.0f}: modes overlap",
        )
