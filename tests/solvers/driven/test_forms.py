"""Quadratic forms of a driven plate on plates like it, against forms made from those plates' own modes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from solvers.driven.error_bars import Variation
from solvers.driven.forms import Forms, face_grams, forms
from solvers.piezo.forced import Drive, ForcedPlate, GroupModes
from tests.solvers.driven.test_driven import PLATE, small

TONES = np.array([12.9e3, 18.3e3, 24e3])
VOLTS = np.array([[1.0, -0.4 + 0.7j]]).repeat(3, axis=0)


@cache
def plate(sensors: tuple[int, ...]) -> ForcedPlate:
    return ForcedPlate(small((0, 1), sensors).plate, PLATE, Drive((0, 1), sensors, (10e3, 60e3), 80.0))


def own(forced: ForcedPlate) -> Forms:
    return forms(forced, face_grams(forced), TONES)


def place_of(forced: ForcedPlate, basis: GroupModes, mode: int) -> int:
    before = forced.modes[: [each is basis for each in forced.modes].index(True)]
    return sum(len(each.eigenvalue) for each in before) + mode


@pytest.mark.parametrize("sensors", [(), pytest.param((2,), marks=pytest.mark.slow)])
def test_forms_are_the_curves_squares(sensors: tuple[int, ...]) -> None:
    forced = plate(sensors)
    fed = np.array([VOLTS[0, 0], VOLTS[0, 1], 0.0])[: 2 + len(sensors)]
    curve, squares = forced.driven_by(fed).curve(TONES), own(forced).fed(VOLTS).squares[..., 0, 0]
    assert squares[0] == pytest.approx(curve.zone_rms_m_per_v**2, rel=1e-9)
    assert squares[1] == pytest.approx(curve.passive_rms_m_per_v**2, rel=1e-9)  # type: ignore[operator]
    assert np.einsum("ta,ktab,tb->kt", VOLTS.conj(), own(forced).squares, VOLTS) == pytest.approx(squares, rel=1e-9)


@pytest.mark.parametrize("sensors", [(), (2,)])
@pytest.mark.parametrize("share", [-0.2, 1e-3, 0.5])
def test_a_softened_mode_is_a_plate_with_another_eigenvalue(sensors: tuple[int, ...], share: float) -> None:
    forced = plate(sensors)
    values = np.concatenate([basis.eigenvalue for basis in forced.modes])
    assert len(values) >= 3
    ours = own(forced).softened(np.broadcast_to((share * values)[:, None], (3, len(values), 1)))[:, :, :, 0]
    for basis in forced.modes:
        for mode, value in enumerate(basis.eigenvalue):
            other = Variation(basis, (mode,), ((1.0 + share) * value,)).of(forced)
            near(ours[:, :, place_of(forced, basis, mode)], forms(other, face_grams(forced), TONES).squares)


@pytest.mark.parametrize("sensors", [(), (2,)])
@pytest.mark.parametrize("share", [-0.1, 1e-3, 0.3])
def test_coupled_modes_are_a_plate_with_turned_ones(sensors: tuple[int, ...], share: float) -> None:
    forced = plate(sensors)
    basis = max(forced.modes, key=lambda each: len(each.eigenvalue))
    pair = (1, 3) if sensors else (0, len(basis.eigenvalue) - 1)  # those that the sensor hears most
    first, last = (place_of(forced, basis, mode) for mode in pair)
    ends = basis.eigenvalue[list(pair)]
    coupling = share * float(np.sqrt(ends.prod()))
    change = np.zeros((3, sum(len(each.eigenvalue) for each in forced.modes), 1))
    change[:, last] = coupling
    ours = own(forced).coupled(np.full(3, first), change)[:, :, last, 0]
    new, turn = np.linalg.eigh(np.array([[ends[0], coupling], [coupling, ends[1]]]))
    other = Variation(basis, pair, tuple(new.tolist()), turn).of(forced)
    whole, columns = np.eye(face_grams(forced).shape[1]), own(forced).places[[first, last]]
    whole[np.ix_(columns, columns)] = turn
    near(ours, forms(other, whole.T @ face_grams(forced) @ whole, TONES).squares)


@pytest.mark.parametrize("sensors", [(), (2,)])
def test_a_force_on_a_mode_is_another_load(sensors: tuple[int, ...]) -> None:
    forced, step = plate(sensors), 0.3
    gains = np.concatenate([basis.gain[:, :2] for basis in forced.modes])
    rows = np.broadcast_to(step * gains[:, None], (3, len(gains), 1, 2)).astype(complex)
    ours, alone = own(forced).forced(rows)[:, :, :, 0], own(forced).fed(VOLTS).forced(rows)[..., 0, 0, 0]
    for basis in forced.modes:
        for mode in range(len(basis.eigenvalue)):
            gain = basis.gain.copy()
            gain[mode, :2] *= 1.0 + step
            changed = replace(basis, gain=gain)
            other = forced.driven_by(np.zeros(2 + len(sensors), dtype=complex))
            other.modes = [changed if each is basis else each for each in forced.modes]
            place, theirs = place_of(forced, basis, mode), forms(other, face_grams(forced), TONES).squares
            near(ours[:, :, place], theirs)
            near(alone[:, :, place], np.einsum("ta,ktab,tb->kt", VOLTS.conj(), theirs, VOLTS))


def near(ours: np.ndarray, theirs: np.ndarray) -> None:
    assert ours == pytest.approx(theirs, rel=1e-7, abs=1e-9 * float(np.abs(theirs).max()))


def test_louder_drivers_and_larger_remainders_are_what_they_say() -> None:
    forced = plate((2,))
    factor = np.array([[[1.1, 0.9]]])
    scaled = own(forced).fed(VOLTS * factor[0]).squares
    near(own(forced).fed(VOLTS).louder(factor)[:, :, 0, 0], scaled)
    near(np.einsum("ta,ktab,tb->kt", VOLTS.conj(), own(forced).louder(factor)[:, :, 0, 0], VOLTS), scaled[..., 0, 0])
    rest = own(forced).rest(np.array([-1.0, 0.0]))
    near(rest[:, :, 0, 1], own(forced).squares)
    places = own(forced).places
    grams = face_grams(forced)[:, places[:, None], places]
    modal = own(forced).modal
    near(rest[:, :, 0, 0], np.einsum("tia,kij,tjb->ktab", modal.conj(), grams, modal))
