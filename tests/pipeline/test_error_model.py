"""The expected error: from the committed table, growing with coarser meshes, and the planner's rungs meet what they promise."""

from __future__ import annotations

from pathlib import Path

import pytest

from geometry.hexmesh import HexSettings, cell_boxes, hex_mesh
from pipeline import calibration, planner
from pipeline.calibration import Measured, table
from pipeline.case import load_case
from pipeline.error_model import expected_error
from pipeline.ways import cell_way, way_of

CASE = Path(__file__).resolve().parents[2] / "studies" / "three-rows.toml"


@pytest.mark.parametrize("accuracy", [0.03, 0.01, 0.003, 0.001])
@pytest.mark.parametrize("part", ["zone", "pillar", "cell"])
def test_what_the_planner_takes_is_expected_to_meet_the_accuracy(part: str, accuracy: float) -> None:
    case = load_case(CASE, [f"solve.accuracy={accuracy}"])
    way = cell_way(case) if part == "cell" else way_of(case, part, 45e3)
    error = expected_error(way, case.design)
    assert error is not None and error <= accuracy


def test_the_cheapest_mesh_that_serves_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = {(3, 1): 4e-3, (4, 1): 2e-3, (3, 2): 1e-3, (4, 2): 2e-4}
    rows = tuple(Measured("zone", "hex", order, layers, 0.0, error) for (order, layers), error in errors.items())
    monkeypatch.setattr(calibration, "table", lambda: rows)
    taken = [planner.rung("zone", accuracy) for accuracy in (0.01, 0.005, 0.003, 0.001, 1e-5)]
    assert [(row.order, row.layers) for row in taken] == [(3, 1), (4, 1), (3, 2), (4, 2), (4, 3)]


def test_the_rungs_ascend_in_unknowns() -> None:
    design = load_case(CASE, []).design
    settings = [HexSettings(r.order, 4e-3, r.layers, r.factor, 3.15e-3) for r in planner.RUNGS]
    sizes = [hex_mesh(cell_boxes(design, each), each.order).dof for each in settings]
    assert sizes == sorted(sizes)


def test_a_finer_mesh_of_one_kind_is_never_worse() -> None:
    for part in ("zone", "pillar", "cell", "plate"):
        for order in (2, 3, 4):
            graded = [row.error for row in table() if (row.part, row.kind, row.order) == (part, "hex", order)]
            assert graded == sorted(graded, reverse=True)
        tets = [row.error for row in table() if (row.part, row.kind, row.order) == (part, "tet", 2)]
        assert tets == sorted(tets, reverse=True)


def test_tetrahedra_say_that_they_miss_a_fine_accuracy() -> None:
    case = load_case(CASE, ["solve.mesh=tet", "solve.accuracy=0.003"])
    error = expected_error(cell_way(case), case.design)
    assert error is not None and error > 0.003


def test_what_was_never_measured_has_no_bar() -> None:
    case = load_case(CASE, ["solve.mesh=tet", "solve.accuracy=0.03"])
    way = way_of(case, "zone", 45e3)
    assert expected_error(way, case.design) is not None
    coarse = planner.tet_edge_m(1.0, 0.03) * 1e3
    assert expected_error(type(way)(**{**vars(way), "edge_m": coarse}), case.design) is None
