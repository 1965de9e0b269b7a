"""Published free-vibration cases: the tapered membrane FV32 and the thick plate on line supports FV52 (nafems1990).

FV52's supports have no mesh-independent limit: a line in a solid has no capacity, so that every halving of the elements
beside it adds the same compliance. That drift is compared with its exact rate.
"""

from __future__ import annotations

from itertools import pairwise
from math import log, pi, sin

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.polynomial import legendre

from geometry.elements import gauss_lobatto, lagrange
from geometry.materials import Material
from geometry.mesh import Mesh
from solvers.fem.assembly import assemble
from solvers.fem.eigen import PlainPencil, modes_in_band
from solvers.fem.solid import Pencil
from tests.helpers import bodies

STEEL = Material.isotropic("steel", 200e9, 8000.0, 0.3)
ROUNDED = 5e-5  # half a unit in the fifth digit of 99 999, relative, at worst 5e-4 of 1.0; these begin with 1 to 4
FV32_HZ = np.array([44.623, 130.03, 162.70, 246.05, 379.90, 391.44])
FV52_HZ = np.array([44.762, 110.52, 110.52, 169.08, 193.93, 206.64, 206.64])
IN_PLANE = np.array([4, 5, 6])  # the modes of FV52 that hardly feel the supports


def membrane(cuts: tuple[int, int], order: int, graded: int = 0) -> Pencil:
    """FV32: 10 m long, 5 m high at the clamped root, 1 m at the tip, 0.05 m thick, in plane stress.

    One element through half the thickness, the middle plane a mirror and the face free: sigma_zz = 0 but for terms of
    (nu k t)^2 / 24 < 3e-6. `graded` lines quarter the elements at the root's corners.
    """
    x, y, z = bodies.even((10.0, 1.0, 0.025), (*cuts, 1))
    for _ in range(graded):
        x = np.insert(x, 1, x[1] / 4.0)
        y = np.sort(np.append(y, [y[1] / 4.0, 1.0 - y[1] / 4.0]))

    def taper(nodes: np.ndarray) -> np.ndarray:
        half = 2.5 - 0.2 * nodes[:, 0]
        return np.column_stack([nodes[:, 0], (2.0 * nodes[:, 1] - 1.0) * half, nodes[:, 2]])

    mesh = bodies.mapped(bodies.bricks((x, y, z), order), taper)
    return bodies.constrained(mesh, STEEL, [(bodies.at(mesh, 0, 0.0), [0, 1]), (bodies.at(mesh, 2, 0.0), [2])])


def membrane_hz(cuts: tuple[int, int], order: int, graded: int = 0) -> np.ndarray:
    """Every frequency between 10 and 420 Hz."""
    return modes_in_band(membrane(cuts, order, graded), 10.0, 420.0).frequency_hz


def check_membrane() -> None:
    """Six modes; the published ones lie between the converged and those of quadratic elements, 16 by 8.

    Conforming elements come down on the exact value, so the coarser mesh bounds the published error from above.
    """
    converged, quadratic = membrane_hz((8, 4), 3, 1), membrane_hz((16, 8), 2)
    assert len(converged) == len(quadratic) == 6
    assert (converged <= quadratic).all()
    assert (converged * (1.0 - ROUNDED) <= FV32_HZ).all()
    assert (quadratic * (1.0 + 2.0 * ROUNDED) >= FV32_HZ).all()
    assert np.abs(FV32_HZ / converged - 1.0).max() < 5e-4


def test_fv32_the_published_frequencies_lie_between_the_converged_and_the_quadratic_ones() -> None:
    check_membrane()


@pytest.mark.slow
def test_fv32_two_independent_sequences_of_meshes_meet() -> None:
    cubic, quartic = membrane_hz((12, 6), 3, 1), membrane_hz((8, 4), 4, 1)
    assert np.abs(cubic / quartic - 1.0).max() < 1e-5  # a fiftieth of what separates the published values


def lower_edges(mesh: Mesh, sides: tuple[tuple[int, float], ...]) -> np.ndarray:
    """Nodes on the edges of the lower face, (n,) bool."""
    on_side = np.any([bodies.at(mesh, axis, value) for axis, value in sides], axis=0)
    return np.asarray(bodies.at(mesh, 2, 0.0) & on_side)


