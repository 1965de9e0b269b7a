"""What is measured of several zones, each driven in turn. Only declarations are imported here: help shows them."""

from __future__ import annotations

from pipeline.records.part import BAR, Part, column


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


def worst_of(zones: list[DrivenZone]) -> tuple[float | None, float | None]:
    """Return the largest level of a zone while another is driven, dB, and the half-width of its bar; None with one zone."""
    others = [
        (level, zone.level_error_db[j] if zone.level_error_db else None)
        for i, zone in enumerate(zones)
        for j, level in enumerate(zone.level_db)
        if i != j
    ]
    return max(others, default=(None, None), key=lambda pair: pair[0] or 0.0)
