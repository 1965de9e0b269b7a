"""Several zones on one plate: each driven in turn, all measured."""

from __future__ import annotations

from typing import Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.patched_plate import forced_plate
from pipeline.planning import calibration
from pipeline.planning.plan import RESPONSE_POINTS
from pipeline.quantity import frequency, frequency_with_bar, level_with_bar
from pipeline.records.record import CrosstalkRecord, DrivenZone, MeshRecord
from pipeline.units import MM
from solvers.driven.crosstalk import Zones, zone_volts, zones_of
from solvers.driven.error_bars import frequency_error, frequency_errors, half_widths, is_known, sources
from solvers.measures.levels import ratio_db
from solvers.measures.wanted_mode import SIMILAR
from solvers.piezo.height import height_error
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
        driven, errors = [], frequency_errors(forced)
        for zone, fed in enumerate(volts):
            peak = zones.peak_hz(fed, zone)
            mac = zones.mac(fed, peak, zone)
            _warn_of_shape(zone, peak, mac, log)
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
                    mac=mac,
                    over_rms_m_per_V=over[:, :-1].T.tolist(),
                    **_bars(zones, fed, zone, peak, errors),
                )
            )
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


def _bars(zones: Zones, fed: FloatArray, zone: int, peak_hz: float, errors: list[FloatArray]) -> dict[str, Any]:
    """Half-widths of the bars of what one driven zone shows at its peak; None where they are not known."""
    forced, share = zones.forced, calibration.mixing()

    def figures(each: Zones, tone: float) -> FloatArray:
        (rms,) = each.rms(fed, np.array([tone]))
        return np.concatenate([rms, ratio_db(rms, rms[zone]), [each.mac(fed, tone, zone)]])

    nominal, count = figures(zones, peak_hz), forced.design.zones
    half = np.full_like(nominal, np.nan)
    if share is not None and is_known(errors):
        load = height_error(forced, peak_hz)
        half = half_widths(
            nominal,
            sources(forced, errors, peak_hz, share, load),
            lambda each: figures(zones.of(each), peak_hz * each.own),
        )
    known = [None if np.isnan(value) else float(value) for value in half]
    return {
        "peak_error": frequency_error(forced, peak_hz, errors),
        "rms_error_m_per_V": known[:count],
        "level_error_db": known[count + 1 : 2 * count + 1],
        "passive_error_db": known[2 * count + 1],
        "mac_error": known[-1],
    }


def _warn_of_shape(zone: int, peak_hz: float, mac: float, log: Log) -> None:
    if mac < SIMILAR:
        log.warning(
            "OTHER_PEAK",
            f"zone {zone + 1} moves most at {frequency(peak_hz)}, but not in the wanted shape (MAC {mac:.2f}): the levels are "
            "another mode's; give a --band around the wanted one",
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
    head = f"{len(record.zones)} zones, {record.gap_m / MM:.2f} mm and {between} between two of them"
    return [head if len(record.zones) > 1 else "one zone", *map(_of_zone, record.zones)]


def _of_zone(zone: DrivenZone) -> str:
    errors = zone.level_error_db or [None] * len(zone.level_db)
    levels = ", ".join(level_with_bar(*each) for each in zip(zone.level_db, errors, strict=True))
    passive = ""
    if zone.passive_db is not None:
        passive = f"; passive face {level_with_bar(zone.passive_db, zone.passive_error_db)}"
    tone = frequency_with_bar(zone.peak_hz, zone.peak_error)
    return f"driven at y = {zone.centre_m / MM:.2f} mm, {tone}: zones at {levels}{passive}"
