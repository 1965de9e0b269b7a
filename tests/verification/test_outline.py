"""Plates of STEP files, solved whole: a ring against an independent method, a rectangle against reduced cells, images."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.linalg import eigh

from geometry.elements import FloatArray
from geometry.materials import MATERIALS, Material
from pipeline.case.model import case_from_dict
from pipeline.exchange import exports
from pipeline.logs import TerminalLog
from pipeline.models.modes import PartModes, Request, solve_modes
from tests.helpers.plate_files import disc, drilled, panel, raw_case, written

RIGID_HZ = 100.0  # rounding puts the rigid motions of a ring below it
RING = (4e-3, 12e-3, 1.2e-3)  # inner and outer radius, height, m


def solved(raw: dict[str, Any], folder: Path, **query: Any) -> PartModes:
    request = Request("plate", search=False, **query)
    return solve_modes(case_from_dict(raw, folder / "case.toml"), request, TerminalLog(True))


# -- a ring --------------------------------------------------------------------------------------------------------------
# Three-dimensional elasticity of a free ring by Ritz's method: for n waves around it, u_r = U cos(n t), u_t = V sin(n t),
# u_z = W cos(n t), each a product of Legendre polynomials in r and z. The free edges at right angles are not singular, so
# that the frequencies converge exponentially with the degrees, from above.


def ring_hz(
    inner: float, outer: float, height: float, waves: int, material: Material, along: int = 14, through: int = 6
) -> FloatArray:
    """Frequencies of a free ring with a number of waves around it, ascending, rigid motions left out, Hz."""
    x, weight = legendre.leggauss(2 * along)
    z, weight_z = legendre.leggauss(2 * through)
    r, half_r, half_z = inner + (outer - inner) * (x + 1.0) / 2.0, (outer - inner) / 2.0, height / 2.0
    radial, slope = legendre.legvander(x, along), np.array(
        [legendre.legval(x, legendre.legder(each)) for each in np.eye(along + 1)]
    ).T / half_r  # fmt: skip
    upward, rise = legendre.legvander(z, through), np.array(
        [legendre.legval(z, legendre.legder(each)) for each in np.eye(through + 1)]
    ).T / half_z  # fmt: skip

    def field(first: FloatArray, second: FloatArray) -> FloatArray:
        return np.einsum("ia,jb->ijab", first, second).reshape(len(r) * len(z), -1)

    own, in_r, in_z = field(radial, upward), field(slope, upward), field(radial, rise)
    over_r, none = own / np.repeat(r, len(z))[:, None], np.zeros_like(own)
    strains = [
        np.hstack([in_r, none, none]),
        np.hstack([over_r, waves * over_r, none]),
        np.hstack([none, none, in_z]),
        np.hstack([none, in_z, -waves * over_r]),
        np.hstack([in_z, none, in_r]),
        np.hstack([-waves * over_r, in_r - over_r, none]),
    ]
    measure = (np.outer(weight * r, weight_z) * half_r * half_z).ravel()
    elastic = np.array(material.stiffness_pa)
    stiff = sum(
        elastic[i, j] * (strains[i].T * measure) @ strains[j] for i in range(6) for j in range(6) if elastic[i, j]
    )
    one = (own.T * measure) @ own * material.density_kg_m3
    mass = np.kron(np.eye(3), one)
    tones = np.sqrt(np.maximum(eigh(np.asarray(stiff), mass, eigvals_only=True), 0.0)) / (2.0 * np.pi)
    return np.asarray(tones[tones > RIGID_HZ])


def ring_below(high_hz: float) -> FloatArray:
    """All frequencies of the ring below a limit, ascending; a motion with waves around it counts twice, turned by a quarter."""
    found: list[float] = []
    for waves in range(12):
        tones = ring_hz(*RING, waves, MATERIALS["aluminium"])
        found += [*tones[tones < high_hz]] * (2 if waves else 1)
    return np.sort(found)


def test_the_ring_tends_to_kirchhoffs() -> None:
    """A ring 0.5 % of its radius thick, of Poisson's ratio 1/3 and inner radius 1/3 of the outer, against the theory of thin
    plates to the theory's own error, (h/R)^2 times a few for the lowest bending mode: lambda^2 = w R^2 sqrt(rho h/D).
    """
    aluminium, outer = MATERIALS["aluminium"], 12e-3
    height, poisson = 5e-3 * outer, aluminium.average.poisson
    bending = aluminium.average.young_pa * height**3 / 12.0 / (1.0 - poisson**2)
    lowest = ring_hz(outer / 3.0, outer, height, 2, aluminium, 14, 3)[0]
    squared = 2.0 * np.pi * lowest * outer**2 * np.sqrt(aluminium.density_kg_m3 * height / bending)
    assert squared == pytest.approx(kirchhoff_ring(1.0 / 3.0, 2, poisson), rel=1e-3)


def kirchhoff_ring(ratio: float, waves: int, poisson: float) -> float:
    """lambda^2 of the lowest bending mode of a free thin ring of outer radius 1, from its determinant of Bessel functions."""
    from scipy.optimize import brentq
    from scipy.special import ivp, jvp, kvp, yvp

    def determinant(k: float) -> float:
        rows = []
        for r in (1.0, ratio):
            moments, shears = [], []
            for function, sign in ((jvp, -1.0), (yvp, -1.0), (ivp, 1.0), (kvp, 1.0)):
                w, slope = function(waves, k * r, 0), k * function(waves, k * r, 1)
                laplacian = sign * k**2 * w
                curved = slope / r - waves**2 * w / r**2
                moments.append(laplacian - (1.0 - poisson) * curved)
                shear = sign * k**2 * slope
                shears.append(shear - (1.0 - poisson) * waves**2 / r**2 * (slope - w / r))
            rows += [moments, shears]
        scaled = np.array(rows) / np.abs(rows).max(axis=0)
        return float(np.linalg.det(scaled / np.abs(scaled).max(axis=1)[:, None]))

    places = np.linspace(0.8, 4.0, 641)
    signs = np.sign([determinant(k) for k in places])
    first = int(np.flatnonzero(signs[1:] != signs[:-1])[0])
    root = brentq(determinant, places[first], places[first + 1], xtol=1e-12)
    return float(root**2)


@pytest.mark.slow
def test_a_ring_has_the_frequencies_of_ritzs_method(tmp_path: Path) -> None:
    """Curved rims and a hole: as many modes as Ritz's method finds, each inside its error bar, which is below 1 %."""
    written(disc(12.0, 4.0, 1.2), tmp_path)
    zone = {"length_mm": 4.0, "width_mm": 3.0, "nodal_lines": 0, "centre_mm": [0.0, 8.0]}
    raw = raw_case(zone=zone, array={"rows": 0})
    exact = ring_below(50e3)
    ours = solved(raw, tmp_path, band_hz=(1e3, 50e3))
    assert ours.count.expected == ours.count.found == len(exact) == len(ours.rows) > 8
    for row, tone in zip(ours.rows, exact, strict=True):
        assert row.error is not None and row.error < 0.01
        assert row.frequency_hz == pytest.approx(tone, rel=row.error)


