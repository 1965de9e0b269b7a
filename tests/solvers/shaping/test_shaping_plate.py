"""Plates as modal tables: a simply supported plate in closed form, and a plate with pillars from its reduced cells."""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest

from geometry.hex.boxes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from geometry.patches import Patches
from geometry.piezo_materials import PIEZO_MATERIALS
from solvers.errors import SolverError
from solvers.fem.eigen import modes_in_band
from solvers.measures.confinement import TouchField
from solvers.shaping.hybrid import attach_oscillators, confinement
from solvers.shaping.modal_table import ModalTable, field_matrix, sensor_matrix
from solvers.shaping.mode_pairs import travelling_pair
from solvers.shaping.plate_table import composite_tables, laplacian_integrals, mass_normalised, plate_table, whole_touch
from solvers.superelement.build import PlateModel, Reductions, ReductionSettings
from solvers.superelement.interface import Interface

ALUMINIUM = MATERIALS["aluminium"]
SIDE = (0.12, 0.09)
THICK = 2e-3
ORDERS = [(m, n) for m in range(1, 7) for n in range(1, 5)]


def patches(centres: list[tuple[float, float]], sensors: tuple[int, ...] = (), size: float = 12e-3) -> Patches:
    return Patches(
        PIEZO_MATERIALS["pz26"],
        (size, size, 0.3e-3),
        "back",
        "centres",
        tuple(centres),
        (size,) * len(centres),
        sensors,
        1.0,
    )


def supported_plate() -> tuple[np.ndarray, TouchField]:
    """Frequencies and mass-normalised shapes 2/sqrt(M) sin sin of a simply supported plate centred at 0."""
    x, y = (np.linspace(-side / 2, side / 2, count) for side, count in zip(SIDE, (121, 91), strict=True))
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    surface = ALUMINIUM.density_kg_m3 * THICK
    rigidity = ALUMINIUM.young_pa * THICK**3 / 12 / (1 - ALUMINIUM.poisson**2)
    waves = [(m * pi / SIDE[0], n * pi / SIDE[1]) for m, n in ORDERS]
    frequencies = np.array([(k**2 + q**2) * np.sqrt(rigidity / surface) / (2 * pi) for k, q in waves])
    scale = 2 / np.sqrt(surface * SIDE[0] * SIDE[1])
    shapes = [
        scale * np.sin(k * (points[:, 0] + SIDE[0] / 2)) * np.sin(q * (points[:, 1] + SIDE[1] / 2)) for k, q in waves
    ]
    weights = np.full(len(points), SIDE[0] * SIDE[1] / len(points))
    order = np.argsort(frequencies)
    return frequencies[order], TouchField(points, weights, np.array(shapes).T[:, order])


def exact_integrals(boxes: np.ndarray) -> np.ndarray:
    """-(k^2 + q^2) times the integral of sin sin over each box, in the order of rising frequency."""
    frequencies, _ = supported_plate()
    surface = ALUMINIUM.density_kg_m3 * THICK
    rows = []
    for m, n in ORDERS:
        k, q = m * pi / SIDE[0], n * pi / SIDE[1]
        edges = boxes + np.array([SIDE[0], SIDE[0], SIDE[1], SIDE[1]]) / 2
        along = (np.cos(k * edges[:, 0]) - np.cos(k * edges[:, 1])) / k
        across = (np.cos(q * edges[:, 2]) - np.cos(q * edges[:, 3])) / q
        rows.append(-(k**2 + q**2) * along * across)
    waves = np.array([(m / SIDE[0]) ** 2 + (n / SIDE[1]) ** 2 for m, n in ORDERS])
    assert len(frequencies) == len(waves)
    return 2 / np.sqrt(surface * SIDE[0] * SIDE[1]) * np.array(rows)[np.argsort(waves)]


def test_patches_feel_the_curvature_under_them():
    _, touch = supported_plate()
    boxes = patches([(0.0, 0.0), (0.03, -0.02), (-0.05, 0.03)]).boxes_m()
    exact = exact_integrals(boxes)
    assert laplacian_integrals(touch.points, touch.values, boxes) == pytest.approx(
        exact, abs=1e-4 * np.abs(exact).max()
    )
    with pytest.raises(SolverError, match=r"patch 1: \d+ points of the field around it, 56 are needed"):
        laplacian_integrals(touch.points[::40], touch.values[::40], boxes)


