"""Forced response of a case to its patches: what the zone and the rest do per volt, and what the sensors hear."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.analysis.peak_bars import curve_errors, level_error_db, quality_error
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models.patched_plate import forced_plate
from pipeline.planning.error_bar import WidestBar
from pipeline.quantity import figure, frequency, frequency_with_bar, level_with_bar, with_bar
from pipeline.records.record import MeshRecord, PeakRecord, ResponseRecord
from pipeline.units import KHZ
from solvers.piezo.circuit import CircuitShift, circuit_shift, driven_hz, resonances_hz
from solvers.piezo.forced import Curve, ForcedPlate
from solvers.piezo.frequency_bar import frequency_errors
from solvers.piezo.height import frequency_error, height_error
from solvers.piezo.peaks import Peak, curve_about, highest_hz, own_or, peak_of
from solvers.threads import one_thread

POINTS = 401
GRID = 160


@dataclass(frozen=True)
class Response:
    """The response curve, the wanted mode's peak (None where the band has none), the highest peak, and the plate
    behind them.

    The operating shape is that at `peak`. widest_bar is that of the frequencies in the band.
    """

    model: str
    dof: int
    curve: Curve
    wanted: Peak | None
    highest: Peak
    quality_factor_given: float
    wanted_hz: float | None
    signs: tuple[int, ...]
    sensors: tuple[int, ...]
    shape_points: FloatArray
    shape: Any
    forced: ForcedPlate
    circuit: CircuitShift | None
    meshes: list[MeshRecord] = field(default_factory=list)
    widest_bar: WidestBar = field(default_factory=partial(WidestBar, None))

    @property
    def expected_error(self) -> float | None:
        """The largest half-width of a frequency's bar in the band, relative: mesh, reduction and bonding together."""
        return self.widest_bar.error

    @property
    def peak(self) -> Peak:
        """The wanted mode's peak; the highest one where there is none."""
        return self.wanted or self.highest

    @property
    def same(self) -> bool:
        """Whether the wanted mode's peak is the highest peak."""
        return self.wanted is not None and self.highest.is_at(self.wanted.frequency_hz, self.forced.loss)

    @cached_property
    def record(self) -> ResponseRecord:
        """The result as a command and a study keep it."""
        curve, shift = self.curve, self.circuit
        passive, bars = curve.passive_rms_m_per_v, curve_errors(self.forced, curve)
        zone_error, passive_error = [None, None] if bars is None else [*bars.tolist(), None][:2]
        first = curve.sensor_v_per_v[:, 0] if self.sensors else None
        circuit = {key: getattr(shift, key, None) for key in ("short_hz", "open_hz", "coupling")}
        wanted = _peak(self.wanted, self.forced) if self.wanted else None
        return ResponseRecord.of(
            self,
            frequency_hz=curve.frequency_hz.tolist(),
            zone_rms_m_per_V=curve.zone_rms_m_per_v.tolist(),
            passive_rms_m_per_V=None if passive is None else passive.tolist(),
            zone_rms_error_m_per_V=zone_error,
            passive_rms_error_m_per_V=passive_error,
            sensor_V_per_V=None if first is None else np.column_stack([first.real, first.imag]).tolist(),
            polarisation_signs=self.signs,
            circuit={"drivers": self.forced.circuit, **circuit},
            wanted_status=self.forced.verdict.status,
            wanted_peak=wanted,
            highest_peak=_peak(self.highest, self.forced, wanted if self.same else None),
            widest_bar=self.widest_bar.to_dict(),
        )


def _peak(peak: Peak, forced: ForcedPlate, same: PeakRecord | None = None) -> PeakRecord:
    """The record of a peak; `same` is that of the same resonance, whose factor has the same bar."""
    height, frequency = (error(forced, peak.frequency_hz) for error in (height_error, frequency_error))
    return PeakRecord.of(
        peak,
        zone_rms_m_per_V=peak.zone_rms,
        passive_rms_m_per_V=peak.passive_rms,
        height_error=height,
        frequency_error=frequency,
        quality_error=same.quality_error if same else quality_error(forced, peak),
        confinement_error_db=same.confinement_error_db if same else level_error_db(forced, peak),
    )