def thick_plate(cuts: tuple[int, int, int], order: int) -> Pencil:
    """FV52: 10 x 10 x 1 m, u_z = 0 along the four edges of the lower face, nothing else held."""
    mesh = bodies.bricks(bodies.even((10.0, 10.0, 1.0), cuts), order)
    edges = lower_edges(mesh, ((0, 0.0), (0, 10.0), (1, 0.0), (1, 10.0)))
    return bodies.constrained(mesh, STEEL, [(edges, [2])])


def serendipity(mesh: Mesh) -> tuple[np.ndarray, sp.csr_array]:
    """Nodes of 20-node bricks among those of 27-node ones, and the map (27-node, 20-node) that they prescribe.

    A face's middle is half its edges' middles minus a quarter of its corners; the brick's centre is a quarter of the
    twelve middles minus a quarter of the eight corners.
    """
    points, count = mesh.element.points, len(mesh.nodes)
    zeros = np.abs(points) < 1e-9
    kind = np.zeros(count, dtype=np.int64)
    kind[mesh.cells] = zeros.sum(axis=1)  # 0 corner, 1 edge, 2 face, 3 centre
    entries = {}
    for local in np.flatnonzero(zeros.sum(axis=1) >= 2):
        fixed = ~zeros[local]
        beside = (np.abs(points[:, fixed] - points[local, fixed]) < 1e-9).all(axis=1)
        for parts, weight in ((0, -0.25), (1, 0.5 if fixed.any() else 0.25)):
            for other in np.flatnonzero(beside & (zeros.sum(axis=1) == parts)):
                entries |= dict.fromkeys(zip(mesh.cells[:, local], mesh.cells[:, other], strict=True), weight)
    kept = np.flatnonzero(kind < 2)
    entries |= {(node, node): 1.0 for node in kept}
    rows, columns = np.array(list(entries)).T
    matrix = sp.csr_array((np.array(list(entries.values())), (rows, columns)), shape=(count, count))
    return kept, sp.csr_array(matrix[:, kept])


def twenty_node_plate(cuts: tuple[int, int, int]) -> PlainPencil:
    """FV52 with 20-node bricks: our 27-node ones confined to the serendipity space."""
    mesh = bodies.bricks(bodies.even((10.0, 10.0, 1.0), cuts), 2)
    kept, shape = serendipity(mesh)
    system = assemble(mesh, {"body": STEEL})
    triple = sp.csr_array(sp.kron(shape, sp.eye_array(3)))
    free = np.ones((len(mesh.nodes), 3), dtype=bool)
    free[lower_edges(mesh, ((0, 0.0), (0, 10.0), (1, 0.0), (1, 10.0))), 2] = False
    use = np.flatnonzero(free[kept].ravel())
    stiffness = sp.csr_array(triple.T @ system.stiffness @ triple)[use][:, use]
    mass = sp.csr_array(sp.kron(shape.T @ system.mass @ shape, sp.eye_array(3), format="csr"))[use][:, use]
    return PlainPencil(sp.csc_array(stiffness), sp.csc_array(mass), system.scale, 3)


def check_line_supports() -> None:
    """Twenty-node bricks, 4 x 4 x 1, have the published frequencies.

    The in-plane modes agree in every published digit. Bending ones are within 1e-3: another rule of integration with
    14 points alone moves them by up to 2.7e-3, and the published rule is not stated.
    """
    result = modes_in_band(twenty_node_plate((4, 4, 1)), 1.0, 210.0).frequency_hz
    assert len(result) == 7
    assert np.abs(result / FV52_HZ - 1.0)[IN_PLANE].max() < ROUNDED
    assert np.abs(result / FV52_HZ - 1.0).max() < 1e-3


def test_fv52_published_frequencies_are_those_of_twenty_node_bricks() -> None:
    check_line_supports()


@pytest.mark.slow
def test_fv52_richer_elements_on_a_finer_division_lie_lower() -> None:
    few = modes_in_band(twenty_node_plate((8, 8, 3)), 1.0, 207.0).frequency_hz
    many = modes_in_band(thick_plate((8, 8, 3), 2), 1.0, 207.0).frequency_hz
    assert len(few) == len(many) == 9, "two bending modes more than on the coarse division come below 207 Hz"
    assert (many < few).all(), "the 20-node space lies within the 27-node one"
    same = np.array([0, 1, 2, 3])
    assert (many[same] < 0.98 * FV52_HZ[same]).all(), "bending feels the supports: 2.5 to 7 per cent lower"
    in_plane = many[[4, 7, 8]]
    assert np.abs(in_plane / FV52_HZ[IN_PLANE] - 1.0).max() < 0.003, "motion in the plane does not"


