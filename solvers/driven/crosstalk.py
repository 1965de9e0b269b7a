"""Several zones of one plate: the motion of every zone while one of them is driven.

Integrals of u_z^2 over one zone couple symmetry classes: in the quarter's points the motion at an image is the sum of the
classes, each with the signs of its mirrors, and a zone takes from every image what of it lies in the zone.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.driven.curve_bars import Doubts, rms, rms_bars, with_peak
from solvers.measures.confinement import wanted_shape
from solvers.measures.driven_zones import peak_hz, zone_parts
from solvers.measures.levels import ratio_db
from solvers.piezo.circuit import resonances_hz
from solvers.piezo.forced import ForcedPlate
from solvers.superelement.plate import WHOLE


@dataclass(frozen=True)
class Zones:
    """A driven plate's zones: rms of u_z over each and over the passive face, from Gram matrices over all columns, per m2.

    grams (zones + 1, columns, columns): the last is the passive face's; its area may be 0, and its mean then NaN. shapes
    (zones, columns): means of u_z times the wanted shape of root mean square 1.
    """

    forced: ForcedPlate
    grams: FloatArray
    shapes: FloatArray

    def rms(self, volts: FloatArray, frequency_hz: FloatArray) -> FloatArray:
        """rms of |u_z|, (n, zones + 1), m per volt, of patches fed with volts (patches,)."""
        a = self._amplitudes(volts, frequency_hz)
        return np.sqrt(np.maximum(np.einsum("it,zit->tz", a.conj(), self.grams @ a).real, 0.0))

    def mac(self, volts: FloatArray, frequency_hz: float, zone: int) -> float:
        """MAC of a zone's motion with the wanted shape."""
        a = self._amplitudes(volts, np.array([frequency_hz]))[:, 0]
        return float(abs(self.shapes[zone] @ a) ** 2 / (a.conj() @ self.grams[zone] @ a).real)

    def _amplitudes(self, volts: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
        """Coefficients of the columns at every frequency, (columns, n)."""
        plate = self.forced.driven_by(np.asarray(volts, dtype=complex))
        at = plate.plate.scale.eigenvalue(frequency_hz)
        fed = plate.volts_over(at)
        return np.concatenate([basis.amplitudes(at, plate.loss, fed) for basis in plate.modes], axis=1).T

    @property
    def has_passive(self) -> bool:
        """Whether something of the touch face lies in no zone."""
        return not bool(np.isnan(self.grams[-1]).any())

    def peak_hz(self, volts: FloatArray, zone: int) -> float:
        """Where the zone moves most within the band, Hz."""
        forced = self.forced
        return peak_hz(
            lambda tones: self.rms(volts, tones)[:, zone], resonances_hz(forced), forced.band_hz, forced.loss
        )


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
        wanted = wanted_shape(design, np.column_stack([points[:, 0], design.from_zone_m(points[:, 1])]))
        for place, part in enumerate(zone_parts(design, points[:, 1])):
            grams[place] += values[part].T @ (weights[part, None] * values[part])
            areas[place] += weights[part].sum()
            if place < design.zones:
                shapes[place] += (weights[part] * wanted[part]) @ values[part]
                norms[place] += weights[part] @ wanted[part] ** 2
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


def zone_volts(forced: ForcedPlate, centres_m: FloatArray) -> FloatArray:
    """Voltages (zones, patches) that drive one zone each: its own drivers at +-1 V, as the wanted shape has them in phase."""
    design = forced.design
    volts = np.zeros((design.zones, len(centres_m)))
    for zone, middle in enumerate(design.zone_centres_m):
        local = centres_m - np.array([0.0, middle])
        own = [i for i in forced.drivers if abs(local[i, 1]) < design.width_m / 2.0]
        volts[zone, own] = np.where(wanted_shape(design, local[own]) < 0.0, -1.0, 1.0)
    return volts


def curve_half_widths(zones: Zones, volts: FloatArray, frequency_hz: FloatArray, known: Doubts | None) -> FloatArray:
    """Half-widths of the error bars of every zone's rms while each is driven.

    Parameters
    ----------
    zones : Zones
        The zones of a driven plate.
    volts : ndarray, shape (driven, patches)
        Voltages that drive one zone each.
    frequency_hz : ndarray, shape (n,)
        Frequencies in Hz.
    known : Doubts or None
        What the plate's resonances and loads may be off by.

    Returns
    -------
    ndarray, shape (driven, zones, n)
        In m/V; NaN without an estimate.
    """
    forced, count = zones.forced, zones.forced.design.zones
    if known is None:
        return np.full((len(volts), count, len(frequency_hz)), np.nan)

    return rms_bars(known, forced, zones.grams[:count], frequency_hz, volts[:, forced.drivers].astype(complex))


def peak_half_widths(zones: Zones, fed: FloatArray, zone: int, peak_hz: float, known: Doubts | None) -> dict[str, Any]:
    """Half-widths of the error bars of what one driven zone shows at its peak, by the names of its figures.

    `rms_error_m_per_V` and `level_error_db` (zones,), `passive_error_db` and `mac_error`; NaN without an estimate.
    """
    forced, count = zones.forced, zones.forced.design.zones
    parts = count + zones.has_passive
    grams = np.concatenate([zones.grams[:parts], [np.outer(zones.shapes[zone], zones.shapes[zone])]])

    def figures(squares: ComplexArray) -> FloatArray:
        each = rms(squares)
        return np.concatenate([each[:-1], ratio_db(each[:-1], each[zone]), each[-1:] ** 2 / each[zone] ** 2])

    half = np.full(2 * parts + 1, np.nan)
    if known is not None:
        half = with_peak(known, forced, grams, peak_hz, fed[forced.drivers].astype(complex), figures)
    return {
        "rms_error_m_per_V": half[:count],
        "level_error_db": half[parts : parts + count],
        "passive_error_db": float(half[parts + count]) if zones.has_passive else None,
        "mac_error": float(half[-1]),
    }
