"""The forced response of a case's plate to its patches, and of several zones, each driven in turn.

Curves over frequency have bars, and so have a peak's quality factor and its level over the passive face.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.tiling import Tiling, tile
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models import parts
from pipeline.models.answer_parts import DrivenZone
from pipeline.models.cell_cache import ArrayCache, MatrixCache
from pipeline.planning import driven_demand, foresight, mesh_rules, simplifications
from pipeline.planning.model_choice import ModelChoice, driven_band_hz, model_choice_of, response_high_hz
from pipeline.planning.refinement import WidestBar
from pipeline.planning.resources import Demand
from pipeline.quantity import MM, figure, frequency
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
from solvers.threads import one_thread

FOLLOWS = 0.2  # of its own lowest resonance: below it motion inside a patch adds at most 4 % to what follows statically
GRID = 160
DECAYED = 4.0  # half-power widths to both sides of a peak: where its quality factor is read
AROUND_PEAK = 65  # points over them, and more at the peak
FIRST_ORDER = 0.05  # of a change: what its second order may add where the plate is not computed again


@dataclass(frozen=True)
class SolvedResponse:
    """The response curve, the target mode's peak (None where the band has none), the highest peak, and the plate behind them.

    widest_bar is that of the frequencies in the band.
    """

    forced: ForcedPlate
    curve: Curve
    target: Peak | None
    highest: Peak
    widest_bar: WidestBar

    @property
    def expected_error(self) -> float | None:
        """The largest half-width of a frequency's bar in the band, relative: mesh, reduction and bonding together."""
        return self.widest_bar.error

    @property
    def peak(self) -> Peak:
        """The target mode's peak; the highest one where there is none."""
        return self.target or self.highest


@one_thread()
def forced_plate(
    case: Case, log: Log, band_hz: tuple[float, float] | None = None, meshes: list[MeshRecord] | None = None,
    is_announced: bool = False, choice: ModelChoice | None = None,
) -> ForcedPlate:  # fmt: skip
    """Bond the patches and prepare the forced response over a band (default: the case's); meshes are added to
    `meshes`. is_announced: the plate is one of several, whose demand was told as a whole; choice: that of a plan, announced.

    InputError for a model that cannot carry patches; raises what its solvers raise.
    """
    band = driven_band_hz(case, band_hz)
    refuse_patches(case, band)
    if not is_announced and choice is None:
        foresight.announce("the forced response", _demand(case, band), log)
    if choice is None:
        choice = driven_demand.as_driven(case, model_choice_of(case, "plate", response_high_hz(case, band)))
        simplifications.log_all(choice.left_out, log)
    if choice.reduction is None:
        raise InputError(f"{case.name}: solve.model: patches are bonded to plates cells, must be auto or superelement")
    model = parts.built(case, choice, log, [] if meshes is None else meshes)
    assert isinstance(model, PlateModel)
    return driven(case, model, band, log)


@one_thread()
def driven(case: Case, model: PlateModel, band_hz: tuple[float, float], log: Log) -> ForcedPlate:
    """Build an assembled plate with the case's patches and solve its modes about the band."""
    patches = case.patches
    assert patches is not None
    with log.step("bond the patches"):
        bonded = _bonded(case, model.tiling)
        # patches that couple all classes would be dense in every pair of them, in the whole plate on their panels alone
        symmetries = model.symmetries if len(coupled_classes(bonded)) > 1 else (None,)
        plates = {plate.symmetry: plate for plate in map(model.assembled, symmetries)}
        middle_hz = (band_hz[0] + band_hz[1]) / 2.0
        beneath = StaticCorrection(model.reductions, MatrixCache())
        plate = PatchedPlate(plates, bonded, patches.face == "back", model.name, beneath, middle_hz)
    if plate.undriven:
        log.left_out("symmetry classes " + ", ".join(plate.undriven), "the patches do not drive them")
    with log.step("modes of the patched plate"):
        drive = Drive(patches.drivers, patches.sensors, band_hz, case.quality_factor, patches.circuit)
        choice = model_choice_of(case, "plate", response_high_hz(case, band_hz))
        bytes_each = driven_demand.group_bytes(case, choice, _demand(case, band_hz).modes or 0.0)
        return ForcedPlate(plate, case.design, drive, bytes_each=bytes_each, target_window_hz=_search_window_hz(case))


def refuse_patches(case: Case, band_hz: tuple[float, float]) -> None:
    """InputError for patches that no assembled plate can carry in this band, before anything of the plate is computed."""
    tiling = tile(case.design, case.design.length_m)
    _refuse_over_pillars(case, tiling)
    _refuse_ringing(case, min(patch.own_hz for patch in _bonded(case, tiling)), band_hz[1])


