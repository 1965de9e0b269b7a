"""Parts of answers that several models compute: modes, waves, zones, spreads, fingers and travelling waves."""

from __future__ import annotations

from collections.abc import Sequence
from math import log10, nan, sqrt
from typing import Any, Literal

from pipeline import quantity
from pipeline.records.part import BAR, Part, column, live

RELATIVE = "half-width of the frequency's error bar, relative; None without an estimate"
MAC = "modal assurance criterion with the target shape on the active touch face, 0 to 1"
STRENGTH = "share of the target shape that the mode carries, times its zone share, 0 to 1"
CONFINEMENT = "rms of u_z on the active touch face over that on the passive one; None without a passive one"
SHARE = "integral of u_z^2 over the active touch face over that over the whole touch face"

UNKNOWN = "None without an estimate"

MAP = ("x_m", "y_m")


class ModeRecord(Part):
    """One mode.

    Frequency in Hz, confinement in dB, `mac`, `zone_share` and `strength` from 0 to 1; None without meaning.

    >>> import antinode
    >>> mode = antinode.load("examples/small.toml", accuracy=0.1).modes(part="pillar", count=1)[0]
    >>> 38e3 < mode.frequency_hz < 41e3, mode.to_pyvista()["displacement"].shape[1]
    (True, 3)
    """

    frequency_hz: float = column("frequency, best value", "Hz", error="error")
    error: float | None = column(RELATIVE, default=None)
    symmetry: str | None = column(
        "symmetry class SS, SA, AS or AA: u_z symmetric or antisymmetric in x, then in y", default=None
    )
    zone_share: float | None = column(SHARE, error="zone_share_error", default=None)
    confinement_db: float | None = column(CONFINEMENT, "dB", error="confinement_error_db", default=None)
    confinement_error_db: float | None = column(BAR.format("the level"), "dB", default=None)
    mac: float | None = column(MAC, error="mac_error", default=None)
    strength: float | None = column(STRENGTH, error="strength_error", default=None)
    residual: float = column("relative residual of the eigenvalue problem")
    zone_share_error: float | None = column(BAR.format("zone_share"), default=None)
    mac_error: float | None = column(BAR.format("mac"), default=None)
    strength_error: float | None = column(BAR.format("strength"), default=None)
    parity: str | None = column("symmetry class as signs", table=False, default=None)
    computed_hz: float | None = column("frequency of the finest mesh itself", "Hz", error="error", default=None)
    surface: Any = live()  # makes the moving surface of a computed mode

    def to_pyvista(self) -> Any:
        """Return the closed outer surface of the whole body in m; `displacement` (points, 3) has unit modal mass.

        Raises ValueError for a mode that was read from a file: its shape is not in it.
        """
        if self.surface is None:
            raise ValueError("this mode was read from a file, which holds no shapes: compute it again")
        return self.surface()


class CountRecord(Part):
    """Modes expected by inertia and found between two frequencies."""

    low_hz: float = column("lower end of the interval", "Hz")
    high_hz: float = column("upper end of the interval", "Hz")
    expected: int = column("modes by the count of inertia")
    found: int = column("modes that were found")
    counts: str | None = column("matrices whose eigenvalues are counted: mesh or reduced pencil", default=None)
    more_in_mesh_at_most: int | None = column(
        "how many more the meshes behind a reduced plate may have; None without a bound", default=None
    )

    @property
    def holds(self) -> bool:
        """Whether as many were found as expected."""
        return self.expected == self.found


class RivalRecord(Part):
    """Another mode that carries the target shape."""

    frequency_hz: float = column("frequency, best value", "Hz", error="error")
    strength: float | None = column(STRENGTH, error="strength_error")
    mac: float | None = column(MAC, error="mac_error")
    confinement_db: float | None = column(CONFINEMENT, "dB", error="confinement_error_db")
    error: float | None = column(RELATIVE, default=None)
    confinement_error_db: float | None = column(BAR.format("the level"), "dB", default=None)
    mac_error: float | None = column(BAR.format("mac"), default=None)
    strength_error: float | None = column(BAR.format("strength"), default=None)


