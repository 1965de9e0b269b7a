"""Mason's circuit against the exact bar and against finite elements of the bar with its absorbers."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from scipy.linalg import eigh

from solvers.errors import SolverError
from solvers.thesis.circuit import (
    Cell,
    Filter,
    Line,
    MasonData,
    five_free,
    mason_study,
    natural_frequencies_hz,
    nodal_response,
    three_clamped,
)
from tests.helpers.mason_chain import absorbed_power_w, chain_response

CELL = Cell(0.03, 20e-6, 2700.0, 70e9)
SPEED = (70e9 / 2700.0) ** 0.5
OMEGA = 2 * pi * np.linspace(1e3, 60e3, 97)
FILTER = Filter(5e-4, 1.0 / ((2 * pi * 25e3) ** 2 * 5e-4))


def bar(line: Line, per_cell: int = 40, loss: float = 0.0):
    """Stiffness, mass and load of quadratic bar elements; each filter is a mass on a spring at its joint."""
    cells, joints = len(line.cells), len(line.cells) * 2 * per_cell + 1
    size = joints + len(line.filters)
    stiffness, mass, load = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    for k, cell in enumerate(line.cells):
        h, ea = cell.length_m / per_cell, cell.stiffness_pa * cell.area_m2
        ke = ea / (3 * h) * np.array([[7, -8, 1], [-8, 16, -8], [1, -8, 7]])
        me = cell.density_kg_m3 * cell.area_m2 * h / 30 * np.array([[4, 2, -1], [2, 16, 2], [-1, 2, 4]])
        for e in range(per_cell):
            span = slice(2 * (k * per_cell + e), 2 * (k * per_cell + e) + 3)
            stiffness[span, span] += ke
            mass[span, span] += me
        load[2 * k * per_cell] += line.sources[k]
        load[2 * (k + 1) * per_cell] -= line.sources[k]
    for i, (joint, one) in enumerate(line.filters.items()):
        at = [2 * joint * per_cell, joints + i]
        stiffness[np.ix_(at, at)] += np.array([[1, -1], [-1, 1]]) / one.capacitance_m_n
        mass[joints + i, joints + i] += one.inductance_kg
    clamped = [0] * (line.left == "clamped") + [joints - 1] * (line.right == "clamped")
    kept = np.setdiff1d(np.arange(size), clamped)
    where = [
        int(np.flatnonzero(kept == 2 * j * per_cell)[0]) if 2 * j * per_cell in kept else None for j in range(cells + 1)
    ]
    return stiffness[np.ix_(kept, kept)] * (1 + 1j * loss if loss else 1), mass[np.ix_(kept, kept)], load[kept], where


def test_chain_matrix_is_a_line_and_the_printed_shunt_sign_is_not():
    """A = cos Gl, B = -j Z0 sin Gl in the thesis' direction; det T = 1 holds for either sign and proves nothing."""
    cell = replace(CELL, loss=0.01)
    phase = cell.phase(OMEGA)
    series, shunt = 1j * cell.impedance * np.tan(phase / 2.0), -1j * cell.impedance / np.sin(phase)
    for sign, holds in ((1.0, True), (-1.0, False)):
        arm = np.moveaxis(
            np.array([[np.ones_like(series), -series], [np.zeros_like(series), np.ones_like(series)]]), -1, 0
        )
        segment = np.moveaxis(
            np.array([[np.ones_like(series), 0 * series], [-sign / shunt, np.ones_like(series)]]), -1, 0
        )
        whole = arm @ segment @ arm  # right from left
        assert np.linalg.det(whole) == pytest.approx(1.0)
        expected = np.cos(phase) if holds else 2.0 - np.cos(phase)
        assert whole[:, 0, 0] == pytest.approx(expected, rel=1e-9)
        if holds:
            assert whole[:, 0, 1] == pytest.approx(-1j * cell.impedance * np.sin(phase), rel=1e-8)
            assert np.linalg.inv(whole) == pytest.approx(cell.chain(OMEGA), rel=1e-7, abs=1e-7)


