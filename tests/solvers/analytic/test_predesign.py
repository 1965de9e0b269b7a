"""Pre-design: the document, the inverse problems, the limits it states, its speed and what it imports."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from math import isfinite, nan

import pytest

from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from solvers.analytic import beams, plates
from solvers.analytic.predesign import (
    pillar_frequencies_hz,
    pillar_height_m,
    predesign,
)
from solvers.errors import SolverError

ALUMINIUM = MATERIALS["aluminium"]
SQUARE = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
DESIGN = Design(0.1155, 0.02, 2e-3, 8, ALUMINIUM, SQUARE, 4e-3, 4e-3, 3, 25e-3)
SHAPES = [SQUARE, replace(SQUARE, shape="round"), replace(SQUARE, shape="tapered", tip_m=1e-3)]


def test_sizes_in_the_units_of_their_names():
    result = predesign(DESIGN)
    zone, pillar = result.zone, result.pillar
    assert zone.frequency_hz == pytest.approx(33_980, abs=5)
    assert zone.formula_hz == pytest.approx(32_980, abs=5)
    assert zone.half_wavelength_m == pytest.approx(0.1155 / 7.5)
    assert zone.clamped_hz == pytest.approx(39_807, rel=0.01)
    assert pillar.given_euler_hz == pytest.approx(32_633 * (7.1 / 6.3) ** 2, rel=1e-4)
    assert pillar.height_m == pytest.approx(7.1e-3 * (32_633 / 33_979) ** 0.5, rel=1e-3)
    assert all("\n" not in line and any(c.isdigit() for c in line) for line in result.limits)


@pytest.mark.parametrize("pillar", SHAPES, ids=lambda pillar: pillar.shape)
@pytest.mark.parametrize("theory", ["euler", "timoshenko"])
@pytest.mark.parametrize("target", [3e3, 32e3, 60e3])
def test_pillar_height_gives_back_its_frequency(pillar, theory, target):
    height = pillar_height_m(pillar, target, theory)
    assert pillar_frequencies_hz(pillar, theory, 1, height)[0] == pytest.approx(target, rel=1e-7)


def test_tapering_raises_the_frequency_and_a_straight_taper_changes_nothing():
    straight = replace(SQUARE, shape="tapered")
    assert pillar_frequencies_hz(straight, "euler")[0] == pillar_frequencies_hz(SQUARE, "euler")[0]
    nearly = replace(SQUARE, shape="tapered", tip_m=2e-3 * (1 - 1e-9))
    assert pillar_frequencies_hz(nearly, "timoshenko")[0] == pytest.approx(
        pillar_frequencies_hz(SQUARE, "timoshenko")[0], rel=1e-7
    )
    assert pillar_frequencies_hz(SHAPES[2], "euler")[0] > pillar_frequencies_hz(SQUARE, "euler")[0]


@pytest.mark.parametrize("target", [0.0, -1.0, nan])
def test_refused(target):
    with pytest.raises(SolverError, match="must be a finite number above 0"):
        pillar_height_m(SQUARE, target, "euler")


def test_parts_that_are_not_given_are_not_computed():
    assert predesign(replace(DESIGN, pillar=None, rows=0)).pillar is None
    bare = predesign(replace(DESIGN, length_m=nan, width_m=nan))
    assert bare.zone is None and bare.pillar.height_m == pytest.approx(6.3e-3, rel=1e-6)


@pytest.mark.parametrize("lines", [0, 1, 2, 40, 41, 300])
def test_any_number_of_lines(lines):
    zone = predesign(replace(DESIGN, nodal_lines=lines)).zone
    assert all(value is None or isfinite(value) for value in vars(zone).values())
    assert (zone.clamped_hz is None) == (lines > 40)
    assert (zone.half_wavelength_m is None) == (lines < 2)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_everything_scales(scale):
    """Elasticity knows no length: frequencies fall as sizes grow."""
    pillar = replace(SQUARE, base_m=scale * 2e-3, tip_m=scale * 2e-3, height_m=scale * 6.3e-3)
    sizes = {
        name: scale * getattr(DESIGN, name) for name in ("length_m", "width_m", "thickness_m", "pitch_x_m", "pitch_y_m")
    }
    result, base = predesign(replace(DESIGN, pillar=pillar, **sizes)), predesign(DESIGN)
    for name in ("frequency_hz", "formula_hz", "pinned_hz", "clamped_hz"):
        assert getattr(result.zone, name) * scale == pytest.approx(getattr(base.zone, name), rel=1e-9)
    assert result.pillar.height_m / scale == pytest.approx(base.pillar.height_m, rel=1e-8)
    assert result.pillar.timoshenko_height_m / scale == pytest.approx(base.pillar.timoshenko_height_m, rel=1e-8)


def test_stubby_pillars_are_called_a_guess():
    lines = predesign(replace(DESIGN, pillar=replace(SQUARE, height_m=4e-3))).limits
    assert any("beam theory is only a guess" in line for line in lines)
    assert not any("beam theory is only a guess" in line for line in predesign(DESIGN).limits)


def test_work_stays_that_of_an_instant_answer(monkeypatch: pytest.MonkeyPatch):
    """Three dense solves and a few hundred 4 x 4 determinants; `make bench` prints the time they take."""
    solved, determinants = [], []
    lowest, characteristic = plates._lowest, beams.characteristic
    monkeypatch.setattr(plates, "_lowest", lambda k, *text: solved.append(len(k)) or lowest(k, *text))
    monkeypatch.setattr(beams, "characteristic", lambda *text: determinants.append(1) or characteristic(*text))
    predesign(DESIGN)
    assert len(solved) == 3 and max(solved) <= 250
    assert 20 <= len(determinants) <= 400


def test_imports_neither_cad_nor_vtk_nor_meshers():
    banned = {"cadquery", "OCP", "vtk", "vtkmodules", "pyvista", "pytetwild", "meshio", "trimesh", "matplotlib"}
    code = f"import sys, solvers.analytic.predesign; sys.exit(str({banned!r} & set(sys.modules) or 0).replace('0', '') or 0)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
