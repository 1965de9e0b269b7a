"""Several zones of one plate: the motion of every zone while one of them is driven.

Integrals of u_z^2 over one zone couple symmetry classes: in the quarter's points the motion at an image is the sum of the
classes, each with the signs of its mirrors, and a zone takes from every image what of it lies in the zone.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from geometry.elements import BoolArray, ComplexArray, FloatArray
from geometry.layout import Design
from solvers.measures.confinement import wanted_shape
from solvers.piezo.circuit import resonances_hz
from solvers.piezo.forced import ForcedPlate
from solvers.superelement.plate import WHOLE

FINE = 6  # points over a half-power width


@dataclass(frozen=True)
class Zones:
    """A driven plate's zones: rms of u_z over each and over the passive face, from Gram matrices over all columns, per m2.

    grams (zones + 1, columns, columns): the last is the passive face's; its area may be 0, and its mean then NaN. shapes
    (zones, columns): rms of what of each column moves as the wanted shape of a zone.
    """

    forced: ForcedPlate
    grams: FloatArray
    shapes: FloatArray

    def rms(self, volts: FloatArray, frequency_hz: FloatArray) -> FloatArray:
        """rms of |u_z|, (n, zones + 1), m per volt, of patches fed with volts (patches,)."""
        moved = self._amplitudes(volts, frequency_hz)
        return np.array(
            [np.sqrt(np.maximum(np.einsum("i,zij,j->z", a.conj(), self.grams, a).real, 0.0)) for a in moved]
        )

    def mac(self, volts: FloatArray, frequency_hz: float, zone: int) -> float:
        """Modal assurance criterion of a zone's motion with its wanted shape."""
        (a,) = self._amplitudes(volts, np.array([frequency_hz]))
        return float(abs(self.shapes[zone] @ a) ** 2 / (a.conj() @ self.grams[zone] @ a).real)

    def _amplitudes(self, volts: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
        """Coefficients of all columns, (n, columns)."""
        plate = self.forced.driven_by(np.asarray(volts, dtype=complex))
        out = []
        for frequency in frequency_hz:
            eigenvalue = plate.plate.scale.eigenvalue(float(frequency))
            fed = plate.volts(eigenvalue)
            out.append(np.concatenate([basis.amplitudes(eigenvalue, plate.loss, fed) for basis in plate.modes]))
        return np.array(out)

    def peak_hz(self, volts: FloatArray, zone: int) -> float:
        """Where the zone moves most within the band, Hz: at the resonances, then finer about the largest."""
        low, high = self.forced.band_hz
        tones = np.concatenate([resonances_hz(self.forced), [low, high]])
        for _ in range(2):
            top = float(tones[int(np.argmax(self.rms(volts, tones)[:, zone]))])
            reach = top * self.forced.loss
            tones = np.clip(np.linspace(top - reach, top + reach, 4 * FINE + 1), low, high)
        return float(tones[int(np.argmax(self.rms(volts, tones)[:, zone]))])


def zones_of(forced: ForcedPlate) -> Zones:
    """The zones of a patched plate's design."""
    design, fields = forced.design, [basis.group.touch(basis.columns) for basis in forced.modes]
    first = fields[0][0]
    whole = forced.modes[0].group.symmetries == (WHOLE,)
    flips = [(1.0, 1.0)] if whole else list(product((1.0, -1.0), repeat=2))
    count = sum(basis.columns.shape[1] for basis in forced.modes)
    grams, areas = np.zeros((design.zones + 1, count, count)), np.zeros(design.zones + 1)
    shapes, norms = np.zeros((design.zones, count)), np.zeros(design.zones)
    for flip in flips:
        values = np.hstack(
            [_added(basis.group.symmetries, own, flip) for basis, own in zip(forced.modes, fields, strict=True)]
        )
        weights = first.weights / len(flips)
        points = first.points * flip
        for place, part in enumerate(_parts(design, points[:, 1])):
            grams[place] += values[part].T @ (weights[part, None] * values[part])
            areas[place] += weights[part].sum()
            if place < design.zones:
                shape = wanted_shape(design, points[part] - [0.0, design.zone_centres_m[place]])
                shapes[place] += (weights[part] * shape) @ values[part]
                norms[place] += weights[part] @ shape**2
    known = areas > 1e-9 * areas.max()
    with np.errstate(divide="ignore", invalid="ignore"):
        means = np.where(known[:, None, None], grams / areas[:, None, None], np.nan)
    return Zones(forced, means, shapes / np.sqrt(norms * areas[:-1])[:, None])


def _added(symmetries: tuple[str, ...], fields: list, flip: tuple[float, ...]) -> FloatArray:
    """u_z of a group's columns at the images of its points, (points, columns)."""
    signs = [
        np.prod([-1.0 if mark == "A" and side < 0.0 else 1.0 for mark, side in zip(symmetry, flip, strict=False)])
        for symmetry in symmetries
    ]
    return np.sum([sign * field.values for sign, field in zip(signs, fields, strict=True)], axis=0)


def _parts(design: Design, y: FloatArray) -> list[BoolArray]:
    """Which places lie in each zone, and which in none."""
    inside = [np.abs(y - middle) < design.width_m / 2.0 for middle in design.zone_centres_m]
    return [*inside, ~np.logical_or.reduce(inside)]


def zone_volts(forced: ForcedPlate, centres_m: FloatArray) -> FloatArray:
    """Voltages (zones, patches) that drive one zone each: its own drivers at +-1 V, as the wanted shape has them in phase."""
    design = forced.design
    volts = np.zeros((design.zones, len(centres_m)))
    for zone, middle in enumerate(design.zone_centres_m):
        local = centres_m - np.array([0.0, middle])
        own = [i for i in forced.drivers if abs(local[i, 1]) < design.width_m / 2.0]
        volts[zone, own] = np.where(wanted_shape(design, local[own]) < 0.0, -1.0, 1.0)
    return volts
