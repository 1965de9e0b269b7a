"""How far the response's peak and the confinement move when no two pillars are alike: a case's [tolerance] table."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from geometry.elements import FloatArray
from pipeline import foresight, patched
from pipeline.asked import driven_band_hz
from pipeline.case import Case, Tolerance
from pipeline.cell_shelf import CellShelf
from pipeline.errors import InputFault
from pipeline.family_shelf import FamilyShelf
from pipeline.logs import Log
from pipeline.records import CONFINED_DB
from pipeline.response import peaked_curve
from pipeline.ways import HEX, SUPERELEMENT, way_of
from solvers.measured_sweep import half_power_quality
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.patched_plate import CLASSES
from solvers.piezo.pressed import PressedPlate
from solvers.superelement.build import PlateModel
from solvers.superelement.families import VariedReductions
from solvers.tolerance import CUT, Deviations, VariedPlate, VariedSample, spread

POINTS = 301  # frequencies of each sample's curve, and more at its peak
DRAWN = 241  # of the curves kept for the picture
AROUND = 0.08  # of the nominal peak, on both sides: what the picture shows
NARROWER = (0.875, 1.15)  # of the band: the smaller space that tells how far the space decides the answer
SHARP = 1e-3  # of a half-power width: how finely a peak is found
MOVED = 0.1  # of the peaks' spread: more, and the space is too small


@dataclass(frozen=True)
class Measured:
    """One plate's response: its peak, the zone's rms there (m/V or m/N), confinement and quality factor."""

    peak_hz: float
    zone_rms: float
    confinement_db: float | None
    quality: float | None


@dataclass(frozen=True)
class ToleranceStudy:
    """The nominal plate and the samples, measured; curves (samples + 1, n) over frequency, the nominal one first."""

    tolerance: Tolerance
    drive: str
    unit: str
    pillars: int
    unknowns: int
    nominal: Measured
    samples: tuple[Measured, ...]
    space_change_hz: float
    space_change_db: float | None
    frequency_hz: FloatArray
    curves: FloatArray
    deviations_m: FloatArray

    def json(self) -> dict[str, Any]:
        """Everything but curves and times."""
        given = self.tolerance
        levels = [one.confinement_db for one in self.samples if one.confinement_db is not None]
        return {
            "schema": 1,
            "tolerance": {
                "height_m": given.height_m,
                "side_m": given.side_m,
                "position_m": given.position_m,
                "seed": given.seed,
                "cut_at_deviations": CUT,
            },
            "drive": self.drive,
            "rms_unit": self.unit,
            "pillars": self.pillars,
            "unknowns": self.unknowns,
            "nominal": asdict(self.nominal),
            "samples": [asdict(one) for one in self.samples],
            "peak_hz": asdict(spread(np.array([one.peak_hz for one in self.samples]))),
            "peak_shift_hz": asdict(spread(np.array([one.peak_hz - self.nominal.peak_hz for one in self.samples]))),
            "confinement_db": asdict(spread(np.array(levels))) if levels else None,
            "confined": sum(level >= CONFINED_DB for level in levels) if levels else None,
            "space_check": {"peak_hz": self.space_change_hz, "confinement_db": self.space_change_db},
        }

    def arrays(self) -> dict[str, FloatArray]:
        """What a picture draws."""
        return {"tolerance_hz": self.frequency_hz, "tolerance_curves": self.curves}


def solve(case: Case, log: Log, band_hz: tuple[float, float] | None = None) -> ToleranceStudy:
    """The case's samples. InputFault without [tolerance] or for a model that cannot be varied; raises as its solvers do."""
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
        nominal = _measured(still, band)
        shown = _shown(nominal.peak_hz, band)
        first = still.curve(shown).zone_rms_m_per_v
    log.info(_told("nominal", nominal))
    samples, more = _sampled(plate, changes, band, shown, log)
    with log.step("a sample in a smaller space"):
        low, high = (factor * edge for factor, edge in zip(NARROWER, band, strict=True))
        narrow = _measured(plate.sample(changes[0], (low, high)), band)
    found = ToleranceStudy(
        given,
        "patches" if case.patches else "pressure in the wanted shape",
        "m/V" if case.patches else "m/N",
        count,
        plate.size,
        nominal,
        tuple(samples),
        abs(narrow.peak_hz - samples[0].peak_hz),
        _apart(narrow.confinement_db, samples[0].confinement_db),
        shown,
        np.array([first, *more]),
        changes,
    )
    _tell(found, forced, band, log)
    return found


def _sampled(
    plate: VariedPlate, changes: FloatArray, band: tuple[float, float], shown: FloatArray, log: Log
) -> tuple[list[Measured], list[FloatArray]]:
    """Every plate measured, and the zone's rms at the frequencies that the picture shows."""
    samples, curves = [], []
    for number, change in enumerate(changes, start=1):
        with log.step(f"sample {number} of {len(changes)}"):
            sample = plate.sample(change)
            samples.append(_measured(sample, band))
            curves.append(sample.curve(shown).zone_rms_m_per_v)
        log.info(_told(f"sample {number}", samples[-1]))
    return samples, curves


