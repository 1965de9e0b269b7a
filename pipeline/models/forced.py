"""Forced response of a case's plate to its patches, and of several zones, each driven in turn.

Curves over frequency have error bars, as do the quality factor of a peak and its level over the passive face.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import chain, combinations
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.layout import Design
from geometry.tiling import Tiling, tile
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models import own_frequency, parts
from pipeline.models.answer_parts import DrivenZone
from pipeline.models.cell_cache import ArrayCache, MatrixCache
from pipeline.planning import driven_demand, mesh_rules, resource_estimate, simplifications
from pipeline.planning.model_choice import ModelChoice, driven_band_hz, model_choice_of, response_high_hz
from pipeline.planning.refinement import WidestBar
from pipeline.planning.resources import ResourceEstimate
from pipeline.quantity import MM, figure, frequency, interval, several
from pipeline.records.record import MeshRecord
from solvers.accuracy import calibration
from solvers.control.identification import half_power_points
from solvers.driven.curve_bars import doubts, rms_bars, with_peak
from solvers.driven.error_bars import (
    Louder,
    Variation,
    WidthRates,
    frequency_error,
    frequency_errors,
    half_widths,
    is_known,
    louder,
    variations,
    width_rates,
)
from solvers.driven.forms import face_grams
from solvers.driven.several_patches import curve_half_widths, peak_half_widths, zone_volts, zones_of
from solvers.measures.confinement import ratio_db
from solvers.measures.target_mode import MIN_MAC
from solvers.piezo import responses
from solvers.piezo.forced import Curve, Drive, ForcedPlate
from solvers.piezo.patch import BondedPatch, StaticCorrection, bonded_patch, patch_mesh, pillars_beneath
from solvers.piezo.patched_plate import PatchedPlate, coupled_classes
from solvers.piezo.responses import (
    Peak,
    curve_about,
    driven_hz,
    height_error,
    highest_hz,
    near_hz,
    own_or,
    peak_of,
    resonances_hz,
)
from solvers.plates.assembled import PlateModel
from solvers.superelement.moduli import Moduli
from solvers.threads import one_thread

FOLLOWS = 0.2  # of its own lowest resonance: below it, motion inside a patch adds at most 4 % to the static deflection
ABOUT = 0.1  # of the target mode's frequency: how far a default band reaches beyond a mode that lies outside it
GRID = 160
DECAYED = 4.0  # half-power widths on either side of a peak: range for reading its quality factor
AROUND_PEAK = 65  # points over this range, and more at the peak
FIRST_ORDER = 0.05  # of a change: largest second-order part for which the plate is not computed again


@dataclass(frozen=True)
class SolvedResponse:
    """Response curve, peak of the target mode (None if the band has none), highest peak, and the plate that gives them.

    widest_bar: the largest error bar of the frequencies in the band.
    """

    forced: ForcedPlate
    curve: Curve
    target: Peak | None
    highest: Peak
    widest_bar: WidestBar

    @property
    def expected_error(self) -> float | None:
        """Largest relative error of a frequency in the band: mesh, reduction and bonding together."""
        return self.widest_bar.error

    @property
    def peak(self) -> Peak:
        """Peak of the target mode, or the highest peak if there is none."""
        return self.target or self.highest


@one_thread()
def forced_plate(
    case: Case, log: Log, band_hz: tuple[float, float] | None = None, meshes: list[MeshRecord] | None = None,
    is_announced: bool = False, choice: ModelChoice | None = None, own_moduli: bool = False,
) -> ForcedPlate:  # fmt: skip
    """Bond the patches and prepare the forced response over a band (default: the case's, or one around the target mode).

    meshes: receives the meshes; is_announced: the plate is one of several, whose resource estimate was logged as a whole;
    choice: model and mesh of a plan that was logged; own_moduli: those that depend on the frequency are taken at each one,
    about a reduction with those at the band's middle. InputError for a model that cannot carry patches, and the exceptions of
    the solvers.
    """
    given, band, known = case, driven_band_hz(case, band_hz), len(meshes or ())
    refuse_patches(case, band)
    if not is_announced and choice is None:
        resource_estimate.log_estimate("the forced response", _demand(case, band), log)
    if choice is None:
        choice = driven_demand.as_driven(case, model_choice_of(case, "plate", response_high_hz(case, band)))
        simplifications.log_all(choice.left_out, log)
    if choice.reduction is None:
        raise InputError(f"{case.name}: solve.model: must be auto or superelement, patches need reduced cells")
    parted = own_moduli and own_frequency.is_open(case, "plate")
    if parted:
        case = own_frequency.at_middle(case, band)
        for line in own_frequency.of_part(case, "plate").beyond(np.array(band)):
            log.warning("MATERIAL", line)
    model = parts.built(case, choice, log, [] if meshes is None else meshes, parted)
    assert isinstance(model, PlateModel)
    forced = driven(case, model, band, log)
    if band_hz or case.solve.band_hz or (wider := _with_target(forced)) is None:
        return forced
    log.info(f"the target mode lies outside the default band, which therefore spans {interval(*wider)}")
    del (meshes or [])[known:]
    return forced_plate(given, log, wider, meshes, is_announced=True, own_moduli=own_moduli)


def _with_target(forced: ForcedPlate) -> tuple[float, float] | None:
    """The band of a plate with its target mode, Hz; None where the band contains it, or there is none.

    Theory sizes the default band for a free plate that ends beyond the rows: supports and narrow rims move the mode.
    """
    (low, high), tone = forced.band_hz, driven_hz(forced)
    if tone is None or low <= tone <= high:
        return None
    return min(low, (1.0 - ABOUT) * tone), max(high, (1.0 + ABOUT) * tone)


@one_thread()
def driven(case: Case, model: PlateModel, band_hz: tuple[float, float], log: Log) -> ForcedPlate:
    """Bond the case's patches to an assembled plate and solve its modes around the band."""
    patches = case.patches
    assert patches is not None
    with log.step("bond the patches"):
        bonded = _bonded(case, model.tiling)
        # patches that couple all classes give a dense block for every pair of classes, but only one in the whole plate
        symmetries = model.symmetries if len(coupled_classes(bonded)) > 1 else (None,)
        plates = {plate.symmetry: plate for plate in map(model.assembled, symmetries)}
        middle_hz = (band_hz[0] + band_hz[1]) / 2.0
        beneath = StaticCorrection(model.reductions, MatrixCache())
        plate = PatchedPlate(plates, bonded, patches.face == "back", model.name, beneath, middle_hz)
    if plate.undriven:
        log.left_out("symmetry classes " + ", ".join(plate.undriven), "the patches do not drive them")
    with log.step("modes of the patched plate"):
        moduli = Moduli(model.reductions.materials, case.is_lossy) if model.reductions.parted else None
        drive = Drive(patches.drivers, patches.sensors, band_hz, case.quality_factor, patches.circuit, case.air, moduli)
        choice = model_choice_of(case, "plate", response_high_hz(case, band_hz))
        bytes_each = driven_demand.group_bytes(case, choice, _demand(case, band_hz).modes or 0.0)
        return ForcedPlate(plate, case.design, drive, bytes_each=bytes_each, target_window_hz=_search_window_hz(case))


def refuse_patches(case: Case, band_hz: tuple[float, float]) -> None:
    """Raise InputError for patches that an assembled plate cannot carry in this band, before computing the plate."""
    tiling = tile(case.design, case.design.length_m)
    _refuse_over_pillars(case, tiling)
    _refuse_ringing(case, min(patch.own_hz for patch in _bonded(case, tiling)), band_hz[1])


@one_thread()
def solve_response(
    case: Case, choice: ModelChoice | None, log: Log, band_hz: tuple[float, float] | None, points: int,
    meshes: list[MeshRecord],
) -> SolvedResponse:  # fmt: skip
    """Compute the response of the patched plate over a band; InputError for a model that cannot carry patches."""
    forced = forced_plate(case, log, band_hz, meshes, choice=choice, own_moduli=True)
    low, high = forced.band_hz
    with log.step("sum the modes"):
        tone, highest = driven_hz(forced), highest_hz(forced, low, high, points, resonances_hz(forced))
        peaks_hz = [highest]
        if tone and low <= tone <= high:
            peaks_hz = [own_or(forced, tone, highest), highest]
        curve = curve_about(forced, low, high, points, peaks_hz)
    target = peak_of(curve, peaks_hz[0]) if len(peaks_hz) > 1 else None
    return SolvedResponse(forced, curve, target, peak_of(curve, highest), _widest_bar(forced, low, high))


def gridded(points: FloatArray, values: ComplexArray) -> dict[str, Any]:
    """Return a field on the touch face for drawing, on an even grid of about GRID points along the longer side."""
    from scipy.spatial import cKDTree

    low, high = points.min(axis=0), points.max(axis=0)
    step = float((high - low).max()) / GRID
    lines = [np.linspace(a, b, max(2, round((b - a) / step)) + 1) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    nearest = values[cKDTree(points).query(grid)[1]]
    return {"response_xy": grid.astype(np.float32), "response_uz": nearest.astype(np.complex64)}


def quality_error(forced: ForcedPlate, peak: Peak) -> float | None:
    """Estimate the error of a peak's quality factor; None if it is unknown.

    The damping is given and counts as exact. Neighbouring modes make a peak wider or narrower than its own mode. The factor
    is therefore read again on plates whose resonances, mode shapes and patch loads vary within their errors, to first order
    where that is enough. The change due to a finer curve is added.

    Parameters
    ----------
    forced : ForcedPlate
    peak : Peak
        A peak of its response.
    """
    share, errors = calibration.mixing(), frequency_errors(forced)
    if peak.quality_factor is None or share is None or not is_known(errors):
        return None

    def again(each: Variation | Louder) -> FloatArray:
        return _quality(*_curve(each.of(forced), peak.frequency_hz * each.own))

    top, curve = _curve(forced, peak.frequency_hz)
    nominal, load = _quality(top, curve), height_error(forced, peak.frequency_hz)
    ends = half_power_points(
        curve.frequency_hz, curve.zone_rms_m_per_v, int(np.argmin(np.abs(curve.frequency_hz - top)))
    )
    far, near = 0.0, list(variations(forced, errors, peak.frequency_hz, share))
    if ends is not None:
        far, near = _parted(width_rates(forced, top, ends), near)
    rest: Iterable[tuple[Variation | Louder, ...]] = chain(near, louder(forced, np.nan if load is None else load))
    half = half_widths(nominal, rest, again)
    error = float(np.hypot(half[0], far * nominal[0]) + abs(nominal[0] - peak.quality_factor))
    return error if np.isfinite(error) else None


def level_error_db(forced: ForcedPlate, peak: Peak) -> float | None:
    """Estimate the error of a peak's level over the passive face, dB; the peak follows its mode.

    None if it is unknown, for example if a charge drives the patches.
    """
    known = doubts(forced, calibration.mixing())
    if known is None or peak.passive_rms is None or forced.circuit != "short":
        return None

    def level(squares: ComplexArray) -> FloatArray:
        zone, passive = np.sqrt(squares[..., 0, 0].real)
        return ratio_db(zone, passive)[None]

    fed = forced.signs[forced.drivers].astype(complex)
    error = float(with_peak(known, forced, face_grams(forced), peak.frequency_hz, fed, level)[0])
    return error if np.isfinite(error) else None


def curve_errors(forced: ForcedPlate, curve: Curve) -> FloatArray | None:
    """Estimate the errors of a curve's rms at its frequencies, zone and passive face, (1 or 2, n) in m/V.

    None if they are unknown, for example if a charge drives the patches.
    """
    known = doubts(forced, calibration.mixing())
    if known is None or forced.circuit != "short":
        return None
    fed = forced.signs[forced.drivers].astype(complex)
    (half,) = rms_bars(known, forced, face_grams(forced), curve.frequency_hz, fed[None])
    return half if np.isfinite(half).all() else None


def check_zones(case: Case) -> None:
    """Raise InputError for patches that cannot drive each zone while those of the others are held at 0 V."""
    patches, design = case.patches, case.design
    assert patches is not None
    said = []
    if patches.circuit != "short":
        said.append(f"patches.circuit = {patches.circuit!r}: must be 'short', zones at rest keep their patches at 0 V")
    centres = np.array([patches.centres_m[i] for i in range(patches.count) if i not in patches.sensors])
    bare = [i for i, view in enumerate(design.views, start=1) if not view.in_zone(centres).any()]
    if bare:
        said.append(f"patches.centres_mm: no patch drives zone {', '.join(map(str, bare))}; every zone needs one")
    if said:
        raise InputError(f"{case.source or case.name}: {text}" for text in said)


def solve(
    case: Case, log: Log, band_hz: tuple[float, float] | None, points: int, meshes: list[MeshRecord],
    is_announced: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Drive each zone at its own peak and measure every zone, there and at `points` frequencies of a band.

    Returns columns of `CrosstalkResult` by name. Raises InputError like `check_zones` and `forced_plate`.
    """
    case.require("patches", command="crosstalk")
    check_zones(case)
    design, patches = case.design, case.patches
    assert patches is not None
    case = replace(case, patches=replace(patches, resting=()))  # each zone has its turn
    forced = forced_plate(case, log, band_hz, meshes, is_announced)
    with log.step(f"{len(design.views)} zones, each driven in turn"), one_thread():
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
                    centre_m=design.views[zone].centre_m[1],
                    centre_x_m=design.views[zone].centre_m[0],
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
        "model": f"{forced.plate.name} with {several(patches.count, 'patch')}",
        "dof": sum(group.pencil.dof for group in forced.plate.groups),
        "shared_rows": design.shared_rows,
        "gap_m": design.zone_gap_m if design.zones > 1 else _gap_m(design),
        "frequency_hz": frequencies.tolist(),
        "zones": driven,
    }


def _gap_m(design: Design) -> float:
    """Least distance between the borders of two zones anywhere on a plate, m; 0 for a single one."""
    size = np.array([design.length_m, design.width_m])
    pairs = combinations(np.array([view.centre_m for view in design.views]), 2)
    return min(
        (float(np.linalg.norm(np.maximum(np.abs(one - other) - size, 0.0))) for one, other in pairs), default=0.0
    )


def _search_window_hz(case: Case) -> tuple[float, float] | None:
    """First search window of the target mode, Hz; None for several driven zones, which share no mode."""
    several = len(case.design.views) > 1 and not (case.patches and case.patches.resting)
    return None if several else mesh_rules.search_window_hz(case.design)


def _bonded(case: Case, tiling: Tiling) -> list[BondedPatch]:
    """Patches of the case, bonded; equal ones are computed once and cached."""
    patches = case.patches
    assert patches is not None
    material, thickness, back = patches.material, patches.size_m[2], patches.face == "back"
    return [
        bonded_patch(material, box, thickness, back, patch_mesh(case.design, tiling, box), ArrayCache(), patches.glue)
        for box in patches.boxes_m()
    ]


def _refuse_over_pillars(case: Case, tiling: Tiling) -> None:
    """Raise InputError if a patch reaches over a panel with a pillar on the same face, which reduced panels do not keep."""
    patches = case.patches
    assert patches is not None
    if patches.face == "touch" and not any(pillar.faces == 2 for pillar in case.design.kinds):
        return
    for number, box in enumerate(patches.boxes_m()):
        for _, j in pillars_beneath(tiling, box):
            low, high = (end / MM for end in tiling.y[j : j + 2])
            y0, y1 = (end / MM for end in box[2:])
            raise InputError(
                f"{case.source or case.name}: patches: patch {number} reaches from y = {y0:g} to {y1:g} mm: must stay clear of "
                f"the strip from {low:g} to {high:g} mm, which has pillars on the same face"
            )


def _refuse_ringing(case: Case, own_hz: float, high_hz: float) -> None:
    """Raise InputError for a patch whose own resonance is too low for it to follow the plate statically."""
    if high_hz > FOLLOWS * own_hz:
        assert case.patches is not None
        size = " x ".join(f"{each / MM:g}" for each in case.patches.size_m)
        raise InputError(
            f"{case.source or case.name}: patches.size_mm: a patch of {size} mm has its own resonance at {frequency(own_hz)}: "
            f"end the band below a fifth of that, {frequency(FOLLOWS * own_hz)}, or use a flatter patch"
        )


def _demand(case: Case, band_hz: tuple[float, float]) -> ResourceEstimate:
    """Resource estimate of the response over a band."""
    choice = model_choice_of(case, "plate", response_high_hz(case, band_hz))
    return driven_demand.of_response(case, choice, band_hz, 0)


def _widest_bar(forced: ForcedPlate, low_hz: float, high_hz: float) -> WidestBar:
    """Find the largest error bar of the resonances in a band and its parts; unknown if one of them has none."""
    known = []
    for basis in forced.modes:
        errors, tones = responses.frequency_errors(basis), basis.frequency_hz
        inside = (tones >= low_hz) & (tones <= high_hz)
        known.append(np.array([tones, errors.mesh, errors.reduction, errors.bonding])[:, inside])
    every = np.hstack(known) if known else np.zeros((4, 0))
    total = every[1:].sum(axis=0)
    if not total.size or np.isnan(total).any():
        return WidestBar(None)
    tone, *parts = every[:, int(np.argmax(total))].tolist()
    of = f"the resonance at {frequency(tone, sum(parts))}"
    return WidestBar(sum(parts), of, dict(zip(("mesh", "reduction", "bonding"), parts, strict=True)))


def _parted(rates: WidthRates, every: list[tuple[Variation, ...]]) -> tuple[float, list[tuple[Variation, ...]]]:
    """Relative error from all sources with a first-order change, and the other sources."""
    far: list[float] = []
    near: list[tuple[Variation, ...]] = []
    for source in every:
        if max(rates.ratio(each) for each in source) <= FIRST_ORDER:
            far.append(max(abs(rates.change(each)) for each in source))
        else:
            near.append(source)
    return float(np.linalg.norm(far)), near


def _quality(top: float, curve: Curve) -> FloatArray:
    """Quality factor of a curve's peak, (1,); NaN without half-power points."""
    found = peak_of(curve, top).quality_factor
    return np.array([np.nan if found is None else found])


def _curve(forced: ForcedPlate, tone: float) -> tuple[float, Curve]:
    """Peak near a frequency, Hz, and the response around it."""
    top = near_hz(forced, tone)
    reach = DECAYED * top * forced.loss_at(top)
    return top, curve_about(forced, top - reach, top + reach, AROUND_PEAK, [top])


def _warn_of_shape(number: int, zone: DrivenZone, log: Log) -> None:
    """Warn of a zone whose largest motion differs from the target shape."""
    if zone.mac is not None and zone.mac < MIN_MAC:
        log.warning(
            "OTHER_PEAK",
            f"zone {number + 1} moves most at {frequency(zone.peak_hz, zone.peak_error)}, but not in the target shape "
            f"(MAC {figure(zone.mac, zone.mac_error)}): the levels are those of another mode; give a --band around the target",
        )
