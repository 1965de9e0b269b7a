"""Complex bands and scattering by rows: exact plate waves, the real bands, exact pairs, energy, and a finite chain."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import pi

import numpy as np
import pytest
from scipy.linalg import eigh

from geometry.hex.scenes import HexSettings
from geometry.layout import Pillar
from geometry.materials import MATERIALS, Stack
from geometry.tiling import Panel
from solvers.analytic.plates import lamb_hz
from solvers.errors import SolverError
from solvers.plates.assembled import Reductions
from solvers.superelement.cell import KNOWN, Cell
from solvers.superelement.interface import Interface, ReductionSettings, Ties
from solvers.superelement.lattice import ReducedLattice
from solvers.waves import complex_bands
from solvers.waves.complex_bands import Row, chain, scatter
from tests.helpers.lattice_waves import shear_hz

ALUMINIUM = MATERIALS["aluminium"]
PITCH_M, THICK_M, KX = 4e-3, 2e-3, 204.0
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)


@cache
def cell(
    foot: tuple[float, float] | None = (0.0, 0.0), halved: tuple[int, ...] = (0, 1), top_hz: float = 600e3
) -> Cell:
    half = PITCH_M / 2.0
    reduction = ReductionSettings(Interface(4, 3), top_hz, HexSettings(3, 2e-3, 0, 0.2, 3e-3))
    panel = Panel((-half, -half), (half, half), foot, halved)
    return Reductions(Stack.of(THICK_M, ALUMINIUM), PILLAR, reduction).cell(panel)


def shorter() -> Cell:
    """The cell with a pillar of its own, shorter than that of the others."""
    half = PITCH_M / 2.0
    reduction = ReductionSettings(Interface(4, 3), 600e3, HexSettings(3, 2e-3, 0, 0.2, 3e-3))
    own = Pillar("square", 2e-3, 2e-3, 5.5e-3, ALUMINIUM)
    panel = Panel((-half, -half), (half, half), (0.0, 0.0), (0, 1), (), own)
    return Reductions(Stack.of(THICK_M, ALUMINIUM), PILLAR, reduction).cell(panel)


def closest(result: complex_bands.RowWaves, ky: float) -> int:
    k = result.wavenumber_per_m
    return int(np.argmin(np.abs(np.abs(k.real) - ky) + np.abs(k.imag)))


@pytest.mark.parametrize("foot", [None, (0.0, 0.0)])
@pytest.mark.parametrize("ky", [90.0, 410.0, 700.0])
def test_every_real_band_is_a_propagating_wave(foot: tuple[float, float] | None, ky: float) -> None:
    """The same matrices answer both: rounding, magnified where a pillar's band is flat, and the second order of what the modes
    left out take, which is part of the band's bar, may part them. All bands lie where what these take is known: beyond, the row
    and the lattice go on with it in different ways.
    """
    c = cell(foot, top_hz=1.2e6)
    row, waves = Row(c, KX), ReducedLattice(c).waves(np.array([KX, ky]), 5)
    assert waves.eigenvalue.max() < KNOWN * c.residual.edge
    slope = np.abs(ReducedLattice(c).group_velocity(waves)[:, 1])
    for frequency, bar, velocity in zip(waves.frequency_hz, waves.by_modes, slope, strict=True):
        result = row.waves(float(frequency))
        index = closest(result, ky)
        assert abs(abs(result.wavenumber_per_m[index]) - ky) < 1e-6 * ky + 2.0 * np.pi * bar * frequency / velocity
        assert abs(abs(result.factor[index]) - 1.0) < 1e-9


def test_every_propagating_wave_of_a_lopsided_row_is_on_a_real_band() -> None:
    """Such a row is no mirror image of itself: k_y and -k_y differ, and each wave found must be a band at its own k_y."""
    c = cell((0.3e-3, 0.4e-3), ())
    row, seen = Row(c, KX), 0
    for frequency in (20e3, 31e3, 40e3, 120e3, 150e3):
        result = row.waves(frequency)
        for ky in result.wavenumber_per_m[result.flux > 0.0]:
            bands = ReducedLattice(c).waves(np.array([KX, ky.real]), 8)
            assert (np.abs(bands.frequency_hz / frequency - 1.0) - bands.by_modes).min() < 1e-7
            seen += 1
    assert seen >= 5


def test_the_bare_plate_carries_and_holds_back_the_exact_waves() -> None:
    """A0 propagates above its cut-off at k_x; SH0 decays by Im k_y = sqrt(k_x^2 - k_t^2), a reduced cell's own error apart."""
    result = Row(cell(None), KX).waves(35e3)
    k = result.wavenumber_per_m[result.flux > 0.0]
    assert len(k) == 1
    assert lamb_hz(float(np.hypot(KX, k[0].real)), THICK_M, ALUMINIUM, False) == pytest.approx(35e3, rel=2e-4)
    slow = 2.0 * pi * 35e3 / (shear_hz(1.0, ALUMINIUM) * 2.0 * pi)
    decay = np.sqrt(KX**2 - slow**2)
    assert np.abs(result.wavenumber_per_m - 1j * decay).min() < 2e-4 * decay


