"""Parts of results that several models compute: modes, waves, zones, spreads, fingers and travelling waves."""

from __future__ import annotations

from collections.abc import Sequence
from math import log10, nan, sqrt
from typing import Any, Literal

from pipeline import quantity
from pipeline.records.part import BAR, Part, column, live

RELATIVE = BAR.format("the frequency, relative")
MAC = "modal assurance criterion with the target shape on the active touch face, 0 to 1"
STRENGTH = "share of the target shape that the mode carries, times its zone share, 0 to 1"
CONFINEMENT = "rms of u_z on the active touch face over that on the passive one; None without a passive one"
QUALITY = 'quality factor from the loss of the materials; None unless damping.quality = "materials"'
AIR_QUALITY = "quality factor by radiation into the air alone; None without [air]"
SHARE = "integral of u_z^2 over the active touch face divided by that over the whole touch face"

UNKNOWN = "None without an estimate"

MAP = ("x_m", "y_m")


class ModeRecord(Part):
    """One mode.

    Frequency in Hz, confinement in dB; `mac`, `zone_share` and `strength` from 0 to 1. Measures without meaning are None.

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
    residual: float = column("residual of the eigenvalue problem, relative")
    zone_share_error: float | None = column(BAR.format("zone_share"), default=None)
    mac_error: float | None = column(BAR.format("mac"), default=None)
    strength_error: float | None = column(BAR.format("strength"), default=None)
    quality_factor: float | None = column(QUALITY, error="quality_error", default=None)
    quality_error: float | None = column(BAR.format("quality_factor"), default=None)
    air_quality_factor: float | None = column(AIR_QUALITY, default=None)
    parity: str | None = column("symmetry class as signs", table=False, default=None)
    computed_hz: float | None = column("frequency on the finest mesh, uncorrected", "Hz", error="error", default=None)
    surface: Any = live("function that makes the moving surface of a computed mode; None if read from a file")

    def to_pyvista(self) -> Any:
        """Return the closed outer surface of the whole body with the mode's displacement.

        Returns
        -------
        pyvista.PolyData
            Surface in m; its array `displacement` (points, 3) has unit modal mass.

        Raises
        ------
        ValueError
            For a mode that was read from a file, which holds no shapes.
        """
        if self.surface is None:
            raise ValueError("this mode was read from a file, which holds no shapes: compute the modes again")
        return self.surface()

    def __str__(self) -> str:
        return f"mode: {_in_words(self)}"


class CountRecord(Part):
    """Modes between two frequencies: their inertia count and the number found."""

    low_hz: float = column("lower end of the interval", "Hz")
    high_hz: float = column("upper end of the interval", "Hz")
    expected: int = column("inertia count of the modes")
    found: int = column("number of modes found")
    counts: str | None = column("matrices whose eigenvalues are counted: mesh or reduced pencil", default=None)
    more_in_mesh_at_most: int | None = column(
        "upper bound on the further modes of a reduced plate's full meshes; None without a bound", default=None
    )

    @property
    def holds(self) -> bool:
        """Whether the number found equals the inertia count."""
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

    def __str__(self) -> str:
        return f"mode: {_in_words(self)}"


ALONG: tuple[Literal["free-free", "pinned-free", "sine"], ...] = ("free-free", "pinned-free", "sine")  # by held ends


class TargetRecord(Part):
    """Verdict on the target mode: status is single, split or none; if none, frequency and levels are None.

    Frequency in Hz, MAC and strength from 0 to 1, confinement of the mode in dB; `response` has the driven confinement at
    its target_peak.

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
    shape: Literal["free-free", "pinned-free", "sine"] = column(
        "target shape along x: free-free where both ends of the zone are free ends of the plate, sine where the plate goes on "
        "beyond both, pinned-free where it goes on beyond one",
        default="free-free",
    )
    driven_confinement_db: float | None = column(
        "always None: `response` gives it at its target_peak", "dB", default=None
    )
    share: float | None = column(
        "share of the target shape that the mode carries, relative to all modes of the window", default=None
    )
    rivals: list[RivalRecord] = column("other modes that carry the shape, strongest first", default_factory=list)
    window_hz: list[float] | None = column("search window", "Hz", default=None)
    index: int | None = column("place among the modes listed, from 0; None if it is not among them", default=None)
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
    quality_factor: float | None = column(QUALITY, error="quality_error", default=None)
    quality_error: float | None = column(BAR.format("quality_factor"), default=None)
    air_quality_factor: float | None = column(AIR_QUALITY, default=None)

    @property
    def is_found(self) -> bool:
        """Whether the target mode was found."""
        return self.frequency_hz is not None

    def __str__(self) -> str:
        if self.frequency_hz is None:
            return "target mode: none of the modes has the target shape"
        kind = "mode" if self.status == "single" else "shape split among several modes, strongest"
        return f"target {kind}: {_in_words(self)}"


