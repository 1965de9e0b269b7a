"""Parts of a comparison with measurements: measured and computed resonances, and the figures of a map."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pipeline import quantity
from pipeline.records.part import Part, column

SCATTER = "two standard deviations of the scatter of the points around their circle"


class ResonanceRecord(Part):
    """Resonance identified from a sweep: from a circle fit, or from the highest point and half-power width."""

    peak_hz: float | None = column("frequency of the highest point", "Hz", error="frequency_error", default=None)
    frequency_hz: float = column("frequency", "Hz", error="frequency_error")
    quality_factor: float | None = column("quality factor; None if it cannot be read", error="quality_error")
    frequency_error: float | None = column(
        f"relative error bar of frequency_hz: if measured, {SCATTER}, or without a circle the distance to the neighbouring "
        "frequencies; if computed, that of the model; None without an estimate",
        default=None,
    )
    quality_error: float | None = column(
        f"error bar of quality_factor: {SCATTER}; None without a circle, and for the computed resonance, whose error bar is "
        "given with the peaks of the response",
        default=None,
    )
    quality_factor_half_power: float | None = column("quality factor from the half-power width", default=None)
    circle: dict[str, Any] | None = column(
        "mode fitted to the circle after removing the delay between drive and sensor: frequency_hz, tau_s, quality_factor, "
        "gain, delay_s, background, circle (centre, radius, misfit) and fitted_hz; None without one"
    )
    no_circle: str | None = column("reason why there is no circle; None with one", default=None)


class ComputedResonance(ResonanceRecord):
    """Computed resonance at the measured point."""

    point_mm: list[float] | None = column("point of the laser; None for a sensor", "mm", default=None)


class MeasuredSweepRecord(ResonanceRecord):
    """Measured sweep compared with the computed response at the same point."""

    file: str = column("file that was read")
    synthetic: bool = column("whether the file declares its data synthetic")
    quantity: str = column("velocity, displacement or sensor", default="")
    points: int | None = column("number of frequencies in the file", default=None)
    band_hz: list[float] | None = column("first and last frequency", "Hz", default=None)
    frequency_shift_hz: float = column("measured minus computed frequency", "Hz", error="frequency_shift_error_hz")
    frequency_shift: float = column("frequency_shift_hz over the computed frequency")
    computed: ComputedResonance = column("computed resonance")
    frequency_shift_error_hz: float | None = column(
        "error bar of frequency_shift_hz, Hz, from the model and the measured frequency; None if that of one is unknown",
        default=None,
    )

    @property
    def shift_text(self) -> str:
        """Write the shift in Hz and in per cent with the digits that its error allows."""
        half, own = self.frequency_shift_error_hz, self.computed.frequency_hz
        moved = quantity.with_bar(self.frequency_shift_hz, half, "Hz")
        part = quantity.percentage(self.frequency_shift_hz / own, None if half is None else half / own)
        return f"{quantity.signed(moved)} ({quantity.signed(part)})"

    def line(self) -> str:
        """Return both resonances, the shift and the quality factors in words."""
        ours, error = self.computed, self.computed.frequency_error
        pairs = [(each.quality_factor, each.quality_error) for each in (self, ours)]
        losses = " against ".join("none" if each[0] is None else quantity.with_bar(*each) for each in pairs)
        bar = f"error of the model: {'unknown' if error is None else quantity.percent(error)}"
        return (
            f"{self.file}{marked(self)}: resonance at "
            f"{quantity.frequency_with_bar(self.frequency_hz, self.frequency_error)}, "
            f"computed {quantity.frequency(ours.frequency_hz, error)}, shift {self.shift_text} ({bar}); "
            f"quality factor {losses} computed"
        )


class ComputedMap(Part):
    """Computed field at the peak, sampled at the measured points."""

    frequency_hz: float = column("frequency of the peak, with the peak's error bar", "Hz")
    confinement_db: float | None = column("confinement at the peak, with the peak's error bar", "dB")
    mac: float = column("modal assurance criterion with the target shape, at the measured points")
    confinement_at_points_db: float | None = column("confinement at the measured points; a map has no error bar", "dB")
    zone_share_at_points: float | None = column("zone share at the measured points")


class MeasuredMapRecord(Part):
    """Measured map of the touch face compared with the computed operating deflection shape."""

    file: str = column("file that was read")
    synthetic: bool = column("whether the file declares its data synthetic")
    quantity: str = column("velocity, displacement or none")
    points: int = column("number of points in the file")
    covered_active: float = column("share of the active touch face that the points cover")
    covered_passive: float | None = column("share of the passive touch face that the points cover")
    zone_share: float | None = column("zone share of the measured motion")
    confinement_db: float | None = column(
        "rms of the measured motion on the active touch face over that on the passive one, None without one; it has no error "
        "bar, since the noise of a map is unknown",
        "dB",
    )
    confined: bool | None = column("whether the measured motion is confined; None without a passive face")
    mac: float = column("modal assurance criterion of the measured motion with the target shape")
    mac_operating: float = column("correlation of the measured map and the computed operating deflection shape, 0 to 1")
    computed: ComputedMap = column("computed field")

    def line(self, frequency_error: float | None) -> str:
        """Return the figures of the map in words."""
        summary, seen = "no passive face", self.computed.confinement_at_points_db
        if self.confinement_db is not None:
            summary = f"confinement {quantity.level(self.confinement_db)}"
        computed = "" if seen is None else f" (computed {quantity.level(seen)} at the same points)"
        tone = quantity.frequency(self.computed.frequency_hz, frequency_error)
        return (
            f"{self.file}{marked(self)}: {self.points} points, {summary}{computed}, "
            f"MAC {quantity.figure(self.mac_operating)} with the operating deflection shape at {tone}, "
            f"{quantity.figure(self.mac)} with the target shape"
        )


class MeasuredRecord(Part):
    """Measurements compared with the response."""

    sweep: MeasuredSweepRecord | None = column("measured sweep; None without one")
    map: MeasuredMapRecord | None = column("measured map of the touch face; None without one")

    def lines(self, frequency_error: float | None) -> Iterator[str]:
        """Yield one line for each; frequency_error: relative error of the computed frequencies."""
        if self.sweep:
            yield self.sweep.line()
        if self.map:
            yield self.map.line(frequency_error)


def marked(record: MeasuredSweepRecord | MeasuredMapRecord) -> str:
    """Return the mark of synthetic data."""
    return " (synthetic)" if record.synthetic else ""
