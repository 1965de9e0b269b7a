"""The cell as a function of its sizes, against meshes made for one design each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.lattice import Lattice
from geometry.materials import Material
from solvers.errors import SolverError
from solvers.fem.assembly import Scale, System, assemble
from solvers.parametric.affine import AffineCell, DesignBox, FixedMesh, Foot, Sizes, as_sizes, between
from solvers.parametric.bands import BandBases, band_bases, bands, own_error
from solvers.parametric.bare import bare_cell
from solvers.parametric.block import KEPT, NOVEL, Block, chosen
from solvers.parametric.cell import Inner, ParametricCell, parametric_cell
from solvers.superelement.cell import Cell, rigid_boundary
from solvers.superelement.interface import Interface
from solvers.superelement.lattice import Periodic, ReducedLattice
from solvers.superelement.reduction import reduce_cell

ALUMINIUM = Material.isotropic("aluminium", 70e9, 2700.0, 0.34)
STEEL = Material.isotropic("steel", 200e9, 7800.0, 0.3)
BOX = DesignBox((1.5e-3, 4e-3, 1.5e-3, 3e-3), (2.5e-3, 7e-3, 2.5e-3, 5e-3))
MESH = FixedMesh(order=2, beside=1, along=3, layers=0)
FACE = Interface(3, 2)
COUNT = 10
PATH = Lattice.of_rows(1.0, 1.0).path("GXMG", 4)
FRACTIONS = PATH.wavevectors / np.pi
UNSEEN = as_sizes(BOX.sample(between(3, seed=5)))


@pytest.fixture(scope="module")
def affine() -> AffineCell:
    return AffineCell(BOX, MESH, ALUMINIUM, STEEL)


@pytest.fixture(scope="module")
def cells(affine: AffineCell) -> tuple[ParametricCell, ...]:
    return parametric_cell(affine, FACE, BOX.spread(6), UNSEEN[:1])


@pytest.fixture(scope="module")
def bases(cells: tuple[ParametricCell, ...]) -> BandBases:
    floor = own_error(cells[0], cells[1:], UNSEEN[:1], COUNT)
    labels = tuple(label or "" for label in PATH.labels)
    return band_bases(cells[0], FRACTIONS, labels, COUNT, BOX.spread(8, seed=2), floor)


def stretched(affine: AffineCell, sizes: Sizes) -> System:
    """The same topology meshed and assembled for one design, as any plate's cell is."""
    mesh = replace(affine.mesh, nodes=affine.plan(affine.mesh.nodes, sizes), spans=None)
    scale = Scale.of(sizes[0], ALUMINIUM)
    return assemble(mesh, {"plate": ALUMINIUM, "pillar": STEEL}, scale)


@pytest.fixture(scope="module")
def plain(affine: AffineCell) -> list[Cell]:
    """Each unseen design reduced from its own mesh, with fixed-interface modes far above ten bands."""
    return [reduce_cell(stretched(affine, sizes), FACE, 4e6, (0, 1)) for sizes in UNSEEN]


def test_stretched_matrices_are_sums_of_products(affine: AffineCell) -> None:
    for sizes in UNSEEN:
        system, ratio = stretched(affine, sizes), affine.scale.length_m / sizes[0]
        forms = ((affine.stiffness, system.stiffness, ratio), (affine.mass, system.mass, ratio**3))
        for form, target, unit in forms:
            pairs = zip(affine.theta(form, sizes), form.matrices, strict=True)
            combined = unit * sum(weight * matrix for weight, matrix in pairs)
            assert abs(combined - target).max() < 1e-13 * abs(target).max()