@pytest.mark.parametrize(
    ("ends", "orders"),
    [(("free", "free"), [1, 2, 3]), (("clamped", "clamped"), [1, 2, 3]), (("free", "clamped"), [0.5, 1.5])],
)
def test_natural_frequencies_of_a_bare_line_are_the_rods(ends, orders):
    line = Line((CELL,) * 4, *ends, (0.0,) * 4)
    expected = np.array(orders) * SPEED / (2 * 4 * CELL.length_m)
    result = natural_frequencies_hz(line, 1e3, expected[-1] * 1.1)
    assert result == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("ends", [("free", "free"), ("clamped", "clamped"), ("free", "clamped"), ("clamped", "free")])
@pytest.mark.parametrize("filters", [{}, {2: FILTER}, {1: FILTER, 3: replace(FILTER, inductance_kg=1e-3)}])
def test_natural_frequencies_against_finite_elements(ends, filters):
    line = Line((CELL, replace(CELL, length_m=0.02), CELL, CELL), *ends, (0.0,) * 4, filters)
    stiffness, mass, _, _ = bar(line)
    expected = np.sqrt(np.abs(eigh(stiffness, mass, eigvals_only=True, subset_by_index=(0, 11)))) / (2 * pi)
    expected = expected[(expected > 1e3) & (expected < 60e3)]
    assert natural_frequencies_hz(line, 1e3, 60e3) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("solve", [nodal_response, chain_response])
@pytest.mark.parametrize("ends", [("free", "free"), ("clamped", "free"), ("clamped", "clamped")])
def test_driven_velocities_against_finite_elements(solve, ends):
    cells = tuple(replace(CELL, loss=0.02, length_m=length) for length in (0.03, 0.025, 0.04))
    line = Line(cells, *ends, (0.0, 1.0, -0.4))
    result = solve(line, OMEGA)
    stiffness, mass, load, where = bar(line, loss=0.02)
    for i, omega in enumerate(OMEGA):
        velocity = 1j * omega * np.linalg.solve(stiffness - omega**2 * mass, load)
        expected = np.array([velocity[j] if j is not None else 0.0 for j in where])
        assert np.abs(result.currents[i]) == pytest.approx(np.abs(expected), rel=1e-4, abs=1e-7)


@pytest.mark.parametrize(
    "line", [three_clamped(MasonData()), five_free(MasonData(), False), five_free(MasonData(), True)]
)
def test_nodal_and_chain_solutions_agree(line):
    nodal, chain = nodal_response(line, OMEGA), chain_response(line, OMEGA)
    assert np.abs(nodal.currents - chain.currents).max() < 1e-10 * np.abs(nodal.currents).max()
    assert np.abs(nodal.voltages - chain.voltages).max() < 1e-10 * np.abs(nodal.voltages).max()


def test_power_given_is_power_taken():
    lossless = replace(MasonData().cell, loss=0.0)
    line = replace(five_free(MasonData(), True), cells=(lossless,) * 5)
    given, taken = absorbed_power_w(line, nodal_response(line, OMEGA), OMEGA)
    assert np.all(taken > 0.0)
    assert given == pytest.approx(taken, rel=1e-10, abs=1e-10 * np.max(taken))
    none = replace(line, filters={})
    response = nodal_response(none, OMEGA)
    power, scale = absorbed_power_w(none, response, OMEGA)[0], np.max(np.abs(response.currents))
    assert np.max(np.abs(power)) < 1e-10 * scale


def test_half_wave_cells_do_not_blow_up():
    """At Gl = pi tan and 1/sin have poles; the line has none."""
    half = pi * SPEED / CELL.length_m
    lossy = replace(CELL, loss=0.01)
    near = [
        nodal_response(Line((lossy,) * 3, "free", "clamped", (1.0, 0.0, 0.0)), half * x).currents
        for x in (1 - 1e-9, 1, 1 + 1e-9)
    ]
    assert near[1] == pytest.approx((near[0] + near[2]) / 2, rel=1e-6)
    line = Line((CELL,) * 3, "free", "clamped", (1.0, 0.0, 0.0))
    assert np.all(np.isfinite(nodal_response(line, half).currents))


