"""The patched beam against exact beams, exact stepped sections solved frequency by frequency, statics, and reciprocity."""

from __future__ import annotations

from dataclasses import replace
from math import cos, cosh, inf, pi, sin, sinh

import numpy as np
import pytest

from firmware.emulate.plant import Beam as EmulatedBeam
from solvers.analytic.beams import frequency_hz, roots
from solvers.errors import SolverError
from solvers.shaping.modal_table import field_matrix, modal_drive, sensor_matrix
from solvers.thesis.shaped_beam import (
    PatchedBeam,
    beam_table,
    charge_table,
    condense,
    evenly,
    point_beam_table,
    section,
)

BEAM = PatchedBeam(quality_factor=inf)
UNEVEN = replace(BEAM, centres_m=(0.011, 0.030, 0.058, 0.075, 0.117, 0.139))


def exact_hz(beam: PatchedBeam, bending: float, mass: float, count: int = 8) -> np.ndarray:
    return np.array([frequency_hz(k, beam.length_m, bending, mass) for k in roots(*beam.ends, count)])


def dynamic_element(bending: float, mass: float, length: float, omega: float) -> np.ndarray:
    """The exact stiffness of a beam piece at one frequency, from its four exponential solutions."""
    k = (mass * omega**2 / bending) ** 0.25

    def rows(x: float) -> np.ndarray:
        c, s, ch, sh = cos(k * x), sin(k * x), cosh(k * x), sinh(k * x)
        return np.array(
            [
                [c, s, ch, sh],
                [-k * s, k * c, k * sh, k * ch],
                [-(k**2) * c, -(k**2) * s, k**2 * ch, k**2 * sh],
                [k**3 * s, -(k**3) * c, k**3 * sh, k**3 * ch],
            ]
        )

    left, right = rows(0.0), rows(length)
    moved = np.stack([left[0], left[1], right[0], right[1]])
    forces = bending * np.stack([left[3], -left[2], -right[3], right[2]])
    return forces @ np.linalg.inv(moved)


