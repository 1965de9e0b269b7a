"""Plates of a case with printing tolerances: each is solved in a small space of the nominal plate's modes and responses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geometry.elements import FloatArray
from pipeline.case.model import Case
from pipeline.case.schema import ToleranceTable
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.answer_parts import SampleRecord
from pipeline.models.cell_cache import CellCache, MatrixCache, ParametricCellCache
from pipeline.models.forced import AROUND_PEAK, DECAYED, driven, refuse_patches
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import HEX, SUPERELEMENT, ModelChoice
from pipeline.planning.simplifications import khz
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patched_plate import PressedPlate
from solvers.piezo.responses import curve_about, near_hz, peak_of
from solvers.plates.assembled import PlateModel
from solvers.threads import one_thread
from solvers.variation.cells import PARAMETERS, VariedReductions
from solvers.variation.samples import ChangedPlate, Deviations, VariedPlate

DRAWN = 241  # points of the curves in the figure
AROUND = 0.08  # of the nominal peak, on both sides: range of the figure
NARROWER = (0.875, 1.15)  # of the band: the smaller space that shows the influence of the space on the result
MEASURES = ("peak_hz", "confinement_db")


@dataclass(frozen=True)
class VariedPlates:
    """Nominal plate and samples, each measured at its target mode, which is tracked by its shape.

    curves (samples + 1, n): rms of the zone over frequency, the nominal plate first. The checks hold the changes due to a
    narrower space, and due to pillars that are reduced instead of interpolated; loss is 1/Q.
    """

    pillars: int
    dofs: int
    nominal: SampleRecord
    samples: list[SampleRecord]
    space_check: dict[str, float | None]
    interpolation_check: dict[str, float | None]
    frequency_hz: FloatArray
    curves: FloatArray
    loss: float


def deviations_of(given: ToleranceTable) -> Deviations:
    """Return the standard deviations of a [tolerance].

    Parameters
    ----------
    given : ToleranceTable
        The table of a case.

    Returns
    -------
    Deviations
        In m; of the stiffness relative.
    """
    return Deviations(given.height_m, given.side_m, given.position_m, given.stiffness)


@one_thread()
def solve(
    case: Case, given: ToleranceTable, choice: ModelChoice, band_hz: tuple[float, float], log: Log
) -> VariedPlates:
    """Compute the samples of a tolerance over a band; InputError for a model that cannot be varied."""
    quality_factor = case.one_quality_factor("tolerance")
    plate = _varied(case, given, choice, band_hz, log)
    count = len(plate.pillars)
    changes = deviations_of(given).draw(count, given.samples, given.seed)
    with log.step("nominal plate"):
        still = plate.sample(np.zeros((count, PARAMETERS)))
        nominal = _measured(still)
        if nominal.peak_hz is None:
            raise InputError(_elsewhere(case, band_hz, plate.forced.target_hz()))
        shown = _shown(nominal.peak_hz, band_hz)
        first = still.curve(shown).zone_rms_m_per_v
    log.info(nominal.line("nominal"))
    samples, more = _sampled(plate, changes, shown, log)
    with log.step("a sample in a smaller space"):
        narrower = NARROWER[0] * band_hz[0], NARROWER[1] * band_hz[1]
        space_check = _space_check(plate, changes[0], samples[0], narrower)
    with log.step("pillars interpolated and reduced"):
        interpolated, reduced = (_measured(one) for one in plate.checked())
    off = _apart(interpolated, reduced)
    curves = np.array([first, *more])
    return VariedPlates(
        count, plate.space.size, nominal, samples, space_check, off, shown, curves, 1.0 / quality_factor
    )


def _elsewhere(case: Case, band: tuple[float, float], target_hz: float | None) -> str:
    """Explain that a band does not contain the target mode, and give its frequency."""
    about = f"{khz(band[0])} to {khz(band[1])}"
    if target_hz is None:
        return f"{case.name}: [tolerance]: needs a target mode to track, but no mode of the plate has the target shape"
    return f"{case.name}: [tolerance]: the target mode at {khz(target_hz)} is outside {about}: change --band or solve.band_kHz"


def _sampled(
    plate: VariedPlate, changes: FloatArray, shown: FloatArray, log: Log
) -> tuple[list[SampleRecord], list[FloatArray]]:
    """Measure every sample, and the rms of the zone at the frequencies of the figure."""
    samples, curves = [], []
    for number, change in enumerate(changes, start=1):
        with log.step(f"sample {number} of {len(changes)}"):
            sample = plate.sample(change)
            samples.append(_measured(sample))
            curves.append(sample.curve(shown).zone_rms_m_per_v)
        log.info(samples[-1].line(f"sample {number}"))
    return samples, curves


def _varied(case: Case, given: ToleranceTable, choice: ModelChoice, band: tuple[float, float], log: Log) -> VariedPlate:
    design = case.design
    assert design.pillar
    if case.patches:
        refuse_patches(case, band)
    if choice.model != SUPERELEMENT or choice.kind != HEX or choice.reduction is None:
        raise InputError(
            f"{case.name}: [tolerance]: varied pillars need assembled cells of hexahedra: set solve.model to auto or "
            "superelement, and solve.mesh to auto or hex"
        )
    reductions = VariedReductions(
        design.stack,
        design.pillar,
        replace(choice.reduction, further=0),
        CellCache(),
        reach=deviations_of(given).reach,
        parametric_cache=ParametricCellCache(),
        matrices=MatrixCache(),
    )
    with log.step("reduce cells and their changes"):
        model = PlateModel(design, reductions)
    log.info(
        f"{len(reductions.families)} distinct pillar cells, each interpolated between "
        f"{1 + max(len(family.nodes) for family in reductions.families.values())} reductions; "
        f"{reductions.fresh} panels reduced, {reductions.reused} loaded from the cache"
    )
    if case.patches:
        forced = driven(case, model, band, log)
    else:
        plates = {plate.symmetry: plate for plate in map(model.assembled, model.symmetries)}
        pressed = PressedPlate(plates, design, model.name)
        with log.step("modes of the plate"):
            window = mesh_rules.search_window_hz(design)
            forced = ForcedPlate(
                pressed, design, Drive((0,), (), band, case.one_quality_factor("tolerance")), target_window_hz=window
            )
    with log.step("build the space of the samples"):
        plate = VariedPlate(forced, reductions.families)
    log.info(
        f"samples: {len(plate.pillars)} independent pillars, in a space of {plate.space.size} nominal modes and responses"
    )
    return plate


def _measured(sample: ChangedPlate) -> SampleRecord:
    """Measure the response at the mode that the nominal target mode has become, independently of any frequency grid."""
    tone, tracking = sample.tracked_hz, sample.tracked.status
    if tone is None:
        return SampleRecord(peak_hz=None, zone_rms=None, confinement_db=None, quality_factor=None, tracking=tracking)
    top = near_hz(sample, tone)
    reach = DECAYED * top * sample.loss_at(top)
    curve = curve_about(sample, top - reach, top + reach, AROUND_PEAK, [top])
    peak = peak_of(curve, top)
    return SampleRecord.of(peak, peak_hz=peak.frequency_hz, tracking=tracking)


def _shown(peak_hz: float, band: tuple[float, float]) -> FloatArray:
    low, high = max(band[0], (1.0 - AROUND) * peak_hz), min(band[1], (1.0 + AROUND) * peak_hz)
    return np.union1d(np.linspace(low, high, DRAWN), [peak_hz])


def _space_check(
    plate: VariedPlate, change: FloatArray, sample: SampleRecord, band_hz: tuple[float, float]
) -> dict[str, float | None]:
    """Change of a sample in the space of a narrower band; None if that space is the same."""
    if not plate.space.is_wider(band_hz):
        return dict.fromkeys(MEASURES)
    return _apart(_measured(plate.sample(change, band_hz)), sample)


def _apart(first: SampleRecord, second: SampleRecord) -> dict[str, float | None]:
    """Differences between two measurements of a plate; None where one of them is missing."""
    apart: dict[str, float | None] = {}
    for name in MEASURES:
        one, other = getattr(first, name), getattr(second, name)
        apart[name] = None if one is None or other is None else abs(one - other)
    return apart
