"""The expected error: from the committed table, growing with coarser meshes, and the planner's mesh levels meet what
they promise.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from geometry.hex.boxes import cell_boxes, hex_mesh, pillar_boxes, zone_boxes
from pipeline.case.model import load_case
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import ModelChoice, cell_model_choice, model_choice_of
from solvers.accuracy import calibration
from solvers.accuracy.calibration import HEX, SAFETY, Measured, table
from studies import ladder

CASE = Path(__file__).resolve().parents[3] / "studies" / "three-rows.toml"


def foreseen(choice: ModelChoice, highest_hz: float = 0.0) -> float:
    """The error by which a mesh of a part solved as meshed was chosen."""
    assert choice.mesh_level and not choice.reduction
    growth = max(1.0, highest_hz / choice.good_to_hz)
    error = mesh_rules.expected_error("whole" if choice.part == "plate" else choice.part, choice.mesh_level, growth)
    assert error is not None
    return error


@pytest.mark.parametrize("accuracy", [0.03, 0.01, 0.003, 0.0015, 0.001])
@pytest.mark.parametrize("part", ["zone", "pillar"])
def test_what_the_planner_takes_is_expected_to_meet_the_accuracy(part: str, accuracy: float) -> None:
    case = load_case(CASE, [f"solve.accuracy={accuracy}"])
    assert foreseen(model_choice_of(case, part, 45e3)) <= accuracy


@pytest.mark.parametrize("part", ["cell", "plate"])
def test_reduced_hexahedra_begin_on_a_finer_mesh_for_a_finer_accuracy(part: str) -> None:
    finest = 0
    for accuracy in (0.03, 0.003, 0.001, 0.0005):
        case = load_case(CASE, [f"solve.accuracy={accuracy}"])
        choice = cell_model_choice(case) if part == "cell" else model_choice_of(case, part, 45e3)
        assert choice.reduction and choice.mesh_level
        levels = list(mesh_rules.CELL_LEVELS.values())
        assert levels.index(choice.mesh_level) >= finest
        finest = levels.index(choice.mesh_level)
    assert finest > 0 and mesh_rules.finer_cell_level(levels[0]) == levels[1]
    assert mesh_rules.finer_cell_level(levels[-1]) is None


def test_the_cheapest_mesh_that_serves_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    errors = (4e-3, 2e-3, 1e-3, 2e-4)
    ladder_of_zone = mesh_rules.mesh_levels("zone")
    rows = [
        Measured("zone", "hex", r.order, r.layers, r.factor, r.share, r.through, 0.0, 1.0, e)
        for r, e in zip(ladder_of_zone, errors, strict=False)
    ]
    monkeypatch.setattr(calibration, "table", lambda: tuple(rows))
    taken = [mesh_rules.mesh_level("zone", SAFETY[HEX] * (error + 1e-9)) for error in (1.0, *errors, 1e-5)]
    assert taken == [ladder_of_zone[0], *ladder_of_zone[: len(errors)], ladder_of_zone[-1]]


@pytest.mark.parametrize("accuracy", [0.03, 0.003, 0.0015])
def test_a_plates_bar_is_that_of_the_mesh_it_is_reduced_on(accuracy: float) -> None:
    case = load_case(CASE, [f"solve.accuracy={accuracy}"])
    choice = model_choice_of(case, "plate", 45e3)
    assert choice.reduction is not None and choice.mesh_level is not None
    assert choice.reduction.hexahedra == choice.hexahedra == mesh_rules.cell_mesh(case.design, choice.mesh_level)


def test_every_mesh_of_a_part_solved_as_meshed_was_measured() -> None:
    for part in ("zone", "pillar", "cell"):
        assert all(mesh_rules.expected_error(part, row) is not None for row in mesh_rules.mesh_levels(part))


def test_a_plate_without_pillars_has_no_tetrahedra_and_no_bar_of_theirs() -> None:
    case = load_case(CASE, ["solve.mesh=tet", "array.rows=0", "patches.sensors=[0]"])
    assert model_choice_of(case, "plate", 45e3).kind == "hex"


MESHES = {
    "zone": lambda design, row: zone_boxes(design, mesh_rules.zone_mesh(design, row)),
    "pillar": lambda design, row: pillar_boxes(design.pillar, mesh_rules.pillar_mesh(design, row)),
    "cell": lambda design, row: cell_boxes(design, mesh_rules.cell_mesh(design, row)),
}


@pytest.mark.parametrize("part", MESHES)
def test_the_study_measures_the_very_elements_of_the_planner(part: str) -> None:
    boxes = {"zone": zone_boxes, "pillar": lambda design, mesh: pillar_boxes(design.pillar, mesh), "cell": cell_boxes}
    for row in mesh_rules.mesh_levels(part):
        planned, measured = MESHES[part](ladder.design(), row), ladder.settings(ladder.of_the_planner(part, row))
        studied = boxes[part](ladder.design(), measured)
        assert all(np.allclose(getattr(planned, axis), getattr(studied, axis), rtol=1e-12) for axis in "xyz")


@pytest.mark.slow
def test_a_zones_error_counts_from_the_mode_at_which_it_was_measured() -> None:
    """Modes above the target mode are given more, those within its window too: what was measured lies no lower than good."""
    design = ladder.design()
    measured_hz = ladder.zone({"model": "hex", **ladder.of_the_planner("zone", mesh_rules.mesh_levels("zone")[0])})[0][
        "zone"
    ]
    good = mesh_rules.good_to_hz("zone", design)
    assert 0.0 < good <= measured_hz


def test_elements_of_a_thin_zone_are_no_longer_over_its_thickness_than_those_that_were_measured() -> None:
    """Elements of order 3 that bend lock as they grow longer than they are thick."""
    row, given = mesh_rules.mesh_levels("zone")[0], ladder.design()
    measured, thin = (
        mesh_rules.zone_mesh(replace(given, thickness_m=t), row).size_m / t for t in (given.thickness_m, 1e-3)
    )
    assert measured < mesh_rules.MAX_LENGTH and thin == pytest.approx(mesh_rules.MAX_LENGTH)
    assert 1.1 * measured > mesh_rules.MAX_LENGTH


def test_the_elements_of_a_foil_do_not_shrink_with_its_thickness_for_ever() -> None:
    """Locking ends where shear vanishes: a zone of 20 um would otherwise have millions of degrees of freedom."""
    row, given = mesh_rules.mesh_levels("zone")[0], ladder.design()
    foil, thinner = (mesh_rules.zone_mesh(replace(given, thickness_m=t), row).size_m for t in (2e-5, 1e-5))
    assert foil == thinner == pytest.approx(mesh_rules.LOCKED * mesh_rules.zone_mesh(given, row).size_m)


@pytest.mark.parametrize("part", MESHES)
def test_the_mesh_levels_ascend_in_degrees_of_freedom(part: str) -> None:
    design = load_case(CASE, []).design
    sizes = [hex_mesh(MESHES[part](design, row), row.order).dof for row in mesh_rules.mesh_levels(part)]
    assert sizes == sorted(sizes) and len(set(sizes)) == len(sizes)


def test_a_finer_mesh_of_one_kind_is_never_worse() -> None:
    for part in ("zone", "pillar", "cell", "plate"):
        for order in (2, 3, 4):
            rows = [row for row in table() if (row.part, row.kind, row.order) == (part, "hex", order)]
            finer = [
                (a, b)
                for a, b in product(rows, rows)
                if a.growth == b.growth and a.layers >= b.layers and a.share <= b.share and a.through >= b.through
            ]
            assert all(a.error <= b.error for a, b in finer)
        tets = [row for row in table() if (row.part, row.kind, row.order) == (part, "tet", 2)]
        finest = max(tets, key=lambda row: row.across)  # between the others pytetwild's chance decides
        assert finest.error == min(row.error for row in tets)


def test_the_bar_grows_with_the_frequency_and_elements_shrink_where_no_mesh_level_serves() -> None:
    case = load_case(CASE, ["solve.accuracy=0.01"])
    good = mesh_rules.good_to_hz("zone", case.design)
    low, high, far = (model_choice_of(case, "zone", factor * good) for factor in (1.0, 3.0, 20.0))
    assert low.mesh_level and far.hexahedra and low.hexahedra
    within, beyond = foreseen(low, good), foreseen(low, 3.0 * good)
    assert 3.0 * within < beyond <= within * 3.0**low.mesh_level.order
    assert high.mesh_level != low.mesh_level and high.good_to_hz == good
    assert far.hexahedra.size_m == pytest.approx(low.hexahedra.size_m / 20.0**0.5) and far.good_to_hz == 20.0 * good
    for choice, factor in ((high, 3.0), (far, 20.0)):
        assert foreseen(choice, factor * good) <= 0.01


def test_a_theory_is_off_by_more_on_a_stockier_pillar() -> None:
    slender = calibration.SLENDER["pillar"]
    known = calibration.by_theory("pillar", "euler", slender)
    assert known and calibration.by_theory("pillar", "euler", slender / 2.0) == known
    assert calibration.by_theory("pillar", "euler", 2.0 * slender) == pytest.approx(4.0 * known)
    assert calibration.by_theory("pillar", "nobody", slender) is None


def test_each_mesh_has_the_error_of_its_own_elements_through_the_plate(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = tuple(Measured("cell", "hex", 3, 1, 0.1, 1.0, through, 0.0, 1.0, 1e-3 / through) for through in (1, 2))
    for listed in (rows, rows[::-1]):
        monkeypatch.setattr(calibration, "table", lambda listed=listed: listed)
        result = [
            mesh_rules.expected_error("cell", mesh_rules.MeshLevel(3, 1, 0.1, 1.0, through)) for through in (1, 2, 3)
        ]
        assert result == [SAFETY[HEX] * 1e-3, SAFETY[HEX] * 5e-4, None]


MESH = calibration.MeshLevel(3, 1, 0.1)


def at_growth(monkeypatch: pytest.MonkeyPatch, errors: dict[float, float], growth: float) -> float:
    """The error that is expected of a mesh at a growth, without the safety."""
    rows = tuple(Measured("zone", "hex", 3, 1, 0.1, 1.0, 1, 0.0, each, error) for each, error in errors.items())
    monkeypatch.setattr(calibration, "table", lambda: rows)
    result = calibration.by_hexahedra("zone", MESH, growth=growth)
    assert result is not None
    return result / SAFETY[HEX]


@pytest.mark.parametrize(("edges", "wave"), [(1e-3, 0.0), (0.0, 1e-3), (3e-4, 7e-4), (9e-4, 1e-4)])
def test_two_modes_bound_the_error_of_edges_and_waves(
    monkeypatch: pytest.MonkeyPatch, edges: float, wave: float
) -> None:
    def made(growth: float) -> float:
        return edges * growth**0.75 + wave * growth**3

    measured = {2.0: made(2.0), 1.0: made(1.0)}
    for growth in measured:
        assert at_growth(monkeypatch, measured, growth) == pytest.approx(made(growth))
    for growth in (1.2, 1.6, 3.0, 5.0):
        assert at_growth(monkeypatch, measured, growth) >= made(growth) * (1.0 - 1e-9)
    assert at_growth(monkeypatch, measured, 1.5) < made(2.0)


def test_one_mode_alone_grows_as_the_smooth_wave(monkeypatch: pytest.MonkeyPatch) -> None:
    assert at_growth(monkeypatch, {1.0: 1e-3}, 2.0) == pytest.approx(8e-3)


def test_a_higher_mode_is_never_expected_to_be_better(monkeypatch: pytest.MonkeyPatch) -> None:
    assert at_growth(monkeypatch, {1.0: 1e-3, 2.0: 8e-4}, 1.5) == pytest.approx(1e-3)


def test_a_mesh_that_was_not_measured_has_no_error(monkeypatch: pytest.MonkeyPatch) -> None:
    at_growth(monkeypatch, {1.0: 1e-3}, 1.0)
    assert calibration.by_hexahedra("zone", calibration.MeshLevel(3, 1, 0.1, 0.7)) is None
    with pytest.raises(ValueError, match="growth"):
        calibration.by_hexahedra("zone", MESH, growth=0.9)


def test_a_zones_higher_modes_were_measured() -> None:
    for row in mesh_rules.mesh_levels("zone"):
        result = [each.growth for each in table() if (each.part, each.kind, each.mesh_level) == ("zone", "hex", row)]
        assert len(result) == 3 and 1.0 <= min(result) < 1.5 < max(result)
