"""Eigenvalues on a coarser mesh without a search for its modes, and a part's error bar, against modes searched there."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh

from geometry.hex.boxes import hex_mesh, interpolation, pillar_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Pillar
from geometry.materials import Material
from solvers.accuracy.mesh import (
    LAYER,
    SMOOTH,
    UNRESOLVED,
    CoarserMeshes,
    ErrorFractions,
    LowerOrders,
    Nested,
    clamped_shares,
    coarser_eigenvalues,
    layer_share,
    regular_share,
    rim_shares,
    smooth_half_width,
)
from solvers.fem.eigen import modes_in_band
from solvers.fem.solid import SolidModel

STEEL = Material.isotropic("steel", 210e9, 7850.0, 0.3)
PILLAR = Pillar("square", 2e-3, 2e-3, 6e-3, STEEL)
MESH = HexSettings(3, 2e-3, 1, 0.15, 1.5e-3)
BAND = (1e3, 450e3)


def boxes(settings: HexSettings):
    return pillar_boxes(PILLAR, settings)


def model(settings: HexSettings, clamped: tuple[str, ...] = ("touch",)) -> SolidModel:
    return SolidModel(hex_mesh(boxes(settings), settings.order), {"pillar": STEEL}, clamped, True)


def nested(settings: HexSettings, clamped: tuple[str, ...] = ("touch",)) -> Nested[SolidModel]:
    return Nested(model(settings, clamped), interpolation(boxes(settings), boxes(MESH), MESH.order, settings.order))


@pytest.mark.parametrize("clamped", [("touch",), ()])
@pytest.mark.parametrize("coarse", [MESH.coarser, replace(MESH, order=2)])
def test_modes_of_the_finer_mesh_tell_the_coarser_eigenvalues(coarse: HexSettings, clamped: tuple[str, ...]) -> None:
    fine, other = model(MESH, clamped), nested(coarse, clamped)
    pencil, pencil_below = fine.pencil("SA"), other.body.pencil("SA")
    modes = modes_in_band(pencil, *BAND)
    values = np.array([pencil.scale.eigenvalue(tone) for tone in modes.frequency_hz])
    estimate = pencil.scale.frequency(coarser_eigenvalues(pencil, pencil_below, other.transfer, modes.vectors, values))
    searched = modes_in_band(pencil_below, BAND[0], 1.02 * BAND[1]).frequency_hz[: len(estimate)]
    change = searched / modes.frequency_hz - 1.0
    assert len(estimate) and (change > -1e-9).all() and change.max() > 1e-5
    assert np.abs(estimate / searched - 1.0).max() < 5.0 * (change**2).max()  # to second order


@pytest.mark.parametrize("first", [40, 50])
def test_modes_that_stand_above_many_others_tell_the_coarser_eigenvalues_too(first: int) -> None:
    """A stiffer pencil over the same unknowns, among its modes some that are not asked for and change as much."""
    draw, dofs = np.random.default_rng(3), 120
    turn, _ = np.linalg.qr(draw.normal(size=(dofs, dofs)))
    values = np.geomspace(1.0, 1e4, dofs)
    added = turn @ (np.sqrt(values)[:, None] * draw.normal(size=(dofs, 6)))
    fine, coarse = (
        SimpleNamespace(
            stiffness=sp.csr_array((turn * values) @ turn.T + share * added @ added.T), mass=sp.eye_array(dofs, format="csr"),
            scale=SimpleNamespace(angular=1.0), free=np.ones(dofs, dtype=bool),
        )
        for share in (0.0, 0.003)
    )  # fmt: skip
    window = slice(first, 60)
    transfer = sp.eye_array(dofs // 3, format="csr")
    estimate = coarser_eigenvalues(fine, coarse, transfer, turn[:, window], values[window])  # type: ignore[arg-type]
    exact = np.linalg.eigvalsh(coarse.stiffness.toarray())[window]
    change = (exact / values[window] - 1.0).mean()
    assert change > 0.01 and np.abs(np.sort(estimate) / exact - 1.0).max() < 0.25 * change


@pytest.mark.slow
def test_the_bar_of_a_part_holds_the_finer_computation() -> None:
    meshes = CoarserMeshes(nested(MESH.coarser), nested(replace(MESH, order=2)), clamped_shares(STEEL, MESH))
    pencil = model(MESH).pencil("SA")
    modes = modes_in_band(pencil, *BAND)
    values = np.array([pencil.scale.eigenvalue(tone) for tone in modes.frequency_hz])
    taken, half_width = meshes.errors("SA", pencil, modes.vectors, values)
    finest = HexSettings(4, 1e-3, 2, 0.15, 1e-3)
    exact = modes_in_band(model(finest).pencil("SA"), *BAND).frequency_hz
    best = modes.frequency_hz * (1.0 - taken)
    assert (np.abs(best / exact - 1.0) <= half_width).all()
    assert (np.abs(best / exact - 1.0) < 0.7 * (modes.frequency_hz / exact - 1.0)).all()
    assert (
        half_width < 10.0 * np.abs(modes.frequency_hz / exact - 1.0)
    ).all()  # a bar that is always too wide is a fault


def test_shares_are_between_the_exponents_and_grow_with_the_contrast() -> None:
    soft, hard = Material.isotropic("soft", 3e9, 1200.0, 0.37), Material.isotropic("hard", 400e9, 19300.0, 0.28)
    light, even, heavy = (rim_shares(*pair, MESH) for pair in ((hard, soft), (STEEL, STEEL), (soft, hard)))
    assert light.correction < even.correction < heavy.correction and all(
        0.0 < each.uncertainty < each.correction for each in (light, even, heavy)
    )
    finer = rim_shares(STEEL, STEEL, replace(MESH, order=4))
    assert finer.correction < even.correction  # outer elements of order 4 leave less


@pytest.mark.parametrize("order", [3, 4])
def test_a_very_soft_pillar_has_the_share_of_a_clamped_one(order: int) -> None:
    """Motion along its rim is regular, and brings nothing of the layer's change; between, the share is between both."""
    mesh = replace(MESH, order=order)
    rubbers = [Material.isotropic("rubber", young_pa, 1200.0, 0.47) for young_pa in (1e5, 1e9)]
    soft, firmer = (rim_shares(STEEL, rubber, mesh).correction for rubber in rubbers)
    clamped = clamped_shares(rubbers[0], mesh).correction
    assert soft == pytest.approx(clamped, rel=1e-3) and firmer == pytest.approx(clamped, rel=0.02)


