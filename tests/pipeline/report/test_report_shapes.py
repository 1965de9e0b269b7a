"""Surfaces made coarser, quarters found, numbers packed; the shapes and diagrams that a page is given."""

from __future__ import annotations

import base64
import shutil
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geometry.decimation import coarse, with_sides
from geometry.lattice import Lattice
from pipeline.records import store
from pipeline.records.study import read_study
from pipeline.report import shapes
from solvers.fem.surface import Skin
from tests.helpers import synthetic

LOW, HIGH = np.array([0.0, 0.0, 0.0]), np.array([0.02, 0.01, 0.002])


def area(points: np.ndarray, facets: np.ndarray) -> float:
    corners = points[facets]
    cross = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
    three = facets[:, -1] == facets[:, -2]
    cross[three] = np.cross(corners[three, 1] - corners[three, 0], corners[three, 2] - corners[three, 0])
    return float(np.linalg.norm(cross, axis=1).sum() / 2.0)


@pytest.mark.parametrize("triangles", [False, True])
def test_a_coarse_box_keeps_its_edges_and_its_area(triangles: bool) -> None:
    points, quads = synthetic.box(LOW, HIGH, (40, 20, 8))
    facets = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]) if triangles else quads
    kept, small = coarse(points, facets, 400)
    assert 100 < len(kept) <= 400 and small.max() < len(kept)
    np.testing.assert_allclose([points[kept].min(axis=0), points[kept].max(axis=0)], [LOW, HIGH], atol=1e-12)
    assert area(points[kept], small) == pytest.approx(area(points, facets), rel=0.02)


def test_an_open_surface_keeps_its_rim() -> None:
    flat, quads = synthetic.grid(np.linspace(0.0, 0.02, 41), np.linspace(0.0, 0.01, 21))
    points = np.column_stack([flat, np.zeros(len(flat))])
    kept, small = coarse(points, quads, 100)
    assert area(points[kept], small) == pytest.approx(2e-4, rel=1e-9)


def test_a_plate_open_at_its_sides_is_closed_at_the_outer_ones() -> None:
    points, quads = synthetic.box(LOW - [0.01, 0.005, 0.0], HIGH - [0.01, 0.005, 0.0], (8, 4, 2))
    level = points[quads][:, :, 2]
    flat = quads[np.ptp(level, axis=1) < 1e-12]  # touch face and back alone
    closed = with_sides(points, flat, 0.002)
    assert len(closed) == len(flat) + 2 * (8 + 4)
    assert area(points, closed) == pytest.approx(2 * (0.02 * 0.01 + 0.02 * 0.002 + 0.01 * 0.002))
    three = np.concatenate([flat[:, [0, 1, 2]], flat[:, [0, 2, 3]]])
    assert area(points, with_sides(points, three, 0.002)) == pytest.approx(area(points, closed))
    np.testing.assert_array_equal(with_sides(points, flat, 0.003), flat)  # nothing stands above the lower rim


def test_what_is_coarse_enough_only_loses_its_doubles() -> None:
    points, quads = synthetic.box(LOW, HIGH, (4, 3, 2))
    kept, small = coarse(points, quads, 10_000)
    assert len(kept) == len(np.unique(points, axis=0)) < len(points) and len(small) == len(quads)
    np.testing.assert_array_equal(points[kept][small], points[quads])


