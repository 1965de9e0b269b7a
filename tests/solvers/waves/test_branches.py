"""Mirror parity on symmetry lines, and waves followed through crossings."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.lattice import Lattice, Path
from geometry.layout import Pillar
from geometry.materials import MATERIALS, Stack
from geometry.tiling import Panel
from solvers.analytic.plates import lamb_hz
from solvers.plates.assembled import Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import ReducedLattice, degenerate
from solvers.waves.branches import Mirrors, Solved, follow, modal_overlap, turned
from tests.helpers.lattice_waves import shear_hz

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
SQUARE, OBLONG = (4e-3, 4e-3), (3e-3, 4e-3)


@cache
def lattice(
    pitch: tuple[float, float] = SQUARE, halved: tuple[int, ...] = (0, 1), foot: tuple[float, float] | None = (0.0, 0.0)
) -> ReducedLattice:
    """A coarse cell with its pillar; a bare one with more degrees and modes, for its waves are the exact ones."""
    half = np.array(pitch) / 2.0
    degrees, top_hz = (Interface(4, 3), 1e6) if foot else (Interface(6, 3), 1.8e6)
    reduction = ReductionSettings(degrees, top_hz, HexSettings(3, 4e-3 if foot else 2e-3, 0, 0.2, 6.3e-3))
    return ReducedLattice(
        Reductions(Stack.of(2e-3, ALUMINIUM), PILLAR, reduction).cell(Panel(tuple(-half), tuple(half), foot, halved))
    )


def test_the_diagonal_mirror_of_the_degrees_of_freedom_is_that_of_the_field() -> None:
    face, random = Interface(4, 2), np.random.default_rng(0)
    points = random.uniform(-1.0, 1.0, (40, 3))
    for part, (axis, at) in zip(np.split(points, 4), ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)), strict=True):
        part[:, axis] = at
    dofs = random.normal(size=face.count)

    def field(u: np.ndarray, at: np.ndarray) -> np.ndarray:
        return face.evaluate(at) @ u.reshape(-1, 3)

    exchanged = [1, 0, 2]
    truth = field(dofs, points[:, exchanged])[:, exchanged]
    assert np.allclose(field(dofs[face.diagonal()], points), truth, atol=1e-12)


@pytest.mark.parametrize(("name", "image"), [("x", (-1, 1)), ("y", (1, -1)), ("d", None)])
def test_a_mirrored_wave_is_a_wave_at_the_mirrored_wavevector(name: str, image: tuple[int, int] | None) -> None:
    one, k = lattice(), np.array([310.0, 520.0])
    there = k[::-1] if image is None else k * np.array(image)
    waves, others = one.waves(k, 6), one.waves(there, 6)
    mirrored = Mirrors(one.cell).image(name, waves.dofs)
    overlap = np.abs(others.dofs.conj().T @ one.cell.mass @ mirrored)
    assert np.allclose(overlap, np.eye(6), atol=1e-3)  # but for what the modes left out make two waves share


def test_a_cell_has_the_mirrors_it_was_built_with() -> None:
    assert Mirrors(lattice().cell).names == ("x", "y", "d")
    assert Mirrors(lattice(OBLONG).cell).names == ("x", "y")
    assert Mirrors(lattice(SQUARE, ()).cell).names == ("d",)


def test_a_mirror_keeps_a_wavevector_up_to_a_reciprocal_vector() -> None:
    mirrors, edge = Mirrors(lattice().cell), np.pi / 4e-3
    cases = {(0.0, 0.0): "xyd", (0.3, 0.0): "y", (1.0, 0.0): "xy", (1.0, 0.4): "x", (1.0, 1.0): "xyd", (0.4, 0.4): "d"}
    for share, names in cases.items():
        assert "".join(mirrors.keeping(np.array(share) * edge)) == names
    assert mirrors.keeping(np.array([0.3, 0.4]) * edge) == ()


def crossed(path: Path, segment: int, mirror: str, sorted_bands: bool) -> int:
    """How often the parity of a branch, or of a sorted band, changes inside a segment."""
    one = lattice()
    solved, part = Solved(one, 10), path.segments[segment]
    result = follow(solved, path.wavevectors)
    mirrors, changes = Mirrors(one.cell), 0
    parity = [
        dict(zip(range(14) if sorted_bands else n, mirrors.parity(mirror, w.dofs), strict=True))
        for n, w in zip(result.number, result.waves, strict=True)
    ][part.first + 1 : part.last]
    for here, there in pairwise(parity):
        changes += sum(here[name] != there[name] for name in here.keys() & there.keys())
    assert all(value != 0 for row in parity for value in row.values())
    return changes


@pytest.mark.parametrize("points", [10, 25])
@pytest.mark.parametrize(("segment", "mirror"), [(0, "y"), (1, "x"), (2, "d")])
def test_a_branch_keeps_its_parity_along_a_symmetry_line_where_sorted_bands_do_not(
    segment: int, mirror: str, points: int
) -> None:
    path = Lattice.of_rows(*SQUARE).path("GXMG", points)
    assert crossed(path, segment, mirror, sorted_bands=False) == 0
    assert crossed(path, segment, mirror, sorted_bands=True) > 0


def test_branches_are_numbered_once_at_each_wavevector_from_one_on() -> None:
    path = Lattice.of_rows(*OBLONG).path("GXMYG", 8)
    result = follow(Solved(lattice(OBLONG), 8), path.wavevectors)
    assert result.number.shape == (33, 12) and result.number[0].tolist() == list(range(1, 13))
    assert all(len(set(row)) == 12 for row in result.number.tolist())
    assert set(result.number.ravel()) == set(range(1, result.number.max() + 1))


@pytest.mark.parametrize("points", [pytest.param(5, marks=pytest.mark.slow), 24])
def test_waves_of_the_bare_plate_are_followed_through_the_folded_ones(points: int) -> None:
    """A0, SH0 and S0 from near G to near X, over a wide cell in which other waves cross them."""
    pitch = (8e-3, 4e-3)
    bare, edge = lattice(pitch, foot=None), np.pi / pitch[0]
    vectors = np.column_stack([np.linspace(0.1, 0.97, points + 1) * edge, np.zeros(points + 1)])
    result = follow(Solved(bare, 10), vectors)
    place = [[int(np.flatnonzero(row == n)[0]) for n in result.number[0][:3]] for row in result.number]
    assert place[0] == [0, 1, 2] and max(place[-1]) > 3  # overtaken on the way
    for k, waves, row in zip(vectors[:, 0], result.waves, place, strict=True):
        exact = [lamb_hz(k, 2e-3, ALUMINIUM, False), shear_hz(k, ALUMINIUM), lamb_hz(k, 2e-3, ALUMINIUM, True)]
        assert np.allclose(waves.frequency_hz[row], exact, rtol=2e-3)


def test_degenerate_waves_are_turned_to_those_that_go_on() -> None:
    """At G the pillar's two bending waves and the three translations; along x each is likest one of its neighbours."""
    one, k = lattice(), np.array([8.0, 0.0])
    still, near = one.waves(np.zeros(2), 10), one.waves(k, 10)
    assert [group.stop - group.start for group in degenerate(still.eigenvalue, one.rounding)][:2] == [3, 2]
    mixed = still.dofs.copy()
    mixed[:, 3:5] = mixed[:, 3:5] @ np.array([[0.6, 0.8], [-0.8, 0.6]])
    for dofs in (still.dofs, mixed):
        start = turned(one, replace(still, dofs=dofs), k, near)
        like = modal_overlap(one, start, near)
        assert (like[:5].max(axis=1) > 0.97).all()
        energy = [u.conj().T @ one.cell.mass @ u for u in (start.dofs, still.dofs)]
        assert np.allclose(np.linalg.svd(energy[0])[1], np.linalg.svd(energy[1])[1], atol=1e-9)