def test_lossless_filter_cuts_the_line_at_its_own_frequency():
    """Y = 0: no velocity passes, and nothing divides by zero."""
    lossy = replace(CELL, loss=0.01)
    line = Line((lossy,) * 5, "free", "free", (0.0, 0.0, 1.0, 0.0, 0.0), {1: FILTER, 4: FILTER})
    cut = nodal_response(line, 2 * pi * FILTER.rejected_hz).currents[0]
    clamped = nodal_response(
        Line((lossy,) * 3, "clamped", "clamped", (0.0, 1.0, 0.0)), 2 * pi * FILTER.rejected_hz
    ).currents[0]
    assert np.abs(cut[[0, 1, 4, 5]]).max() < 1e-9 * np.abs(cut).max()
    assert cut[1:5] == pytest.approx(clamped, rel=1e-6, abs=1e-9 * np.abs(cut).max())


def test_confined_mode_appears_with_the_filter_only():
    study = mason_study()
    target = study.data.target_hz
    assert np.min(np.abs(study.modes_hz["filtered"] - target)) < 1e-3
    assert np.min(np.abs(study.modes_hz["bare"] - target)) > 0.05 * target
    assert study.confinement_db["filtered"] > 40.0 > 10.0 > study.confinement_db["bare"]
    at = int(np.argmin(np.abs(study.frequencies_hz - target)))
    window = slice(at - 50, at + 51)
    assert np.argmax(np.abs(study.filtered[window, 2])) == 50
    assert np.abs(study.filtered[at, 2]) > 50 * np.abs(study.bare[at, 2])
    assert np.argmax(np.abs(study.filter_impedance)) == at


def test_central_source_drives_even_clamped_modes_only():
    """Of three clamped cells the first and third mode stay silent: the target at 25 kHz is the second."""
    study = mason_study()
    undriven, target = study.modes_hz["clamped"][:2]
    assert (undriven, target) == pytest.approx((12_500.0, 25_000.0), rel=1e-9)
    quiet, loud = (
        np.abs(nodal_response(three_clamped(study.data), 2 * pi * f).currents[0, 1]) for f in (undriven, target)
    )
    assert loud > 100 * quiet


def test_lossless_resonance_hit_exactly_is_refused():
    line = Line((CELL,) * 3, "clamped", "clamped", (0.0, 1.0, 0.0))
    exact = SPEED / (3 * CELL.length_m)
    with pytest.raises(SolverError, match="that of a lossless resonance"):
        nodal_response(line, 2 * pi * exact)
    assert np.all(np.isfinite(nodal_response(line, 2 * pi * exact * 1.001).currents))


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: replace(CELL, length_m=0.0), "above 0"),
        (lambda: replace(CELL, loss=-1.0), "the loss 0 or more"),
        (lambda: Filter(0.0, 1.0), "above 0"),
        (lambda: Line((), "free", "free", ()), "at least one cell"),
        (lambda: Line((CELL,), "free", "free", ()), "one source value per cell"),
        (lambda: Line((CELL,), "free", "pinned", (1.0,)), "free or clamped"),
        (lambda: Line((CELL,) * 2, "free", "free", (1.0, 0.0), {2: FILTER}), "joint 2: must be from 1 to 1"),
        (lambda: nodal_response(Line((CELL,), "free", "free", (1.0,)), 0.0), "above 0"),
        (lambda: natural_frequencies_hz(Line((CELL,), "free", "free", (1.0,)), 2.0, 1.0), "0 < low < high"),
        (lambda: mason_study(MasonData(target_hz=-1.0)), "above 0"),
    ],
)
def test_refused(call, expected):
    with pytest.raises(SolverError, match=expected):
        call()
