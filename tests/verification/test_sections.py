"""Pillars of several sections: chains of beams, and rubber under lead, by hexahedra and by tetrahedra of the CAD solid."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from geometry.layout import Pillar, Section
from geometry.materials import MATERIALS
from pipeline.case.model import Case, case_from_dict
from pipeline.logs import TerminalLog
from pipeline.models.modes import Request, solve_modes
from solvers.analytic.predesign import Theory, pillar_frequencies_hz
from solvers.errors import SolverError
from solvers.plates.strip import bending_effective_mass
from tests.helpers.asked import bands_of

LOG = TerminalLog(True)
ALUMINIUM, EPOXY, LEAD = (MATERIALS[name] for name in ("aluminium", "epoxy", "lead"))
# silicone under lead, a contrast of 3e5, as soft in volume as measured and nearly incompressible; and resin under steel
SILICONE = {"young_GPa": 1.175e-4, "poisson": 0.469, "density_kg_m3": 1300.0}
RUBBER = SILICONE | {"poisson": 0.4997}
RESIN = {"young_GPa": 2.5, "poisson": 0.4, "density_kg_m3": 1180.0}
LEADEN = {"young_GPa": 40.8, "poisson": 0.37, "density_kg_m3": 11600.0}
STEEL = {"young_GPa": 210.0, "poisson": 0.29, "density_kg_m3": 7850.0}


@pytest.mark.parametrize("heights", [(3e-3, 2e-3, 1e-3), (1e-3, 5e-3), (6e-3,)])
def test_a_cut_beam_is_the_whole_one(heights: tuple[float, ...]) -> None:
    """Sections of one material and width: Timoshenko's exact frequencies."""
    first, *upper = heights
    whole = Pillar("square", 2e-3, 2e-3, 6e-3, ALUMINIUM)
    cut = Pillar("square", 2e-3, 2e-3, first, ALUMINIUM, upper=tuple(Section.square(2e-3, h, ALUMINIUM) for h in upper))
    exact = pillar_frequencies_hz(whole, "timoshenko", 3)
    assert pillar_frequencies_hz(cut, "timoshenko", 3) == pytest.approx(exact, rel=1e-8)
    thin = pillar_frequencies_hz(whole, "euler", 3)
    assert pillar_frequencies_hz(cut, "euler", 3) == pytest.approx(thin, rel=1e-8)


@pytest.mark.parametrize("theory", ["euler", "timoshenko"])
def test_rounding_takes_no_digits_of_stiff_sections_on_soft_ones(theory: Theory) -> None:
    """Lengths times s, frequencies over s: what differs is rounding, which shear without end had raised to 1e-4."""

    def twin_hz(s: float) -> np.ndarray:
        head = Section.square(1.3e-3 * s, 2e-3 * s, LEAD)
        neck = Pillar("square", 2.6e-3 * s, 2.6e-3 * s, 4e-3 * s, EPOXY, upper=(head,))
        return s * pillar_frequencies_hz(neck, theory, 2)

    for s in (0.037, 17.0, 1.01):
        assert twin_hz(s) == pytest.approx(twin_hz(1.0), rel=1e-9)


def test_a_heavy_body_on_a_soft_neck_is_an_oscillator() -> None:
    """Of lead 2 mm high on rubber 2 mm high: kappa G A / h holds the mass, bending little; within the neck's own 10 %."""
    rubber = MATERIALS["silicone-rubber"]
    pillar = Pillar("square", 20e-3, 20e-3, 2e-3, rubber, upper=(Section.square(20e-3, 2e-3, LEAD),))
    stiff = pillar.form.shear_factor(rubber.as_isotropic.poisson) * rubber.as_isotropic.shear_pa * 4e-4 / 2e-3
    exact = np.sqrt(stiff / pillar.upper[0].mass_kg) / (2.0 * np.pi)
    assert pillar_frequencies_hz(pillar, "timoshenko")[0] == pytest.approx(exact, rel=0.1)


