"""Parts of an answer about plates whose pillars differ: a sample, and the spread of a figure over samples."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Any

from pipeline import quantity
from pipeline.records.part import BAR, Part, column


class SpreadRecord(Part):
    """A figure over samples."""

    mean: float = column("mean")
    deviation: float | None = column("standard deviation; None of one sample, which has none")
    lowest: float = column("smallest")
    highest: float = column("largest")

    @property
    def relative(self) -> float | None:
        """The standard deviation relative to the mean; None of one sample."""
        return None if self.deviation is None else self.deviation / self.mean

    def spread(self, count: int, unit: str) -> str:
        """The standard deviation of count samples with the digits that its own, deviation / sqrt(2 (count - 1)), allows."""
        if self.deviation is None:
            return "unknown"
        return f"{quantity.figure(self.deviation, self.spread_error(count))} {unit}"

    def spread_error(self, count: int) -> float | None:
        """The standard deviation's own, of count samples of a normal distribution; None of one sample."""
        return None if self.deviation is None or count < 2 else self.deviation / sqrt(2.0 * (count - 1))


class SampleRecord(Part):
    """A plate at the mode that the target mode has become; samples have no error bar of their resonances."""

    peak_hz: float | None = column("frequency of the target mode's peak; None where the mode is lost", "Hz")
    zone_rms: float | None = column("rms of u_z on the active touch face, in rms_unit")
    confinement_db: float | None = column("rms on the active touch face over that on the passive one", "dB")
    quality_factor: float | None = column("quality factor; None where it cannot be read", error="quality_error")
    tracking: str = column("single, split (the strongest is measured) or none (the figures are None)")
    quality_error: float | None = column(BAR.format("quality_factor"), table=False, default=None)

    def line(self, name: str, relative: float | None = None) -> str:
        """Return the sample in words; relative: what its frequency's digits may be off by."""
        if self.peak_hz is None:
            return f"{name}: lost, no mode has the target mode's shape"
        confinement = "" if self.confinement_db is None else f", confinement {quantity.level(self.confinement_db)}"
        split = ", split among several modes" if self.tracking == "split" else ""
        return f"{name}: peak at {quantity.frequency(self.peak_hz, relative)}{confinement}{split}"


def statistics(nominal: SampleRecord, samples: Sequence[SampleRecord]) -> dict[str, Any]:
    """Return what samples come to, by the names of the result: those without the target mode are counted and left out."""
    from solvers.measures.confinement import CONFINED_DB

    peaks, levels = known(samples, "peak_hz"), known(samples, "confinement_db")
    shifts = [peak - nominal.peak_hz for peak in peaks] if nominal.peak_hz else []
    return {
        "lost": len(samples) - len(peaks),
        "split": sum(one.tracking == "split" for one in samples),
        "peak_hz": spread_of(peaks),
        "peak_shift_hz": spread_of(shifts),
        "confinement_db": spread_of(levels),
        "confined": sum(level >= CONFINED_DB for level in levels) if levels else None,
    }


def known(samples: Sequence[SampleRecord], name: str) -> list[float]:
    """Return a figure of those samples that have it."""
    return [value for one in samples if (value := getattr(one, name)) is not None]


def spread_of(values: Sequence[float]) -> SpreadRecord | None:
    """Return the spread of a figure; None of no sample."""
    import numpy as np

    from solvers.variation.samples import spread

    return SpreadRecord.of(spread(np.array(values))) if values else None
