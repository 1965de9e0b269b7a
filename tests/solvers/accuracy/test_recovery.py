"""What continuous stresses tell of tetrahedra: nothing where they are exact, the error where they are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.materials import Material
from geometry.mesh import Mesh
from solvers.accuracy.mesh import StressRecovery
from solvers.fem.assembly import Scale, assemble
from solvers.fem.eigen import modes_in_band, modes_near
from solvers.fem.solid import SolidModel
from tests.helpers import bodies

STEEL, SOFT = Material.isotropic("steel", 210e9, 7850.0, 0.3), Material.isotropic("soft", 3e9, 1200.0, 0.35)
EDGES_M = (4e-3, 2e-3, 2e-3)
SCALE = Scale.of(1e-3, STEEL)


def block(counts: tuple[int, int, int]) -> Mesh:
    """A block of tetrahedra, `left` and `right` of the middle of its longest edge."""
    mesh = bodies.tetrahedra(bodies.even(EDGES_M, counts), 2)
    left = mesh.nodes[mesh.cells[:, :4]].mean(axis=1)[:, 0] < mesh.nodes[:, 0].mean()
    return replace(mesh, regions={"left": np.flatnonzero(left), "right": np.flatnonzero(~left)})


def losses(mesh: Mesh, materials: dict[str, Material], motions: np.ndarray) -> np.ndarray:
    """Share of the energy of motions (3n, m) that continuous stresses lose."""
    stiffness = assemble(mesh, materials, SCALE).stiffness
    energy = np.einsum("im,im->m", motions, stiffness @ motions)
    recovery = StressRecovery(mesh, materials, SCALE)
    assert np.allclose(np.diag(recovery.energy(motions)), recovery.energies(motions))
    return 1.0 - recovery.energies(motions) / energy


def test_a_body_bent_and_stretched_loses_nothing() -> None:
    """Quadratic displacements have linear stresses, which the continuous ones are."""
    mesh = block((4, 2, 2))
    x, y, z = mesh.nodes.T / 1e-3
    still = np.zeros_like(x)
    bent = [x * z, -0.3 * y * z, -(x**2) / 2.0 - 0.15 * (z**2 - y**2)]
    motions = np.stack([np.stack(each, axis=1).ravel() for each in (bent, [x, still, still], [x * y, z**2, still])])
    assert np.abs(losses(mesh, {"left": STEEL, "right": STEEL}, motions.T)).max() < 1e-10


def test_stresses_may_jump_where_materials_meet_and_nowhere_else() -> None:
    mesh = block((4, 2, 2))
    x = mesh.nodes[:, 0] - mesh.nodes[:, 0].mean()
    kinked = np.stack([np.where(x > 0.0, 3.0 * x, x), 0.0 * x, 0.0 * x], axis=1).reshape(-1, 1)
    assert losses(mesh, {"left": STEEL, "right": SOFT}, kinked)[0] == pytest.approx(0.0, abs=1e-10)
    assert losses(mesh, {"left": STEEL, "right": STEEL}, kinked)[0] > 1e-3


def fine(materials: dict[str, Material]) -> SolidModel:
    """Hexahedra of order 3 with a layer at each singular edge: there the error is 0.1^(2 * 0.7) of one without."""
    x = [0.0, 0.1, 1.0, 1.9, 2.0, 2.1, 3.0, 4.0]
    lines = tuple(1e-3 * np.array(each) for each in (x, *[[0.0, 0.1, 1.0, 1.9, 2.0]] * 2))
    mesh = bodies.bricks(lines, 3)
    left = mesh.nodes[mesh.cells].mean(axis=1)[:, 0] < 2e-3
    regions = {"left": np.flatnonzero(left), "right": np.flatnonzero(~left)}
    return SolidModel(replace(mesh, regions=regions), materials, ("x-",), False)


@pytest.mark.slow
@pytest.mark.parametrize("soft", [False, True], ids=["one material", "a soft half on a stiff one"])
def test_the_modes_of_a_clamped_block_lie_within_their_bars(soft: bool) -> None:
    materials = {"left": STEEL, "right": SOFT if soft else STEEL}
    coarse = SolidModel(block((4, 2, 2)), materials, ("x-",), False)
    top_hz = 300e3 if soft else 500e3
    own, true = (modes_in_band(model.pencil(None), 1e3, top_hz) for model in (coarse, fine(materials)))
    count = min(len(own.frequency_hz), len(true.frequency_hz))
    assert count >= 5
    values = np.array([coarse.scale.eigenvalue(tone) for tone in own.frequency_hz])
    recovery = StressRecovery(coarse.mesh, materials, coarse.scale, True)
    taken, half = (each[:count] for each in recovery.errors(None, coarse.pencil(None), own.vectors, values))
    missed = own.frequency_hz[:count] / true.frequency_hz[:count] - 1.0
    assert (missed > 0.0).all() and (np.abs(missed - taken) <= half).all()
    assert np.median(half / missed) < 1.0, "the bar is narrower than what was missed"


def test_modes_of_one_frequency_are_corrected_alike_however_they_are_mixed() -> None:
    """Of modes of one frequency any two perpendicular mixtures are modes, too: their corrections are the same."""
    mesh = bodies.tetrahedra(bodies.even(EDGES_M, (3, 1, 2)), 2)  # coarser along y than along z
    model = SolidModel(mesh, dict.fromkeys(mesh.region_of_cells(), STEEL), (), False)
    pencil = model.pencil(None)
    found = modes_near(pencil, 0.0, 2)
    recovery = StressRecovery(mesh, model.materials, model.scale)
    values = np.array([pencil.scale.eigenvalue(tone) for tone in found.frequency_hz])
    alone = np.array([recovery.errors(None, pencil, found.vectors[:, [i]], values[[i]])[0][0] for i in (0, 1)])
    assert abs(alone[0] - alone[1]) > 0.1 * alone.max()  # otherwise nothing would change with the mixture
    same = np.full(2, values[:2].mean())
    pair = found.vectors[:, :2] * np.sqrt(same / values[:2])
    turned = pair @ np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    (taken, half), (again, bars) = (recovery.errors(None, pencil, each, same) for each in (pair, turned))
    assert again == pytest.approx(taken, rel=1e-9) and bars == pytest.approx(half, rel=1e-6)
