"""Parts of answers about waves across the rows: what passes them, at each frequency."""

from __future__ import annotations

from math import log10, nan

from pipeline.records.part import Part, column

UNKNOWN = "None without an estimate"


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