def test_forces_and_voltages_of_a_patch_are_the_thin_plates():
    """Moment of a biaxially held patch times the exact curvature under it; charge over the clamped capacitance."""
    frequencies, touch = supported_plate()
    placed = patches([(0.0, 0.0), (0.03, -0.02)], sensors=(1,))
    table = plate_table(frequencies, touch, placed, THICK, inf)
    piezo = placed.material
    plane_stress = np.linalg.inv(np.array([[piezo.s11, piezo.s12], [piezo.s12, piezo.s11]]))
    moment = abs(plane_stress @ np.array([piezo.d31, piezo.d31]))[0] * (THICK + 0.3e-3) / 2
    exact = exact_integrals(placed.boxes_m())
    assert np.abs(table.actuators[:, 0]) == pytest.approx(
        np.abs(moment * exact[:, 0]), abs=1e-4 * moment * np.abs(exact).max()
    )
    strain = np.array([piezo.d31, piezo.d31])
    clamped = 1330 * 8.8541878128e-12 - strain @ plane_stress @ strain
    charge = moment * exact[:, 1]
    capacitance = clamped * 12e-3**2 / 0.3e-3
    assert np.abs(table.sensors[:, 0]) == pytest.approx(
        np.abs(charge / capacitance), abs=1e-4 * np.abs(charge / capacitance).max()
    )
    both = plate_table(frequencies, touch, patches([(0.0, 0.0), (0.03, -0.02)]), THICK, 100.0)
    matrix = sensor_matrix(both, 5000.0)
    assert matrix == pytest.approx(matrix.T) and (np.diag(sensor_matrix(both, 1.0)).real > 0.0).all()


def test_images_of_a_class_are_the_whole_plate():
    frequencies, whole = supported_plate()
    quarter = (whole.points > -1e-12).all(axis=1)
    for mode, symmetry in ((0, "SS"), (1, "AS")):
        flips = [(1.0, "S"), (-1.0, "A")]
        signs = "".join(
            next(
                name
                for sign, name in flips
                if np.allclose(
                    _mirrored(whole, mode, axis), sign * whole.values[:, mode], atol=1e-9 * np.abs(whole.values).max()
                )
            )
            for axis in (0, 1)
        )
        assert signs == symmetry
        part = TouchField(whole.points[quarter], whole.weights[quarter], whole.values[quarter][:, [mode]])
        images = whole_touch(part, symmetry)
        for point, value in zip(images.points[::97], images.values[::97, 0], strict=True):
            nearest = np.argmin(np.abs(whole.points - point).sum(axis=1))
            assert value == pytest.approx(whole.values[nearest, mode], abs=1e-9 * np.abs(whole.values).max())
        assert images.weights.sum() == pytest.approx(part.weights.sum())
    with pytest.raises(SolverError, match="symmetry 'S': must be two letters"):
        whole_touch(whole, "S")
    assert len(frequencies) == len(ORDERS)


def _mirrored(touch: TouchField, mode: int, axis: int) -> np.ndarray:
    grid = touch.values[:, mode].reshape(121, 91)
    return np.flip(grid, axis).ravel()


def table_of(quality: float = 200.0) -> ModalTable:
    """The supported plate under six patches."""
    frequencies, touch = supported_plate()
    places = [(x, y) for x in (-0.04, 0.0, 0.04) for y in (-0.022, 0.018)]
    return plate_table(frequencies, touch, patches(places), THICK, quality)


def test_classes_join_into_one_table_in_ascending_order():
    table = table_of()
    first, second = (
        replace(
            table,
            **{
                name: getattr(table, name)[half]
                for name in ("frequencies_hz", "quality", "actuators", "sensors", "field")
            },
        )
        for half in (slice(1, None, 2), slice(0, None, 2))
    )
    joined = composite_tables([first, second])
    assert (joined.frequencies_hz == table.frequencies_hz).all() and (joined.field == table.field).all()
    with pytest.raises(SolverError, match="must share their points"):
        composite_tables([first, replace(second, points_m=second.points_m + 1.0)])
    with pytest.raises(SolverError, match="no class to join"):
        composite_tables([])


def test_a_wave_travels_along_the_middle_of_a_plate():
    """Modes (4, 1) and (5, 1) a quarter period apart; each alone stands."""
    table = table_of()
    orders = sorted(ORDERS, key=lambda one: (one[0] / SIDE[0]) ** 2 + (one[1] / SIDE[1]) ** 2)
    line = (np.abs(table.points_m[:, 1]) < 1e-9) & (np.abs(table.points_m[:, 0]) < 0.02)
    pair = travelling_pair(table, (orders.index((4, 1)), orders.index((5, 1))), line, others=0.01)
    alone = field_matrix(table, pair.frequency_hz)[:, 0]
    assert pair.twr > 0.5 > 5 * _ratio(np.abs(alone[line]))
    assert pair.wavenumber == pytest.approx(4.5 * pi / SIDE[0], rel=0.15)


