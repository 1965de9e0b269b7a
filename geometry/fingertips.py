"""Fingertips pressed on a vibrating plate, as mechanical impedances of their contact in SI, each value with its source."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

from geometry.errors import GeometryError


@dataclass(frozen=True)
class Fingertip:
    """Mechanical impedance of a contact to normal motion: Z = c + specific A + j (omega m - k/omega), force/velocity, N s/m.

    stiffness_n_m k, damping_n_s_m c and mass_kg m are the whole contact's, specific_n_s_m3 is a resistance per area.
    Raises GeometryError for a negative value.
    """

    name: str
    stiffness_n_m: float = 0.0
    damping_n_s_m: float = 0.0
    mass_kg: float = 0.0
    specific_n_s_m3: float = 0.0
    source: str = "given in the case file"

    def __post_init__(self) -> None:
        if min(self.stiffness_n_m, self.damping_n_s_m, self.mass_kg, self.specific_n_s_m3) < 0.0:
            raise GeometryError(f"fingertip {self.name}: stiffness, damping and mass must be 0 or more")

    @property
    def is_nothing(self) -> bool:
        """Whether it has no effect on a plate: no stiffness, no damping, no mass."""
        return not (self.stiffness_n_m or self.damping_n_s_m or self.mass_kg or self.specific_n_s_m3)

    def resistance_n_s_m(self, area_m2: float) -> float:
        """Real part of the impedance of a contact of this area, N s/m, which dissipates power."""
        return self.damping_n_s_m + self.specific_n_s_m3 * area_m2

    def impedance_n_s_m(self, frequency_hz: float, area_m2: float) -> complex:
        """Z of a contact of this area at a frequency above 0, time convention e^{+j omega t}."""
        omega = 2.0 * pi * frequency_hz
        return complex(self.resistance_n_s_m(area_m2), omega * self.mass_kg - self.stiffness_n_m / omega)


FINGERTIPS: dict[str, Fingertip] = {
    tip.name: tip
    for tip in (
        Fingertip(
            "finger",
            damping_n_s_m=55.0,
            source="monnoyer2017: about 55 N s/m for people who felt an ultrasonic switch clearly, others lay above and "
            "below; the phase is unknown in what could be read of it, all of it is taken as resistance",
        ),
        Fingertip(
            "light",
            stiffness_n_m=1.0e3,
            damping_n_s_m=1.0,
            mass_kg=1.0e-4,
            source="robomech2017, table 1: a finger pad's mass, stiffness and viscosity for lateral motion below 1 kHz; "
            "nothing shows that they hold at ultrasonic frequencies",
        ),
        Fingertip(
            "tissue",
            specific_n_s_m3=1131.24 * 1654.93,
            source="tissues2025: density 1131 +- 52 kg/m3 times speed of sound 1655 +- 33 m/s of skin: plane waves into a "
            "half-space that touches everywhere, more than which no resistance of a finger is expected",
        ),
    )
}
