"""What a case keeps on disk: quarters and integers that unfold to what pictures read, cells within a budget, and fields."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.batch import case_study
from pipeline.case.model import load_case
from pipeline.cli.main import main
from pipeline.logs import RunLog, TerminalLog
from pipeline.models import mode_fields, modes
from pipeline.models.cell_cache import MatrixCache
from pipeline.paths import STUDIES
from pipeline.planning.model_choice import Request
from pipeline.records import record, store
from pipeline.records.record import Record
from pipeline.records.study import StoredCase
from pipeline.records.surface_codec import folded, from_steps, in_steps, scaled, surface_arrays, touch_arrays, unfolded
from solvers.fem.surface import Skin

pytestmark = pytest.mark.usefixtures("coarsest_cells")
CASE = str(STUDIES / "three-rows.toml")
SMALL = [
    "zone.length_mm=40", "zone.nodal_lines=4", "zone.width_mm=16", "array.extension_mm=10", "solve.accuracy=0.05",
    "patches.centres_mm=[[0.0,0.0]]", "patches.sensors=[]", "patches.size_mm=[4.0,3.0,0.3]", "bands.points=5",
]  # fmt: skip
SETS = [part for text in SMALL for part in ("--set", text)]
BYTES_A_CASE = 1_000_000  # a thousand cases in 1 GB
THESIS_POINTS = 25_500  # of the skin of the quarter of the plate with three rows and 25 mm


def quarter(seed: int) -> Skin:
    """Two faces of a box's quarter, points with 0 <= x, y."""
    line = np.linspace(0.0, 1e-2, 6)
    grid = np.array([[x, y, z] for z in (0.0, 2e-3) for x in line for y in line])
    facets = [[i, i + 1, i + 7, i + 6] for i in range(29) if i % 6 < 5]
    both = np.array([*facets, *(np.array(facets) + 36)])
    return Skin(grid, both, np.random.default_rng(seed).normal(size=(1, len(grid), 3)))


def test_steps_keep_a_number_to_half_a_step() -> None:
    values = np.concatenate([np.random.default_rng(1).uniform(-1.0, 1.0, 1000), [-1.0, 0.0, 1.0]])
    back = from_steps(in_steps(values))
    assert np.abs(back - values).max() <= 0.5000001 / 4095
    assert back[-3:].tolist() == [-1.0, 0.0, 1.0]


@pytest.mark.parametrize("symmetries", [("SS",), ("AS", "SA"), ("AA", "SS", "SA"), (None,)])
def test_what_was_folded_unfolds_to_the_whole_plate(symmetries: tuple[str | None, ...]) -> None:
    skins = [quarter(seed) for seed in range(len(symmetries))]
    result = unfolded(folded(skins, symmetries, np.arange(1.0, 1.0 + len(skins))))
    whole = [skin.unfolded(symmetry) for skin, symmetry in zip(skins, symmetries, strict=True)]
    expected = surface_arrays(whole) | touch_arrays(whole)
    assert set(expected) <= set(result) and result["surface_frequency_hz"].tolist() == [
        1.0 + i for i in range(len(skins))
    ]
    for name, array in expected.items():
        np.testing.assert_allclose(result[name], array, atol=1.3e-4 if array.dtype.kind == "f" else 0)
    np.testing.assert_allclose(result["mesh_points"], skins[0].points, atol=1e-8)
    assert np.abs(result["surface_u"]).max() == 1.0 == np.abs(scaled(skins[0].displacement)).max()