def test_nothing_singular_leaves_the_order_alone() -> None:
    layer, order = np.array([0.0, 0.0]), np.array([1e-3, -2e-3])
    assert ErrorFractions().half_width(layer, order) == pytest.approx(SMOOTH * np.abs(order))


def rod_hz(order: int, elements: int = 12) -> float:
    """The fifth frequency of a fixed rod of unit length, density and modulus over the exact one, by elements of an order."""
    points, weights = np.polynomial.legendre.leggauss(order + 2)
    nodes = np.linspace(-1.0, 1.0, order + 1)
    basis = [np.polynomial.Polynomial.fromroots(np.delete(nodes, i)) for i in range(order + 1)]
    basis = [one / one(nodes[i]) for i, one in enumerate(basis)]
    values, slopes = (np.array([one(points) for one in each]) for each in (basis, [one.deriv() for one in basis]))
    half = 0.5 / elements
    stiffness, mass = (np.zeros((order * elements + 1,) * 2) for _ in range(2))
    for element in range(elements):
        own = np.ix_(*(2 * [order * element + np.arange(order + 1)]))
        stiffness[own] += (slopes * weights) @ slopes.T / half
        mass[own] += (values * weights) @ values.T * half
    inside = slice(1, -1)
    return float(np.sqrt(eigh(stiffness[inside, inside], mass[inside, inside], eigvals_only=True)[4]) / (5.0 * np.pi))


@pytest.mark.parametrize("order", [2, 3, 4])
def test_what_an_order_misses_of_a_rod_is_what_the_order_below_tells(order: int) -> None:
    """An even mesh misses C_p (k h)^2p and higher powers of k h, here 1.3; of a motion that is badly resolved as a whole the
    law tells as many times more as half of the energy alone would be off by.
    """
    missed = rod_hz(order) - 1.0
    told = smooth_half_width(np.array([rod_hz(order - 1) - 1.0 - missed]), 0.0, order)[0]
    assert told * UNRESOLVED ** (1.0 / (order - 1)) == pytest.approx(missed, rel=0.25)
    assert missed < told < 3.0 * missed


def test_short_waves_widen_the_bar_of_a_part_and_of_a_cell() -> None:
    none, change = np.zeros(3), np.array([1e-3, 1e-2, 1e-1])
    for shares in (rim_shares(STEEL, STEEL, MESH), clamped_shares(STEEL, MESH)):
        bars = shares.half_width(none, change)
        assert bars[0] == pytest.approx(shares.smooth * 1e-3) and bars[2] > 2.0 * shares.smooth * 0.1
        assert bars[2] == pytest.approx(smooth_half_width(change, 0.0, MESH.order)[2])


def test_a_plate_longer_in_its_elements_than_thick_counts_less_of_its_last_order() -> None:
    """Order two locks there: of a plate of 2 mm in elements of 4 mm half of what order three brought is waves'."""
    none, change = np.zeros(1), np.array([0.1])
    even = HexSettings(3, 4e-3)
    thick, thin = (clamped_shares(STEEL, even, thickness_m=t).half_width(none, change) for t in (5e-3, 2e-3))
    assert thin == pytest.approx(0.5**1.5 * thick) and thick == pytest.approx(smooth_half_width(change, 0.0, 3))