@one_thread()
def solve(case: Case, log: Log, band_hz: tuple[float, float] | None = None, points: int = POINTS) -> Response:
    """Compute the response of the patched plate over a band. Raises InputError without patches or for a model that
    cannot carry them.
    """
    case.require_plate(command="response")
    case.require("patches", command="response")
    patches = case.patches
    assert patches is not None
    meshes: list[MeshRecord] = []
    forced = forced_plate(case, log, band_hz, meshes)
    plate, (low, high) = forced.plate, forced.band_hz
    with log.step("sum the modes"):
        tone, highest = driven_hz(forced), highest_hz(forced, low, high, points, resonances_hz(forced))
        peaks_hz = [own_or(forced, tone, highest), highest] if tone and low <= tone <= high else [highest]
        curve = curve_about(forced, low, high, points, peaks_hz)
        wanted = peak_of(curve, peaks_hz[0]) if len(peaks_hz) > 1 else None
        shape_points, shape = _gridded(*forced.shape(peaks_hz[0]))
    forced_response = Response(
        f"{plate.name} with {patches.count} patches",
        sum(group.pencil.dof for group in plate.groups),
        curve,
        wanted,
        peak_of(curve, highest),
        case.quality_factor,
        forced.wanted_hz(),
        tuple(int(sign) for sign in forced.signs),
        patches.sensors,
        shape_points,
        shape,
        forced,
        circuit_shift(forced),
        meshes,
        _widest_bar(forced, low, high),
    )
    log.info(forced_response.widest_bar.text())
    forced_response.widest_bar.warn(case, log)
    _log_summary(forced_response, log)
    return forced_response


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


def _gridded(points: FloatArray, values: Any) -> tuple[FloatArray, Any]:
    """Interpolate the field to the nearest value on an even grid of about GRID points along its longer side."""
    from scipy.spatial import cKDTree

    low, high = points.min(axis=0), points.max(axis=0)
    step = float((high - low).max()) / GRID
    lines = [np.linspace(a, b, max(2, round((b - a) / step)) + 1) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid, values[cKDTree(points).query(grid)[1]]


def _log_summary(forced_response: Response, log: Log) -> None:
    log.info(lines(forced_response)[0])
    if forced_response.circuit:
        shift, error = forced_response.circuit, forced_response.record.peak.frequency_error
        log.info(
            f"wanted mode at {frequency(shift.short_hz, error)} with all patches short, {frequency(shift.open_hz, error)} "
            f"with all open: effective coupling factor squared (k_eff^2) {figure(shift.coupling)}"
        )
    _warn_of_wanted(forced_response, log)
    if forced_response.highest.frequency_hz in (
        forced_response.curve.frequency_hz[0],
        forced_response.curve.frequency_hz[-1],
    ):
        log.warning("PEAK_AT_END", "the response is largest at the end of the band: widen it")
    quality_factor = forced_response.peak.quality_factor
    if quality_factor and abs(quality_factor / forced_response.quality_factor_given - 1.0) > 0.2:
        log.warning(
            "SHARED_PEAK",
            f"the peak's width implies a quality factor of {figure(quality_factor)}, but the case gives "
            f"{forced_response.quality_factor_given:g}: modes overlap",
        )


def _warn_of_wanted(forced_response: Response, log: Log) -> None:
    """A warning where the highest peak is not the wanted mode's, or the band has no wanted mode."""
    (low, high), record = forced_response.forced.band_hz, forced_response.record
    if record.wanted_peak is None:
        where = (
            f"it lies at {frequency(forced_response.wanted_hz)}"
            if forced_response.wanted_hz
            else "no mode of the plate has its shape"
        )
        log.warning(
            "NO_MODE",
            f"the band from {low / KHZ:g} to {high / KHZ:g} kHz does not hold the wanted mode, {where}: the peak is another "
            "mode's",
        )
    elif not forced_response.same:
        log.warning(
            "OTHER_PEAK",
            f"the response is highest at {_tone(record.highest_peak)}, which is not the wanted mode at "
            f"{_tone(record.wanted_peak)}",
        )
    if forced_response.forced.verdict.status == "split":
        log.warning(
            "SPLIT_MODE", "the wanted shape is split among several modes of the patched plate: the strongest is meant"
        )


def lines(forced_response: Response) -> list[str]:
    """Describe the response in words: the wanted mode's peak, and the highest peak where it is another."""
    record = forced_response.record
    said = [_summary("wanted mode's peak", record.wanted_peak)] if record.wanted_peak else []
    return said if forced_response.same else [*said, _summary("highest peak", record.highest_peak)]


def _summary(name: str, peak: PeakRecord) -> str:
    level_text = ""
    if peak.confinement_db is not None:
        level_text = f", {level_with_bar(peak.confinement_db, peak.confinement_error_db)} above the passive face"
    known = frequency_with_bar(peak.frequency_hz, peak.frequency_error)
    tone = known if peak.frequency_error is not None else f"{known} (error not known)"
    error = peak.height_error
    height = with_bar(peak.zone_nm_per_V, None if error is None else error * peak.zone_nm_per_V, "nm/V")
    bar = "error not known" if error is None else "the damping given"
    return (
        f"{name} at {tone}: {height} rms on the zone ({bar}){level_text}; quality factor from the curve: "
        f"{'none' if peak.quality_factor is None else with_bar(peak.quality_factor, peak.quality_error)}"
    )


def _tone(peak: PeakRecord) -> str:
    return frequency(peak.frequency_hz, peak.frequency_error)
