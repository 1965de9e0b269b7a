"""Cells whose mesh error is told by coarser meshes: the bar holds, most of the error goes, K and M stay positive."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.layout import Design
from geometry.materials import Material
from geometry.tiling import lattice_panel
from pipeline.case.model import load_case
from solvers.accuracy.reduction import AT_RIMS, mesh_error, mode_errors
from solvers.fem.eigen import modes_in_band
from solvers.plates import assembled
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.cell import Cell
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import ReducedLattice

DESIGN = load_case(Path(__file__).resolve().parents[3] / "examples" / "small.toml").design
TOP_HZ, COUNT = 8e5, 10
MATERIALS = {
    "aluminium": Material.isotropic("aluminium", 70e9, 2700.0, 0.33),
    "tungsten": Material.isotropic("tungsten", 400e9, 19300.0, 0.28),
    "acrylic": Material.isotropic("acrylic", 3.3e9, 1190.0, 0.37),
    "printed": Material.isotropic("printed", 110e9, 4400.0, 0.34),
}
PAIRS = (("aluminium", "aluminium"), ("aluminium", "tungsten"), ("aluminium", "acrylic"))


def scene(plate: str, pillar: str) -> Design:
    assert DESIGN.pillar
    return replace(DESIGN, material=MATERIALS[plate], pillar=replace(DESIGN.pillar, material=MATERIALS[pillar]))


@cache
def cell(plate: str, pillar: str, order: int, layers: int = 1) -> Cell:
    design = scene(plate, pillar)
    mesh = HexSettings(order, 4e-3, layers, 0.15, 1.6e-3)
    reductions = Reductions(design.stack, design.pillar, ReductionSettings(Interface(4, 3), TOP_HZ, mesh))
    return reductions.cell(lattice_panel(design))


def wavevectors() -> np.ndarray:
    edge = np.pi / DESIGN.pitch_x_m
    return np.array([[0.0, 0.0], [edge, edge], [0.37 * edge, 0.61 * edge]])


def frequencies(one: Cell) -> np.ndarray:
    return np.concatenate([moving(ReducedLattice(one).frequencies(k, COUNT)) for k in wavevectors()])


def moving(values: np.ndarray) -> np.ndarray:
    return values[-7:]  # three rigid-body waves at the zone's middle


def errors(one: Cell) -> tuple[np.ndarray, np.ndarray]:
    bars = [mesh_error(one, ReducedLattice(one).waves(k, COUNT)) for k in wavevectors()]
    return tuple(np.concatenate([moving(getattr(e, name)) for e in bars]) for name in ("taken", "half_width"))  # type: ignore[return-value]


def without(one: Cell) -> Cell:
    """The same cell as its finer mesh alone has it."""
    bar = one.mesh_error
    assert bar is not None
    stiffness, mass = one.stiffness + bar.taken * bar.layer_stiffness, one.mass + bar.taken * bar.layer_mass
    return replace(one, stiffness=stiffness, mass=mass)


@pytest.mark.slow
@pytest.mark.parametrize("pair", PAIRS)
def test_the_bar_holds_a_finer_computation_and_most_of_the_error_goes(pair: tuple[str, str]) -> None:
    coarse, fine = cell(*pair, 3), cell(*pair, 4)
    (_, bar), (_, own) = errors(coarse), errors(fine)
    best, exact = frequencies(coarse), frequencies(fine)
    left, before = np.abs(best / exact - 1.0), frequencies(without(coarse)) / exact - 1.0
    assert (left <= bar + own).mean() >= 0.95 and (left <= 2.0 * (bar + own)).all()
    assert np.median(left) < 0.3 * np.median(before)
    assert np.median(bar) < 0.9 * np.median(before)  # the bar is worth having


@pytest.mark.slow
@pytest.mark.parametrize("pair", [PAIRS[0], pytest.param(PAIRS[1], marks=pytest.mark.slow)])
def test_what_was_taken_is_what_the_finer_mesh_lies_above(pair: tuple[str, str]) -> None:
    one = cell(*pair, 3)
    above = frequencies(without(one)) / frequencies(one) - 1.0
    taken, _ = errors(one)
    assert (taken > 0.0).all() and np.abs(above - taken).max() < 10.0 * (taken**2).max()


@pytest.mark.slow
def test_the_matrices_without_what_was_taken_are_those_of_the_mesh_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    one = cell(*PAIRS[0], 3)
    monkeypatch.setattr(assembled.Reductions, "coarser", lambda self, panel: None)
    cell.cache_clear()
    alone = cell(*PAIRS[0], 3)
    cell.cache_clear()
    assert alone.mesh_error is None
    for name in ("stiffness", "mass"):
        ours, theirs = getattr(without(one), name), getattr(alone, name)
        assert np.abs(ours - theirs).max() < 1e-12 * np.abs(theirs).max()


@pytest.mark.slow
def test_almost_massless_combinations_keep_their_mass() -> None:
    """A pillar of tungsten on a thick plate: the coarser mesh's shapes carry other masses by more than r could take."""
    assert DESIGN.pillar
    design = replace(
        DESIGN,
        thickness_m=2.92e-3,
        material=MATERIALS["printed"],
        pillar=replace(DESIGN.pillar, base_m=2.42e-3, tip_m=2.42e-3, height_m=4.69e-3, material=MATERIALS["tungsten"]),
        pitch_x_m=8.31e-3,
        pitch_y_m=8.31e-3,
    )
    settings = ReductionSettings(Interface(4, 3), 3.5e5, HexSettings(3, 5.84e-3, 1, 0.15, 1.17e-3))
    one = Reductions(design.stack, design.pillar, settings).cell(lattice_panel(design))
    bar = one.mesh_error
    assert bar and bar.taken > 0.15  # nothing had to be left
    unit = np.sqrt(np.diag(one.mass))
    assert np.linalg.eigvalsh(one.mass / np.outer(unit, unit)).min() > 1e-6