class TargetRecord(Part):
    """The verdict on the target mode: status is single, split or none; with none, frequency and levels are None.

    Frequency in Hz, MAC and strength from 0 to 1, confinement in dB as a mode; as driven it is at `response`'s target_peak.

    >>> import antinode
    >>> antinode.Target(status="single", frequency_hz=34.6e3, mac=0.97, strength=0.62, confinement_db=12.1).confinement_db
    12.1
    """

    status: Literal["single", "split", "none"] = column("single, split among several modes, or none")
    frequency_hz: float | None = column("frequency of the target mode", "Hz", error="frequency_error")
    mac: float | None = column(MAC, error="mac_error")
    strength: float | None = column(STRENGTH, error="strength_error")
    confinement_db: float | None = column(CONFINEMENT, "dB", error="confinement_error_db")
    zone_share: float | None = column(SHARE, error="zone_share_error", default=None)
    symmetry: str | None = column("symmetry class of the target mode", default=None)
    shape: Literal["free-free"] = column(
        "target shape along x: both ends of the zone are ends of the plate", default="free-free"
    )
    driven_confinement_db: float | None = column(
        "always None: `response` has the driven one at its target_peak", "dB", default=None
    )
    share: float | None = column(
        "part of the target shape that the mode carries, of all modes of the window", default=None
    )
    rivals: list[RivalRecord] = column("the other modes that carry the shape, strongest first", default_factory=list)
    window_hz: list[float] | None = column("window in which it was searched", "Hz", default=None)
    index: int | None = column("its place among the modes listed, from 0; None beyond them", default=None)
    extension_db: float | None = column(
        "rms in the zone over that on the plate beyond the rows", "dB", error="extension_error_db", default=None
    )
    extension_error_db: float | None = column(BAR.format("extension_db"), "dB", default=None)
    frequency_error: float | None = column(RELATIVE, default=None)
    confinement_error_db: float | None = column(BAR.format("the level"), "dB", default=None)
    zone_share_error: float | None = column(BAR.format("zone_share"), default=None)
    mac_error: float | None = column(BAR.format("mac"), default=None)
    strength_error: float | None = column(BAR.format("strength"), default=None)
    pillar_energy_share: float | None = column(
        "share of the kinetic energy in the pillars", error="pillar_energy_share_error", default=None
    )
    pillar_energy_share_error: float | None = column(BAR.format("pillar_energy_share"), default=None)

    @property
    def is_found(self) -> bool:
        """Whether there is such a mode."""
        return self.frequency_hz is not None


class TargetMode(TargetRecord):
    """The same where there is a mode."""

    frequency_hz: float = column("frequency of the target mode", "Hz", error="frequency_error")


class Wave(Part):
    """One wave across the rows."""

    polarisation: str = column("how the wave moves: flexural, shear, longitudinal, or in the pillar")
    ky_re_per_m: float = column("real part of the wavenumber across the rows", "rad/m")
    ky_im_per_m: float = column("imaginary part of the wavenumber across the rows", "rad/m")
    db_per_row: float = column("decay per row", "dB", error="db_error")
    pillar_share: float = column("share of the kinetic energy in the pillar; it has no error bar")
    db_error: float | None = column(
        "half-width of the decay's error bar, of the least attenuated flexural wave alone; " + UNKNOWN,
        "dB",
        default=None,
    )


class Transmission(Part):
    """Shares of an incoming flexural wave's power after the case's rows, by polarisation."""

    reflected: float = column("share that comes back")
    flexural: float = column("share that passes as a flexural wave", name="transmitted_flexural")
    shear: float = column("share that passes as a shear wave", name="transmitted_shear")
    longitudinal: float = column("share that passes as a longitudinal wave", name="transmitted_longitudinal")

    @property
    def taken_db(self) -> float:
        """What the rows take from a flexural wave's power, dB, at most 300."""
        return -10.0 * log10(max(self.flexural, 1e-30))


