"""Motions of a touched plate on plates like it, against plates that are made so: matrices drawn at random, solved whole."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from solvers.driven import curve_bars
from solvers.driven.curve_bars import Contacts, Doubts, Motions, peak_half_widths

MODES, PATCHES, POINTS, PLACES = 4, 3, 5, 2
DRIVERS, SENSORS = [0, 2], [1]
AT, UNIT, STIFFNESS, LOSS = 1.3, 7.0, 40.0 + 9.0j, 0.02
VALUE = np.array([0.5, 1.2, 2.0, 4.0])
VOLTS = np.array([1.0, -0.4 + 0.7j])


def drawn() -> Contacts:
    draw = np.random.default_rng(3)
    gains = draw.normal(size=(PLACES, MODES, PATCHES + POINTS))
    beyond = draw.normal(size=(PLACES, PATCHES + POINTS, PATCHES + POINTS))
    beyond = 0.05 * beyond @ beyond.swapaxes(1, 2)
    return made(gains, beyond, VALUE)


def made(gains: np.ndarray, beyond: np.ndarray, value: np.ndarray) -> Contacts:
    return Contacts(
        beyond.astype(complex),
        gains,
        value,
        LOSS * np.ones(len(value)),
        UNIT,
        np.array([0.3, 0.4, 0.5]),
        DRIVERS,
        SENSORS,
    )


def fed(contacts: Contacts, stiffness: complex | None = STIFFNESS) -> Motions:
    return contacts.motions(AT, stiffness).fed(np.broadcast_to(VOLTS, (PLACES, 2)))


def direct(contacts: Contacts, stiffness: complex | None = STIFFNESS, tone: float = AT) -> np.ndarray:
    """Motions and the sensor's voltage (t, m) from all equations at once: u = R L, Q + C V = 0, f + D u = 0."""
    return solved(contacts.receptance(tone), contacts.capacitance_f, stiffness)


def solved(receptance: np.ndarray, capacitance_f: np.ndarray, stiffness: complex | None = STIFFNESS) -> np.ndarray:
    out = []
    for whole in receptance:
        system, right = np.eye(PATCHES + POINTS, dtype=complex), np.zeros(PATCHES + POINTS, dtype=complex)
        right[DRIVERS] = VOLTS
        system[SENSORS] = whole[SENSORS]
        system[SENSORS, SENSORS] += capacitance_f[SENSORS]
        if stiffness is not None:
            system[PATCHES:] = system[PATCHES:] + stiffness * whole[PATCHES:]
        loads = np.linalg.solve(system, right)
        out.append(np.concatenate([whole[PATCHES:] @ loads, loads[SENSORS]]))
    return np.array(out)


@pytest.mark.parametrize("stiffness", [None, STIFFNESS])
def test_motions_are_those_of_all_equations_at_once(stiffness: complex | None) -> None:
    assert fed(drawn(), stiffness).answers[..., 0] == pytest.approx(direct(drawn(), stiffness), rel=1e-9)


def test_another_tone_and_more_flexibility_are_another_plate() -> None:
    plate, tone, more = drawn(), 1.5, 1e-2
    assert plate.motions(tone, STIFFNESS).answers @ VOLTS == pytest.approx(direct(plate, tone=tone), rel=1e-9)
    softer = plate.motions(AT, STIFFNESS, more).answers @ VOLTS
    at_points = np.diag(np.append(np.zeros(PATCHES), np.full(POINTS, more)))
    assert softer == pytest.approx(direct(replace(plate, beyond=plate.beyond + at_points)), rel=1e-9)


@pytest.mark.parametrize("stiffness", [None, STIFFNESS])
@pytest.mark.parametrize("share", [-0.2, 1e-3, 0.5])
def test_a_softened_mode_is_a_plate_with_another_eigenvalue(stiffness: complex | None, share: float) -> None:
    plate = drawn()
    ours = fed(plate, stiffness).softened(np.broadcast_to((share * VALUE)[:, None], (PLACES, MODES, 1)))[:, :, 0]
    for mode in range(MODES):
        value = VALUE * np.where(np.arange(MODES) == mode, 1.0 + share, 1.0)
        theirs = direct(made(plate.gains, plate.beyond, value), stiffness)
        assert ours[:, mode] == pytest.approx(theirs, rel=1e-9)


