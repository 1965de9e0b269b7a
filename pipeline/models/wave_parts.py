"""Parts of answers about waves and driven zones: what passes the rows at each frequency, what one zone moves of the others."""

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
    """At a frequency: confinement of the motion that a pressure of the wanted shape forces, and what passes the rows."""

    confinement_db: float | None = column("confinement of the driven zone", "dB", error="confinement_error_db")
    confinement_error_db: float | None = column("half-width of the level's error bar; " + UNKNOWN, "dB", default=None)


class DrivenZone(Part):
    """One zone driven at its own peak while the others' patches are held at 0 V; lists have an entry a measured zone."""

    centre_m: float = column("y of the driven zone's centre line", "m")
    drivers: list[int] = column("numbers of the driven patches, from 0")
    peak_hz: float = column("frequency at which the driven zone moves most", "Hz", error="peak_error")
    peak_error: float | None = column(
        "half-width of the error bar of peak_hz, relative; None without an estimate", default=None
    )
    rms_m_per_V: list[float] = column("rms of u_z", "m/V", along="measured", error="rms_error_m_per_V")
    rms_error_m_per_V: list[float | None] | None = column(
        "half-width of the error bar of rms_m_per_V; None without an estimate", "m/V", along="measured", default=None
    )
    level_db: list[float] = column("rms over the driven zone's", "dB", along="measured", error="level_error_db")
    level_error_db: list[float | None] | None = column(
        "half-width of the error bar of level_db; None without an estimate", "dB", along="measured", default=None
    )
    passive_db: float | None = column(
        "rms of the passive face over the driven zone's; None without a passive face", "dB", error="passive_error_db"
    )
    passive_error_db: float | None = column(
        "half-width of the error bar of passive_db; None without an estimate", "dB", default=None
    )
    mac: float | None = column(
        "modal assurance criterion of the driven zone with the target shape", error="mac_error", default=None
    )
    mac_error: float | None = column("half-width of the error bar of mac; None without an estimate", default=None)
    over_rms_m_per_V: list[list[float]] = column(
        "rms of u_z over frequency", "m/V", along=("measured", "frequency_hz"), error="over_rms_error_m_per_V"
    )
    over_rms_error_m_per_V: list[list[float | None]] | None = column(
        "half-width of the error bar of over_rms_m_per_V; None without an estimate", "m/V",
        along=("measured", "frequency_hz"), default=None,
    )  # fmt: skip


def worst_level(zones: list[DrivenZone]) -> tuple[float | None, float | None]:
    """Return the largest level of a zone while another is driven and the half-width of its bar, dB; None with one zone."""
    others = [
        (level, zone.level_error_db[j] if zone.level_error_db else None)
        for i, zone in enumerate(zones)
        for j, level in enumerate(zone.level_db)
        if i != j
    ]
    return max(others, default=(None, None), key=lambda pair: pair[0] or 0.0)
