"""Boundary functions through a plate of several layers: continuous, of each layer's degree, the lower ones first."""

from __future__ import annotations

import numpy as np
import pytest

from solvers.superelement.interface import Interface, through_functions

JOINTS = (-0.3, 0.1)
Z = np.linspace(-1.0, 1.0, 401)


def best(values: np.ndarray, functions: np.ndarray) -> float:
    """The largest residual of a field's best combination."""
    return float(np.abs(functions @ np.linalg.lstsq(functions, values, rcond=None)[0] - values).max())


@pytest.mark.parametrize("degree", [1, 2, 4])
def test_every_continuous_polynomial_of_each_layer_is_among_them_and_none_of_a_higher_degree(degree: int) -> None:
    functions = through_functions(Z, degree, JOINTS)
    assert functions.shape[1] == 3 * degree + 1 == Interface(2, degree, JOINTS).layers
    assert np.linalg.matrix_rank(functions) == functions.shape[1]
    for joint in JOINTS:
        assert best(np.maximum(Z - joint, 0.0) ** degree, functions) < 1e-10
        assert best(np.maximum(Z - joint, 0.0) ** (degree + 1), functions) > 1e-4
    assert best(np.abs(Z - 0.5), functions) > 1e-4  # a kink within a layer
    assert best((Z > 0.1) * 1.0, functions) > 0.1  # a step


def test_lower_degrees_come_first_and_the_two_first_move_it_rigidly() -> None:
    low, high = through_functions(Z, 2, JOINTS), through_functions(Z, 3, JOINTS)
    np.testing.assert_array_equal(low, high[:, : low.shape[1]])
    np.testing.assert_array_equal(low[:, :2], np.column_stack([np.ones_like(Z), Z]))
    face = Interface(2, 3, JOINTS)
    assert face.highest.tolist() == [7, 8, 9]
    kept = face.within(Interface(2, 2, JOINTS))
    assert len(kept) == Interface(2, 2, JOINTS).count and (face.across[kept] < 7).all()


def test_one_layer_keeps_legendres_polynomials() -> None:
    np.testing.assert_array_equal(through_functions(Z, 3), np.polynomial.legendre.legvander(Z, 3))
    assert Interface(2, 3).layers == 4 and Interface(2, 3).highest.tolist() == [3]