def graded_quarter(level: int) -> tuple[Mesh, Pencil]:
    """A quarter of FV52, symmetric about both middles, the elements at the supports halved `level` times."""
    x = np.append(np.linspace(5.0, 8.75, 4), 10.0)
    z = np.linspace(0.0, 1.0, 4)
    for _ in range(level):
        x = np.insert(x, len(x) - 1, (x[-1] + x[-2]) / 2.0)
        z = np.insert(z, 1, z[1] / 2.0)
    mesh = bodies.bricks((x, x, z), 2)
    edges = lower_edges(mesh, ((0, 10.0), (1, 10.0)))
    stops = [(edges, [2]), (bodies.at(mesh, 0, 5.0), [0]), (bodies.at(mesh, 1, 5.0), [1])]
    return mesh, bodies.constrained(mesh, STEEL, stops)


def drift_rate(mesh: Mesh, pencil: Pencil) -> tuple[float, float]:
    """The lowest eigenvalue and by how much the next halving should lower it, both in scaled units.

    First-order change of an eigenvalue when a support line with reaction q (force a length, of the M-orthonormal mode)
    yields by c a unit of q: d lambda = - int q^2 c ds. A quarter space under a line load at its edge yields by
    c = (1 - nu^2) / E * (1 / (pi/2 + 1) + 1 / (pi/2 - 1)) * ln(R/h): Flamant's wedge of half angle pi/4 loaded at
    45 degrees, 2 P_a^2 / (2 a + sin 2 a) + 2 P_b^2 / (2 a - sin 2 a). So ln 2 a halving.
    """
    modes = modes_in_band(pencil, 1.0, 60.0)
    eigenvalue = pencil.scale.eigenvalue(float(modes.frequency_hz[0]))
    field = pencil.expand(modes.vectors[:, :1])[:, :, 0]
    force = (pencil.system.stiffness @ field.ravel()).reshape(-1, 3) - eigenvalue * (pencil.system.mass @ field)
    line = np.flatnonzero(lower_edges(mesh, ((0, 10.0),)))
    line = line[np.argsort(mesh.nodes[line, 1])]
    reaction = force[line, 2]
    reaction[-1] /= 2.0  # the corner belongs to both lines
    squared = 2.0 * float(reaction @ np.linalg.solve(_line_mass(mesh.nodes[line, 1], 2), reaction))
    angle = pi / 2.0
    wedge = 1.0 / (angle + sin(angle)) + 1.0 / (angle - sin(angle))
    softer = (1.0 - STEEL.as_isotropic.poisson**2) * wedge * log(2.0) * pencil.scale.length_m
    return eigenvalue, -squared * softer


def _line_mass(places: np.ndarray, order: int) -> np.ndarray:
    """int N_a N_b ds along a line of elements."""
    at, weights = legendre.leggauss(order + 1)
    value, _ = lagrange(gauss_lobatto(order), at)
    matrix = np.zeros((len(places), len(places)))
    for start in range(0, len(places) - 1, order):
        own = slice(start, start + order + 1)
        half = (places[start + order] - places[start]) / 2.0
        matrix[own, own] += half * value.T @ (weights[:, None] * value)
    return matrix


def check_drift(levels: tuple[int, ...] = (2, 3, 4)) -> None:
    """Each halving beside the supports lowers the eigenvalue by what the wedge predicts, and does not slow down.

    One per cent: the trapezoidal mean of the rates at both ends leaves terms of second order in a drift of 1.6 %.
    """
    result = [drift_rate(*graded_quarter(level)) for level in levels]
    drop = np.diff([eigenvalue for eigenvalue, _ in result])
    text = [(first[1] + second[1]) / 2.0 for first, second in pairwise(result)]
    assert np.abs(drop / np.array(text) - 1.0).max() < 0.01
    compliance = np.diff([1.0 / eigenvalue for eigenvalue, _ in result])
    assert (compliance[1:] > 0.9 * compliance[:-1]).all(), "no limit: the steps do not fade"


@pytest.mark.slow
def test_fv52_line_supports_drift_at_the_rate_of_the_loaded_wedge() -> None:
    check_drift()
