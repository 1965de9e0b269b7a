"""How far the response's peak and the confinement move when no two pillars are alike: a case's [tolerance] table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.case.model import Case, Tolerance
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models import patched_plate
from pipeline.models.cell_cache import CellCache, ParametricCellCache
from pipeline.models.peak_bars import AROUND_PEAK, DECAYED
from pipeline.planning import driven_demand, foresight, mesh_rules
from pipeline.planning.model_choice import HEX, SUPERELEMENT, model_choice_of
from pipeline.planning.request import driven_band_hz, response_high_hz
from pipeline.planning.simplifications import khz
from pipeline.quantity import figure, frequency, interval, level, signed
from pipeline.records.record import SampleRecord, SpreadRecord, ToleranceRecord
from solvers.measures.levels import CONFINED_DB
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patched_plate import CLASSES
from solvers.piezo.peaks import curve_about, near_hz, peak_of
from solvers.piezo.pressure_load import PressedPlate
from solvers.superelement.build import PlateModel
from solvers.threads import one_thread
from solvers.variation.parametric_cell import CHECKED
from solvers.variation.plate_space import ChangedPlate
from solvers.variation.reductions import VariedReductions
from solvers.variation.samples import CUT, Deviations, VariedPlate, spread

DRAWN = 241  # of the curves kept for the picture
AROUND = 0.08  # of the nominal peak, on both sides: what the picture shows
NARROWER = (0.875, 1.15)  # of the band: the smaller space that tells how far the space decides the answer
MOVED = 0.1  # of the spread of peaks or levels: more, and the space is too small
MEASURES = ("peak_hz", "confinement_db")
ALIKE_DB = 0.01  # levels that differ by less are alike, however small their spread


@dataclass(frozen=True)
class ToleranceStudy:
    """The nominal plate and the samples, each measured at its wanted mode, tracked by its shape.

    Curves (samples + 1, n) over frequency, the nominal one first. Statistics leave out what was lost, and `lost` counts it.
    """

    tolerance: Tolerance
    drive: str
    unit: str
    pillars: int
    dofs: int
    nominal: SampleRecord
    samples: tuple[SampleRecord, ...]
    space_check: dict[str, float | None]
    interpolation_check: dict[str, float | None]
    frequency_hz: FloatArray
    curves: FloatArray
    deviations_m: FloatArray

    @cached_property
    def record(self) -> ToleranceRecord:
        """Everything but curves and times."""
        given = self.tolerance
        return ToleranceRecord.of(
            self,
            tolerance={key: getattr(given, key) for key in ("height_m", "side_m", "position_m", "seed")}
            | {"cut_at_deviations": CUT},
            rms_unit=self.unit,
            **statistics(self.nominal, self.samples),
        )

    @property
    def peaks_hz(self) -> FloatArray:
        """Peaks of the samples whose wanted mode was tracked."""
        return _known(self.samples, "peak_hz")

    def arrays(self) -> dict[str, FloatArray]:
        """Return the arrays that a figure draws."""
        return {"tolerance_hz": self.frequency_hz, "tolerance_curves": self.curves}


def statistics(nominal: SampleRecord, samples: Sequence[SampleRecord]) -> dict[str, Any]:
    """What samples come to, by the names of a tolerance record: those without the wanted mode are counted and left out."""
    peaks, levels = _known(samples, "peak_hz"), _known(samples, "confinement_db")
    return {
        "lost": len(samples) - len(peaks),
        "split": sum(one.tracking == "split" for one in samples),
        "peak_hz": _spread(peaks),
        "peak_shift_hz": _spread(peaks - nominal.peak_hz) if nominal.peak_hz else None,
        "confinement_db": _spread(levels),
        "confined": int((levels >= CONFINED_DB).sum()) if len(levels) else None,
    }


def _known(samples: Sequence[SampleRecord], name: str) -> FloatArray:
    return np.array([value for one in samples if (value := getattr(one, name)) is not None])


def _spread(values: FloatArray) -> SpreadRecord | None:
    return SpreadRecord.of(spread(values)) if len(values) else None


@one_thread()
def solve(case: Case, log: Log, band_hz: tuple[float, float] | None = None) -> ToleranceStudy:
    """Compute the case's samples. Raises InputError without [tolerance] or for a model that cannot be varied."""
    case.require_plate(command="tolerance")
    case.require("tolerance", "pillar", command="tolerance")
    given, band = case.tolerance, driven_band_hz(case, band_hz)
    assert given is not None
    plate = _varied(case, given, band, log)
    forced = plate.forced
    count = len(plate.pillars)
    changes = Deviations(given.height_m, given.side_m, given.position_m).draw(count, given.samples, given.seed)
    with log.step("nominal plate"):
        still = plate.sample(np.zeros((count, 4)))
        nominal = _measured(still)
        if nominal.peak_hz is None:
            raise InputError(_elsewhere(case, band, forced.wanted_hz()))
        summary = _shown(nominal.peak_hz, band)
        first = still.curve(summary).zone_rms_m_per_v
    log.info(_summary("nominal", nominal))
    samples, more = _sampled(plate, changes, summary, log)
    with log.step("a sample in a smaller space"):
        space_check = _space_check(plate, changes[0], samples[0], (NARROWER[0] * band[0], NARROWER[1] * band[1]))
    with log.step("pillars as interpolated and as reduced"):
        interpolated, reduced = (_measured(one) for one in plate.checked())
    tolerance_study = ToleranceStudy(
        given,
        "patches" if case.patches else "pressure in the wanted shape",
        "m/V" if case.patches else "m/N",
        count,
        plate.space.size,
        nominal,
        tuple(samples),
        space_check,
        _apart(interpolated, reduced),
        summary,
        np.array([first, *more]),
        changes,
    )
    _log_summary(tolerance_study, forced, band, log)
    return tolerance_study


