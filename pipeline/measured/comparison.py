"""Comparison of a computed response with a measured sweep and map: shift, losses, confinement, correlation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.measured import files, parts
from pipeline.measured.files import MeasuredField, MeasuredSweep
from pipeline.models.forced import SolvedResponse
from pipeline.planning.model_choice import driven_band_hz
from pipeline.quantity import MM, frequency, percentage
from solvers.control.identification import Resonance, Sensor, Sweep, resonance
from solvers.errors import SolverError
from solvers.measures.confinement import CONFINED_DB
from solvers.measures.correlation import Weights, assurance, confinement_of, sampled, weigh
from solvers.piezo.responses import loudest_point, point_response

COVERED = 0.9  # of a face's area: with less, the map does not represent the face


@dataclass(frozen=True)
class Measurements:
    """Measurements read: a sweep, the point of its laser (m; None: where the zone moves most), a map with its weights."""

    sweep: MeasuredSweep | None
    at_m: tuple[float, float] | None
    field: MeasuredField | None
    weights: Weights | None


def read(
    case: Case, sweep: str | None, field: str | None, at: str | None, band_hz: tuple[float, float] | None = None
) -> Measurements | None:
    """Read the files of a command line, or else of the case; None if neither names one.

    Raises InputError for measurements that do not fit the case or its response over a band.
    """
    of_case = sweep is None and field is None and at is None and case.measured is not None
    if of_case:
        given = case.measured
        assert given is not None
        sweep, field = (None if path is None else str(path) for path in (given.sweep, given.map))
        at = None if given.at_m is None else f"{given.at_m[0] / MM!r},{given.at_m[1] / MM!r}"
    if sweep is None and field is None:
        return None
    case.require_plate("response")
    case.require("patches", command="response")
    measured = files.read_sweep(sweep) if sweep is not None else None
    if measured and measured.quantity == "sensor" and not (case.patches and case.patches.sensors):
        raise InputError(f"{sweep}: holds a sensor's voltage, but the case has no sensor: set patches.sensors")
    if measured:
        key = "--band" if band_hz else "solve.band_kHz"
        what = f"{case.source or case.name}: measured.sweep = {measured.file}" if of_case else measured.file
        _refuse_elsewhere(measured, driven_band_hz(case, band_hz), str(what), key)
    mapped = files.read_field(field, case.design) if field is not None else None
    try:
        weights = weigh(mapped.points_m, case.design) if mapped else None
    except SolverError as error:
        raise InputError(f"{field}: {error}") from error
    place = _place(at, case, f"{case.source or case.name}: measured.at_mm" if of_case else "--at")
    return Measurements(measured, place, mapped, weights)


def _refuse_elsewhere(measured: MeasuredSweep, band_hz: tuple[float, float], what: str, key: str) -> None:
    low, high = measured.sweep.frequencies_hz[0], measured.sweep.frequencies_hz[-1]
    if high <= band_hz[0] or low >= band_hz[1]:
        raise InputError(
            f"{what}: {low:g} to {high:g} Hz: must overlap the response, {band_hz[0]:g} to {band_hz[1]:g} Hz ({key})"
        )


def _place(at: str | None, case: Case, what: str) -> tuple[float, float] | None:
    if at is None:
        return None
    half = (case.design.half_length_m, case.design.half_span_m)
    allowed = f"must be X,Y in mm, within {half[0] / MM:g} and {half[1] / MM:g} of the plate's centre"
    try:
        x, y = (MM * float(part) for part in at.split(","))
    except ValueError as error:
        raise InputError(f"{what} = {at!r}: {allowed}") from error
    if not (abs(x) <= half[0] and abs(y) <= half[1]):
        raise InputError(f"{what} = {at!r}: {allowed}")
    return x, y


def compare(
    case: Case, response: SolvedResponse, measured: Measurements, log: Log
) -> tuple[parts.MeasuredRecord, dict[str, Any]]:
    """Compare both files with the computed response; returns the record and the arrays of the pictures."""
    sweep, field = None, None
    arrays: dict[str, Any] = {}
    with log.step("compare with the measurement"):
        if measured.sweep:
            sweep, drawn = _sweep(case, response, measured.sweep, measured.at_m, log)
            arrays |= drawn
        if measured.field and measured.weights:
            field, drawn = _map(case, response, measured.field, measured.weights, log)
            arrays |= drawn
    return parts.MeasuredRecord(sweep=sweep, map=field), arrays


def _sweep(
    case: Case, response: SolvedResponse, measured: MeasuredSweep, at_m: tuple[float, float] | None, log: Log
) -> tuple[parts.MeasuredSweepRecord, dict[str, Any]]:
    given, tone = measured.sweep, response.curve.frequency_hz
    low, high = given.frequencies_hz[0], given.frequencies_hz[-1]
    sensor: Sensor = "velocity" if measured.quantity == "velocity" else "displacement"
    place, curve = _computed(case, response, measured, at_m)
    near = np.abs(tone - (low + high) / 2.0) <= 1.5 * (high - low)  # peaks further away belong to other modes
    near |= near.sum() < files.MIN_COUNT
    theirs, ours = resonance(given, sensor), resonance(Sweep(tone[near], curve[near]), sensor)
    if theirs.trouble:
        instead = "using the peak and its half-power width instead"
        log.warning("NO_CIRCLE", f"{measured.file}: {theirs.trouble}; {instead}")
    if not tone[0] <= theirs.peak_hz <= tone[-1]:
        beyond = f"its peak at {frequency(theirs.peak_hz)} lies outside the band of the response"
        log.warning("PEAK_OUTSIDE", f"{measured.file}: {beyond}")
    shift, error = theirs.frequency_hz - ours.frequency_hz, response.expected_error
    halves_hz = [theirs.frequency_error and theirs.frequency_hz * theirs.frequency_error]
    halves_hz += [error and ours.frequency_hz * error]
    if ours.trouble:  # the computed frequency is that of a point, too
        halves_hz += [ours.frequency_error and ours.frequency_hz * ours.frequency_error]
    point_mm = None if place is None else [place[0] / MM, place[1] / MM]
    by_model = {"point_mm": point_mm, "frequency_error": error, "quality_error": None}
    record = parts.MeasuredSweepRecord(
        **_source(measured),
        **_identified(theirs),
        points=len(given.frequencies_hz),
        band_hz=[float(low), float(high)],
        frequency_shift_hz=shift,
        frequency_shift=shift / ours.frequency_hz,
        frequency_shift_error_hz=None if None in halves_hz else sum(filter(None, halves_hz)),
        computed=parts.ComputedResonance(**_identified(ours) | by_model),
    )
    arrays = {"measured_hz": given.frequencies_hz, "measured_response": given.response}
    return record, arrays | {"measured_computed_hz": tone, "measured_computed": curve}


def _source(measured: MeasuredSweep | MeasuredField) -> dict[str, Any]:
    return {"file": Path(measured.file).name, "synthetic": measured.synthetic, "quantity": measured.quantity}


def _computed(
    case: Case, response: SolvedResponse, measured: MeasuredSweep, at_m: tuple[float, float] | None
) -> tuple[tuple[float, float] | None, ComplexArray]:
    """Compute the quantity that the instrument measures, per volt, and the point where it does."""
    tone = response.curve.frequency_hz
    if measured.quantity == "sensor":
        return None, response.curve.sensor_v_per_v[:, 0]
    place = at_m or loudest_point(response.forced, response.peak.frequency_hz)
    moved = point_response(response.forced, place, tone)
    return place, 2j * np.pi * tone * moved if measured.quantity == "velocity" else moved


def _identified(identified: Resonance) -> dict[str, Any]:
    circle = identified.circle
    return {
        "peak_hz": identified.peak_hz,
        "frequency_hz": identified.frequency_hz,
        "quality_factor": identified.quality_factor,
        "frequency_error": identified.frequency_error,
        "quality_error": circle and circle.quality_error and circle.quality_error * circle.plant.quality_factor,
        "quality_factor_half_power": identified.half_power_quality_factor,
        "circle": None if circle is None else circle.to_dict() | {"fitted_hz": [identified.low_hz, identified.high_hz]},
        "no_circle": identified.trouble,
    }


def _map(
    case: Case, response: SolvedResponse, measured: MeasuredField, weights: Weights, log: Log
) -> tuple[parts.MeasuredMapRecord, dict[str, Any]]:
    design = case.design
    computed = operating_field(response, measured.points_m)
    given, seen = confinement_of(weights, measured.values, design), confinement_of(weights, computed, design)
    alike = assurance(weights.area_m2, measured.values[weights.index], computed[weights.index])
    _log_cover(measured, weights, log)
    confined = None if given.confinement_db is None else bool(given.confinement_db >= CONFINED_DB)
    record = parts.MeasuredMapRecord(
        **_source(measured),
        points=len(measured.values),
        covered_active=weights.active,
        covered_passive=weights.passive,
        zone_share=given.zone_share,
        confinement_db=given.confinement_db,
        confined=confined,
        mac=given.mac,
        mac_operating=alike,
        computed=parts.ComputedMap(
            frequency_hz=response.peak.frequency_hz,
            confinement_db=response.peak.confinement_db,
            mac=seen.mac,
            confinement_at_points_db=seen.confinement_db,
            zone_share_at_points=seen.zone_share,
        ),
    )
    arrays = {"measured_xy": measured.points_m, "measured_field": measured.values, "measured_operating": computed}
    return record, arrays


def _log_cover(measured: MeasuredField, weights: Weights, log: Log) -> None:
    for name, share in (("active", weights.active), ("passive", weights.passive)):
        if share is not None and share < COVERED:
            part = f"covers only {percentage(share)} of the {name} touch face; its rms is that of the covered part"
            log.warning("MAP_PARTIAL", f"{measured.file}: {part}")


def operating_field(response: SolvedResponse, points_m: FloatArray) -> ComplexArray:
    """Computed u_z per volt at the peak, (n,) in m/V, at points (n, 2) in m."""
    return sampled(*response.forced.shape(response.peak.frequency_hz), points_m)