def test_models_of_rigid_upper_sections_refuse_those_that_bend() -> None:
    glued = Pillar("square", 2e-3, 2e-3, 0.05e-3, EPOXY, upper=(Section.square(2e-3, 5e-3, ALUMINIUM),))
    with pytest.raises(SolverError, match="upper sections bend"):
        bending_effective_mass(glued, 0.0)


def cell(neck: dict[str, float], head: dict[str, float], shape: dict[str, Any], *more: str) -> Case:
    sections = [{"height_mm": 5.0, "material": neck}, {"height_mm": 5.0, "material": head}]
    raw = {
        "name": "resonator",
        "material": {"young_GPa": 4.35, "poisson": 0.37, "density_kg_m3": 1180.0},
        "plate": {"thickness_mm": 1.0},
        "pillar": shape | {"section": sections},
        "array": {"pitch_mm": 10.0, "rows": 1},
        "bands": {"points": 1, "count": 9},
        "solve": {"accuracy": 0.02},
    }
    return case_from_dict(raw, None, more)


SQUARE, ROUND = {"side_mm": 6.0}, {"shape": "round", "diameter_mm": 6.0}


@pytest.mark.slow
@pytest.mark.parametrize("rows", ["in line", "shifted"])
def test_a_lattice_moves_as_one_at_no_frequency(rows: str) -> None:
    """Rubber under lead: the plate is so much stiffer that its rounding passed for waves of 0.1 Hz, and spoilt every bar."""
    more = ["array.stagger=true", "pillar.side_mm=4"] if rows == "shifted" else []
    bands = bands_of(cell(SILICONE, LEADEN, SQUARE, "solve.mesh=hex", "solve.accuracy=0.1", *more), LOG)
    assert bands.points[0].label == "G"
    assert bands.points[0].frequencies_hz[:3] == [0.0, 0.0, 0.0]
    assert bands.points[0].frequencies_hz[3] > 10.0
    assert all(bar is not None and bar <= 0.1 for point in bands.points for bar in point.error)


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "accuracy"), [(SQUARE, 0.02), (ROUND, 0.04)], ids=["square", "round"])
@pytest.mark.parametrize(
    ("neck", "head"), [(SILICONE, LEADEN), (RUBBER, LEADEN), (RESIN, STEEL)], ids=["silicone", "rubber", "resin"]
)
def test_two_materials_have_one_answer(
    neck: dict[str, float], head: dict[str, float], shape: dict[str, Any], accuracy: float
) -> None:
    """Hexahedra against tetrahedra: within both bars, rigid-body modes apart."""
    own = cell(neck, head, shape, f"solve.accuracy={accuracy}")
    ours, other = (bands_of(replace(own, solve=own.solve.but(mesh=mesh)), LOG) for mesh in ("hex", "tet"))
    slowest = 1e-3 * max(point.frequencies_hz[-1] for point in other.points)
    for one, two in zip(ours.points, other.points, strict=True):
        pairs = zip(one.frequencies_hz, one.error, two.frequencies_hz, two.error, strict=True)
        for hz, bar, theirs, their_bar in pairs:
            assert bar is not None and their_bar is not None
            assert theirs < slowest or abs(hz / theirs - 1.0) <= bar + their_bar


@pytest.mark.slow
def test_a_glued_pillar_has_one_answer() -> None:
    """A layer of epoxy at the foot: modes of the lone pillar by hexahedra and by tetrahedra, which need it not too thin."""
    sections = [{"height_mm": 0.8, "material": "epoxy"}, {"height_mm": 5.0}]
    raw = {"name": "glued", "material": "aluminium", "pillar": {"side_mm": 2.0, "section": sections}}
    found = []
    for mesh in ("hex", "tet"):
        case = case_from_dict(raw, None, [f"solve.mesh={mesh}", "solve.accuracy=0.02"])
        found.append(solve_modes(case, Request("pillar", near_hz=0.0, count=5), LOG).rows)
    assert min(map(len, found)) >= 4
    for one, two in zip(*found, strict=False):
        assert one.error is not None and two.error is not None
        assert one.frequency_hz == pytest.approx(two.frequency_hz, rel=one.error + two.error)
