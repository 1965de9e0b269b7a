"""What the proofs are worth: five faults, each planted where it could arise, and the proofs that must fail on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from geometry.elements import FloatArray, IntArray
from geometry.materials import Material
from solvers.errors import CountMismatch, SolverError
from solvers.fem import assembly, eigen
from solvers.waves import bloch
from tests.solvers.fem import test_convergence
from tests.verification import (
    test_cantilever,
    test_hex_against_tet,
    test_nafems,
    test_navier_families,
    test_rayleigh_lamb,
    test_rods,
)

Plant = Callable[[pytest.MonkeyPatch], None]


def off_diagonal_sign(patch: pytest.MonkeyPatch) -> None:
    """The blocks K_xy and K_yx with the other sign."""
    real = assembly._Geometry.stiffness

    def wrong(self: Any, tensor: FloatArray, i: int, j: int) -> FloatArray:
        return -real(self, tensor, i, j) if {i, j} == {0, 1} else real(self, tensor, i, j)

    patch.setattr(assembly._Geometry, "stiffness", wrong)


def lost_mid_node(patch: pytest.MonkeyPatch) -> None:
    """One element that takes a corner where it should take a mid-node which its neighbours keep."""
    real = assembly._Pattern

    def wrong(cells: IntArray, node_count: int) -> Any:
        shared, cells = np.bincount(cells.ravel(), minlength=node_count), cells.copy()
        middles = _middles(cells.shape[1])
        element, place = np.unravel_index(int(np.argmax(shared[cells[:, middles]])), (len(cells), len(middles)))
        cells[element, middles[place]] = cells[element, 0]
        return real(cells, node_count)

    patch.setattr(assembly, "_Pattern", wrong)


def _middles(width: int) -> IntArray:
    """Local nodes that are no corners, from the number of nodes an element has."""
    if width == 10:
        return np.arange(4, 10)
    line = round(width ** (1.0 / 3.0))
    grid = np.arange(width).reshape(line, line, line)
    return np.setdiff1d(grid, grid[:: line - 1, :: line - 1, :: line - 1])


def poisson_factor(patch: pytest.MonkeyPatch) -> None:
    """Lame's constant of plane stress, E nu / (1 - nu^2), in a solid."""
    real = Material.__dict__["tensor_pa"].func

    def wrong(self: Material) -> FloatArray:
        own, eye = self.as_isotropic, np.eye(3)
        plane = own.young_pa * own.poisson / (1.0 - own.poisson**2)
        return np.asarray(real(self) + (plane - own.lame_pa) * np.einsum("ik,jl->ikjl", eye, eye))

    patch.setattr(Material, "tensor_pa", property(wrong))


def transposed_phase(patch: pytest.MonkeyPatch) -> None:
    """The phases of the two axes exchanged."""
    real = bloch._at_phase
    patch.setattr(bloch, "_at_phase", lambda matrices, phase: real(matrices, phase[::-1]))


def conjugated_mass(patch: pytest.MonkeyPatch) -> None:
    """M with the transposed phase, exp(-ik.d), beside K with exp(ik.d)."""
    real, calls = bloch._at_phase, []

    def wrong(matrices: Any, phase: FloatArray) -> Any:
        calls.append(1)
        return real(matrices, phase if len(calls) % 2 else -phase)

    patch.setattr(bloch, "_at_phase", wrong)


def dropped_mode(patch: pytest.MonkeyPatch) -> None:
    """Every solve returns one mode too few, and its count with it: only what a proof knows by itself can tell."""
    real = eigen._Solver.verified

    def wrong(self: Any, *given: Any) -> eigen.Modes:
        modes = real(self, *given)
        kept = np.arange(len(modes.frequency_hz)) != 1
        count = replace(modes.count, expected=int(kept.sum()), found=int(kept.sum()))
        return replace(modes, frequency_hz=modes.frequency_hz[kept], vectors=modes.vectors[:, kept], count=count)

    patch.setattr(eigen._Solver, "verified", wrong)