def test_a_layer_at_a_pillars_foot_brings_its_smooth_end_where_elements_are_as_high_as_it_is_wide() -> None:
    """Midway between what is left of the share in stretching and in bending; elements of order four resolve the end anyway."""
    wide, narrow = (clamped_shares(STEEL, MESH, width_m=width) for width in (1e3 * MESH.size_m, MESH.pillar_size_m))
    assert narrow.correction / wide.correction == pytest.approx((0.9 + 1.0 / 1.54) / 1.9, rel=1e-6)
    assert narrow.uncertainty == wide.uncertainty == clamped_shares(STEEL, MESH).uncertainty
    joint = ((STEEL, pi), (STEEL, pi / 2.0))  # its rim has no such end
    assert clamped_shares(STEEL, MESH, joint, width_m=1e-3) == clamped_shares(STEEL, MESH, joint)
    finer = replace(MESH, order=4)
    assert clamped_shares(STEEL, finer, width_m=1e-3) == clamped_shares(STEEL, finer)


def test_a_mode_to_which_the_last_order_brought_nothing_has_half_the_bar_of_lower_ones() -> None:
    """Whatever the order of the modes; what the edge has is each mode's own, and no higher mode widens a lower one's bar."""
    shares, none = ErrorFractions(order=3), np.zeros(3)
    changes, values = np.array([5e-2, 0.0, 1e-3]), np.array([2.0, 3.0, 1.0])
    own = shares.smooth_part(none, changes)
    assert shares.of_modes(values, none, changes) == pytest.approx([own[0], 0.5 * own[0], own[2]])
    foot = rim_shares(STEEL, STEEL, MESH)
    layer = np.array([0.0, 0.0, 1e-2])
    assert foot.of_modes(values, layer, foot.edge * layer) == pytest.approx(foot.half_width(layer, foot.edge * layer))


def test_what_the_layer_brings_beyond_the_edges_part_is_doubted() -> None:
    """The order's change bounds what of the layer's is the edge's; half of the share of the rest counts, at a foot alone."""
    foot = rim_shares(STEEL, STEEL, MESH)
    layer, order = np.array([1e-2, 1e-2, 1e-2]), np.array([2.0, 1.0, 0.25]) * foot.edge * 1e-2
    plain = replace(foot, doubt=0.0).half_width(layer, order)
    assert foot.half_width(layer, order) - plain == pytest.approx(0.5 * foot.correction * np.array([0.0, 0.0, 0.75e-2]))
    clamped = clamped_shares(STEEL, MESH)
    assert clamped.half_width(layer, order) == pytest.approx(replace(clamped, doubt=0.0).half_width(layer, order))


def test_a_layer_leaves_what_polynomials_leave_of_its_strain() -> None:
    """Best approximations of exp(-a s) in the mean square by polynomials, from Gauss points."""
    points, weights = np.polynomial.legendre.leggauss(40)
    for reach, order, steps in ((0.8, 3, 1), (2.1, 4, 1), (4.2, 4, 2)):
        strain = np.exp(-reach * points)

        def missed(degrees: int, strain=strain) -> float:
            table = np.polynomial.legendre.legvander(points, degrees - 1)
            fit = table @ (np.linalg.solve(table.T @ (weights[:, None] * table), table.T @ (weights * strain)))
            return float(weights @ (strain - fit) ** 2)

        left, before = missed(order), missed(order - steps)
        assert layer_share(reach, order, steps) == pytest.approx(left / (before - left), rel=1e-6)


def test_one_element_across_hides_what_the_last_order_did_not_serve() -> None:
    """Where the last order brought nothing, the last two tell."""
    lower = LowerOrders(None, None, 4, 0.5, 1.0)  # type: ignore[arg-type]
    assert lower.half_width(np.zeros(1), np.full(1, 1e-2)) == pytest.approx(1e-2 * layer_share(LAYER, 4, 2))
    change = np.full(1, 1e-5)
    assert lower.half_width(change, change) > regular_share(4) * change


def test_any_rim_may_have_all_of_the_change_and_a_section_beside_the_foot_hides_half_of_it() -> None:
    soft = Material.isotropic("soft", STEEL.as_isotropic.young_pa / 50.0, 1200.0, 0.38)
    flush = ((STEEL, np.pi / 2.0), (soft, np.pi / 2.0))
    foot, both = rim_shares(STEEL, STEEL, MESH), rim_shares(STEEL, STEEL, MESH, flush)
    assert both.correction != foot.correction
    assert abs(foot.correction - both.correction) < both.uncertainty > foot.uncertainty
    far, beside = (rim_shares(STEEL, STEEL, MESH, flush, step_m=share * MESH.size_m) for share in (0.6, 0.1))
    assert far == both and beside.uncertainty == pytest.approx(both.uncertainty + both.correction)