@pytest.mark.parametrize(
    ("sizes", "said"),
    [
        ((2.6e-3, 5e-3, 2e-3, 4e-3), "thickness = 2.6 mm: must lie between 1.5 and 2.5 mm"),
        ((2e-3, 3e-3, 2e-3, 4e-3), "height = 3 mm"),
        ((2e-3, 5e-3, 2.5e-3, 2.9e-3), "side = 2.5 mm does not fit pitch = 2.9 mm"),
        ((float("nan"), 5e-3, 2e-3, 4e-3), "thickness"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(cells: tuple[ParametricCell, ...], sizes: Sizes, said: str) -> None:
    with pytest.raises(SolverError, match=said):
        cells[0].at(sizes, Inner(3, 3))


def test_samples_fit_the_box() -> None:
    designs = DesignBox().spread(30)
    assert len(designs) == 46
    assert not any(DesignBox().faults(sizes) for sizes in designs)


@pytest.mark.parametrize(
    "sizes",
    [
        (0.7e-3, 7.11e-3, 2e-3, 4e-3), (2e-6, 6e-6, 2e-6, 4e-6), (5e-3, 13e-3, 4e-3, 9e-3), (0.3e-3, 20e-3, 0.5e-3, 9e-3),
        (2.9e-3, 3e-3, 2.6e-3, 3.2e-3),
    ],
)  # fmt: skip
def test_a_box_is_laid_about_a_design(sizes: Sizes) -> None:
    box, usual = DesignBox().about(sizes), DesignBox()
    assert not box.faults(sizes) and box.about(sizes) == box
    assert np.divide(box.high, box.low) == pytest.approx(np.divide(usual.high, usual.low))
    assert usual.about((2e-3, 6e-3, 2e-3, 4e-3)) is not None and usual.about((2e-3, 6e-3, 2e-3, 4e-3)) == usual


def test_rigid_motions_meet_no_force_and_carry_the_mass(cells: tuple[ParametricCell, ...]) -> None:
    t, h, a, p = UNSEEN[0]
    cell = cells[0].at(UNSEEN[0], Inner(4, 4))
    motions = rigid_boundary(cell)
    assert np.abs(cell.stiffness @ motions).max() < 1e-8 * np.abs(cell.stiffness).max()
    mass = cell.scale.mass_kg * np.diag(motions[:, :3].T @ cell.mass @ motions[:, :3])
    target = 2700.0 * t * p * p + 7800.0 * h * a * a
    assert mass == pytest.approx(target, rel=1e-8)


def test_touch_face_follows_the_stretch(cells: tuple[ParametricCell, ...], plain: list[Cell]) -> None:
    """u_z and the area of the touch face are those of the cell from its own mesh, wherever the boundary moves it."""
    ours, theirs = cells[0].at(UNSEEN[1], Inner(6, 6)), plain[1]
    rule = theirs.touch.rule()
    assert ours.touch.weights is not None and rule.weights.sum() == pytest.approx(UNSEEN[1][3] ** 2, rel=1e-12)
    assert ours.touch.weights.sum() == pytest.approx(UNSEEN[1][3] ** 2, rel=1e-12)
    motions = rigid_boundary(ours)  # of a turn about x or y, u_z grows with the place
    one = ours.touch.weights @ (ours.touch.matrix[:, 0] @ motions) ** 2
    other = rule.weights @ rule.values(rigid_boundary(theirs)) ** 2
    assert one == pytest.approx(other, rel=1e-6)
    places = ours.touch.matrix[:, 0] @ motions[:, 3] / np.abs(ours.touch.matrix[:, 0] @ motions[:, 3]).max()
    assert places == pytest.approx(ours.touch.points[:, 1] / np.abs(ours.touch.points[:, 1]).max(), abs=1e-6)


def test_sectors_have_every_wave_of_the_lattice(cells: tuple[ParametricCell, ...]) -> None:
    """The mirrors and the half turn only sort: all unknowns kept, the sectors' waves are those of the Hermitian pencil."""
    from solvers.parametric.bands import INNER, _eigenvalues, _merged
    from solvers.parametric.block import sectors

    cell, sizes = cells[0], UNSEEN[2]
    of = sectors(FACE, FRACTIONS)
    values = _merged([_eigenvalues(cell.parts(sizes, INNER, FACE), s) for s in of], of, len(FRACTIONS), COUNT)
    lattice = ReducedLattice(cell.at(sizes, INNER))
    for fraction, computed_hz in zip(FRACTIONS, cell.scale.frequency(values), strict=True):
        target = lattice.frequencies(fraction * np.pi / sizes[3], COUNT)
        assert computed_hz == pytest.approx(target, rel=1e-7, abs=1e-3 * target[-1])
    assert lattice.c2_symmetry is not None


@pytest.mark.slow
def test_bands_of_unseen_designs_hold_their_bar(
    cells: tuple[ParametricCell, ...], bases: BandBases, plain: list[Cell]
) -> None:
    """Against each design's own mesh and reduction: never below it but for rounding, above it by the bar at most."""
    for sizes, cell in zip(UNSEEN, plain, strict=True):
        result, lattice = bands(cells[0], bases, sizes), ReducedLattice(cell)
        target = np.array([lattice.frequencies(k * np.pi / sizes[3], COUNT) for k in FRACTIONS])
        moving = target > 1e-3 * target.max()
        excess = np.where(moving, result.frequency_hz / np.where(moving, target, 1.0) - 1.0, 0.0)
        left_out = 5e-4  # fixed-interface modes above 4 MHz, which the plain reduction leaves out
        assert excess.min() > -left_out
        assert (excess.max(axis=0) <= result.error + 1e-4).all()
        assert excess.max() < 3e-3


def test_fewer_boundary_polynomials_lie_above(cells: tuple[ParametricCell, ...]) -> None:
    few, many = (ReducedLattice(cells[0].at(UNSEEN[0], Inner(5, 5), face)) for face in (Interface(2, 1), FACE))
    k = np.array([0.7, 0.3]) * np.pi / UNSEEN[0][3]
    assert (few.frequencies(k, COUNT) >= many.frequencies(k, COUNT) * (1.0 - 1e-9)).all()


@pytest.mark.slow
def test_sectors_of_a_cell_with_two_mirrors_have_every_wave_of_the_lattice() -> None:
    """A hexagon is no image of itself with x and y exchanged: four classes, and a path around a quarter of the zone."""
    from solvers.parametric.bands import INNER, _eigenvalues, _merged

    box = replace(BOX, foot=Foot(hexagonal=True))
    sizes = as_sizes(box.sample(between(1, seed=5)))[0]
    affine = AffineCell(box, MESH, ALUMINIUM, STEEL)
    (cell,) = parametric_cell(affine, FACE, [sizes])
    fractions = Lattice.of_rows(1.0, 1.0).path("GXMYG", 2).wavevectors / np.pi
    of = cell.sectors(fractions)
    values = _merged([_eigenvalues(cell.parts(sizes, INNER, FACE), s) for s in of], of, len(fractions), COUNT)
    own = ReducedLattice(cell.at(sizes, INNER))
    mesh = replace(affine.mesh, nodes=affine.plan(affine.mesh.nodes, sizes), spans=None)
    scale = Scale.of(sizes[0], ALUMINIUM)
    plain = ReducedLattice(reduce_cell(assemble(mesh, {"plate": ALUMINIUM, "pillar": STEEL}, scale), FACE, 4e6, (0, 1)))
    for fraction, computed_hz in zip(fractions, cell.scale.frequency(values), strict=True):
        target, apart = (each.frequencies(fraction * np.pi / sizes[3], COUNT) for each in (own, plain))
        assert computed_hz == pytest.approx(target, rel=1e-7, abs=1e-3 * target[-1])
        assert computed_hz == pytest.approx(apart, rel=3e-3, abs=1e-3 * apart[-1])
    with pytest.raises(SolverError, match="no mirror of the cell"):
        cell.sectors(((0.5, 0.5),))


LATTICES = [Lattice.of_rows(1.0, aspect, True) for aspect in (0.5, 0.7, 1.0)] + [Lattice.of_rows(1.0, 0.8)]


@pytest.mark.slow
@pytest.mark.parametrize("lattice", LATTICES, ids=["centred square", "closer rows", "wider rows", "in line"])
def test_bands_of_oblong_and_staggered_cells_are_those_of_their_own_meshes(lattice: Lattice) -> None:
    """Along the whole border of the zone, where no mirror parts the waves, too: above each own mesh, within the bar."""
    box = DesignBox((1.5e-3, 4e-3, 1.2e-3, 5e-3), (2.5e-3, 6e-3, 1.6e-3, 7e-3), lattice=lattice)
    affine = AffineCell(box, MESH, ALUMINIUM, STEEL)
    unseen = as_sizes(box.sample(between(3, seed=5)))
    designs = box.spread(2)[::2]
    cell, *alone = parametric_cell(affine, FACE, designs, unseen[:1])
    path = box.path(2)
    fractions, labels = path.wavevectors / np.pi, tuple(label or "" for label in path.labels)
    assert sum(map(bool, labels)) == (5 if lattice.cell_m == (1.0, 0.5) or not lattice.is_centred else 6)
    bases = band_bases(cell, fractions, labels, COUNT, designs, own_error(cell, alone, unseen[:1], COUNT))
    for sizes in unseen:
        plain = reduce_cell(stretched(affine, sizes), FACE, 4e6, (0, 1))
        row = Periodic(
            [plain, *[bare_cell(plain.size_m, ALUMINIUM, FACE)] * lattice.is_centred], int(lattice.is_centred)
        )
        target = np.array([row.frequencies(k / sizes[3], COUNT) for k in path.wavevectors])
        result, moving = bands(cell, bases, sizes), target > 1e-3 * target.max()
        excess = np.where(moving, result.frequency_hz / np.where(moving, target, 1.0) - 1.0, 0.0)
        assert excess.min() > -5e-4 and (excess.max(axis=0) <= result.error + 1e-4).all() and excess.max() < 3e-3


@pytest.mark.slow
def test_few_chosen_designs_tell_what_many_do(affine: AffineCell) -> None:
    """The greedy choice on a coarser mesh: on unseen designs as near as all of the pool, with a part of it."""
    pool, coarse = BOX.spread(16), AffineCell(BOX, FixedMesh(order=2, beside=1, along=2, layers=0), ALUMINIUM, STEEL)
    few, *alone = parametric_cell(affine, FACE, pool, UNSEEN, coarse=coarse)
    (many,) = parametric_cell(affine, FACE, pool)
    (two,) = parametric_cell(affine, FACE, pool[:2])
    taken = chosen(Block(coarse, FACE, (1, 1, 1)), pool, NOVEL * KEPT)
    assert taken[0] == pool[0] and len(set(taken)) == len(taken) < len(pool) / 2
    error, least, worse = (own_error(cell, alone, UNSEEN, COUNT) for cell in (few, many, two))
    assert error < 1.5 * least < worse / 1.5
