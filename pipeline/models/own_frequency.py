"""Frequencies of bodies whose moduli depend on the frequency, each with the moduli at its own.

Solved with the moduli at one frequency, an eigenvalue changes with the moduli at another by a factor between the smallest
and the largest change of a material, because K is the sum of the materials' parts: by min-max, wave by wave in their order.
f = g sqrt(r(f)) at both ends encloses the wave at its own frequency; where all materials change alike the two are one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Design
from geometry.materials import Material
from pipeline.case.limits import beyond_spectrum
from pipeline.case.model import Case
from pipeline.quantity import KHZ

STEPS = 60  # of f = g sqrt(r(f)): a modulus that rises with f itself still halves the rest at each
SETTLED = 1e-6  # relative change of the moduli that needs no further solution
SLIGHT = 1e-6  # relative step of a derivative


@dataclass(frozen=True)
class OwnFrequency:
    """What the materials of a body, taken at one frequency, change of frequencies that were solved with them."""

    materials: tuple[Material, ...]

    def ends(self, solved_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and the highest frequency that each wave may have with the moduli at its own, Hz."""
        return self._own(solved_hz, min), self._own(solved_hz, max)

    def centred(self, solved_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the middle of `ends`, Hz, and half their distance, relative to it; 0 Hz stays."""
        low, high = self.ends(np.asarray(solved_hz, dtype=float))
        middle = (low + high) / 2.0
        return middle, np.divide(high - low, 2.0 * middle, out=np.zeros_like(middle), where=middle > 0.0)

    def slope(self, solved_hz: FloatArray) -> FloatArray:
        """Return d centred / d solved."""
        further, here = (self.centred(factor * solved_hz)[0] for factor in (1.0 + SLIGHT, 1.0))
        step = SLIGHT * np.asarray(solved_hz)
        return np.divide(further - here, step, out=np.ones_like(step), where=step > 0.0)

    def stiffer(self, frequency_hz: float) -> float:
        """Return the largest relative change of a modulus to that at a frequency."""
        return max((abs(each.stiffening(frequency_hz) - 1.0) for each in self.materials), default=0.0)

    def lossier(self, frequency_hz: float) -> float:
        """Return the largest relative change of a loss factor to that at a frequency; inf from none to some."""
        changes = [0.0]
        for each in self.materials:
            before, after = each.loss_factor or 0.0, each.at_hz(frequency_hz).loss_factor or 0.0
            changes.append(abs(after / before - 1.0) if before else float("inf") if after else 0.0)
        return max(changes)

    def beyond(self, frequency_hz: FloatArray) -> list[str]:
        """Return a line for each material whose spectrum does not hold at the lowest or the highest frequency above 0."""
        moving = frequency_hz[frequency_hz > 0.0]
        ends = [float(moving.min()), float(moving.max())] if len(moving) else []
        return [line for each in self.materials for tone in ends for line in beyond_spectrum(each, tone)]

    def _own(self, solved_hz: FloatArray, pick: Callable[[list[float]], float]) -> FloatArray:
        found = solved_hz.copy()
        moving = solved_hz > 0.0
        for _ in range(STEPS):
            factors = [pick([each.stiffening(tone) for each in self.materials]) for tone in found[moving].tolist()]
            before, found[moving] = found[moving], solved_hz[moving] * np.sqrt(np.array(factors))
            if np.allclose(found[moving], before, rtol=1e-14, atol=0.0):
                break
        return found


def is_open(case: Case, part: str) -> bool:
    """Whether moduli of a part depend on the frequency, and the case does not fix at which they are taken."""
    return case.solve.moduli_kHz is None and any(material.spectrum for material in materials_of(case.design, part))


def materials_of(design: Design, part: str) -> Sequence[Material]:
    """Return the materials of a part of the design: plate, zone, pillar or cell, each once."""
    if part == "zone":
        return tuple(dict.fromkeys(layer.material for layer in design.stack.layers))
    if part == "pillar":
        return tuple(dict.fromkeys(section.material for section in design.pillar.sections)) if design.pillar else ()
    return design.materials


def of_part(case: Case, part: str) -> OwnFrequency:
    """Return the materials of a part at the frequency at which the case takes them."""
    return OwnFrequency(tuple(materials_of(case.design, part)))


def at_middle(case: Case, band_hz: tuple[float, float]) -> Case:
    """Return the case with open moduli at the middle of a band, Hz."""
    return taken_at(case, sqrt(band_hz[0] * band_hz[1])) if is_open(case, "plate") and band_hz[0] > 0.0 else case


def taken_at(case: Case, frequency_hz: float) -> Case:
    """Return the case with the moduli at a frequency, Hz."""
    return case.but({"solve.moduli_kHz": frequency_hz / KHZ})