def _ratio(size: np.ndarray) -> float:
    return float(2 * size.min() / (size.max() + size.min()))


def test_resonators_beside_a_zone_and_patches_hold_a_plate_together():
    table = table_of()
    inside = np.abs(table.points_m[:, 1]) < 0.02
    rows = np.flatnonzero(np.isclose(np.abs(table.points_m[:, 1]), 0.024) & (np.abs(table.points_m[:, 0]) < 0.055))[::6]
    frequency = 3000.0
    passive = attach_oscillators(table, rows, 2e-4, frequency, 200.0)
    bare, with_rows = (confinement(one, frequency, inside, 2) for one in (table, passive))
    assert bare.shaped_db > bare.alone_db + 3.0 and with_rows.shaped_db > with_rows.alone_db + 3.0
    assert with_rows.shaped_db > bare.shaped_db


PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
PILLARED = Design(60e-3, 20e-3, 2e-3, 4, ALUMINIUM, PILLAR, 4e-3, 4e-3, 2, 6e-3)
BARE = replace(PILLARED, pillar=None, rows=0, extension_m=PILLARED.half_span_m - PILLARED.width_m / 2)
PLACES = [(x, 0.0) for x in (-24e-3, -8e-3, 8e-3, 24e-3)] + [
    (x, y) for x in (-16e-3, 16e-3) for y in (-22.5e-3, 22.5e-3)
]


def solved_plate(design: Design) -> tuple[ModalTable, np.ndarray]:
    """The free plate to 45 kHz from reduced cells, four patches in the zone and four beyond the pillars; area weights."""
    settings = HexSettings(order=3, size_m=4e-3, layers=0, pillar_size_m=6.3e-3)
    reduction = ReductionSettings(Interface(3, 2), 90e3, settings, max_edge_m=4e-3)
    model = PlateModel(design, Reductions(design.thickness_m, ALUMINIUM, design.pillar, reduction))
    placed = Patches(
        PIEZO_MATERIALS["pz26"], (6e-3, 3e-3, 0.3e-3), "back", "centres", tuple(PLACES), (6e-3,) * 8, (), 1.0
    )
    tables, weights = [], np.zeros(0)
    for symmetry in ("SS", "SA", "AS", "AA"):
        pencil = model.pencil(symmetry)
        modes = modes_in_band(pencil, 1e3, 45e3)
        touch = mass_normalised(whole_touch(model.assembled(symmetry).touch(modes.vectors), symmetry), pencil.scale)
        tables.append(plate_table(modes.frequency_hz, touch, placed, design.thickness_m, 300.0))
        weights = touch.weights
    return composite_tables(tables), weights


@pytest.mark.slow
def test_pillars_and_patches_on_a_plate_of_reduced_cells():
    """Modal masses, reciprocity, confinement by both together, and a wave inside the zone of a pillared plate."""
    (passive, weights), (bare, bare_weights) = solved_plate(PILLARED), solved_plate(BARE)
    surface = ALUMINIUM.density_kg_m3 * THICK
    bending = surface * bare.field**2 @ bare_weights  # the rest of a mode's unit mass moves in the plane
    assert bending.max() < 1.0 and np.sort(bending)[-10:].min() > 0.95
    matrix = sensor_matrix(passive, 33e3)
    assert np.abs(matrix - matrix.T).max() < 1e-9 * np.abs(matrix).max()
    inside, bare_inside = (np.abs(one.points_m[:, 1]) < PILLARED.width_m / 2 for one in (passive, bare))
    energy = passive.field**2 * weights
    share = energy[:, inside].sum(axis=1) / energy.sum(axis=1)
    wanted = int(np.argmax(share))
    frequency = float(passive.frequencies_hz[wanted])
    both = confinement(passive, frequency, inside, 1, weights)
    neither = confinement(bare, frequency, bare_inside, 1, bare_weights)
    assert neither.alone_db < neither.shaped_db < both.shaped_db
    assert neither.alone_db < both.alone_db < both.shaped_db
    assert both.alone_db > 10.0
    line = (np.abs(passive.points_m[:, 1]) < 1.2e-3) & (np.abs(passive.points_m[:, 0]) < 15e-3)
    clamped = np.flatnonzero(share > 0.8)
    pairs = [travelling_pair(passive, (wanted, int(n)), line, others=0.01) for n in clamped if n != wanted]
    best = max(pairs, key=lambda pair: pair.twr * (pair.wavenumber > 1.0))
    alone = _ratio(np.abs(field_matrix(passive, best.frequency_hz)[line, 1]))
    assert best.wavenumber > 1.0 and best.twr > 0.5 and best.twr > 3.0 * alone
