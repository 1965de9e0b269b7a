"""Parts of the answer about a finger: the mode under it, the states of the driven plate, the loop's drive, the map."""

from __future__ import annotations

from pipeline.records.part import BAR, Part, column

MAP = ("x_m", "y_m")


class LoadedModeRecord(Part):
    """The target mode under a finger, by its complex eigenvalue (2 pi frequency_hz)^2 (1 + i/quality_factor)."""

    free_hz: float = column("frequency without the finger", "Hz", error="free_error")
    frequency_hz: float = column("frequency under the finger", "Hz", error="frequency_error")
    shift_hz: float = column("what the finger shifts it by", "Hz", error="shift_error_hz")
    quality_factor: float | None = column(
        "quality factor under the finger; None where it has none", error="quality_error"
    )
    added_loss: float = column("what the finger adds to 1/Q", error="added_loss_error")
    share: float = column("how much of the free mode is left in it, of 1", error="share_error")
    free_error: float | None = column(BAR.format("free_hz, relative"), default=None)
    frequency_error: float | None = column(BAR.format("frequency_hz, relative"), default=None)
    shift_error_hz: float | None = column(BAR.format("shift_hz"), "Hz", default=None)
    quality_error: float | None = column(BAR.format("quality_factor"), default=None)
    added_loss_error: float | None = column(BAR.format("added_loss"), default=None)
    share_error: float | None = column(BAR.format("share"), default=None)


class TouchStateRecord(Part):
    """A way of driving the plate, with the finger or without: amplitudes are peaks, powers means over a period."""

    state: str = column("free, touched, retuned, held or shaped")
    frequency_hz: float = column("frequency of the drive", "Hz", error="frequency_error")
    drive_V: float = column("voltage of the drive", "V", error="drive_error_V")
    finger_m: float = column("rms of u_z over the contact", "m", error="finger_error_m")
    zone_rms_m: float = column("rms of u_z on the active touch face", "m", error="zone_rms_error_m")
    passive_rms_m: float | None = column(
        "rms of u_z on the passive touch face; None without one", "m", error="passive_rms_error_m"
    )
    confinement_db: float | None = column(
        "rms on the active touch face over that on the passive one; None without one",
        "dB",
        error="confinement_error_db",
    )
    sensor_V: float | None = column("voltage of the first sensor; None without one", "V", error="sensor_error_V")
    friction_low: float | None = column(
        "friction over that at rest with the smallest gap; None where the relation says nothing",
        error="friction_low_error",
    )
    friction_high: float | None = column(
        "friction over that at rest with the largest gap; None where the relation says nothing",
        error="friction_high_error",
    )
    patches_W: float = column("power that the patches put in", "W", error="patches_error_W")
    plate_W: float = column("power that the plate loses", "W", error="plate_error_W")
    finger_W: float = column("power that the finger takes", "W", error="finger_error_W")
    dielectric_W: float | None = column("dielectric loss of the patches; None without a loss tangent", "W")
    drawn_W: float | None = column("patches_W and dielectric_W together", "W", error="drawn_error_W")
    apparent_VA: float = column("what an amplifier without recovery handles", "VA")
    drawn_mW_at_1um: float | None = column(
        "drawn_W at an amplitude of 1 um under the finger", "mW", error="drawn_error_mW_at_1um"
    )
    drive_V_at_1um: float | None = column(
        "voltage for an amplitude of 1 um under the finger", "V", error="drive_error_V_at_1um"
    )
    frequency_error: float | None = column(BAR.format("frequency_hz, relative"), default=None)
    drive_error_V: float | None = column(BAR.format("drive_V"), "V", default=None)
    finger_error_m: float | None = column(BAR.format("finger_m"), "m", default=None)
    zone_rms_error_m: float | None = column(BAR.format("zone_rms_m"), "m", default=None)
    passive_rms_error_m: float | None = column(BAR.format("passive_rms_m"), "m", default=None)
    confinement_error_db: float | None = column(BAR.format("confinement_db"), "dB", default=None)
    sensor_error_V: float | None = column(BAR.format("sensor_V"), "V", default=None)
    friction_low_error: float | None = column(BAR.format("friction_low"), default=None)
    friction_high_error: float | None = column(BAR.format("friction_high"), default=None)
    patches_error_W: float | None = column(BAR.format("patches_W"), "W", default=None)
    plate_error_W: float | None = column(BAR.format("plate_W"), "W", default=None)
    finger_error_W: float | None = column(BAR.format("finger_W"), "W", default=None)
    drawn_error_W: float | None = column(BAR.format("drawn_W"), "W", default=None)
    drawn_error_mW_at_1um: float | None = column(BAR.format("drawn_mW_at_1um"), "mW", default=None)
    drive_error_V_at_1um: float | None = column(BAR.format("drive_V_at_1um"), "V", default=None)


class LoopRecord(Part):
    """The drive that keeps the first sensor's amplitude as without the finger, and whether the amplifier can."""

    sensor_V: float = column("voltage of the first sensor without the finger", "V", error="sensor_error_V")
    needed_V: float = column("drive that keeps that voltage", "V", error="needed_error_V")
    limit_V: float | None = column("limit of the amplifier; None where the case gives none", "V")
    saturates: bool | None = column("whether needed_V is beyond it")
    sensor_error_V: float | None = column(BAR.format("sensor_V"), "V", default=None)
    needed_error_V: float | None = column(BAR.format("needed_V"), "V", default=None)


class TouchMapRecord(Part):
    """The finger at every place of a grid, x first, at constant voltage; bars are those of a peak that follows its mode."""

    frequency_hz: float = column("frequency of the drive", "Hz", error="frequency_error")
    x_m: list[float] = column("places along x", "m", along="x_m")
    y_m: list[float] = column("places along y", "m", along="y_m")
    displacement_m: list[list[float]] = column(
        "the free plate's u_z in the phase of its largest, whose zeros are the nodes", "m", along=MAP
    )
    free_m: list[list[float]] = column("amplitude without a finger", "m", along=MAP, error="free_error_m")
    touched_m: list[list[float]] = column("amplitude under the finger", "m", along=MAP, error="touched_error_m")
    friction: list[list[float | None]] | None = column(
        "friction over that at rest at the gaps' geometric mean; None where the relation says nothing", along=MAP,
        error="friction_error",
    )  # fmt: skip
    needed_V: list[list[float]] | None = column(
        "drive that keeps the first sensor's voltage; None without one", "V", along=MAP, error="needed_error_V"
    )
    frequency_error: float | None = column(BAR.format("frequency_hz, relative"), default=None)
    free_error_m: list[list[float]] | None = column(BAR.format("free_m"), "m", along=MAP, default=None)
    touched_error_m: list[list[float]] | None = column(
        "that of touched_m, the contact's integrals and the flexibility under the finger included", "m", along=MAP,
        default=None,
    )  # fmt: skip
    friction_error: list[list[float | None]] | None = column(
        "what touched_m at either end of its bar makes of friction; None where the relation does not hold there", along=MAP,
        default=None,
    )  # fmt: skip
    needed_error_V: list[list[float]] | None = column(BAR.format("needed_V"), "V", along=MAP, default=None)