@one_thread()
def solve_response(
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
    target = peak_of(curve, peaks_hz[0]) if len(peaks_hz) > 1 else None
    return SolvedResponse(forced, curve, target, peak_of(curve, highest), _widest_bar(forced, low, high))


def gridded(points: FloatArray, values: ComplexArray) -> dict[str, Any]:
    """Return a field on the touch face at an even grid of about GRID points along its longer side, as a picture draws it."""
    from scipy.spatial import cKDTree

    low, high = points.min(axis=0), points.max(axis=0)
    step = float((high - low).max()) / GRID
    lines = [np.linspace(a, b, max(2, round((b - a) / step)) + 1) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    nearest = values[cKDTree(points).query(grid)[1]]
    return {"response_xy": grid.astype(np.float32), "response_uz": nearest.astype(np.complex64)}


def quality_error(forced: ForcedPlate, peak: Peak) -> float | None:
    """Compute the half-width of the bar of a peak's quality factor; None where it is not known.

    The damping is given and not judged. A peak is wider or narrower than its own mode where neighbours carry some of the
    response: the factor is read again on plates whose resonances lie elsewhere within their bars, whose modes are mixed within
    them, and whose patches push harder by the error of their loads; to first order where that is enough. The change by a finer
    curve is added.

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
    """Compute the half-width of the bar of a peak's level over the passive face, dB, the peak following its mode.

    None where it is not known, as where a charge feeds the drivers.
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
    """Compute the half-widths of the bars of a curve's rms at its own frequencies, zone and passive face, (1 or 2, n) in m/V.

    None where they are not known, as where a charge feeds the drivers.
    """
    known = doubts(forced, calibration.mixing())
    if known is None or forced.circuit != "short":
        return None
    fed = forced.signs[forced.drivers].astype(complex)
    (half,) = rms_bars(known, forced, face_grams(forced), curve.frequency_hz, fed[None])
    return half if np.isfinite(half).all() else None


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


def _search_window_hz(case: Case) -> tuple[float, float] | None:
    """Where the target mode is searched first; None for several zones, which share no mode."""
    return mesh_rules.search_window_hz(case.design) if case.design.zones == 1 else None


def _bonded(case: Case, tiling: Tiling) -> list[BondedPatch]:
    """The case's patches; those of one size are one, and kept."""
    patches = case.patches
    assert patches is not None
    material, thickness, back = patches.material, patches.size_m[2], patches.face == "back"
    return [
        bonded_patch(material, box, thickness, back, patch_mesh(case.design, tiling, box), ArrayCache())
        for box in patches.boxes_m()
    ]


def _refuse_over_pillars(case: Case, tiling: Tiling) -> None:
    """InputError where a patch shares a face with a pillar whose panel it reaches over: that face is not kept there."""
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
                f"the strip from {low:g} to {high:g} mm, where pillars stand on its face"
            )


def _refuse_ringing(case: Case, own_hz: float, high_hz: float) -> None:
    """InputError where a patch would ring by itself on the plate, which it follows statically."""
    if high_hz > FOLLOWS * own_hz:
        assert case.patches is not None
        size = " x ".join(f"{each / MM:g}" for each in case.patches.size_m)
        raise InputError(
            f"{case.source or case.name}: patches.size_mm: a patch of {size} mm rings by itself at {frequency(own_hz)}: the "
            f"band must end below a fifth of that, {frequency(FOLLOWS * own_hz)}, or the patch be flatter"
        )


def _demand(case: Case, band_hz: tuple[float, float]) -> Demand:
    """What the response over a band is foreseen to take."""
    choice = model_choice_of(case, "plate", response_high_hz(case, band_hz))
    return driven_demand.of_response(case, choice, band_hz, 0)


def _widest_bar(forced: ForcedPlate, low_hz: float, high_hz: float) -> WidestBar:
    """Find the widest bar of the resonances in a band, and what it is made of; unknown where one of them has none."""
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
    """Relative half-width by all sources whose change is that of first order, and the other sources."""
    far: list[float] = []
    near: list[tuple[Variation, ...]] = []
    for source in every:
        if max(rates.ratio(each) for each in source) <= FIRST_ORDER:
            far.append(max(abs(rates.change(each)) for each in source))
        else:
            near.append(source)
    return float(np.linalg.norm(far)), near


def _quality(top: float, curve: Curve) -> FloatArray:
    """The quality factor of a curve's peak, (1,); NaN where the curve has no half-power points there."""
    found = peak_of(curve, top).quality_factor
    return np.array([np.nan if found is None else found])


def _curve(forced: ForcedPlate, tone: float) -> tuple[float, Curve]:
    """A peak near a frequency, Hz, and the response about it."""
    top = near_hz(forced, tone)
    reach = DECAYED * top * forced.loss
    return top, curve_about(forced, top - reach, top + reach, AROUND_PEAK, [top])


def _warn_of_shape(number: int, zone: DrivenZone, log: Log) -> None:
    """Warn of a zone that moves most in another shape than the target's."""
    if zone.mac is not None and zone.mac < MIN_MAC:
        log.warning(
            "OTHER_PEAK",
            f"zone {number + 1} moves most at {frequency(zone.peak_hz, zone.peak_error)}, but not in the target shape "
            f"(MAC {figure(zone.mac, zone.mac_error)}): the levels are another mode's; give a --band about the target mode",
        )
