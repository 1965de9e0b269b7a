"""The accuracy is met by what a mesh tells of itself: where it misses, the next one is taken, and it is said."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.errors import MeshError
from pipeline.case.model import Case, case_from_dict
from pipeline.models import modes
from pipeline.planning import mesh_rules, refinement, resource_estimate
from pipeline.planning.model_choice import ModelChoice, Request, cell_model_choice, model_choice_of
from pipeline.planning.refinement import EDGE_RATE, SHORTER, finer_mesh
from pipeline.planning.resources import ResourceEstimate
from pipeline.questions.bands import Bands
from solvers.accuracy.calibration import MeshLevel
from solvers.errors import SolverError
from tests.helpers.asked import solve_bands
from tests.helpers.recording_log import RecordingLog

LEVELS = MeshLevel(2, 1, 0.15), MeshLevel(3, 1, 0.15)
OF_CELLS = MeshLevel(2, 0, 0.15), MeshLevel(3, 0, 0.15)  # small ones


def case(accuracy: float = 0.01, height_mm: float = 3.0, count: int = 2, path: str = "XM", **solve: str) -> Case:
    return case_from_dict(
        {
            "name": "small",
            "material": "aluminium",
            "plate": {"thickness_mm": 2.0},
            "zone": {"length_mm": 28.0, "width_mm": 18.0, "nodal_lines": 2},
            "pillar": {"shape": "square", "side_mm": 2.0, "height_mm": height_mm},
            "array": {"pitch_mm": 4.0, "rows": 1, "extension_mm": 5.0},
            "bands": {"points": 1, "count": count, "path": path},
            "solve": {"accuracy": accuracy, **solve},
        }
    )


def choice_of(part: str, scene: Case) -> ModelChoice:
    return cell_model_choice(scene) if part == "cell" else model_choice_of(scene, part, 50e3)


@pytest.mark.parametrize("model", ["auto", "solid"])
@pytest.mark.parametrize("part", ["zone", "pillar", "plate", "cell"])
def test_each_part_has_a_next_mesh_level_until_the_finest(part: str, model: str) -> None:
    """Only a plate meshed whole has a finer mesh after the finest level; memory and the count of refinements end those."""
    scene, log = case(0.03, model=model), RecordingLog()
    choice: ModelChoice | None = choice_of(part, scene)
    names, dofs, most = [], [], len(mesh_rules.CELL_LEVELS) + 2
    while choice is not None and len(names) < most:
        assert choice.hexahedra and (choice.reduction is None or choice.reduction.hexahedra == choice.hexahedra)
        names.append(choice.mesh)
        dofs.append(_dofs(part, scene, choice))
        choice = finer_mesh(choice, 0.031, 0.0, scene, log)
    assert len(names) >= 3 and [name in fact for name, fact in zip(names[1:], log.facts, strict=choice is None)]
    assert dofs == sorted(dofs) and len(set(dofs)) == len(names)
    assert (choice is not None) is ((part, model) == ("plate", "solid"))


def _dofs(part: str, scene: Case, choice: ModelChoice) -> float:
    if part == "cell" or choice.reduction:
        assert choice.hexahedra
        return resource_estimate.of_boxes(
            resource_estimate.cell_scene(scene.design, choice.hexahedra), choice.hexahedra.order
        ).dofs
    return resource_estimate.whole_mesh(scene, choice).dofs


def test_a_mesh_level_that_has_no_more_elements_is_passed_over() -> None:
    """Feet on both faces grade a plate from either side: two elements through it are there before a level asks for them."""
    scene = case_from_dict(
        {
            "name": "both",
            "material": "glass",
            "plate": {"thickness_mm": 0.5},
            "pillar": {"shape": "square", "side_mm": 1.2, "height_mm": 1.5, "faces": "both"},
            "array": {"pitch_x_mm": 3.0, "pitch_y_mm": 7.0},
        }
    )
    (demand,) = Bands().plan(scene).demands.values()
    assert len(demand.finer_bytes) == 1
    first, log = cell_model_choice(scene), RecordingLog()
    finer = finer_mesh(first, 0.031, 0.0, scene, log)
    assert finer and resource_estimate.cell_dofs(scene.design, finer) > resource_estimate.cell_dofs(scene.design, first)


@pytest.mark.parametrize(
    ("error", "truncated"),
    [(0.0099, 0.0), (None, 0.0), (0.008, 0.0019), (0.011, 0.012)],
    ids=["met", "unknown", "met with truncation", "truncation is more"],
)
def test_no_finer_mesh_where_none_would_help(error: float | None, truncated: float) -> None:
    scene, log = case(), RecordingLog()
    assert finer_mesh(choice_of("cell", scene), error, truncated, scene, log) is None and not log.facts


def test_edges_of_tetrahedra_shrink_with_what_is_left_to_the_mesh() -> None:
    scene, log = case(0.01, mesh="tet"), RecordingLog()
    choice = choice_of("cell", scene)
    factors = [
        finer.edge_m / choice.edge_m
        for error, truncated in ((0.0101, 0.0), (0.013, 0.0), (0.013, 0.002), (1.0, 0.0))
        if (finer := finer_mesh(choice, error, truncated, scene, log))
    ]
    assert factors == sorted(factors, reverse=True) and factors[0] <= SHORTER[1] and factors[-1] == SHORTER[0]
    assert 0.013 * factors[1] ** EDGE_RATE < 0.01 and 0.013 * factors[2] ** EDGE_RATE < 0.008
    assert "stress recovery" in log.facts[0]


@pytest.fixture
def two_levels(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two coarse mesh levels of every part, the first of them expected to do."""
    monkeypatch.setattr(mesh_rules, "CELL_LEVELS", dict(zip((0.0, -1.0), OF_CELLS, strict=True)))
    monkeypatch.setattr(mesh_rules, "MESH_LEVELS", dict.fromkeys(("zone", "pillar", "cell", "whole"), LEVELS))
    monkeypatch.setattr(mesh_rules, "expected_error", lambda part, row, growth=1.0: 0.0)