def _elsewhere(case: Case, band: tuple[float, float], wanted_hz: float | None) -> str:
    """Say that a band does not hold the wanted mode, and where that lies."""
    about = f"{khz(band[0])} to {khz(band[1])}"
    if wanted_hz is None:
        return f"{case.name}: no mode of the plate has the wanted shape, which a tolerance follows"
    return (
        f"{case.name}: the wanted mode, which a tolerance follows, lies at {khz(wanted_hz)}, outside {about}: give another "
        "--band or solve.band_kHz"
    )


def _sampled(
    plate: VariedPlate, changes: FloatArray, summary: FloatArray, log: Log
) -> tuple[list[SampleRecord], list[FloatArray]]:
    """Measure every sample, and the rms on the zone at the frequencies of the figure."""
    samples, curves = [], []
    for number, change in enumerate(changes, start=1):
        with log.step(f"sample {number} of {len(changes)}"):
            sample = plate.sample(change)
            samples.append(_measured(sample))
            curves.append(sample.curve(summary).zone_rms_m_per_v)
        log.info(_summary(f"sample {number}", samples[-1]))
    return samples, curves


def _varied(case: Case, given: Tolerance, band: tuple[float, float], log: Log) -> VariedPlate:
    design, choice = case.design, model_choice_of(case, "plate", response_high_hz(case, band))
    assert design.pillar
    if case.patches:
        patched_plate.refuse_patches(case, band)
    if choice.model != SUPERELEMENT or choice.kind != HEX or choice.reduction is None:
        raise InputError(
            f"{case.name}: [tolerance]: pillars are varied in assembled cells of hexahedra: solve.model must be auto or "
            "superelement, solve.mesh auto or hex"
        )
    foresight.announce(
        "plates with printed tolerances",
        driven_demand.of_tolerance(case, choice, band, given.samples * (DRAWN + AROUND_PEAK)),
        log,
    )
    reach = Deviations(given.height_m, given.side_m, given.position_m).reach_m
    reductions = VariedReductions(
        design.thickness_m,
        design.material,
        design.pillar,
        replace(choice.reduction, further=0),
        CellCache(),
        reach_m=reach,
        parametric_cache=ParametricCellCache(),
    )
    with log.step("reduce cells and their changes"):
        model = PlateModel(design, reductions)
    log.info(
        f"{len(reductions.families)} kinds of pillar cells, each interpolated between "
        f"{1 + max(len(family.nodes) for family in reductions.families.values())} reductions: "
        f"{reductions.fresh} panels reduced now, {reductions.reused} taken from the cache"
    )
    if case.patches:
        forced = patched_plate.driven(case, model, band, log)
    else:
        pressed = PressedPlate({symmetry: model.assembled(symmetry) for symmetry in CLASSES}, design, model.name)
        with log.step("modes of the plate"):
            window = mesh_rules.search_window_hz(design)
            forced = ForcedPlate(pressed, design, Drive((0,), (), band, case.quality_factor), wanted_window_hz=window)
    with log.step("the space of the samples"):
        plate = VariedPlate(forced, reductions.families)
    log.info(
        f"{len(plate.pillars)} pillars, each of its own; {plate.space.size} nominal modes and answers hold every sample"
    )
    return plate


def _measured(sample: ChangedPlate) -> SampleRecord:
    """Measure the response at the mode into which the nominal wanted mode has turned, between the points of any
    grid.
    """
    tone, tracking = sample.tracked_hz, sample.tracked.status
    if tone is None:
        return SampleRecord(peak_hz=None, zone_rms=None, confinement_db=None, quality_factor=None, tracking=tracking)
    top = near_hz(sample, tone)
    reach = DECAYED * top * sample.loss
    curve = curve_about(sample, top - reach, top + reach, AROUND_PEAK, [top])
    peak = peak_of(curve, top)
    return SampleRecord.of(peak, peak_hz=peak.frequency_hz, tracking=tracking)