def _varied(case: Case, given: Tolerance, band: tuple[float, float], log: Log) -> VariedPlate:
    design, way = case.design, way_of(case, "plate", band[1])
    assert design.pillar
    if way.model != SUPERELEMENT or way.kind != HEX or way.recipe is None:
        raise InputFault(
            f"{case.name}: [tolerance]: pillars are varied in joined cells of hexahedra: solve.model must be auto or "
            "superelement, solve.mesh auto or hex"
        )
    foresight.announce(
        "plates with printed tolerances", foresight.of_response(case, way, band, given.samples * POINTS), log
    )
    reach = Deviations(given.height_m, given.side_m, given.position_m).reach_m
    reductions = VariedReductions(
        design.thickness_m,
        design.material,
        design.pillar,
        way.recipe,
        CellShelf(),
        reach_m=reach,
        family_shelf=FamilyShelf(),
    )
    with log.step("reduce cells and their changes"):
        model = PlateModel(design, reductions)
    log.info(
        f"{len(reductions.families)} kinds of pillar cells, each interpolated between "
        f"{1 + max(len(family.nodes) for family in reductions.families.values())} reductions: "
        f"{reductions.fresh} pieces reduced now, {reductions.reused} taken from the shelf"
    )
    if case.patches:
        forced = patched.driven(case, model, band, log)
    else:
        pressed = PressedPlate({parity: model.joined(parity) for parity in CLASSES}, design, model.name)
        with log.step("modes of the plate"):
            forced = ForcedPlate(pressed, design, (0,), (), band, case.quality)
    with log.step("the space of the samples"):
        plate = VariedPlate(forced, reductions.families)
    log.info(f"{len(plate.pillars)} pillars, each of its own; {plate.size} nominal modes and answers hold every sample")
    return plate


def _measured(sample: VariedSample, band: tuple[float, float]) -> Measured:
    """The peak between the points of a grid, since samples differ by less than a grid is wide."""
    curve, peak = peaked_curve(sample, *band, POINTS)
    tone = curve.frequency_hz
    ends = (tone[max(peak - 1, 0)], tone[min(peak + 1, len(tone) - 1)])
    best = minimize_scalar(
        lambda hz: -float(sample.curve(np.array([hz])).zone_rms_m_per_v[0]),
        bounds=ends,
        method="bounded",
        options={"xatol": SHARP * tone[peak] * sample.loss},
    )
    top = sample.curve(np.array([best.x]))
    passive = top.passive_rms_m_per_v
    held = None if passive is None else float(20.0 * np.log10(top.zone_rms_m_per_v[0] / passive[0]))
    quality = half_power_quality(tone, curve.zone_rms_m_per_v, peak)
    return Measured(float(best.x), float(top.zone_rms_m_per_v[0]), held, quality)


def _shown(peak_hz: float, band: tuple[float, float]) -> FloatArray:
    low, high = max(band[0], (1.0 - AROUND) * peak_hz), min(band[1], (1.0 + AROUND) * peak_hz)
    return np.union1d(np.linspace(low, high, DRAWN), [peak_hz])


def _apart(first: float | None, second: float | None) -> float | None:
    return None if first is None or second is None else abs(first - second)


def _told(name: str, found: Measured) -> str:
    held = "" if found.confinement_db is None else f", confinement {found.confinement_db:.1f} dB"
    return f"{name}: peak at {found.peak_hz:.1f} Hz{held}"


def lines(found: ToleranceStudy) -> list[str]:
    """What the study says, for people."""
    shown = found.json()
    peak, shift, held = shown["peak_hz"], shown["peak_shift_hz"], shown["confinement_db"]
    out = [
        _told("nominal", found.nominal),
        f"{len(found.samples)} plates: peak {peak['mean']:.1f} Hz, spread {peak['deviation']:.1f} Hz, "
        f"{peak['lowest']:.1f} to {peak['highest']:.1f} Hz; moved by {shift['mean']:+.1f} Hz on average",
    ]
    if held:
        out.append(
            f"confinement {held['mean']:.1f} dB, spread {held['deviation']:.1f} dB, worst {held['lowest']:.1f} dB; "
            f"{shown['confined']} of {len(found.samples)} confined"
        )
    return out


def _tell(found: ToleranceStudy, forced: ForcedPlate, band: tuple[float, float], log: Log) -> None:
    for line in lines(found):
        log.info(line)
    peaks = np.array([one.peak_hz for one in found.samples])
    if (peaks <= band[0]).any() or (peaks >= band[1]).any():
        log.alarm("PEAK_AT_END", "a sample's response is largest at the end of the band: widen it")
    if found.space_change_hz > max(MOVED * spread(peaks).deviation, 0.1 * found.nominal.peak_hz * forced.loss):
        log.alarm(
            "SPACE_TOO_SMALL",
            f"a narrower space of modes moves a sample's peak by {found.space_change_hz:.1f} Hz: widen the band",
        )