def test_pairs_are_exact_and_the_two_routes_agree() -> None:
    row = Row(cell(), KX)
    stiffness, _ = row.condensed(34.7e3)
    assert row._symmetric(stiffness)
    paired, _ = complex_bands._paired(stiffness, row.mirror_sign)
    general, _ = complex_bands._general(stiffness)
    slow = np.sort(np.abs(np.log(np.abs(paired))))[:6]
    assert np.sort(np.abs(np.log(np.abs(general))))[:6] == pytest.approx(slow, rel=1e-6)
    both = np.concatenate([paired, 1.0 / paired])
    assert np.abs(np.sort(np.abs(both)) * np.sort(np.abs(both))[::-1] - 1.0).max() < 1e-12


def test_each_wave_balances_forces_between_rows() -> None:
    row = Row(cell(), KX)
    stiffness, _ = row.condensed(33.5e3)
    result = row.waves(33.5e3)
    for index in range(12):
        factor, q = result.factor[index], result.edge[:, index]
        upper = stiffness.tb @ q + stiffness.tt @ (q * factor)
        assert np.abs(upper + factor * result.force[:, index]).max() < 1e-9 * np.abs(stiffness.bb).max()


def test_a_wrong_phase_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    frequency = float(ReducedLattice(cell()).frequencies(np.array([KX, 300.0]), 1)[0])
    true = Ties.open
    monkeypatch.setattr(Ties, "open", lambda self, phase: true(self, phase + np.array([0.02, 0.0])))
    result = Row(cell(), KX).waves(frequency)
    assert abs(abs(result.wavenumber_per_m[closest(result, 300.0)]) - 300.0) > 1e-4 * 300.0


@pytest.mark.parametrize("kx", [0.0, 40.0, KX])
@pytest.mark.parametrize("count", [1, 3, 7])
def test_energy_is_neither_lost_nor_made(kx: float, count: int) -> None:
    bare, row = Row(cell(None), kx), Row(cell(), kx)
    half = bare.waves(36e3)
    going = np.flatnonzero(half.flux > 0.0)
    assert len(going) == (1 if kx == KX else 3)
    stiffness, _ = row.condensed(36e3)
    for incoming in going:
        result = scatter(chain([stiffness] * count), half, bare.mirror_sign, int(incoming))
        assert result.reflected.sum() + result.transmitted.sum() == pytest.approx(1.0, abs=1e-10)


def test_a_kept_row_solves_a_frequency_once_and_knows_what_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    plain, solved = complex_bands.Row.waves, []
    monkeypatch.setattr(complex_bands.Row, "waves", lambda row, tone: solved.append(tone) or plain(row, tone))
    one = complex_bands.KeptRow(cell(), 100.0)
    assert one.waves(3e4) is one.waves(3e4) and solved == [3e4]
    assert np.array_equal(one.waves(3e4).factor, plain(one, 3e4).factor)
    heavier = replace(cell(), mass=1.001 * cell().mass)
    others = [complex_bands.KeptRow(*each) for each in ((cell(), 100.0), (cell(), 101.0), (heavier, 100.0))]
    assert [other.same == one.same for other in others] == [True, False, False]


def test_rows_of_bare_plate_reflect_nothing() -> None:
    bare = Row(cell(None), KX)
    half = bare.waves(36e3)
    stiffness, _ = bare.condensed(36e3)
    result = scatter(chain([stiffness] * 5), half, bare.mirror_sign, int(np.flatnonzero(half.flux > 0.0)[0]))
    assert result.reflected.sum() < 1e-18 and result.transmitted.sum() == pytest.approx(1.0, abs=1e-10)


