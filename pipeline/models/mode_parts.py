"""Parts of an answer about modes: each mode, the count by inertia, and the target mode with its rivals."""

from __future__ import annotations

from typing import Any, Literal

from pipeline.records.part import BAR, Part, column, live

RELATIVE = "half-width of the frequency's error bar, relative; None without an estimate"
MAC = "modal assurance criterion with the target shape on the active touch face, 0 to 1"
STRENGTH = "share of the target shape that the mode carries, times its zone share, 0 to 1"
CONFINEMENT = "rms of u_z on the active touch face over that on the passive one; None without a passive one"
SHARE = "integral of u_z^2 over the active touch face over that over the whole touch face"


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