def unfolded(symmetry: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    points, quads = synthetic.box(LOW, HIGH, (4, 3, 2))
    u = np.random.default_rng(3).normal(size=(1, len(points), 3)).astype(np.float32)
    skin = Skin(points, quads, u).unfolded(symmetry)
    return skin.points, skin.facets, skin.displacement


@pytest.mark.parametrize("symmetry", ["SS", "AS", "SA", "AA"])
def test_an_unfolded_skin_is_sent_as_its_quarter_and_drawn_whole(symmetry: str) -> None:
    points, facets, u = unfolded(symmetry)
    arrays = {"surface_points": points, "surface_u": u, "surface_symmetry": np.array([symmetry])}
    first, few, small, copies = shapes.quarter(arrays, facets, 4)
    assert 4 * len(first) == len(points) and 4 * len(few) == len(facets) and len(copies) == 1
    mirrored = np.concatenate([first * image["flip"] for image in copies[0]])
    moved = np.concatenate([image["parity"] * small[0] * image["flip"] for image in copies[0]])
    np.testing.assert_allclose(mirrored, points)
    np.testing.assert_allclose(moved, u[0])


@pytest.mark.parametrize("symmetry", [{}, {"surface_symmetry": np.array([""])}])
def test_a_shape_without_mirrors_is_sent_whole(symmetry: dict[str, np.ndarray]) -> None:
    points, facets, u = unfolded("SS")
    first, few, small, copies = shapes.quarter({"surface_points": points, "surface_u": u} | symmetry, facets, 4)
    assert few is facets and first.shape == points.shape and small.shape == u.shape
    assert copies == [[{"flip": [1, 1, 1], "parity": 1}]]


def unpacked(text: str, columns: int, kind: str) -> np.ndarray:
    """What unpack.js makes of packed rows."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(np.dtype(kind).itemsize, -1)
    return np.ascontiguousarray(planes.T).view(kind).reshape(columns, -1).T.astype(float)


def test_numbers_come_back_within_a_step() -> None:
    gallery = shapes.Gallery()
    points, quads = synthetic.box(LOW, HIGH, (4, 3, 2))
    u = np.random.default_rng(4).normal(size=points.shape)
    body = gallery.add_body(points, quads, 1e-3)
    gallery.add_shape(body, u, {"name": "n"}, [])
    stored, shape = gallery.bodies[0], gallery.shapes[0]
    steps = unpacked(stored["points"], 3, "<u2")
    np.testing.assert_allclose(np.array(stored["low"]) + steps / 65535 * stored["span"], points, atol=1e-6)
    np.testing.assert_array_equal(np.cumsum(unpacked(stored["facets"], 4, "<u2"), axis=0) % 2**16, quads)
    moved = unpacked(shape["re"], 3, "<i2") / 32767
    np.testing.assert_allclose(moved * np.abs(u).max(), u, atol=1e-4)
    assert "im" not in shape and shape["normal"] == pytest.approx(np.abs(u[:, 2]).max() / np.abs(u).max(), rel=1e-3)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return synthetic.put_study(tmp_path_factory.mktemp("shapes") / "rows", pitches=(0.004,), rows=(1, 2))


def test_a_page_shows_the_best_plate_with_neighbours_and_the_others_target_modes(study: Path) -> None:
    cases = [case for case in read_study(study).cases if case.record.status == "OK"]
    gallery = shapes.plates(cases, cases[1], {cases[1].case_id: "case-2-moving_plate"})
    assert [shape["group"] for shape in gallery["shapes"]].count(cases[0].case_id) == 1
    assert gallery["shapes"][0]["group"] == cases[1].case_id and "target" in gallery["shapes"][0]["name"]
    assert gallery["shapes"][0]["still"] == "case-2-moving_plate" and "16.0 dB" in gallery["shapes"][0]["about"]
    assert len(gallery["shapes"]) <= shapes.MAX_SHAPES


def test_a_long_study_stays_light(study: Path) -> None:
    case = next(case for case in read_study(study).cases if case.record.status == "OK")
    names = [f"c{number}" for number in range(30)]
    many = [replace(case, record=case.record.model_copy(update={"case_id": name})) for name in names]
    gallery = shapes.plates(many, many[7], {})
    assert len(gallery["shapes"]) == shapes.MAX_SHAPES and gallery["shapes"][0]["group"] == "c7"


def test_cases_with_the_same_bands_share_a_diagram(study: Path) -> None:
    stored = read_study(study)
    result = shapes.diagrams(stored, stored.cases[1])
    assert len(result["cells"]) == 1 and result["cells"][0]["name"] == "array pitch (mm) = 4, 2 plates"
    cell = result["cells"][0]
    assert cell["kind"] is None and cell["pillar"] is None and "shapes" not in cell  # a record of an older version
    assert cell["gaps"][0]["lower_hz"] == 163100.0 and cell["target_hz"] == 31500.0
    assert len(cell["arc"]) == len(cell["hz"]) == 76 and [x for x in cell["labels"] if x] == ["G", "X", "M", "G"]


def test_tiles_carry_the_bloch_phase() -> None:
    tiles = shapes._tiles(np.array([np.pi / 0.004, 0.0]), Lattice.of_rows(0.004, 0.005))
    phase = {tuple(np.sign(tile["offset"][:2])): tile["phase"] for tile in tiles}
    assert phase[1.0, 1.0] - phase[-1.0, 1.0] == pytest.approx(np.pi)  # neighbours along x move against each other
    assert phase[1.0, 1.0] == pytest.approx(phase[1.0, -1.0])
    assert {tile["offset"][1] for tile in tiles} == {-0.0025, 0.0025}


def test_torn_arrays_leave_the_others_shapes(study: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(study, tmp_path / "rows"))
    (copy / "pitch_mm=4,rows=2" / store.ARRAYS).write_bytes(b"PK torn")
    cases = [case for case in read_study(copy).cases if case.record.status == "OK"]
    gallery = shapes.plates(cases, cases[1], {})
    assert {shape["group"] for shape in gallery["shapes"]} == {"pitch_mm=4,rows=1"}