class Passed(Part):
    """What becomes of an incoming flexural wave at a frequency."""

    frequency_hz: float = column("frequency", "Hz", along=())
    transmission: Transmission | None = column(
        "what becomes of an incoming flexural wave's power at the case's rows; None where none arrives", spread=True
    )
    taken_error_db: float | None = column(
        "half-width of the error bar of what the rows take from a flexural wave's power; " + UNKNOWN, "dB", default=None
    )

    @property
    def taken_db(self) -> float:
        """What the rows take from a flexural wave's power, dB; NaN where no wave arrives."""
        return self.transmission.taken_db if self.transmission else nan


class AttenuationPoint(Passed):
    """All waves at a frequency, the decay of the least attenuated flexural one, and what the rows let through."""

    waves: list[Wave] = column("every wave at this frequency")
    db_per_row: float | None = column(
        "decay per row of the least attenuated flexural wave; None where there is none", "dB", error="db_error"
    )
    db_error: float | None = column("half-width of the decay's error bar; " + UNKNOWN, "dB", default=None)


class BroadbandPoint(Passed):
    """At a frequency: confinement of the motion that a pressure of the target shape forces, and what passes the rows."""

    confinement_db: float | None = column("confinement of the driven zone", "dB", error="confinement_error_db")
    confinement_error_db: float | None = column("half-width of the level's error bar; " + UNKNOWN, "dB", default=None)


class DrivenZone(Part):
    """One zone driven at its own peak while the others' patches are held at 0 V; lists have an entry a measured zone."""

    centre_m: float = column("y of the driven zone's centre line", "m")
    drivers: list[int] = column("numbers of the driven patches, from 0")
    peak_hz: float = column("frequency at which the driven zone moves most", "Hz", error="peak_error")
    peak_error: float | None = column(BAR.format("peak_hz, relative"), default=None)
    rms_m_per_V: list[float] = column("rms of u_z", "m/V", along="measured", error="rms_error_m_per_V")
    rms_error_m_per_V: list[float | None] | None = column(
        BAR.format("rms_m_per_V"), "m/V", along="measured", default=None
    )
    level_db: list[float] = column("rms over the driven zone's", "dB", along="measured", error="level_error_db")
    level_error_db: list[float | None] | None = column(BAR.format("level_db"), "dB", along="measured", default=None)
    passive_db: float | None = column(
        "rms of the passive face over the driven zone's; None without a passive face", "dB", error="passive_error_db"
    )
    passive_error_db: float | None = column(BAR.format("passive_db"), "dB", default=None)
    mac: float | None = column(
        "modal assurance criterion of the driven zone with the target shape", error="mac_error", default=None
    )
    mac_error: float | None = column(BAR.format("mac"), default=None)
    over_rms_m_per_V: list[list[float]] = column(
        "rms of u_z over frequency", "m/V", along=("measured", "frequency_hz"), error="over_rms_error_m_per_V"
    )
    over_rms_error_m_per_V: list[list[float | None]] | None = column(
        BAR.format("over_rms_m_per_V"), "m/V",
        along=("measured", "frequency_hz"), default=None,
    )  # fmt: skip


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


def worst_of(zones: list[DrivenZone]) -> tuple[float | None, float | None]:
    """Return the largest level of a zone while another is driven, dB, and the half-width of its bar; None with one zone."""
    others = [
        (level, zone.level_error_db[j] if zone.level_error_db else None)
        for i, zone in enumerate(zones)
        for j, level in enumerate(zone.level_db)
        if i != j
    ]
    return max(others, default=(None, None), key=lambda pair: pair[0] or 0.0)


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