def test_a_long_stack_decays_as_its_least_attenuated_wave() -> None:
    bare, row = Row(cell(None), KX), Row(cell(), KX)
    half = bare.waves(35e3)
    incoming = int(np.flatnonzero(half.flux > 0.0)[0])
    stiffness, _ = row.condensed(35e3)
    transmitted = [
        scatter(chain([stiffness] * n), half, bare.mirror_sign, incoming).transmitted.sum() for n in (14, 15)
    ]
    first, second = row.waves(35e3).db_per_row[:2]
    next_amplitude = 10.0 ** (-14.0 * (second - first) / 20.0)  # amplitude of the next wave beside the first
    assert -10.0 * np.log10(transmitted[1] / transmitted[0]) == pytest.approx(first, rel=3.0 * next_amplitude)
    assert next_amplitude < 0.02


def test_rows_that_differ_pass_as_much_from_either_side_and_keep_the_power() -> None:
    """Reciprocity between two equal half-plates: the order of the rows changes phases, not what passes."""
    bare, other = Row(cell(None), KX), Row(shorter(), KX)
    half, one = bare.waves(36e3), Row(cell(), KX).condensed(36e3)[0]
    two, incoming = other.condensed(36e3)[0], int(np.flatnonzero(half.flux > 0.0)[0])
    transmitted = []
    for rows in ([one, one, two], [two, one, one], [one, one, one]):
        result = scatter(chain(rows), half, bare.mirror_sign, incoming)
        assert result.reflected.sum() + result.transmitted.sum() == pytest.approx(1.0, abs=1e-10)
        transmitted.append(result.transmitted.sum())
    equal = scatter(chain([one] * 3), half, bare.mirror_sign, incoming).transmitted.sum()
    assert transmitted[0] == pytest.approx(transmitted[1], rel=1e-8)
    assert transmitted[2] == pytest.approx(equal, rel=1e-8) and abs(transmitted[0] / equal - 1.0) > 0.1


def test_a_stack_is_its_rows_one_by_one() -> None:
    """Doubling against a chain of seven rows assembled and condensed in one go."""
    row = Row(cell(), KX)
    one, _ = row.condensed(36e3)
    m, count = len(one.bb), 7
    joined = np.zeros((m * (count + 1),) * 2, dtype=complex)
    for k in range(count):
        joined[k * m : (k + 2) * m, k * m : (k + 2) * m] += np.block([[one.bb, one.bt], [one.tb, one.tt]])
    ends = np.r_[0:m, count * m : (count + 1) * m]
    inner = np.setdiff1d(np.arange(len(joined)), ends)
    whole = joined[np.ix_(ends, ends)] - joined[np.ix_(ends, inner)] @ np.linalg.solve(
        joined[np.ix_(inner, inner)], joined[np.ix_(inner, ends)]
    )
    fast = chain([one] * count)
    assert np.abs(whole - np.block([[fast.bb, fast.bt], [fast.tb, fast.tt]])).max() < 1e-9 * np.abs(whole).max()


@pytest.mark.parametrize("frequency", [0.0, -5.0, float("nan")])
def test_a_frequency_must_be_above_zero(frequency: float) -> None:
    with pytest.raises(SolverError, match="above 0"):
        Row(cell(), KX).waves(frequency)


def test_a_wave_that_carries_nothing_is_refused() -> None:
    bare = Row(cell(None), KX)
    half = bare.waves(36e3)
    stiffness, _ = bare.condensed(36e3)
    with pytest.raises(SolverError, match="carries no energy"):
        scatter(stiffness, half, bare.mirror_sign, len(half.flux) - 1)


def test_a_resonance_of_the_held_row_is_stepped_over() -> None:
    c = cell()
    row = Row(c, KX)
    n = 2 * row.edge
    inner = eigh(row.stiffness[n:, n:], row.mass[n:, n:], eigvals_only=True)
    hit = float(c.scale.frequency(inner[:1])[0])
    near = row.waves(hit * (1.0 + 1e-4)).db_per_row[:3]
    assert row.waves(hit).db_per_row[:3] == pytest.approx(near, rel=0.05, abs=0.05)