@pytest.mark.parametrize("share", [-0.1, 0.3])
def test_coupled_modes_are_a_plate_with_turned_ones(share: float) -> None:
    plate, pair = drawn(), [1, 3]
    coupling = share * float(np.sqrt(VALUE[pair].prod()))
    change = np.zeros((PLACES, MODES, 1))
    change[:, pair[1]] = coupling
    ours = fed(plate).coupled(np.full(PLACES, pair[0]), change)[:, pair[1], 0]
    new, turn = np.linalg.eigh(np.array([[VALUE[1], coupling], [coupling, VALUE[3]]]))
    value, gains = VALUE.copy(), plate.gains.copy()
    value[pair], gains[:, pair] = new, np.einsum("ij,til->tjl", turn, gains[:, pair])
    assert ours == pytest.approx(direct(made(gains, plate.beyond, value)), rel=1e-9)


def test_loads_that_are_off_are_other_gains() -> None:
    plate, step = drawn(), 0.3
    rows = step * plate.gains[:, :, DRIVERS][:, :, None].astype(complex)
    ours = fed(plate).forced(rows)[:, :, 0]
    for mode in range(MODES):
        loud = plate.gains.copy()
        loud[:, mode, DRIVERS] *= 1.0 + step
        whole = plate.receptance(AT)
        flexible = plate.flexible(AT)
        given = UNIT * plate.gains.swapaxes(1, 2) * flexible @ loud + plate.beyond
        whole[:, :, DRIVERS] = given[:, :, DRIVERS]
        assert ours[:, mode] == pytest.approx(solved(whole, plate.capacitance_f), rel=1e-9)
    louder = fed(plate).louder(np.array([[[1.1, 0.9]]]))[:, 0, 0]
    factor = plate.motions(AT, STIFFNESS).answers @ (VOLTS * np.array([1.1, 0.9]))
    assert louder == pytest.approx(factor, rel=1e-12)


def test_what_lies_beyond_the_modes_is_larger_to_first_order() -> None:
    plate, step = drawn(), 1e-5
    ours = fed(plate).rest(np.array([step]))[:, 0, 0]
    theirs = direct(made(plate.gains, (1.0 + step) * plate.beyond, VALUE))
    assert ours == pytest.approx(theirs, rel=10.0 * step**2, abs=1e3 * step**2 * float(np.abs(theirs).max()))
    assert np.abs(theirs - direct(plate)).max() > 1e2 * np.abs(ours - theirs).max() > 0.0


def test_bars_hold_what_any_mode_within_its_own_makes_of_a_peak_that_follows_its_mode() -> None:
    plate, error, loud = drawn(), 0.01, np.zeros((MODES, 2))
    ends = VALUE[:, None] * ((1.0 + error * np.array([-1.0, 1.0])) ** 2 - 1.0)
    group, errors = np.zeros(MODES, dtype=int), np.full(MODES, error)
    known = Doubts(VALUE, ends, errors, loud, np.zeros(2), group, 0.0, 0.0)

    def figures(under: np.ndarray) -> np.ndarray:
        return np.array([np.linalg.norm(under[..., :POINTS], axis=-1), np.abs(under[..., POINTS])])

    def at(value: np.ndarray, tone: float) -> np.ndarray:
        return figures(direct(made(plate.gains, plate.beyond, value), tone=tone)[:, None, None])[..., 0, 0]

    half = peak_half_widths(known, lambda tone: [plate.motions(tone, STIFFNESS)], AT, VOLTS, figures)
    nominal, used = at(VALUE, AT), 0.0
    for mode in range(MODES):
        for step in (-0.01, -0.004, 0.006, 0.01):
            value = VALUE * np.where(np.arange(MODES) == mode, (1.0 + step) ** 2, 1.0)
            off = np.abs(at(value, AT * (1.0 + step) ** 2 if mode == 1 else AT) - nominal)
            assert (off <= half * (1.0 + 1e-9)).all()
            used = max(used, float((off / half).max()))
    assert used > 0.5


@pytest.mark.parametrize("rest", [1e-16, -1e-16, 1e-16j])
def test_what_rounding_leaves_of_a_motion_has_no_phase(rest: complex) -> None:
    """Two drivers in step do not move an odd mode; with a phase of rounding, bars of voltages moved by a hundredth."""
    modal = np.array([[[1.0, 1.0], [1.0, -1.0 + rest]]], dtype=complex)
    parts = SimpleNamespace(modal=modal, flexible=np.array([[1j, 1j]]))
    phases = curve_bars._turned(parts, np.array([[1.0, 1.0 + 0.0j]]))
    assert phases[0].tolist() == [[-1j, -1j], [1.0, 1.0]]