class TargetMode(TargetRecord):
    """Verdict on a target mode that was found."""

    frequency_hz: float = column("frequency of the target mode", "Hz", error="frequency_error")


def _in_words(mode: ModeRecord | RivalRecord | TargetRecord) -> str:
    """Write a mode's frequency and its known measures with their error bars."""
    error = mode.frequency_error if isinstance(mode, TargetRecord) else mode.error
    words = [quantity.frequency_with_bar(mode.frequency_hz, error)]
    if mode.mac is not None:
        words.append(f"MAC {quantity.figure(mode.mac, mode.mac_error)}")
    if mode.strength is not None:
        words.append(f"strength {quantity.figure(mode.strength, mode.strength_error)}")
    if mode.confinement_db is not None:
        words.append(quantity.level_with_bar(mode.confinement_db, mode.confinement_error_db))
    return ", ".join(words)


class ZoneTarget(Part):
    """Target mode of one of several zones on a larger plate."""

    zone: int = column("number of the zone, from 1 in the order of the case")
    centre_m: tuple[float, float] = column("its centre (x, y) from the plate's", "m")
    target: TargetMode | TargetRecord = column("its target mode")


class Wave(Part):
    """One wave across the rows."""

    polarisation: str = column("type of wave: flexural, shear, longitudinal, or in the pillar")
    ky_re_per_m: float = column("real part of the wavenumber across the rows", "rad/m")
    ky_im_per_m: float = column("imaginary part of the wavenumber across the rows", "rad/m")
    db_per_row: float = column("decay per row", "dB", error="db_error")
    pillar_share: float = column("share of the kinetic energy in the pillar; it has no error bar")
    db_error: float | None = column(
        "error bar of the decay, for the least attenuated flexural wave only; " + UNKNOWN,
        "dB",
        default=None,
    )


class Transmission(Part):
    """Shares of an incoming flexural wave's power after the case's rows, by polarisation."""

    reflected: float = column("share that is reflected")
    flexural: float = column("share transmitted as a flexural wave", name="transmitted_flexural")
    shear: float = column("share transmitted as a shear wave", name="transmitted_shear")
    longitudinal: float = column("share transmitted as a longitudinal wave", name="transmitted_longitudinal")

    @property
    def taken_db(self) -> float:
        """Power that a flexural wave loses at the rows, dB, at most 300."""
        return -10.0 * log10(max(self.flexural, 1e-30))


class Passed(Part):
    """Reflection and transmission of an incident flexural wave at a frequency."""

    frequency_hz: float = column("frequency", "Hz", along=())
    transmission: Transmission | None = column(
        "shares of an incoming flexural wave's power after the case's rows; None without an incoming wave", spread=True
    )
    taken_error_db: float | None = column(
        "error bar of the power that a flexural wave loses at the rows; " + UNKNOWN, "dB", default=None
    )

    @property
    def taken_db(self) -> float:
        """Power that a flexural wave loses at the rows, dB; NaN without an incoming wave."""
        return self.transmission.taken_db if self.transmission else nan


class AttenuationPoint(Passed):
    """All waves at a frequency, the decay of the least attenuated flexural one, and the transmission of the rows."""

    waves: list[Wave] = column("every wave at this frequency")
    db_per_row: float | None = column(
        "decay per row of the least attenuated flexural wave; None without one", "dB", error="db_error"
    )
    db_error: float | None = column("error bar of the decay; " + UNKNOWN, "dB", default=None)


class BroadbandPoint(Passed):
    """Confinement at a frequency under a pressure of the target shape, and the transmission of the rows."""

    confinement_db: float | None = column("confinement of the driven zone", "dB", error="confinement_error_db")
    confinement_error_db: float | None = column("error bar of the confinement; " + UNKNOWN, "dB", default=None)


