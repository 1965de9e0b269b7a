"""Labels of plate waves: exact on the bare plate, whatever wavevector names the wave, decaying waves too."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.layout import Pillar
from geometry.materials import MATERIALS, Stack
from geometry.tiling import Panel
from solvers.analytic.plates import lamb_hz
from solvers.plates.assembled import Reductions
from solvers.superelement.cell import Cell, rigid_boundary
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import Periodic, ReducedLattice
from solvers.waves.branches import Label, label_of, pillar_share
from tests.helpers.lattice_waves import shear_hz

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
PITCH, THICK_M = (3e-3, 4e-3), 2e-3


@cache
def cell(foot: bool = False) -> Cell:
    half = np.array(PITCH) / 2.0
    reduction = ReductionSettings(Interface(6, 3), 2e6, HexSettings(3, 1.5e-3, 0, 0.2, 3e-3))
    panel = Panel(tuple(-half), tuple(half), (0.0, 0.0) if foot else None, (0, 1))
    return Reductions(Stack.of(THICK_M, ALUMINIUM), PILLAR, reduction).cell(panel)


def labels(of: Cell, k: np.ndarray, count: int, named: np.ndarray | None = None) -> list[Label]:
    """Labels of the lowest waves at k, told under another name of the wavevector if given."""
    waves = ReducedLattice(of).waves(k, count)
    return label_of(of, waves.dofs, np.tile((k if named is None else named)[:, None], count))


def exact(k: np.ndarray, count: int) -> list[str]:
    """Names of the bare plate's waves seen as a lattice, by frequency."""
    result = []
    for m in range(-2, 3):
        for n in range(-2, 3):
            q = float(np.hypot(*(k + 2.0 * np.pi * np.array([m, n]) / PITCH)))
            result += [(lamb_hz(q, THICK_M, ALUMINIUM, False), "flexural"), (shear_hz(q, ALUMINIUM), "shear")]
            result.append((lamb_hz(q, THICK_M, ALUMINIUM, True), "longitudinal"))
    return [name for _, name in sorted(result)[:count]]


@pytest.mark.parametrize("k", [(300.0, 0.0), (0.0, 250.0), (310.0, 420.0), (-500.0, 330.0)])
def test_a0_sh0_and_s0_of_the_bare_plate_are_named_and_pure(k: tuple[float, float]) -> None:
    result = labels(cell(), np.array(k), 3)
    assert [label.name for label in result] == exact(np.array(k), 3)
    for label in result:
        assert label.flexural_share == pytest.approx(float(label.name == "flexural"), abs=1e-9)
        if label.name != "flexural":
            assert label.longitudinal_share == pytest.approx(float(label.name == "longitudinal"), abs=1e-3)
        assert label.pillar_share == 0.0 and label.plate == label.name


def test_folded_waves_are_named_by_their_own_direction() -> None:
    """In-plane waves of the second zone, which the wavevector in the first one does not point along."""
    k = np.array([0.37, 0.81]) * np.pi / PITCH
    assert [label.name for label in labels(cell(), k, 6)] == exact(k, 6)


@pytest.mark.slow
def test_labels_do_not_depend_on_the_name_of_the_wavevector() -> None:
    k = np.array([310.0, 420.0])
    for turn in ((1, 0), (0, -1), (1, 1)):
        other = k + 2.0 * np.pi * np.array(turn) / PITCH
        ours, theirs = labels(cell(True), k, 8), labels(cell(True), k, 8, other)
        assert [label.name for label in ours] == [label.name for label in theirs]


def test_at_the_zones_centre_a_short_vector_tells_the_direction_meant() -> None:
    motions = rigid_boundary(cell())[:, :3].astype(complex)
    for direction, names in (((1e-6, 0.0), ("longitudinal", "shear")), ((0.0, 1e-6), ("shear", "longitudinal"))):
        result = label_of(cell(), motions, np.tile(np.array(direction)[:, None], 3))
        assert [label.name for label in result] == [*names, "flexural"]


@pytest.mark.parametrize("kx", [0.0, 204.0])
@pytest.mark.parametrize("decay", [100.0, 900.0])
def test_decaying_in_plane_waves_are_told_apart(kx: float, decay: float) -> None:
    """u = grad or curl of exp(i (kx x + ky y)) with ky = q + i decay, put on the boundary functions."""
    k = np.array([kx, 150.0 + 1j * decay])
    for motion, name in (
        ((k[0], k[1], 0.0), "longitudinal"),
        ((k[1], -k[0], 0.0), "shear"),
        ((0.0, 0.0, 1.0), "flexural"),
    ):
        dofs = on_boundary(k, np.array(motion))
        (result,) = label_of(cell(), dofs[:, None], k[:, None])
        assert result.name == name


def on_boundary(k: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """A plane wave, constant through the thickness, in the cell's degrees of freedom by least squares."""
    s, one = np.linspace(-1.0, 1.0, 41), np.ones(41)
    at = np.concatenate(
        [np.column_stack(xy) for xy in ((-one, s, 0 * s), (one, s, 0 * s), (s, -one, 0 * s), (s, one, 0 * s))]
    )
    wave = np.exp(1j * (at[:, :2] * np.array(PITCH) / 2.0) @ k)
    face = cell().interface
    values = face.evaluate(at)[:, :: face.layers]
    flat = np.linalg.lstsq(values, wave, rcond=None)[0]
    out = np.zeros((face.count // 3, 3), dtype=complex)
    out[:: face.layers] = flat[:, None] * motion
    return np.concatenate([out.ravel(), np.zeros(len(cell().fixed_hz))])


def test_the_pillars_share_is_its_part_of_the_mass_when_all_moves_alike() -> None:
    motions = rigid_boundary(cell(True))[:, :3].astype(complex)
    pillar_m3, plate_m3 = 4e-6 * 6.3e-3, PITCH[0] * PITCH[1] * THICK_M
    assert np.allclose(pillar_share(Periodic([cell(True)]), motions), pillar_m3 / (pillar_m3 + plate_m3), rtol=1e-9)


def test_pillar_waves_are_named_only_where_asked() -> None:
    k = np.array([900.0, 700.0])
    waves = ReducedLattice(cell(True)).waves(k, 3)
    k = np.tile(k[:, None], 3)
    plain, query = label_of(cell(True), waves.dofs, k), label_of(cell(True), waves.dofs, k, with_pillars=True)
    assert [label.name for label in query] == ["pillar"] * 3
    assert all(label.pillar_share > 0.9 for label in query)
    assert [label.name for label in plain] == [label.plate for label in plain] == [label.plate for label in query]