def forgetful_lanczos(patch: pytest.MonkeyPatch) -> None:
    """A Lanczos that always loses its second mode, under an inertia that sees it."""
    real, lost = eigen._Solver.lanczos, {}

    def wrong(self: Any, solve: Any, shift: float, count: int) -> tuple[FloatArray, FloatArray]:
        values, vectors = real(self, solve, shift, count)
        low = self.pencil.scale.eigenvalue(1.0)
        lost.setdefault(id(self), values[values > low][1])
        keep = np.abs(values / lost[id(self)] - 1.0) > 1e-9
        return values[keep], vectors[:, keep]

    patch.setattr(eigen._Solver, "lanczos", wrong)


PROOFS: dict[str, Callable[[], None]] = {
    "convergence hex2": lambda: test_convergence.check_rate("hex2"),
    "Navier plate": test_navier_families.check_families,
    "FV32": test_nafems.check_membrane,
    "FV52": test_nafems.check_line_supports,
    "FV52 drift": test_nafems.check_drift,
    "bare-plate bands": test_rayleigh_lamb.check_bands,
    "rod in torsion": lambda: test_rods.check_rod(True),
    "rod along its axis": lambda: test_rods.check_rod(False),
    "cantilever": test_cantilever.check_with_poisson,
    "hexahedra and tetrahedra": test_hex_against_tet.check_block,
}
KILLS: list[tuple[Plant, str]] = [
    (off_diagonal_sign, "convergence hex2"),
    (off_diagonal_sign, "Navier plate"),
    (off_diagonal_sign, "FV32"),
    (off_diagonal_sign, "rod along its axis"),
    (off_diagonal_sign, "rod in torsion"),
    (lost_mid_node, "convergence hex2"),
    (lost_mid_node, "Navier plate"),
    (lost_mid_node, "hexahedra and tetrahedra"),
    (poisson_factor, "convergence hex2"),
    (poisson_factor, "Navier plate"),
    (poisson_factor, "FV32"),
    (poisson_factor, "FV52"),
    (poisson_factor, "FV52 drift"),
    (poisson_factor, "rod along its axis"),
    (poisson_factor, "cantilever"),
    (transposed_phase, "bare-plate bands"),
    (conjugated_mass, "bare-plate bands"),
    (dropped_mode, "Navier plate"),
    (dropped_mode, "FV32"),
    (dropped_mode, "rod in torsion"),
]


QUICK = {  # one for each fault; the slow ones show that each proof is worth something
    (off_diagonal_sign, "convergence hex2"),
    (lost_mid_node, "convergence hex2"),
    (poisson_factor, "convergence hex2"),
    (transposed_phase, "bare-plate bands"),
    (dropped_mode, "rod in torsion"),
}


@pytest.mark.parametrize(
    ("plant", "proof"),
    [
        pytest.param(*kill, id=f"{kill[0].__name__}-{kill[1]}", marks=() if kill in QUICK else pytest.mark.slow)
        for kill in KILLS
    ],
)
def test_a_planted_fault_fails_the_proof(plant: Plant, proof: str, monkeypatch: pytest.MonkeyPatch) -> None:
    test_cantilever.solid_hz.cache_clear()
    plant(monkeypatch)
    with pytest.raises((AssertionError, SolverError)):
        PROOFS[proof]()
    test_cantilever.solid_hz.cache_clear()


def test_every_proof_kills_a_fault_and_every_fault_is_killed() -> None:
    assert {proof for _, proof in KILLS} == set(PROOFS)
    assert {plant for plant, _ in QUICK} | {conjugated_mass} == {plant for plant, _ in KILLS}
    assert {plant.__name__ for plant, _ in KILLS} >= {
        "off_diagonal_sign",
        "lost_mid_node",
        "poisson_factor",
        "transposed_phase",
        "dropped_mode",
    }


@pytest.mark.slow
def test_the_count_itself_sees_a_mode_that_lanczos_loses(monkeypatch: pytest.MonkeyPatch) -> None:
    forgetful_lanczos(monkeypatch)
    with pytest.raises(CountMismatch, match="but the inertia count is"):
        test_rods.computed_hz(True)