def plate(order: int) -> PlateModel:
    design = replace(scene(*PAIRS[0]), length_m=12e-3, width_m=10e-3, extension_m=5e-3)
    mesh = HexSettings(order, 4e-3, 1, 0.15, 3.2e-3)
    settings = ReductionSettings(Interface(4, 2), 4e5, mesh, 6e-3, 4e-3)
    return PlateModel(design, Reductions(design.stack, design.pillar, settings))


@pytest.mark.slow
def test_a_plates_modes_know_what_was_taken_from_their_cells() -> None:
    model = plate(3)
    pencil = model.pencil("SS")
    modes = modes_in_band(pencil, 5e3, 100e3)
    bars = mode_errors(model.assembled("SS"), pencil, modes.vectors)
    as_bands = mode_errors(model.assembled("SS"), pencil, modes.vectors, rims=1.0)
    assert (as_bands.mesh > bars.mesh).all() and (bars.mesh > AT_RIMS * as_bands.mesh).all()
    model.cells = {key: without(one) for key, one in model.cells.items()}
    model._assembled_plates.clear()
    del model._grid
    above = modes_in_band(model.pencil("SS"), 5e3, 101e3).frequency_hz[: len(bars.taken)] / modes.frequency_hz - 1.0
    assert len(above) >= 3 and (bars.mesh > 0.0).all() and above.max() > 1e-4
    assert np.abs(above - bars.taken).max() < 0.05 * above.max()


@pytest.mark.slow
def test_the_bar_of_a_plates_modes_holds_a_finer_computation() -> None:
    tones, bars = [], []
    for order in (3, 4):
        model = plate(order)
        pencil = model.pencil("SS")
        modes = modes_in_band(pencil, 5e3, 120e3)
        tones.append(modes.frequency_hz)
        bars.append(mode_errors(model.assembled("SS"), pencil, modes.vectors).mesh)
    assert len(tones[0]) == len(tones[1]) >= 4
    assert (np.abs(tones[0] / tones[1] - 1.0) <= bars[0] + bars[1]).all()
