"""Bloch bands: known gap and bending bands, reduced against full cell, and the bare plate against exact waves."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from geometry.hex.boxes import Boxes, cell_boxes, hex_mesh
from geometry.hex.scenes import HexSettings
from geometry.lattice import Lattice
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Stack
from geometry.tiling import lattice_panel
from pipeline.planning import mesh_rules
from solvers.fem.assembly import assemble
from solvers.plates.assembled import Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import ReducedLattice
from solvers.waves.bloch import BlochCell
from solvers.waves.gaps import complete_gaps
from tests.helpers.lattice_waves import folded_hz

ALUMINIUM = MATERIALS["aluminium"]
MATERIALS_OF = {"plate": ALUMINIUM, "pillar": ALUMINIUM}
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
CELL = Design(115.5e-3, 20e-3, 2e-3, 8, ALUMINIUM, PILLAR, 4e-3, 4e-3, 1, 0.0)
OBLONG = replace(CELL, pitch_x_m=3e-3, pitch_y_m=4e-3)
SHARES = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.37, 0.81), (0.8, -0.3))
BENDING_AT_M_HZ, GAP_HZ = 32540.0, (163100.0, 175840.0)


def reduced(design: Design, reduction: ReductionSettings) -> ReducedLattice:
    """The lattice of one reduced cell."""
    return ReducedLattice(
        Reductions(Stack.of(design.thickness_m, ALUMINIUM), design.pillar, reduction).cell(lattice_panel(design))
    )


@lru_cache
def planned(accuracy: float) -> ReducedLattice:
    """As the bands of a case are computed."""
    return reduced(CELL, mesh_rules.lattice_reduction(CELL, accuracy))


def wavevector(share: tuple[float, float], design: Design) -> np.ndarray:
    """A share of the zone's edge along each axis, rad/m."""
    return np.array(share) * np.pi / np.array([design.pitch_x_m, design.pitch_y_m])


def mirrored(boxes: Boxes) -> Boxes:
    """The whole cell on the very lines of its quarter."""

    def whole(lines: np.ndarray) -> np.ndarray:
        return np.concatenate([-lines[:0:-1], lines])

    region = np.concatenate([boxes.region[::-1], boxes.region])
    region = np.concatenate([region[:, ::-1], region], axis=1)
    return Boxes(whole(boxes.x), whole(boxes.y), boxes.z, region, boxes.names)


def full(design: Design, settings: HexSettings) -> BlochCell:
    """The cell meshed whole, on the lines on which its quarter is reduced."""
    mesh = hex_mesh(mirrored(cell_boxes(design, settings, quarter=True)), settings.order)
    return BlochCell(assemble(mesh, MATERIALS_OF), design.lattice)


def check_known(lattice: ReducedLattice, tolerance: float) -> None:
    """Two bending bands at M and the complete gap between bands 6 and 7."""
    at_m = lattice.frequencies(wavevector((1.0, 1.0), CELL), 10)
    assert np.abs(at_m[:2] / BENDING_AT_M_HZ - 1.0).max() < tolerance
    path = Lattice.of_rows(CELL.pitch_x_m, CELL.pitch_y_m).path("GXMG", 8)
    gaps = complete_gaps(np.array([lattice.frequencies(k, 8) for k in path.wavevectors]))
    sixth = next(gap for gap in gaps if gap.lower_band == 6)
    assert sixth.upper_band == 7
    assert np.abs(np.array([sixth.lower_hz, sixth.upper_hz]) / GAP_HZ - 1.0).max() < tolerance


@pytest.mark.slow
def test_bending_at_m_and_the_complete_gap_are_the_known_ones() -> None:
    check_known(planned(0.01), 0.005)


@pytest.mark.slow
def test_finer_settings_meet_them_closer() -> None:
    check_known(planned(0.002), 0.002)


def test_bands_at_gamma_are_the_known_ones() -> None:
    result = planned(0.01).frequencies(np.zeros(2), 9)
    assert (result[:3] < 20.0).all()
    known = np.array([39.67e3, 39.67e3, 108.45e3, 175.83e3, 175.83e3, 233.28e3])
    assert np.abs(result[3:] / known - 1.0).max() < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("design", [CELL, pytest.param(OBLONG, marks=pytest.mark.slow)], ids=["square", "oblong"])
def test_the_reduced_cell_has_the_bands_of_the_full_cell(design: Design) -> None:
    settings = HexSettings(order=3, size_m=4e-3, layers=0, pillar_size_m=6.3e-3)
    reduction = ReductionSettings(Interface(4, 3), mesh_rules.lattice_reduction(design, 0.01).top_hz, settings)
    whole, lattice = full(design, settings), reduced(design, reduction)
    for share in SHARES[1:]:
        k = wavevector(share, design)
        ours, truth = lattice.frequencies(k, 6), whole.frequencies(k, 6)
        assert np.abs(ours / truth - 1.0).max() < 1e-3, share


@pytest.mark.parametrize("route", [pytest.param("full", marks=pytest.mark.slow), "reduced"])
def test_the_bare_plate_carries_the_exact_lamb_and_shear_waves(route: str) -> None:
    bare = replace(OBLONG, pillar=None, rows=0)
    settings = HexSettings(order=4, size_m=2e-3, layers=0)
    if route == "full":
        bands, allowed = full(bare, settings).frequencies, 1e-3
    else:
        # the reduction may add as much again as it may differ from the full cell
        bands, allowed = reduced(bare, ReductionSettings(Interface(6, 3), 3e6, settings)).frequencies, 2e-3
    for share in SHARES[1:]:
        k = wavevector(share, bare)
        exact = folded_hz(k, Lattice.of_rows(3e-3, 4e-3), 2e-3, ALUMINIUM, 4)
        assert np.abs(bands(k, 4) / exact - 1.0).max() < allowed, share


def test_the_bands_are_periodic_and_even_in_the_wavevector() -> None:
    lattice = planned(0.01)
    k = wavevector((0.37, 0.81), CELL)
    around = np.array([2.0 * np.pi / CELL.pitch_x_m, 0.0])
    here = lattice.frequencies(k, 8)
    for same in (k + around, -k, k * np.array([1.0, -1.0]), k[::-1]):
        assert np.allclose(lattice.frequencies(same, 8), here, rtol=1e-7)