def test_arrays_that_were_never_folded_stay_as_they_are() -> None:
    arrays = {"surface_points": np.zeros((3, 3)), "response_xy": np.zeros((2, 2))}
    assert unfolded(arrays) is arrays


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small case as a study computes it, modes and bands, with every field on demand."""
    folder = tmp_path_factory.mktemp("case")
    case = load_case(CASE, SMALL)
    payload = {"case": case.to_dict(), "overrides": SMALL, "measure": ["modes", "bands"], "fields": True}
    with RunLog(folder / store.RUN_LOG) as log:
        result = case_study.compute(CASE, payload, folder, log)
    store.seal(folder, Record.of_case(result, case_id=folder.name, status="OK").to_dict())
    return folder


@pytest.mark.slow
def test_a_thousand_cases_stay_under_a_gigabyte(computed: Path) -> None:
    """Bytes of a small case, and of its moving skin a point: four shapes, points, facets."""
    kept = sum(path.stat().st_size for path in computed.iterdir() if path.name != store.FIELDS)
    points = len(store.load_arrays(computed)["folded_points"])
    with np.load(computed / store.ARRAYS) as file:
        alone = {name: file[name] for name in file.files if name.startswith(("folded_", "surface_"))}
    store.save_arrays(computed, alone, "alone.npz")
    skin = (computed / "alone.npz").stat().st_size
    (computed / "alone.npz").unlink()
    assert kept - skin + THESIS_POINTS * skin / points < BYTES_A_CASE
    assert "surface_u" not in store.load_arrays(computed)


@pytest.mark.slow
def test_a_stored_case_unfolds_for_its_pictures(computed: Path) -> None:
    arrays = StoredCase(computed, record.read(computed)).arrays()
    assert arrays["surface_u"].shape[0] == 4 and len(arrays["surface_points"]) == 4 * len(arrays["mesh_points"])
    assert {"touch_xy", "touch_triangles", "touch_uz", "mesh_quads", "surface_quads"} <= arrays.keys()
    assert not [name for name in arrays if name.startswith("folded_")]


@pytest.mark.slow
def test_fields_on_demand_hold_every_mode_and_no_less(computed: Path) -> None:
    stored = record.read(computed)
    with np.load(computed / store.FIELDS) as file:
        tones, moved = file["frequency_hz"], file["displacement"]
        assert tones.tolist() == [mode.frequency_hz for mode in stored.modes.modes]
        assert moved.shape == (len(tones), len(file["points"]), 3) and moved.dtype == np.float64
        target = moved[stored.target.index]
    kept = from_steps(store.load_arrays(computed)["folded_u"][0])
    np.testing.assert_allclose(kept, scaled(target), atol=1.3e-4)


@pytest.mark.slow
def test_a_case_keeps_no_fields_unless_asked(tmp_path: Path) -> None:
    case = load_case(CASE, [*SMALL, "array.rows=0"])
    payload = {"case": case.to_dict(), "overrides": [*SMALL, "array.rows=0"], "measure": ["modes"]}
    with RunLog(tmp_path / store.RUN_LOG) as log:
        case_study.compute(CASE, payload, tmp_path, log)
    assert not (tmp_path / store.FIELDS).exists() and (tmp_path / store.ARRAYS).exists()


@pytest.mark.slow
def test_modes_write_fields_where_they_are_asked_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part = (
        "modes",
        CASE,
        "--part",
        "pillar",
        "--count",
        "2",
        "--quiet",
        "--set",
        "solve.accuracy=0.1",
        "--save-all-fields",
    )
    assert main([*part]) == 2
    assert "--out" in capsys.readouterr().err
    assert main([*part, "--out", str(tmp_path)]) == 0
    with np.load(tmp_path / store.FIELDS) as file:
        assert file["displacement"].shape[0] == 2 and set(file["symmetry"]) == {"SA", "AS"}


@pytest.mark.slow
def test_pictures_and_commands_read_the_same_arrays() -> None:
    """plate_arrays, which shows a mode at once, is what a record unfolds to."""
    case = load_case(CASE, [*SMALL, "array.rows=0"])
    result = modes.solve_modes(case, Request("plate", near_hz=30e3, count=2, symmetry="SS"), TerminalLog(True))
    direct, stored = mode_fields.plate_arrays(result, [0, 1]), unfolded(mode_fields.kept_arrays(result, [0, 1]))
    assert direct.keys() == stored.keys()
    assert all(np.array_equal(direct[name], stored[name]) for name in direct)


def test_a_matrix_is_kept_to_the_last_digit(tmp_path: Path) -> None:
    matrix = np.random.default_rng(2).normal(size=(7, 7))
    cache = MatrixCache(tmp_path)
    cache.put("own", matrix + matrix.T)
    kept = cache.get("own")
    assert kept is not None and np.array_equal(kept, matrix + matrix.T)
    assert cache.get("none") is None