@pytest.mark.slow
def test_a_band_holds_the_modes_between_its_ends_once_they_are_corrected(tmp_path: Path) -> None:
    """Of the ring on coarse elements, both ends between the frequency on the mesh and the corrected one."""
    written(disc(12.0, 4.0, 1.2), tmp_path)
    zone = {"length_mm": 4.0, "width_mm": 3.0, "nodal_lines": 0, "centre_mm": [0.0, 8.0]}
    raw = raw_case(zone=zone, array={"rows": 0}, solve={"accuracy": 0.05})
    every = solved(raw, tmp_path, band_hz=(1e3, 50e3)).rows
    low, high = ((row.frequency_hz + (row.computed_hz or 0.0)) / 2.0 for row in (every[1], every[4]))
    ours = solved(raw, tmp_path, band_hz=(low, high))
    inside = [row.frequency_hz for row in every if low < row.frequency_hz < high]
    assert every[4].frequency_hz in inside and every[1].frequency_hz not in inside and len(inside) < len(every)
    for row, tone in zip(ours.rows, inside, strict=True):  # on another mesh: the mesher's are never the same
        assert row.error is not None and row.frequency_hz == pytest.approx(tone, rel=row.error)
    assert len(inside) == ours.count.expected == ours.count.found and ours.count.high_hz == high


