"""How a cell's degrees, modes and mesh are chosen together: what the mesh leaves of the accuracy is truncation's."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.case.model import Case, case_from_dict
from pipeline.models import unit_cell
from pipeline.planning import mesh_rules
from solvers.accuracy.calibration import MeshLevel
from solvers.superelement.interface import Interface, ReductionSettings
from tests.helpers.recording_log import RecordingLog

FIRST, SECOND, FINEST = mesh_rules.CELL_LEVELS.values()


def case(accuracy: float = 0.001, side_mm: float = 2.0, thickness_mm: float = 2.0) -> Case:
    return case_from_dict(
        {
            "name": "cell",
            "material": "aluminium",
            "plate": {"thickness_mm": thickness_mm},
            "zone": {"length_mm": 28.0, "width_mm": 18.0, "nodal_lines": 2},
            "pillar": {"shape": "square", "side_mm": side_mm, "height_mm": 6.3},
            "array": {"pitch_mm": 4.0, "rows": 1, "extension_mm": 5.0},
            "bands": {"points": 1, "count": 10},
            "solve": {"accuracy": accuracy},
        }
    )


@pytest.mark.parametrize(
    ("bar", "left"),
    [
        ((None, 2e-3), 1e-3),
        ((5e-4, 4e-4), 1e-3),  # met
        ((6e-4, 6e-4), 4e-4),
        ((9e-4, 6e-4), 1e-3),  # a finer mesh is taken anyway
    ],
)
def test_what_the_mesh_takes_of_the_accuracy_is_left_out_of_truncations_part(bar: unit_cell.Bar, left: float) -> None:
    assert unit_cell._left_by_the_mesh(bar, 1e-3) == pytest.approx(left)


@pytest.mark.slow
def test_modes_that_nobody_needs_make_room_for_a_degree() -> None:
    """All modes that the plan allows, with a degree more, were more functions than a wavevector may have."""
    scene, corners = case(0.0005), np.pi / 4e-3 * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    begun = mesh_rules.lattice_reduction(scene.design, scene.solve.accuracy)
    pilot, target = unit_cell._coarse_pilot(scene.design, 10), unit_cell.MARGIN * scene.solve.accuracy
    advised = unit_cell._piloted(pilot, begun, corners, 10, target, RecordingLog(), 0.0)
    assert advised.interface.along > begun.interface.along and advised.top_hz < begun.top_hz
    assert unit_cell.reduction_error(pilot.lattice(advised), corners, 10).total <= target


@pytest.mark.parametrize(("side_mm", "elements"), [(2.0, 1), (1.5, 2), (0.2, mesh_rules.MAX_BENEATH)])
def test_elements_beneath_a_foot_are_no_thicker_than_about_its_width(side_mm: float, elements: int) -> None:
    design = case(side_mm=side_mm).design
    meshes = [mesh_rules.cell_mesh(design, level).through for level in (FIRST, SECOND, FINEST)]
    assert meshes == [elements, elements + 1, 1]


@pytest.mark.parametrize(("degree", "elements"), [(3, 1), (4, 2)])
def test_a_finer_mesh_has_a_node_for_each_degree_through_the_plate(degree: int, elements: int) -> None:
    settings = ReductionSettings(Interface(4, degree), 1e6, mesh_rules.cell_mesh(case().design, MeshLevel(3, 1, 0.15)))
    mesh = mesh_rules.with_nodes_for(settings.interface, settings.hexahedra)
    assert mesh.through == elements and mesh_rules.with_nodes_for(settings.interface, mesh) == mesh
