"""The expected error: from the committed table, growing with coarser meshes, and the planner's rungs meet what they promise."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline import error_model, planner
from pipeline.case import load_case
from pipeline.error_model import expected_error, table
from pipeline.ways import cell_way, way_of

CASE = Path(__file__).resolve().parents[2] / "studies" / "three-rows.toml"


@pytest.mark.parametrize("accuracy", [0.03, 0.01, 0.003, 0.002])
@pytest.mark.parametrize("part", ["zone", "pillar", "cell", "plate"])
def test_what_the_planner_takes_meets_the_accuracy_on_the_reference_parts(part: str, accuracy: float) -> None:
    case = load_case(CASE, [f"solve.accuracy={accuracy}"])
    way = cell_way(case) if part == "cell" else way_of(case, part, 45e3)
    error = expected_error(way, case.design)
    assert error is not None
    assert error / error_model.SAFETY <= accuracy


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
