"""Several zones on one plate: each driven in turn, all measured."""

from __future__ import annotations

from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.patched_plate import forced_plate
from pipeline.planning import calibration
from pipeline.planning.plan import RESPONSE_POINTS
from pipeline.quantity import figure, frequency, frequency_with_bar, level_with_bar
from pipeline.records.record import CrosstalkRecord, DrivenZone, MeshRecord
from pipeline.units import MM
from solvers.driven.crosstalk import Zones, zone_volts, zones_of
from solvers.driven.curve_bars import Doubts, doubts, rms, rms_bars, with_peak
from solvers.driven.error_bars import frequency_error, frequency_errors
from solvers.measures.levels import ratio_db
from solvers.measures.wanted_mode import SIMILAR
from solvers.threads import one_thread


@one_thread()
def solve(
    case: Case, log: Log, band_hz: tuple[float, float] | None = None, points: int = RESPONSE_POINTS,
    meshes: list[MeshRecord] | None = None,
) -> CrosstalkRecord:  # fmt: skip
    """Drive one zone at its own peak and measure every zone. InputError for a case without patches that drive each zone."""
    check(case)
    forced = forced_plate(case, log, band_hz, [] if meshes is None else meshes)
    patches, design = case.patches, case.design
    assert patches is not None
    with log.step(f"{design.zones} zones, each driven in turn"):
        zones, volts = zones_of(forced), zone_volts(forced, np.array(patches.centres_m))
        tones = np.linspace(*forced.band_hz, points)
        driven, errors, known = [], frequency_errors(forced), doubts(forced, calibration.mixing())
        curves = _curve_bars(zones, volts, tones, known)
        for zone, fed in enumerate(volts):
            peak = zones.peak_hz(fed, zone)
            (at,) = zones.rms(fed, np.array([peak]))
            over = zones.rms(fed, tones)
            driven.append(
                DrivenZone(
                    centre_m=float(design.zone_centres_m[zone]),
                    drivers=np.flatnonzero(fed).tolist(),
                    peak_hz=peak,
                    rms_m_per_V=at[:-1].tolist(),
                    level_db=ratio_db(at[:-1], at[zone]).tolist(),
                    passive_db=None if np.isnan(at[-1]) else float(ratio_db(at[-1], at[zone])),
                    mac=zones.mac(fed, peak, zone),
                    over_rms_m_per_V=over[:, :-1].T.tolist(),
                    over_rms_error_m_per_V=_numbers(curves[zone]),
                    peak_error=frequency_error(forced, peak, errors),
                    **_peak_bars(zones, fed, zone, peak, known),
                )
            )
            _warn_of_shape(zone, driven[-1], log)
    record = CrosstalkRecord(
        model=f"{forced.plate.name} with {patches.count} patches",
        dof=sum(group.pencil.dof for group in forced.plate.groups),
        shared_rows=design.shared_rows,
        gap_m=design.zone_gap_m,
        frequency_hz=tones.tolist(),
        zones=driven,
    )
    for line in lines(record):
        log.info(line)
    return record


def _curve_bars(zones: Zones, volts: FloatArray, tones: FloatArray, known: Doubts | None) -> FloatArray:
    """Half-widths of the bars of every zone's rms while each is driven, (driven, zones, n); NaN where they are not known."""
    forced, count = zones.forced, zones.forced.design.zones
    if known is None:
        return np.full((len(volts), count, len(tones)), np.nan)
    return rms_bars(known, forced, zones.grams[:count], tones, volts[:, forced.drivers].astype(complex))


def _peak_bars(zones: Zones, fed: FloatArray, zone: int, peak_hz: float, known: Doubts | None) -> dict[str, Any]:
    """Half-widths of the bars of what one driven zone shows at its peak; None where they are not known."""
    forced, count = zones.forced, zones.forced.design.zones
    parts = count + zones.has_passive
    grams = np.concatenate([zones.grams[:parts], [np.outer(zones.shapes[zone], zones.shapes[zone])]])

    def figures(squares: ComplexArray) -> FloatArray:
        each = rms(squares)
        return np.concatenate([each[:-1], ratio_db(each[:-1], each[zone]), each[-1:] ** 2 / each[zone] ** 2])

    half = np.full(2 * parts + 1, np.nan)
    if known is not None:
        half = with_peak(known, forced, grams, peak_hz, fed[forced.drivers].astype(complex), figures)
    levels = _numbers(half[parts : 2 * parts])
    return {
        "rms_error_m_per_V": _numbers(half[:count]),
        "level_error_db": levels[:count],
        "passive_error_db": levels[count] if zones.has_passive else None,
        "mac_error": _numbers(half)[-1],
    }


def _numbers(values: FloatArray) -> list[Any]:
    """The same with None for NaN."""
    return [_numbers(each) if np.ndim(each) else None if np.isnan(each) else float(each) for each in values]


def _warn_of_shape(number: int, zone: DrivenZone, log: Log) -> None:
    if zone.mac is not None and zone.mac < SIMILAR:
        log.warning(
            "OTHER_PEAK",
            f"zone {number + 1} moves most at {frequency(zone.peak_hz, zone.peak_error)}, but not in the wanted shape "
            f"(MAC {figure(zone.mac, zone.mac_error)}): the levels are another mode's; give a --band around the wanted one",
        )


def check(case: Case) -> None:
    """InputError for a case without patches that drive each of its zones at rest on 0 V."""
    case.require_plate(command="crosstalk", several=True)
    case.require("patches", command="crosstalk")
    patches, design = case.patches, case.design
    assert patches is not None
    said = []
    if patches.circuit != "short":
        said.append(f"patches.circuit = {patches.circuit!r}: must be 'short', zones at rest hold their patches at 0 V")
    y = np.array([patches.centres_m[i][1] for i in patches.drivers])
    bare = [i + 1 for i, mid in enumerate(design.zone_centres_m) if not (np.abs(y - mid) < design.width_m / 2.0).any()]
    if bare:
        said.append(f"patches.centres_mm: zone {', '.join(map(str, bare))} has no patch that drives it")
    if said:
        raise InputError(f"{case.source or case.name}: {text}" for text in said)


def lines(record: CrosstalkRecord) -> list[str]:
    """The table in words: a line a driven zone."""
    between = f"{record.shared_rows} rows" if record.shared_rows else "no row"
    head = f"{len(record.zones)} zones, {record.gap_m / MM:g} mm and {between} between two of them"
    return [head if len(record.zones) > 1 else "one zone", *map(_of_zone, record.zones)]


def _of_zone(zone: DrivenZone) -> str:
    errors = zone.level_error_db or [None] * len(zone.level_db)
    levels = ", ".join(level_with_bar(*each) for each in zip(zone.level_db, errors, strict=True))
    passive = ""
    if zone.passive_db is not None:
        passive = f"; passive face {level_with_bar(zone.passive_db, zone.passive_error_db)}"
    tone = frequency_with_bar(zone.peak_hz, zone.peak_error)
    return f"driven at y = {zone.centre_m / MM:g} mm, {tone}: zones at {levels}{passive}"
