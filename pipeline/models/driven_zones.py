"""Several zones on one plate: each driven in turn at its own peak while the others' patches are held at 0 V."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.forced import forced_plate
from pipeline.models.zone_parts import DrivenZone
from pipeline.quantity import figure, frequency
from pipeline.records.record import MeshRecord
from solvers.accuracy import calibration
from solvers.driven.curve_bars import doubts
from solvers.driven.error_bars import frequency_error, frequency_errors
from solvers.driven.several_patches import curve_half_widths, peak_half_widths, zone_volts, zones_of
from solvers.measures.confinement import ratio_db
from solvers.measures.target_mode import SIMILAR
from solvers.threads import one_thread


def check_zones(case: Case) -> None:
    """Raise InputError for patches that do not drive each zone with the others' at 0 V."""
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


def solve(
    case: Case, log: Log, band_hz: tuple[float, float] | None, points: int, meshes: list[MeshRecord],
    is_announced: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Drive each zone at its own peak and measure every zone, there and at so many frequencies of a band.

    Returns columns of `CrosstalkResult` by name. InputError as `check_zones` and `forced_plate`.
    """
    case.require("patches", command="crosstalk")
    check_zones(case)
    forced = forced_plate(case, log, band_hz, meshes, is_announced)
    patches, design = case.patches, case.design
    assert patches is not None
    with log.step(f"{design.zones} zones, each driven in turn"), one_thread():
        zones, volts = zones_of(forced), zone_volts(forced, np.array(patches.centres_m))
        frequencies = np.linspace(*forced.band_hz, points)
        errors, known = frequency_errors(forced), doubts(forced, calibration.mixing())
        curves = curve_half_widths(zones, volts, frequencies, known)
        driven = []
        for zone, fed in enumerate(volts):
            peak = zones.peak_hz(fed, zone)
            (at,) = zones.rms(fed, np.array([peak]))
            driven.append(
                DrivenZone(
                    centre_m=float(design.zone_centres_m[zone]),
                    drivers=np.flatnonzero(fed).tolist(),
                    peak_hz=peak,
                    rms_m_per_V=at[:-1].tolist(),
                    level_db=ratio_db(at[:-1], at[zone]).tolist(),
                    passive_db=float(ratio_db(at[-1], at[zone])),
                    mac=zones.mac(fed, peak, zone),
                    over_rms_m_per_V=zones.rms(fed, frequencies)[:, :-1].T.tolist(),
                    over_rms_error_m_per_V=curves[zone].tolist(),
                    peak_error=frequency_error(forced, peak, errors),
                    **peak_half_widths(zones, fed, zone, peak, known),
                )
            )
            _warn_of_shape(zone, driven[-1], log)
    return {
        "model": f"{forced.plate.name} with {patches.count} patches",
        "dof": sum(group.pencil.dof for group in forced.plate.groups),
        "shared_rows": design.shared_rows,
        "gap_m": design.zone_gap_m,
        "frequency_hz": frequencies.tolist(),
        "zones": driven,
    }


def _warn_of_shape(number: int, zone: DrivenZone, log: Log) -> None:
    """Warn of a zone that moves most in another shape than the target's."""
    if zone.mac is not None and zone.mac < SIMILAR:
        log.warning(
            "OTHER_PEAK",
            f"zone {number + 1} moves most at {frequency(zone.peak_hz, zone.peak_error)}, but not in the target shape "
            f"(MAC {figure(zone.mac, zone.mac_error)}): the levels are another mode's; give a --band about the target mode",
        )
