"""What a coarser mesh of the bond shows of the finer one's error, on matrices whose modes are known."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from solvers.accuracy.mesh import ErrorFractions
from solvers.fem.assembly import Scale
from solvers.fem.eigen import PlainPencil
from solvers.piezo.patched_plate import CoarserBond, Group, extrapolated_modes

VALUES = np.array([1.0, 2.0, 4.0])
SHARES = ErrorFractions(correction=0.4, uncertainty=0.1)


def group(change: np.ndarray) -> Group:
    """Modes that are the degrees of freedom themselves, and a coarser mesh that changes their stiffness."""

    def pencil(stiffness: np.ndarray) -> PlainPencil:
        return PlainPencil(sp.csc_array(stiffness), sp.eye_array(3, format="csc"), Scale(1.0, 1.0, 1.0), 0)

    loads = np.ones((3, 1))
    coarser = CoarserBond(lambda: pencil(np.diag(VALUES) + change), loads, np.zeros((3, 1)), SHARES)
    return Group((), lambda: pencil(np.diag(VALUES)), loads, coarser=coarser)


def test_of_what_the_coarser_mesh_is_stiffer_by_a_share_is_taken_and_of_what_it_is_softer_none() -> None:
    """The share of what it is softer by would stiffen the plate beyond its finer mesh."""
    change = np.array([0.05, -0.02, 0.0])
    result = extrapolated_modes(group(np.diag(change)), VALUES, np.eye(3))
    assert result.eigenvalue == pytest.approx([1.0 - 0.4 * 0.05, 2.0, 4.0], rel=1e-6)
    assert result.errors is not None
    expected = np.array([0.1 * 0.05, (0.1 + 0.4) * 0.02, 0.0]) / (2.0 * result.eigenvalue)
    assert result.errors.frequency == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_modes_that_the_coarser_mesh_mixes_are_only_lowered() -> None:
    change = np.array([[0.02, 0.03, 0.0], [0.03, -0.01, 0.0], [0.0, 0.0, 0.01]])
    result = extrapolated_modes(group(change), VALUES, np.eye(3))
    assert (result.eigenvalue <= VALUES + 1e-9).all()
    assert result.errors is not None and np.isfinite(result.errors.frequency).all()
