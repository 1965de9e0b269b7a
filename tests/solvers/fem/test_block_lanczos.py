"""Block Lanczos: exact spectra, clusters wider than a block, orthogonality, limits, and agreement with ARPACK."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from geometry.hex.boxes import Boxes, hex_mesh
from geometry.materials import MATERIALS
from solvers.fem import block_lanczos as module
from solvers.fem.assembly import assemble
from solvers.fem.block_lanczos import BLOCK, MAX_SLICE, SLICE, Basis, block_lanczos
from solvers.fem.eigen import modes_in_band
from solvers.fem.solid import constrain, free_mask


def pairs(stiffness: sp.csc_array, mass: sp.csc_array, shift: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    factor = splu(sp.csc_matrix(stiffness - shift * mass))
    result = block_lanczos(factor.solve, lambda x: mass @ x, stiffness.shape[0], count)
    assert result is not None
    return shift + 1.0 / result[0], result[1]


def chain(size: int) -> tuple[sp.csc_array, sp.csc_array, np.ndarray]:
    """Linear elements of a fixed string: lambda_k = 6 (1 - c) / (2 + c) / h^2 with c = cos(k pi h)."""
    h = 1.0 / (size + 1)
    diagonals = [np.full(size - 1, -1.0), np.full(size, 2.0), np.full(size - 1, -1.0)]
    stiffness = sp.diags_array(diagonals, offsets=[-1, 0, 1]) / h
    mass = (
        sp.diags_array([np.full(size - 1, 1.0), np.full(size, 4.0), np.full(size - 1, 1.0)], offsets=[-1, 0, 1])
        * h
        / 6.0
    )
    c = np.cos(np.arange(1, size + 1) * np.pi * h)
    return sp.csc_array(stiffness), sp.csc_array(mass), 6.0 * (1.0 - c) / (2.0 + c) / h**2


@pytest.mark.parametrize("shift", [0.0, 5e3, 1.2e5])
def test_the_pairs_nearest_to_a_shift_are_exact_and_orthonormal(shift: float) -> None:
    stiffness, mass, exact = chain(2000)
    values, vectors = pairs(stiffness, mass, shift, 40)
    nearest = exact[np.argsort(np.abs(exact - shift))[:40]]
    assert np.sort(values) == pytest.approx(np.sort(nearest), rel=1e-10)
    assert np.abs(vectors.T @ (mass @ vectors) - np.eye(40)).max() < 1e-12
    defect = stiffness @ vectors - (mass @ vectors) * values
    assert np.linalg.norm(defect, axis=0).max() < 1e-9 * np.abs(stiffness).max()


def test_a_cluster_wider_than_a_block_is_found_whole() -> None:
    exact = np.concatenate([np.full(3 * BLOCK, 1.0), 2.0 + np.arange(1000.0)])
    stiffness, mass = sp.csc_array(sp.diags_array(exact)), sp.csc_array(sp.eye_array(len(exact)))
    values, _ = pairs(stiffness, mass, 0.0, 3 * BLOCK + 6)
    assert np.sort(values) == pytest.approx(exact[: 3 * BLOCK + 6], rel=1e-10)


def test_few_distinct_values_are_no_dead_end() -> None:
    """The Krylov space of a block is exhausted after three blocks; what follows comes from rounding, orthonormal."""
    exact = np.repeat([1.0, 2.0, 3.0], 300)
    values, vectors = pairs(sp.csc_array(sp.diags_array(exact)), sp.csc_array(sp.eye_array(900)), 0.0, 30)
    assert np.abs(vectors.T @ vectors - np.eye(30)).max() < 1e-12
    assert np.isin(np.round(values, 9), [1.0, 2.0, 3.0]).all()


def test_a_basis_that_grows_too_large_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    stiffness, mass, _ = chain(2000)
    factor = splu(sp.csc_matrix(stiffness))
    monkeypatch.setattr(module, "MAX_COUNT", 1.0)
    assert block_lanczos(factor.solve, lambda x: mass @ x, 2000, 40, tolerance=0.0) is None
    assert not Basis.fits(10_000_000, 10) and not Basis.fits(100, 20) and Basis.fits(12_000, 100)


def test_a_solid_has_the_same_modes_by_arpack(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [np.linspace(0.0, length, n + 1) for length, n in ((30e-3, 10), (30e-3, 10), (2e-3, 1))]
    mesh = hex_mesh(Boxes(*lines, np.zeros((10, 10, 1), dtype=np.int64), ("plate",)), 2)
    system = assemble(mesh, {"plate": MATERIALS["aluminium"]})
    pencil = constrain(system, free_mask(mesh, ()))
    result = modes_in_band(pencil, 5e3, 120e3)
    used = len(result.frequency_hz)
    monkeypatch.setattr(module, "BYTES", 0.0)
    by_arpack = modes_in_band(pencil, 5e3, 120e3)
    assert used > 20 and result.frequency_hz == pytest.approx(by_arpack.frequency_hz, rel=1e-10)
    assert not np.array_equal(result.vectors, by_arpack.vectors)  # two ways indeed


@pytest.mark.filterwarnings("error")
def test_degrees_of_freedom_without_mass_are_no_trouble() -> None:
    """M of rank 30: the images of a block leave its range after four blocks, and what follows weighs nothing."""
    exact = np.arange(1.0, 31.0)
    stiffness = sp.csc_array(sp.diags_array(np.concatenate([exact, np.full(970, 5.0)])))
    mass = sp.csc_array(sp.diags_array(np.concatenate([np.ones(30), np.zeros(970)])))
    values, vectors = pairs(stiffness, mass, 0.0, 30)
    assert np.sort(values) == pytest.approx(exact, rel=1e-10)
    assert np.abs(vectors.T @ (mass @ vectors) - np.eye(30)).max() < 1e-12


def test_a_slice_is_as_wide_as_its_basis_fits() -> None:
    assert Basis.slice_of(1000) == Basis.slice_of(10**6) == SLICE and Basis.slice_of(8000) == MAX_SLICE
    for size in (2500, 4000, 12_000, 24_000, 54_000):
        pair_count = round(1.1 * Basis.slice_of(size)) + 4
        assert Basis.slice_of(size) > SLICE and Basis.fits(size, pair_count - 1)
        assert Basis.slice_of(size) == MAX_SLICE or not Basis.fits(size, pair_count + 8)
