"""Parts of the answer about a travelling wave: its two modes, what a finger on it feels, and what the board played."""

from __future__ import annotations

from pipeline.records.part import BAR, Part, column


class PatternMode(Part):
    """A mode held for a travelling wave."""

    nodal_lines: int = column("nodal lines of its shape along x")
    frequency_hz: float = column("frequency", "Hz", error="frequency_error")
    share: float = column("share of its mass that moves in that shape, 0 to 1", error="share_error")
    frequency_error: float | None = column(BAR.format("frequency_hz, relative"), default=None)
    share_error: float | None = column(BAR.format("share"), default=None)


class PlayedPattern(Part):
    """A pattern as the emulated board drove it."""

    name: str = column("its name")
    twr: float = column("travelling-wave ratio in the window")
    twr_target: float = column("travelling-wave ratio of the table's voltages")
    error: float = column("|V - V_table|/|V_table|")


class PlayFault(Part):
    """What kept the emulated board from playing."""

    fault: str = column("the fault in which the image ended")


class ShearRecord(Part):
    """A finger at rest on a travelling wave of 1 um rms in the free zone, over its places, row by row along x."""

    fingertip: str = column("which finger of the table, or the case's own")
    radius_m: float = column("radius of its contact", "m")
    force_N: float | None = column("normal force of the finger; None where it is not given", "N")
    x_m: list[float] = column("places along x", "m", along="x_m")
    y_m: list[float] = column("places along y", "m", along="y_m")
    touched_m: list[list[float]] = column("amplitude of the face under the finger", "m", along=("x_m", "y_m"))
    crest_m_s: list[list[float]] = column("speed of the face along x at the crests", "m/s", along=("x_m", "y_m"))
    shear_low: list[list[float | None]] | None = column(
        "lower end of the net shear over the friction at rest, positive towards +x; None where the relations do not hold",
        along=("x_m", "y_m"),
    )
    shear_high: list[list[float | None]] | None = column("its upper end", along=("x_m", "y_m"))
    unknown: list[str] = column("why the shear is unknown, a sentence each")
    fastest_error_m_s: float | None = column(BAR.format("the largest of crest_m_s, at its place"), "m/s", default=None)
    shear_low_error: float | None = column(BAR.format("the largest of shear_low, at its place"), default=None)
    shear_high_error: float | None = column(BAR.format("the largest of shear_high, at its place"), default=None)

    @property
    def fastest_m_s(self) -> float:
        """The largest crest speed, signed."""
        return max((speed for row in self.crest_m_s for speed in row), key=abs, default=0.0)
