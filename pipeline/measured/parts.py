"""Parts of an answer about what was measured: resonances of a sweep and of the model in its place, and a map's figures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pipeline import quantity
from pipeline.records.part import Part, column

SCATTER = "by the scatter of the points about their circle, two standard deviations"


class ResonanceRecord(Part):
    """A resonance as identified from a sweep; the circle's, or the highest point and half-power width without a circle."""

    peak_hz: float | None = column("frequency of the highest point", "Hz", error="frequency_error", default=None)
    frequency_hz: float = column("frequency", "Hz", error="frequency_error")
    quality_factor: float | None = column("quality factor; None where it cannot be read", error="quality_error")
    frequency_error: float | None = column(
        f"half-width of the error bar of frequency_hz, relative: of a measured one {SCATTER}, of the computed one the model's; "
        "None without an estimate",
        default=None,
    )
    quality_error: float | None = column(
        f"half-width of the error bar of quality_factor, {SCATTER}; None without a circle, and of the computed one, where the "
        "peaks of the response have it",
        default=None,
    )
    quality_factor_half_power: float | None = column("quality factor by the half-power width", default=None)
    circle: dict[str, Any] | None = column(
        "the mode as fitted to the circle, the delay between drive and sensor taken out: frequency_hz, tau_s, quality_factor, "
        "gain, delay_s, background, circle (centre, radius, misfit) and fitted_hz; None where there is none"
    )
    no_circle: str | None = column("why there is no circle; None with one", default=None)


class ComputedResonance(ResonanceRecord):
    """The computed resonance where the measuring instrument points."""

    point_mm: list[float] | None = column("where a laser stands; None of a sensor", "mm", default=None)


class MeasuredSweepRecord(ResonanceRecord):
    """A measured sweep beside the computed response, where the measuring instrument points."""

    file: str = column("the file that was read")
    synthetic: bool = column("whether the file says that its data were made up")
    quantity: str = column("velocity, displacement or sensor", default="")
    points: int | None = column("frequencies in the file", default=None)
    band_hz: list[float] | None = column("the first and the last of them", "Hz", default=None)
    frequency_shift_hz: float = column("measured less computed frequency", "Hz", error="frequency_shift_error_hz")
    frequency_shift: float = column("frequency_shift_hz over the computed frequency")
    computed: ComputedResonance = column("the computed resonance")
    frequency_shift_error_hz: float | None = column(
        "half-width of the error bar of frequency_shift_hz, Hz, by the model's and by the scatter of the points; None without "
        "the model's",
        default=None,
    )

    @property
    def shift_text(self) -> str:
        """The shift in Hz and in percent with the digits that its bar allows."""
        half, own = self.frequency_shift_error_hz, self.computed.frequency_hz
        moved = quantity.with_bar(self.frequency_shift_hz, half, "Hz")
        part = quantity.percentage(self.frequency_shift_hz / own, None if half is None else half / own)
        return f"{quantity.signed(moved)} ({quantity.signed(part)})"

    def line(self) -> str:
        """Return both resonances, the shift and the quality factors in words."""
        ours, error = self.computed, self.computed.frequency_error
        pairs = [(each.quality_factor, each.quality_error) for each in (self, ours)]
        losses = " against ".join("none" if each[0] is None else quantity.with_bar(*each) for each in pairs)
        bar = (
            "the model's error is not known" if error is None else f"the model may be off by {quantity.percent(error)}"
        )
        return (
            f"{self.file}{marked(self)}: resonance at "
            f"{quantity.frequency_with_bar(self.frequency_hz, self.frequency_error)}, "
            f"computed {quantity.frequency(ours.frequency_hz, error)}: shift {self.shift_text}, {bar}; "
            f"quality factor {losses} computed"
        )


class ComputedMap(Part):
    """The computed field at the peak, at the measured points."""

    frequency_hz: float = column("the peak's frequency; its bar is that of the peak", "Hz")
    confinement_db: float | None = column("confinement at that peak; its bar is that of the peak", "dB")
    mac: float = column("modal assurance criterion with the target shape, at the measured points")
    confinement_at_points_db: float | None = column("confinement at the measured points; a map has no error bar", "dB")
    zone_share_at_points: float | None = column("zone share at the measured points")


class MeasuredMapRecord(Part):
    """A measured map of the touch face beside the computed operating shape."""

    file: str = column("the file that was read")
    synthetic: bool = column("whether the file says that its data were made up")
    quantity: str = column("velocity, displacement or none")
    points: int = column("points in the file")
    covered_active: float = column("share of the active touch face that the points cover")
    covered_passive: float | None = column("share of the passive touch face that the points cover")
    zone_share: float | None = column("zone share of the measured motion")
    confinement_db: float | None = column(
        "rms of the measured motion on the active touch face over that on the passive one, None without one; without an error "
        "bar: a map does not tell its noise",
        "dB",
    )
    confined: bool | None = column("whether that is confined; None without a passive face")
    mac: float = column("modal assurance criterion of the measured motion with the target shape")
    mac_operating: float = column("correlation of the measured map and the computed operating deflection shape, 0 to 1")
    computed: ComputedMap = column("the computed field")

    def line(self, frequency_error: float | None) -> str:
        """Return the map's figures in words."""
        summary, seen = "no passive face", self.computed.confinement_at_points_db
        if self.confinement_db is not None:
            summary = f"confinement {quantity.level(self.confinement_db)}"
        beside = "" if seen is None else f" (computed {quantity.level(seen)} at the same points)"
        tone = quantity.frequency(self.computed.frequency_hz, frequency_error)
        return (
            f"{self.file}{marked(self)}: {self.points} points, {summary}{beside}, "
            f"MAC {quantity.figure(self.mac_operating)} to the operating deflection shape at {tone}, "
            f"{quantity.figure(self.mac)} to the target mode"
        )


class MeasuredRecord(Part):
    """What was measured beside the response."""

    sweep: MeasuredSweepRecord | None = column("the sweep; None without one")
    map: MeasuredMapRecord | None = column("the map of the touch face; None without one")

    def lines(self, frequency_error: float | None) -> Iterator[str]:
        """Yield a line for each; the half-width of the bar of the computed frequencies, relative."""
        if self.sweep:
            yield self.sweep.line()
        if self.map:
            yield self.map.line(frequency_error)


def marked(record: MeasuredSweepRecord | MeasuredMapRecord) -> str:
    """Return the mark of data that were made up."""
    return " (synthetic)" if record.synthetic else ""
