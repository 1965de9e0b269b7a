"""What a design must keep whatever it is searched for: heard by nobody, felt by a fingertip, printable, the target shape."""

from __future__ import annotations

from math import atan2, degrees
from typing import TYPE_CHECKING

from pipeline.quantity import figure, frequency, level
from pipeline.records.part import Part, column
from pipeline.units import KHZ, MM

if TYPE_CHECKING:
    from geometry.layout import Design, Pillar


class Limits(Part):
    """What a design must keep: limits on the target mode, on what is printed, and on a driven zone's level over the others."""

    lowest_hz: float = column("least frequency of the target mode", "Hz", default=25 * KHZ)
    half_wavelength_m: float = column("largest half-wavelength along the zone", "m", default=20 * MM)
    feature_m: float = column("smallest feature", "m", default=0.4 * MM)
    mac: float = column("least modal assurance to the target shape", default=0.8)
    isolation_db: float | None = column(
        "least level of a driven zone over every other; None for no limit", "dB", default=None
    )

    def of_design(self, design: Design) -> list[tuple[str, float]]:
        """Limits that the geometry alone violates: in words, and by how much (relative)."""
        from geometry.cad.printing import SUPPORT_DEG, features

        violations = []
        half = design.half_wavelength_m or design.length_m  # rigid shapes: the whole length
        if not half <= self.half_wavelength_m:
            text = f"half-wavelength {figure(half / MM)} mm, at most {self.half_wavelength_m / MM:g}"
            violations.append((text, half / self.half_wavelength_m - 1.0))
        name, size = min(features(design).items(), key=lambda item: item[1])
        if size < self.feature_m * (1.0 - 1e-9):
            violations.append(
                (f"{name} {size / MM:g} mm, at least {self.feature_m / MM:g}", 1.0 - size / self.feature_m)
            )
        lean = max((overhang_deg(pillar) for pillar in design.kinds), default=0.0)
        first = design.pillar
        if first and design.rows and first.faces == 2 and first.material == design.stack.back:
            violations.append(
                ("pillars on both faces cannot be printed with the plate: its underside is a ceiling", 1.0)
            )
        if lean > SUPPORT_DEG:
            violations.append(
                (f"pillars lean out by {figure(lean)} degrees, at most {SUPPORT_DEG:g}", lean / SUPPORT_DEG - 1.0)
            )
        return violations

    def of_mode(self, frequency_hz: float, mac: float, slack: float = 0.0) -> list[tuple[str, float]]:
        """Limits that the target mode violates by more than `slack` (relative: what a cheap fidelity may err by)."""
        violations = []
        if frequency_hz < self.lowest_hz * (1.0 - slack):
            text = f"{frequency(frequency_hz)}, at least {self.lowest_hz / KHZ:g}"
            violations.append((text, 1.0 - frequency_hz / self.lowest_hz))
        if mac < self.mac * (1.0 - slack):
            violations.append((f"MAC {figure(mac)} to the target shape, at least {self.mac:g}", 1.0 - mac / self.mac))
        return violations

    def of_zones(self, isolation_db: float | None, slack: float = 0.0) -> list[tuple[str, float]]:
        """The limit on a driven zone's level over the others, in the same way."""
        least = self.isolation_db
        if least is None or isolation_db is None or isolation_db >= least * (1.0 - slack):
            return []
        return [(f"zones {level(isolation_db)} apart, at least {least:g}", 1.0 - isolation_db / least)]


def overhang_deg(pillar: Pillar) -> float:
    """How far the pillar's sides lean outwards, degrees from the vertical; 0 for those that do not, and for a STEP file.

    A heavy tip of the pillar's own material is printed with it: one that is wider has a level underside.
    """
    tip = pillar.tip
    if tip and tip.material == pillar.material and tip.side_m > pillar.tip_m:
        return 90.0
    return max(0.0, degrees(atan2((pillar.tip_m - pillar.base_m) / 2.0, pillar.height_m)))


def mass_kg(design: Design) -> float:
    """Plate and pillars, fillets left out, kg."""
    plate = design.length_m * 2.0 * design.half_span_m * design.stack.mass_kg_m2
    return plate + sum(len(each.centres) * each.pillar.faces * each.pillar.mass_kg for each in design.standing())