@pytest.mark.slow
@pytest.mark.usefixtures("two_levels")
def test_a_whole_cell_that_misses_is_meshed_anew() -> None:
    kept, missed = (solve_bands(case(accuracy, model="solid"), RecordingLog()) for accuracy in (0.1, 0.002))
    assert (kept.model, missed.model) == ("solid hex2", "solid hex3")
    moving = kept.frequencies_hz > 1.0
    # both meshes have the same lines: what the coarser one can do the finer one can, too
    assert (missed.computed_hz <= kept.computed_hz * (1.0 + 1e-9))[moving].all()
    assert missed.by_mesh.max() < kept.by_mesh.max()


@pytest.mark.usefixtures("two_levels")
def test_a_mesh_that_memory_does_not_hold_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource_estimate, "shortfall", lambda demand: "needs more than there is")
    log = RecordingLog()
    result = solve_bands(case(0.002, model="solid"), log)
    assert result.model == "solid hex2" and "finer mesh skipped: it needs more than there is" in log.facts
    assert result.expected_error and result.expected_error > 0.002  # and is told


@pytest.mark.parametrize(("failing", "fault"), [(1, SolverError), (2, MeshError)])
def test_a_mesh_that_cannot_be_had_leaves_what_the_one_before_it_gave(failing: int, fault: type[Exception]) -> None:
    scene, log = case(0.01), RecordingLog()
    start, built = choice_of("zone", scene), []

    def build(choice: ModelChoice) -> str:
        built.append(choice.mesh)
        if len(built) == failing:
            raise fault("the mesh holds no more")
        return choice.mesh

    def demand(choice: ModelChoice) -> ResourceEstimate:
        return resource_estimate.of_modes(scene, choice, Request("zone", near_hz=30e3, count=2, search=False))

    first = start, start.mesh
    choice, kept = refinement.on_finer_meshes(first, lambda mesh: (0.02, 0.0), build, demand, scene, log)
    assert len(built) == failing and kept == choice.mesh == [start.mesh, *built][-2]
    assert "refinement stopped: the mesh holds no more" in log.facts


@pytest.mark.slow
@pytest.mark.usefixtures("two_levels")
@pytest.mark.parametrize("part", ["pillar", "zone"])
def test_a_lone_part_that_misses_is_meshed_anew(part: str) -> None:
    request = Request(part, near_hz=30e3, count=2, search=False)
    kept, missed = (modes.solve_modes(case(accuracy), request, RecordingLog()) for accuracy in (0.1, 0.001))
    assert kept.meshes[0].order == 2 and missed.meshes[0].order == 3
    for rough, fine in zip(kept.rows, missed.rows, strict=True):
        assert rough.error and fine.error
        assert abs(rough.frequency_hz / fine.frequency_hz - 1.0) <= rough.error + fine.error
        assert fine.error < rough.error


@pytest.mark.slow
def test_tetrahedra_that_miss_are_meshed_anew() -> None:
    """Against hexahedra, within both bars, at an accuracy that the first edges miss."""
    log, asked = RecordingLog(), (0.0005, 6.3, 4, "GXMG")
    by_tetrahedra = solve_bands(case(*asked, mesh="tet"), log)
    assert any("refining: tetrahedra" in fact for fact in log.facts) and len(by_tetrahedra.meshes) == 1
    assert by_tetrahedra.expected_error and by_tetrahedra.expected_error < 0.0005
    hexahedra = solve_bands(case(*asked), RecordingLog())
    moving = hexahedra.frequencies_hz > 1.0
    off = np.abs(by_tetrahedra.frequencies_hz[moving] / hexahedra.frequencies_hz[moving] - 1.0)
    allowed = np.array(by_tetrahedra.error, dtype=float) + np.array(hexahedra.error, dtype=float)
    assert (off <= allowed[moving]).all()


@pytest.mark.slow
def test_what_a_mesh_tells_of_itself_outweighs_what_another_design_did(monkeypatch: pytest.MonkeyPatch) -> None:
    """Modes above those measured on another design ask for no finer elements where their own bars do not."""
    asked: list[float] = []
    monkeypatch.setattr(modes, "coarse_modes", lambda *given: None)
    monkeypatch.setattr(modes, "refine_mesh", lambda choice, highest_hz, *given: asked.append(highest_hz))
    request = Request("pillar", near_hz=300e3, count=2, search=False)
    met = modes.solve_modes(case(0.01), request, RecordingLog())
    assert met.expected_error and met.expected_error < 0.01 and not asked
    monkeypatch.setattr(refinement, "finer_mesh", lambda *given: None)
    monkeypatch.setattr(modes, "_decisive", lambda *given: 0.011)
    modes.solve_modes(case(0.01), request, RecordingLog())
    assert asked