# -- a rectangle -----------------------------------------------------------------------------------------------------------

SMALL: dict[str, Any] = {
    "plate": {"thickness_mm": 1.5, "length_mm": 22.0, "width_mm": 18.0},
    "zone": {"length_mm": 8.0, "width_mm": 6.0, "nodal_lines": 1, "centre_mm": [1.5, -1.0]},
    "pillar": {"side_mm": 1.6, "height_mm": 5.0},
    "array": {"pitch_mm": 4.0, "rows": 1, "surround": True},
}


@pytest.mark.slow
@pytest.mark.parametrize("brass", [False, True])
def test_a_rectangle_read_back_has_the_modes_of_reduced_cells(tmp_path: Path, brass: bool) -> None:
    """The plate without its pillars exported and read again: frequencies and levels within the bars of both models."""
    sizes = raw_case(**SMALL)
    bare = case_from_dict({**sizes, "array": {"rows": 0}})
    exports.write(bare, "step", str(tmp_path / "plate.step"), TerminalLog(True))
    read = {**sizes, "plate": {"file": "plate.step"}}
    if brass:  # bonded, not united
        for raw in (sizes, read):
            raw["pillar"] = {**SMALL["pillar"], "material": "brass"}
    ours, theirs = (solved(raw, tmp_path, band_hz=(20e3, 45e3)).rows for raw in (read, sizes))
    kept = sum(
        row.frequency_hz < 42e3 for row in theirs
    )  # the window is that of the mesh, whose frequencies are higher
    assert 5 < kept <= len(ours)
    for one, other in zip(ours[:kept], theirs[:kept], strict=True):
        assert one.error is not None and other.error is not None and max(one.error, other.error) < 0.02
        assert one.frequency_hz == pytest.approx(other.frequency_hz, rel=one.error + other.error)
        bars = [each.confinement_error_db for each in (one, other)]
        assert None not in bars and one.confinement_db == pytest.approx(other.confinement_db, abs=sum(bars))


# -- images ----------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_turned_and_moved_plate_has_the_same_modes(tmp_path: Path) -> None:
    """A panel without mirrors turned by 180 degrees and moved, zone and rows with it: modes within the bars of both."""
    plate = drilled(panel(26.0, 18.0, 1.2, 3.0), 10.0, 5.0, 2.0)
    written(plate, tmp_path, "plate.step")
    turned = plate.rotate((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 180.0).translate((70.0, -40.0, 0.0))
    written(turned, tmp_path, "turned.step")
    raw = raw_case(zone={"length_mm": 8.0, "width_mm": 5.0, "nodal_lines": 1, "centre_mm": [-3.0, -1.0]})
    there = {**raw, "plate": {"file": "turned.step"}, "zone": {**raw["zone"], "centre_mm": [73.0, -39.0]}}
    one, other = (solved(each, tmp_path, near_hz=0.0, count=8).rows for each in (raw, there))
    assert len(one) == len(other) == 8
    for ours, theirs in zip(one, other, strict=True):
        assert ours.error is not None and theirs.error is not None
        assert ours.frequency_hz == pytest.approx(theirs.frequency_hz, rel=ours.error + theirs.error)
        assert ours.confinement_error_db is not None and theirs.confinement_error_db is not None
        bar = ours.confinement_error_db + theirs.confinement_error_db
        assert ours.confinement_db == pytest.approx(theirs.confinement_db, abs=bar)