def _shown(peak_hz: float, band: tuple[float, float]) -> FloatArray:
    low, high = max(band[0], (1.0 - AROUND) * peak_hz), min(band[1], (1.0 + AROUND) * peak_hz)
    return np.union1d(np.linspace(low, high, DRAWN), [peak_hz])


def _space_check(
    plate: VariedPlate, change_m: FloatArray, sample: SampleRecord, band_hz: tuple[float, float]
) -> dict[str, float | None]:
    """How far a sample lies from itself in the space of a narrower band; None where that is no other space."""
    if not plate.space.is_wider(band_hz):
        return dict.fromkeys(MEASURES)
    return _apart(_measured(plate.sample(change_m, band_hz)), sample)


def _apart(first: SampleRecord, second: SampleRecord) -> dict[str, float | None]:
    """How far two measures of a plate lie apart; None where one of them has none."""
    apart: dict[str, float | None] = {}
    for name in MEASURES:
        one, other = getattr(first, name), getattr(second, name)
        apart[name] = None if one is None or other is None else abs(one - other)
    return apart


def _summary(name: str, sample: SampleRecord, bar: float | None = None) -> str:
    if sample.peak_hz is None:
        return f"{name}: lost, no mode has the wanted mode's shape"
    confinement = "" if sample.confinement_db is None else f", confinement {level(sample.confinement_db)}"
    split = ", split among several modes" if sample.tracking == "split" else ""
    return f"{name}: peak at {frequency(sample.peak_hz, bar)}{confinement}{split}"


def lines(record: ToleranceRecord) -> list[str]:
    """Describe the samples in words: frequencies and levels with the digits that their spread allows."""
    peak, shift, levels = record.peak_hz, record.peak_shift_hz, record.confinement_db
    count = len(record.samples) - record.lost
    wide = peak.relative if peak else None
    out = [_summary("nominal", record.nominal, wide)]
    if peak and shift:
        moved = None if shift.deviation is None else shift.deviation / sqrt(count)
        out.append(
            f"{count} plates: peak {frequency(peak.mean, wide)}, spread {peak.spread(count, 'Hz')}, "
            f"{interval(peak.lowest, peak.highest, wide, wide)}; moved by {signed(figure(shift.mean, moved))} Hz on average"
        )
    if levels:
        out.append(
            f"confinement {level(levels.mean, levels.deviation)}, spread {levels.spread(count, 'dB')}, "
            f"worst {level(levels.lowest, levels.deviation)}; {record.confined} of {count} confined"
        )
    off_hz, off_db = (record.interpolation_check.get(name) for name in ("peak_hz", "confinement_db"))
    if off_hz is not None:
        of_level = "" if off_db is None else f" and {figure(off_db, off_db or None)} dB of its confinement"
        out.append(
            f"with all pillars {CUT * CHECKED:g} standard deviations off, interpolation between reductions misses "
            f"{figure(off_hz, off_hz or None)} Hz of the peak{of_level}"
        )
    if record.lost:
        out.append(f"{record.lost} of {len(record.samples)} plates lost the wanted mode: no mode has its shape")
    return out


def _log_summary(tolerance_study: ToleranceStudy, forced: ForcedPlate, band: tuple[float, float], log: Log) -> None:
    said = lines(tolerance_study.record)
    for line in said:
        log.info(line)
    peaks, nominal = tolerance_study.peaks_hz, tolerance_study.nominal.peak_hz
    if ((peaks <= band[0]) | (peaks >= band[1])).any():
        log.warning("PEAK_AT_END", "a sample's wanted mode lies outside the band: widen it")
    if len(peaks) < len(tolerance_study.samples):
        log.warning("LOST", said[-1])
    levels = _known(tolerance_study.samples, "confinement_db")
    change, louder = (tolerance_study.space_check[name] for name in ("peak_hz", "confinement_db"))
    if change is not None and nominal and change > max(MOVED * _deviation(peaks), 0.1 * nominal * forced.loss):
        log.warning(
            "SPACE_TOO_SMALL",
            f"a narrower space of modes moves a sample's peak by {figure(change, change)} Hz: widen the band",
        )
    if louder is not None and louder > max(MOVED * _deviation(levels), ALIKE_DB):
        log.warning(
            "SPACE_TOO_SMALL",
            f"a narrower space of modes changes a sample's confinement by {figure(louder, louder)} dB: widen the band",
        )


def _deviation(values: FloatArray) -> float:
    return (spread(values).deviation or 0.0) if len(values) else 0.0
