"""Lower bounds of Bloch waves: below those of the whole mesh however far the approximate ones lie above, and near them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh

from geometry.hex.boxes import Boxes, hex_mesh
from geometry.lattice import Lattice
from geometry.materials import MATERIALS
from solvers.fem.assembly import assemble
from solvers.waves.bloch import BlochCell
from solvers.waves.enclosure import Enclosure

PITCH_M, COUNT, TRIALS = 4e-3, 4, 7
MARGIN = 4.0  # of a bound over the rise, for waves half as far from the one above the bounded ones as from zero


@pytest.mark.parametrize("amount", [1e-1, 1e-2, 1e-3])
@pytest.mark.parametrize("place", [(0.31, 0.0), (0.21, 0.43), (-0.4, 0.1)])
def test_waves_of_the_mesh_lie_between_the_bounds_and_disturbed_ones(place: tuple[float, float], amount: float) -> None:
    lines, region = np.linspace(0.0, PITCH_M, 5) - PITCH_M / 2.0, np.zeros((4, 4, 1), dtype=int)
    region[1, 2] = 1
    mesh = hex_mesh(Boxes(lines, lines, np.array([0.0, 1e-3]), region, ("plate", "inclusion")), 2)
    lattice = Lattice((PITCH_M, 0.0), (0.0, PITCH_M))
    system = assemble(mesh, {"plate": MATERIALS["aluminium"], "inclusion": MATERIALS["steel"]})
    cell, k = BlochCell(system, lattice), np.array(place) @ lattice.reciprocal_per_m
    pencil, _ = cell.pencil(k)
    half = cell.dof
    stiffness, mass = (
        each[:half, :half].toarray() + 1j * each[half:, :half].toarray() for each in (pencil.stiffness, pencil.mass)
    )
    exact, waves = eigh(stiffness, mass, subset_by_index=[0, TRIALS - 1])
    draw = np.random.default_rng(4)
    load = mass @ (draw.standard_normal((half, TRIALS)) + 1j * draw.standard_normal((half, TRIALS)))
    strange = np.linalg.solve(stiffness, load)
    trial = waves + amount * strange / np.sqrt((strange.conj() * (mass @ strange)).sum(axis=0).real)
    values, turn = eigh(trial.conj().T @ stiffness @ trial, trial.conj().T @ mass @ trial)
    bounds = Enclosure(system, cell, 0.1 * float(exact[COUNT]))
    motion = cell.motion(k, trial @ turn)
    rises, true = bounds.rises(k, motion, values, COUNT), (values - exact)[:COUNT]
    assert (true > 0.0).all() and (rises >= true).all() and (rises[0] < MARGIN * true[0])


def test_a_wave_with_others_at_its_frequency_up_to_the_last_has_no_bound() -> None:
    lines = np.linspace(0.0, PITCH_M, 3) - PITCH_M / 2.0
    mesh = hex_mesh(Boxes(lines, lines, np.array([0.0, 1e-3]), np.zeros((2, 2, 1), dtype=int), ("plate",)), 1)
    system = assemble(mesh, {"plate": MATERIALS["aluminium"]})
    bounds = Enclosure(system, BlochCell(system, Lattice((PITCH_M, 0.0), (0.0, PITCH_M))), 1.0)
    waves = np.linalg.qr(np.random.default_rng(1).standard_normal((mesh.dof, 3)))[0].astype(complex)
    assert np.isinf(bounds.rises(np.array([1.0, 2.0]), waves, np.array([1.0, 2.0, 2.001]), 2)).all()