class WarmPlate(Part):
    """Target mode at a temperature; None where the plate has none."""

    temperature_C: float = column("temperature", "C", along=())
    frequency_hz: float | None = column("frequency of the target mode", "Hz", error="error", default=None)
    error: float | None = column(BAR.format("frequency_hz, relative"), default=None)
    confinement_db: float | None = column(CONFINEMENT, "dB", error="confinement_error_db", default=None)
    confinement_error_db: float | None = column(BAR.format("confinement_db"), "dB", default=None)
    mac: float | None = column("modal assurance criterion with the target shape", default=None)
    left_out: float | None = column(
        "bound on what the bow of warm layers changes of the frequency, relative; None where it is not known",
        default=None,
    )


class LayerStress(Part):
    """Stress of a layer of the free plate, at the face where it is larger."""

    material: str = column("material of the layer")
    along_Pa_per_K: float = column("stress along x per kelvin", "Pa/K")
    across_Pa_per_K: float = column("stress along y per kelvin", "Pa/K")


class DrivenZone(Part):
    """One zone driven at its own peak while the other zones' patches are held at 0 V; lists have one entry per zone."""

    centre_m: float = column("y of the driven zone's centre line", "m")
    centre_x_m: float = column("x of its centre", "m", default=0.0)
    drivers: list[int] = column("numbers of the driven patches, from 0")
    peak_hz: float = column("frequency at which the driven zone moves most", "Hz", error="peak_error")
    peak_error: float | None = column(BAR.format("peak_hz, relative"), default=None)
    rms_m_per_V: list[float] = column("rms of u_z", "m/V", along="measured", error="rms_error_m_per_V")
    rms_error_m_per_V: list[float | None] | None = column(
        BAR.format("rms_m_per_V"), "m/V", along="measured", default=None
    )
    level_db: list[float] = column("rms relative to the driven zone's", "dB", along="measured", error="level_error_db")
    level_error_db: list[float | None] | None = column(BAR.format("level_db"), "dB", along="measured", default=None)
    passive_db: float | None = column(
        "rms of the passive face relative to the driven zone's; None without one", "dB", error="passive_error_db"
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
    """Statistics of a quantity over samples."""

    mean: float = column("mean")
    deviation: float | None = column("standard deviation; None for a single sample")
    lowest: float = column("smallest")
    highest: float = column("largest")

    @property
    def relative(self) -> float | None:
        """Standard deviation relative to the mean; None for a single sample."""
        return None if self.deviation is None else self.deviation / self.mean

    def spread(self, count: int, unit: str) -> str:
        """Write the standard deviation with the digits that its own error, deviation / sqrt(2 (count - 1)), allows."""
        if self.deviation is None:
            return "unknown"
        return f"{quantity.figure(self.deviation, self.spread_error(count))} {unit}"

    def spread_error(self, count: int) -> float | None:
        """Standard error of the standard deviation of `count` normally distributed samples; None for a single one."""
        return None if self.deviation is None or count < 2 else self.deviation / sqrt(2.0 * (count - 1))


class SampleRecord(Part):
    """A sampled plate at the mode that the target mode has become; its resonances have no error bars."""

    peak_hz: float | None = column("frequency of the target mode's peak; None if the mode is lost", "Hz")
    zone_rms: float | None = column("rms of u_z on the active touch face, in rms_unit")
    confinement_db: float | None = column("rms on the active touch face over that on the passive one", "dB")
    quality_factor: float | None = column("quality factor; None if it cannot be read", error="quality_error")
    tracking: str = column("single, split (the strongest is measured) or none (the figures are None)")
    quality_error: float | None = column(BAR.format("quality_factor"), table=False, default=None)

    def line(self, name: str, relative: float | None = None) -> str:
        """Return the sample in words; relative: error of its frequency, which limits the digits shown."""
        if self.peak_hz is None:
            return f"{name}: lost (no mode has the shape of the target mode)"
        confinement = "" if self.confinement_db is None else f", confinement {quantity.level(self.confinement_db)}"
        split = ", split among several modes" if self.tracking == "split" else ""
        return f"{name}: peak at {quantity.frequency(self.peak_hz, relative)}{confinement}{split}"


class LoadedModeRecord(Part):
    """Target mode under a finger, from its complex eigenvalue (2 pi frequency_hz)^2 (1 + i/quality_factor)."""

    free_hz: float = column("frequency without the finger", "Hz", error="free_error")
    frequency_hz: float = column("frequency under the finger", "Hz", error="frequency_error")
    shift_hz: float = column("frequency shift due to the finger", "Hz", error="shift_error_hz")
    quality_factor: float | None = column("quality factor under the finger; None if it has none", error="quality_error")
    added_loss: float = column("increase of 1/Q due to the finger", error="added_loss_error")
    share: float = column("share of the free mode in it, 0 to 1", error="share_error")
    free_error: float | None = column(BAR.format("free_hz, relative"), default=None)
    frequency_error: float | None = column(BAR.format("frequency_hz, relative"), default=None)
    shift_error_hz: float | None = column(BAR.format("shift_hz"), "Hz", default=None)
    quality_error: float | None = column(BAR.format("quality_factor"), default=None)
    added_loss_error: float | None = column(BAR.format("added_loss"), default=None)
    share_error: float | None = column(BAR.format("share"), default=None)


class TouchStateRecord(Part):
    """State of the driven plate, with or without the finger: amplitudes are peaks, powers are means over a period."""

    state: str = column("free, touched, retuned, held or shaped")
    frequency_hz: float = column("excitation frequency", "Hz", error="frequency_error")
    drive_V: float = column("drive voltage", "V", error="drive_error_V")
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
        "friction relative to that at rest, for the smallest gap; None outside the range of the relation",
        error="friction_low_error",
    )
    friction_high: float | None = column(
        "friction relative to that at rest, for the largest gap; None outside the range of the relation",
        error="friction_high_error",
    )
    patches_W: float = column("mechanical power of the patches", "W", error="patches_error_W")
    plate_W: float = column("power dissipated in the plate", "W", error="plate_error_W")
    finger_W: float = column("power dissipated in the finger", "W", error="finger_error_W")
    dielectric_W: float | None = column("dielectric loss of the patches; None without a loss tangent", "W")
    drawn_W: float | None = column("sum of patches_W and dielectric_W", "W", error="drawn_error_W")
    apparent_VA: float = column("apparent power of an amplifier without energy recovery", "VA")
    drawn_mW_at_1um: float | None = column(
        "drawn_W at an amplitude of 1 um under the finger", "mW", error="drawn_error_mW_at_1um"
    )
    drive_V_at_1um: float | None = column(
        "drive voltage for an amplitude of 1 um under the finger", "V", error="drive_error_V_at_1um"
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
    """Drive that keeps the first sensor's amplitude at its value without the finger, and the amplifier's limit."""

    sensor_V: float = column("voltage of the first sensor without the finger", "V", error="sensor_error_V")
    needed_V: float = column("drive voltage that keeps sensor_V under the finger", "V", error="needed_error_V")
    limit_V: float | None = column("limit of the amplifier; None if the case gives none", "V")
    saturates: bool | None = column("whether needed_V exceeds limit_V")
    sensor_error_V: float | None = column(BAR.format("sensor_V"), "V", default=None)
    needed_error_V: float | None = column(BAR.format("needed_V"), "V", default=None)


class TouchMapRecord(Part):
    """Finger at every place of a grid, x first, at constant voltage; error bars are those of a peak that follows its mode."""

    frequency_hz: float = column("excitation frequency", "Hz", error="frequency_error")
    x_m: list[float] = column("places along x", "m", along="x_m")
    y_m: list[float] = column("places along y", "m", along="y_m")
    displacement_m: list[list[float]] = column(
        "u_z of the free plate in phase with its largest value; its zeros are the nodes", "m", along=MAP
    )
    free_m: list[list[float]] = column("amplitude without a finger", "m", along=MAP, error="free_error_m")
    touched_m: list[list[float]] = column("amplitude under the finger", "m", along=MAP, error="touched_error_m")
    friction: list[list[float | None]] | None = column(
        "friction relative to that at rest, for the gaps' geometric mean; None outside the range of the relation", along=MAP,
        error="friction_error",
    )  # fmt: skip
    needed_V: list[list[float]] | None = column(
        "drive voltage that keeps the first sensor's voltage; None without one", "V", along=MAP, error="needed_error_V"
    )
    frequency_error: float | None = column(BAR.format("frequency_hz, relative"), default=None)
    free_error_m: list[list[float]] | None = column(BAR.format("free_m"), "m", along=MAP, default=None)
    touched_error_m: list[list[float]] | None = column(
        "error bar of touched_m, including the contact integrals and the flexibility under the finger", "m", along=MAP,
        default=None,
    )  # fmt: skip
    friction_error: list[list[float | None]] | None = column(
        "error bar of friction from that of touched_m; None outside the range of the relation", along=MAP,
        default=None,
    )  # fmt: skip
    needed_error_V: list[list[float]] | None = column(BAR.format("needed_V"), "V", along=MAP, default=None)


class PatternMode(Part):
    """Mode that contributes to a travelling wave."""

    nodal_lines: int = column("number of nodal lines of its shape along x")
    frequency_hz: float = column("frequency", "Hz", error="frequency_error")
    share: float = column("share of its mass that moves in this shape, 0 to 1", error="share_error")
    frequency_error: float | None = column(BAR.format("frequency_hz, relative"), default=None)
    share_error: float | None = column(BAR.format("share"), default=None)


class PlayedPattern(Part):
    """Pattern driven by the emulated board."""

    name: str = column("name of the pattern")
    twr: float = column("travelling-wave ratio in the window")
    twr_target: float = column("travelling-wave ratio of the table's voltages")
    error: float = column("|V - V_table|/|V_table|")


class PlayFault(Part):
    """Fault that kept the emulated board from playing."""

    fault: str = column("fault that ended the firmware image")


class ShearRecord(Part):
    """Finger at rest on a travelling wave of 1 um rms in the free zone, over its places, row by row along x."""

    fingertip: str = column("name of the finger in the table, or the case's own")
    radius_m: float = column("contact radius", "m")
    force_N: float | None = column("normal force of the finger; None if it is not given", "N")
    x_m: list[float] = column("places along x", "m", along="x_m")
    y_m: list[float] = column("places along y", "m", along="y_m")
    touched_m: list[list[float]] = column("amplitude of the face under the finger", "m", along=("x_m", "y_m"))
    crest_m_s: list[list[float]] = column("speed of the face along x at the crests", "m/s", along=("x_m", "y_m"))
    shear_low: list[list[float | None]] | None = column(
        "lower bound of the net shear over the friction at rest, positive towards +x; None if the relations do not hold",
        along=("x_m", "y_m"),
    )
    shear_high: list[list[float | None]] | None = column("upper bound of the same ratio", along=("x_m", "y_m"))
    unknown: list[str] = column("reasons why the shear is unknown, one sentence each")
    fastest_error_m_s: float | None = column(BAR.format("the largest of crest_m_s, at its place"), "m/s", default=None)
    shear_low_error: float | None = column(BAR.format("the largest of shear_low, at its place"), default=None)
    shear_high_error: float | None = column(BAR.format("the largest of shear_high, at its place"), default=None)

    @property
    def fastest_m_s(self) -> float:
        """Largest crest speed, signed."""
        return max((speed for row in self.crest_m_s for speed in row), key=abs, default=0.0)


def worst_of(zones: list[DrivenZone]) -> tuple[float | None, float | None]:
    """Return the largest level of a zone while another is driven, dB, and its error bar; None with a single zone."""
    others = [
        (level, zone.level_error_db[j] if zone.level_error_db else None)
        for i, zone in enumerate(zones)
        for j, level in enumerate(zone.level_db)
        if i != j
    ]
    return max(others, default=(None, None), key=lambda pair: pair[0] or 0.0)


def statistics(nominal: SampleRecord, samples: Sequence[SampleRecord]) -> dict[str, Any]:
    """Return statistics of the samples by the names of the result; samples without the target mode are counted as lost."""
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
    """Return a quantity of the samples for which it is known."""
    return [value for one in samples if (value := getattr(one, name)) is not None]


def spread_of(values: Sequence[float]) -> SpreadRecord | None:
    """Return the spread of a quantity; None without samples."""
    import numpy as np

    from solvers.variation.samples import spread

    return SpreadRecord.of(spread(np.array(values))) if values else None