def exact_stepped(beam: PatchedBeam, frequency: float) -> tuple[np.ndarray, np.ndarray]:
    """Matrix and right-hand sides (one per volt) over w, w' at the patches' edges, the axial force, and the sensors' volts.

    Each patched piece bends about its own neutral axis; the axial force is one number, for the ends hold the beam's length.
    """
    omega, (_, _, bare_ei, bare_mass) = 2 * pi * frequency, section(beam, False)
    ea, es, ei, mass = section(beam, True)
    nodes = np.concatenate([[0.0], beam.edges_m.ravel(), [beam.length_m]])
    count, size = len(beam.centres_m), 2 * len(nodes)
    per_width = -beam.piezo.d31 / beam.piezo.s11
    drive, sense = per_width * beam.actuator_width_m, per_width * beam.sensor_width_m
    bare_ea = beam.material.as_isotropic.young_pa * beam.width_m * beam.thickness_m
    soft = (beam.length_m - count * beam.patch_length_m) / bare_ea + count * beam.patch_length_m / ea
    free = beam.piezo.permittivity_free_f_m[2, 2] - beam.piezo.d31**2 / beam.piezo.s11
    capacitance = free * beam.sensor_width_m * beam.patch_length_m / beam.patch_thickness_m
    whole, loads = np.zeros((size + 1 + count,) * 2), np.zeros((size + 1 + count, count))
    for e, length in enumerate(np.diff(nodes)):
        patched = e % 2 == 1
        one = dynamic_element(ei - es**2 / ea if patched else bare_ei, mass if patched else bare_mass, length, omega)
        whole[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += one
    axial = size
    whole[axial, axial] = soft
    offset, stretch = es / ea, beam.patch_length_m / ea
    arm = offset - beam.lever_m  # what turning of a patch's ends by one does to its length, the axial force kept
    for k in range(count):
        turn = np.zeros(size)
        turn[2 * (2 * k + 1) + 1], turn[2 * (2 * k + 2) + 1] = -1.0, 1.0
        volts = size + 1 + k
        whole[:size, axial] -= offset * turn
        whole[axial, :size] += offset * turn
        whole[:size, volts] -= arm * sense * turn
        whole[axial, volts] += sense * stretch
        whole[volts, :size] += sense * arm * turn
        whole[volts, axial] += sense * stretch
        whole[volts, volts] += sense**2 * stretch + capacitance
        loads[:size, k] += arm * drive * turn
        loads[axial, k] -= drive * stretch
        loads[volts, k] -= sense * drive * stretch
    kept = np.setdiff1d(np.arange(len(whole)), [0, 1, size - 2, size - 1])
    return whole[np.ix_(kept, kept)], loads[kept]


def test_vanishing_patches_leave_the_exact_bare_beam():
    thin = replace(BEAM, patch_thickness_m=1e-10)
    _, _, bending, mass = section(thin, False)
    assert beam_table(thin, 8).frequencies_hz == pytest.approx(exact_hz(thin, bending, mass), rel=1e-5)


def test_a_patch_over_the_whole_beam_bends_about_the_neutral_axis():
    whole = replace(BEAM, centres_m=(0.075,), patch_length_m=0.150)
    stretching, coupling, bending, mass = section(whole, True)
    expected = exact_hz(whole, bending - coupling**2 / stretching, mass)
    assert beam_table(whole, 8).frequencies_hz == pytest.approx(expected, rel=1e-5)
    assert expected[0] < 0.99 * exact_hz(whole, bending, mass)[0]  # the middle plane would be seen to be wrong


@pytest.mark.parametrize("beam", [BEAM, UNEVEN], ids=["even", "uneven"])
def test_sensor_voltages_are_those_of_the_exact_stepped_beam(beam):
    table = beam_table(beam, 40)
    for frequency in (700.0, 1700.0, 2400.0, 3800.0):
        matrix, loads = exact_stepped(beam, frequency)
        exact = -np.linalg.solve(matrix, loads)[-len(beam.centres_m) :]  # wires turned: stretching is positive
        result = sensor_matrix(table, frequency)
        assert np.abs(result.imag).max() == 0.0
        assert result.real == pytest.approx(exact, abs=1e-4 * np.abs(exact).max())


def test_the_exact_stepped_beam_is_singular_at_the_tables_frequencies():
    for frequency in beam_table(UNEVEN, 8).frequencies_hz:
        signs = [np.linalg.slogdet(exact_stepped(UNEVEN, frequency * (1 + d))[0])[0] for d in (-1e-5, 1e-5)]
        assert signs[0] * signs[1] == -1.0


def test_static_rest_of_the_left_out_modes_makes_few_modes_enough():
    """What is left out answers as at rest but for 1/(1 - (f/f_11)^2), f_11 the first mode left out."""
    few, many = beam_table(BEAM, 10), beam_table(BEAM, 80)
    assert few.sensor_residual is not None
    detuning = (2400.0 / many.frequencies_hz[10]) ** 2
    allowed = detuning / (1.0 - detuning) * np.abs(few.sensor_residual).max()
    exact, result = sensor_matrix(many, 2400.0), sensor_matrix(few, 2400.0)
    assert np.abs(result - exact).max() < allowed
    assert np.abs(result - few.sensor_residual - exact).max() > 10.0 * allowed


def test_a_cantilever_bends_under_a_patch_as_statics_say():
    beam = replace(BEAM, ends=("clamped", "free"), centres_m=(0.04,), sensor_width_m=1e-9)
    ea, es, ei, _ = section(beam, True)
    push = -beam.piezo.d31 / beam.piezo.s11 * beam.actuator_width_m
    curvature = -push * (beam.lever_m - es / ea) / (ei - es**2 / ea)  # stretching on top bends the end down
    expected = curvature * beam.patch_length_m * (beam.length_m - 0.04)
    table = beam_table(beam, 20, np.array([beam.length_m]))
    assert field_matrix(table, 0.01)[0, 0].real == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("quality_factor", [20.0, inf])
def test_reciprocity(quality_factor):
    for table in (
        beam_table(replace(UNEVEN, quality_factor=quality_factor)),
        charge_table(replace(UNEVEN, quality_factor=quality_factor)),
    ):
        matrix = sensor_matrix(table, 2400.0)
        assert np.abs(matrix - matrix.T).max() < 1e-9 * np.abs(matrix).max()
        assert (np.diag(table.sensor_residual) > 0.0).all()


def test_electrical_power_is_what_the_modes_lose():
    beam = replace(UNEVEN, quality_factor=35.0)
    table, volts = charge_table(beam), np.exp(1j * np.arange(6)) * np.arange(1, 7)
    for frequency in (900.0, 2129.0, 3300.0):
        omega = 2 * pi * frequency
        fed = 0.5 * np.real(volts.conj() @ (1j * omega * sensor_matrix(table, frequency) @ volts))
        moved = modal_drive(table, frequency) @ volts
        lost = 0.5 * np.sum(table.angular / table.quality_factor * omega**2 * np.abs(moved) ** 2)
        assert fed == pytest.approx(lost, rel=1e-10)
    lossless = charge_table(UNEVEN)
    kept = volts.conj() @ (1j * 2 * pi * 900.0 * sensor_matrix(lossless, 900.0) @ volts)
    assert abs(kept.real) < 1e-10 * abs(kept)


def test_charge_at_rest_is_held_capacitance_and_what_the_patch_gives_way():
    body, table = condense(BEAM), charge_table(BEAM)
    static_charge = body.capacitance + body.forces.T @ np.linalg.solve(body.stiffness, body.forces)
    assert sensor_matrix(table, 0.01).real == pytest.approx(static_charge, rel=1e-6)
    clamped = BEAM.capacitance_f(BEAM.actuator_width_m)
    free = 1330 * 8.8541878128e-12 * 12e-3**2 / 0.3e-3
    assert clamped < static_charge[0, 0] < free


def test_point_beam_is_the_emulated_beam_of_the_six_channel_build():
    """Six modes: the emulated beam's cosh - sinh loses e^kappa times the rounding of the largest value, 1e-7 here."""
    emulated, points = EmulatedBeam(modes=6), np.array([0.033, 0.101])
    beam = PatchedBeam(centres_m=evenly(0.150, 6, 0.150 / 7), quality_factor=emulated.quality_factor)
    table = point_beam_table(beam, emulated.modes, points_m=points)
    for frequency in (300.0, 2200.0, 2400.0):
        ours, theirs = sensor_matrix(table, frequency), emulated.matrix(frequency)
        scale = theirs[0, 0] / ours[0, 0]
        allowed = 1e-6 * np.abs(theirs).max()
        assert theirs == pytest.approx(scale * ours, abs=allowed)
        assert emulated.matrix(frequency, points) == pytest.approx(scale * field_matrix(table, frequency), abs=allowed)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"centres_m": ()}, "list of actuators is empty"),
        ({"length_m": 0.0}, "length_m = 0: must be a finite number above 0"),
        ({"centres_m": (0.002,)}, "overhangs"),
        ({"centres_m": (0.05, 0.055)}, "overlap"),
        ({"sensor_width_m": 0.02}, "do not fit"),
        ({"ends": ("free", "free")}, "leave a rigid-body mode"),
        ({"ends": ("clamped", "glued")}, "must be one of clamped, pinned, free"),
        ({"quality_factor": 0.0}, "quality_factor = 0: must be above 0"),
    ],
)
def test_beams_that_cannot_be_are_refused(change, message):
    with pytest.raises(SolverError, match=message):
        beam_table(replace(BEAM, **change))


def test_point_beams_that_cannot_be_are_refused():
    for change, message in (
        ({"centres_m": ()}, "list of actuators is empty"),
        ({"centres_m": (0.2,)}, "places must lie"),
    ):
        with pytest.raises(SolverError, match=message):
            point_beam_table(replace(BEAM, **change))
    with pytest.raises(SolverError, match="modes = 0"):
        beam_table(BEAM, 0)
