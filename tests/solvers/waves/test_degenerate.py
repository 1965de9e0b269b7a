"""Degenerate waves by a rule: whatever combination of them a solver returns, branches, labels and gaps are the same."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.elements import ComplexArray, FloatArray
from geometry.lattice import Lattice
from solvers.superelement.lattice import ReducedLattice, degenerate
from solvers.waves.branches import Branches, Label, Solved, follow, label_of
from solvers.waves.gaps import PolarisationGap, labels_along, polarisation_gaps
from tests.solvers.waves.test_branches import SQUARE, lattice

COUNT, POINTS = 8, 9
MORE = 3  # waves above those asked for, so that the last ones are mixed with their partners, too


class Mixed(ReducedLattice):
    """A lattice whose solver returns degenerate waves in combinations drawn by chance."""

    def __init__(self, like: ReducedLattice, seed: int) -> None:
        super().__init__(like.cell)
        self.random = np.random.default_rng(seed)

    def _solve(self, wavevector: FloatArray, count: int) -> tuple[FloatArray, ComplexArray]:
        values, free = super()._solve(wavevector, count + MORE)
        free = free.astype(complex)
        for group in degenerate(values, self.rounding):
            size = group.stop - group.start
            real, imaginary = self.random.normal(size=(2, size, size))
            free[:, group] = free[:, group] @ np.linalg.qr(real + 1j * imaginary)[0]
        return values[:count], free[:, :count]


def followed(one: ReducedLattice) -> tuple[Branches, list[list[Label]], list[PolarisationGap]]:
    solved = Solved(one, COUNT)
    path = Lattice.of_rows(*SQUARE).path("GXMG", POINTS)
    branches = follow(solved, path.wavevectors)
    labels = labels_along(solved, branches)
    return branches, labels, polarisation_gaps(solved, branches, labels)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_branches_labels_and_gaps_do_not_depend_on_the_solver_s_combinations(seed: int) -> None:
    plain, mixed = lattice(), Mixed(lattice(), seed)
    (branches, labels, gaps), (others, named, opened) = followed(plain), followed(mixed)
    assert (branches.number == others.number).all()
    for row, other in zip(labels, named, strict=True):
        assert [label.plate for label in row] == [label.plate for label in other]
        for name in ("flexural_share", "longitudinal_share", "pillar_share"):
            ours, theirs = ([getattr(label, name) for label in each] for each in (row, other))
            assert ours == pytest.approx(theirs, abs=1e-4)
    assert [gap.polarisation for gap in gaps] == [gap.polarisation for gap in opened] != []
    for ours, theirs in zip(gaps, opened, strict=True):
        assert (ours.lower_hz, ours.upper_hz) == pytest.approx((theirs.lower_hz, theirs.upper_hz), rel=1e-4)


def test_degenerate_waves_stay_degenerate() -> None:
    """Bending along x and along y at G and at M: what is left out couples pairs with pairs, never with half of one."""
    one = lattice()
    for k in (np.zeros(2), np.full(2, np.pi / SQUARE[0])):
        known = one.waves(k, 20).eigenvalue
        for count in range(6, 16):
            groups = [group.stop - group.start for group in degenerate(one.waves(k, count).eigenvalue, one.rounding)]
            theirs = [group.stop - group.start for group in degenerate(known, one.rounding)]
            assert groups[:-1] == theirs[: len(groups) - 1]


def test_a_wave_as_much_along_as_across_is_a_shear_wave_whatever_rounding_says() -> None:
    """At M the wavevector lies at 45 degrees to u_x of a plane wave."""
    one = lattice()
    face, random = one.cell.interface, np.random.default_rng(2)
    s = np.tile(np.linspace(-1.0, 1.0, 41), 2)
    sides = [np.column_stack([s, np.repeat([-1.0, 1.0], 41)]), np.column_stack([np.repeat([-1.0, 1.0], 41), s])]
    points = np.column_stack([np.concatenate(sides), np.zeros(164)])
    motion = np.exp(0.5j * np.pi * (points[:, 0] + points[:, 1]))  # over the cell, from -1 to 1
    shape = np.linalg.lstsq(face.evaluate(points), motion, rcond=1e-12)[0]
    labels = set()
    for _ in range(8):
        dofs = np.zeros((one.cell.dof, 1), dtype=complex)
        dofs[: face.count : 3, 0] = shape * (1.0 + 1e-13 * random.normal(size=len(shape)))
        k = (np.pi / SQUARE[0] * (1.0 + 1e-15 * random.normal(size=(2, 1)))).astype(complex)
        (label,) = label_of(one.cell, dofs, k)
        assert label.longitudinal_share == pytest.approx(0.5, abs=1e-6)
        labels.add(label.plate)
    assert labels == {"shear"}
