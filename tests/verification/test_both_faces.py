"""Pillars on both faces: the mirror image below, what one face leaves alone, tetrahedra, and the whole solid plate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry.cad.printing import check_print, write_stl
from geometry.cad.solids import cell_solid, plate_solid
from geometry.hex.boxes import boxes_of, hex_mesh
from geometry.hex.scenes import HexSettings, plate_scene
from geometry.materials import PIEZO_MATERIALS
from geometry.mesh import cell_volumes, check_mesh
from geometry.tiling import lattice_panel
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.modes import solve_modes
from pipeline.planning.model_choice import Request, cell_model_choice
from pipeline.records.record import DesignRecord
from pipeline.search.terms import Limits, mass_kg
from solvers.fem.surface import face_quadrature
from solvers.measures.confinement import measure, ratio_db
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patch import bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import ReducedLattice
from solvers.thesis.scattering import design_feet
from tests.helpers.scenes import STEEL_PILLARS
from tests.helpers.whole_solid import check_within_both_bars

RAW: dict[str, Any] = {
    **STEEL_PILLARS,
    "zone": {"length_mm": 12.0, "width_mm": 8.0, "nodal_lines": 2},
    "pillar": {"side_mm": 2.0, "height_mm": 5.0, "faces": "both"},
    "array": {"pitch_mm": 4.0, "rows": 1, "extension_mm": 3.0},
    "solve": {"accuracy": 0.01},
}
"""Half the length times half the span is 6 x (4 + 2 + 3) mm; one pillar and a half stand on the quarter's faces."""
COARSE = HexSettings(2, 4e-3, 0)
REDUCTION = ReductionSettings(Interface(2, 2), 2e5, COARSE)


def case_of(*settings: str, **more: Any) -> Case:
    return case_from_dict({**RAW, **more}, None, settings)


def test_the_quarter_holds_each_pillar_twice_and_its_touch_face_the_rest() -> None:
    mesh = hex_mesh(boxes_of(plate_scene(case_of().design, COARSE)), 2)
    assert check_mesh(mesh).volume_m3 == pytest.approx(1e-9 * (6.0 * 9.0 * 2.0 + 2.0 * 1.5 * 4.0 * 5.0), rel=1e-12)
    assert cell_volumes(mesh)[mesh.regions["pillar"]].sum() == pytest.approx(1e-9 * 60.0, rel=1e-12)
    assert np.abs(mesh.nodes[mesh.nodes_of("touch"), 2]).max() == 0.0
    assert face_quadrature(mesh, "touch").weights.sum() == pytest.approx(1e-6 * (54.0 - 1.5 * 4.0), rel=1e-12)
    turned = mesh.nodes * [1.0, 1.0, -1.0] + [0.0, 0.0, 2e-3]
    places = [{tuple(node) for node in np.round(1e9 * nodes).tolist()} for nodes in (mesh.nodes, turned)]
    assert places[0] == places[1], "the mesh is its own mirror image"


def test_one_face_is_the_case_as_it_was() -> None:
    bare = {**RAW, "pillar": {key: value for key, value in RAW["pillar"].items() if key != "faces"}}
    ours, theirs = case_of("pillar.faces=back"), case_from_dict(bare)
    assert ours.design == theirs.design and ours.to_dict() == theirs.to_dict()
    assert "faces" not in ours.to_dict()["design"]["pillar"] and case_of().to_dict()["design"]["pillar"]["faces"] == 2


def test_masses_records_beams_and_printers_count_both() -> None:
    one, both = case_of("pillar.faces=back").design, case_of().design
    assert mass_kg(both) - mass_kg(one) == pytest.approx(2 * 3 * 20e-9 * 2700.0)
    record = DesignRecord.of_design(both).pillar
    assert record and record.faces == 2 and both.pillar and one.pillar
    omega = np.array([1e5, 2e5])
    assert design_feet(both.pillar, omega) == pytest.approx(2.0 * design_feet(one.pillar, omega))
    texts = [text for text, _ in Limits().of_design(both)]
    assert any("cannot be printed with the plate" in text for text in texts)
    glued = case_of("pillar.material=steel").design
    assert not any("cannot be printed" in text for text, _ in Limits().of_design(glued))


def test_the_cad_solid_and_its_print_file_hold_both(tmp_path: Path) -> None:
    design = case_of().design
    body = plate_solid(design)
    assert body.volume_m3 == pytest.approx(1e-9 * (4.0 * 108.0 + 12 * 20.0))
    write_stl(body, tmp_path / "plate.stl")
    report = check_print(tmp_path / "plate.stl", body, design)
    assert not report.faults and report.overhang_deg == pytest.approx(90.0)
    assert report.extent_m[2] == pytest.approx(12e-3)
    glued = cell_solid(case_of("pillar.material=steel").design, "xy")
    assert glued.part_volumes_m3() == pytest.approx({"plate": 8e-9, "pillar": 10e-9})


def test_waves_of_the_cell_are_even_or_odd_through_the_thickness() -> None:
    """Flexural and in-plane waves part: u_z at the touch face is that at the back, or its opposite."""
    design = case_of().design
    cell = Reductions(design.stack, design.pillar, REDUCTION).cell(lattice_panel(design))
    waves = ReducedLattice(cell).waves(np.array([300.0, 170.0]), 8)
    half = design.pitch_x_m / 2.0
    corners = np.flatnonzero((np.abs(np.abs(cell.skin.points[:, :2]) - half) < 1e-9).all(axis=1))
    for wave in waves.dofs.T:
        moved = cell.skin.matrix[corners] @ wave
        low, high = (moved[np.abs(cell.skin.points[corners, 2] - z) < 1e-9, 2] for z in (0.0, design.thickness_m))
        sign = np.sign((low[0] / high[0]).real)
        assert np.abs(low - sign * high).max() < 1e-6 * np.abs(high).max()


@pytest.mark.parametrize("shape", ["round", "tapered"])
def test_pairs_of_waves_that_symmetry_makes_equal_are_equal(shape: str) -> None:
    """Of a square cell at G; soft stubs on both faces of a stiff plate ring in two such pairs."""
    size = {"diameter_mm": 2.0} if shape == "round" else {"base_mm": 2.0, "tip_mm": 1.6}
    soft = {"young_GPa": 1e-3, "poisson": 0.45, "density_kg_m3": 1200.0}
    stub = {"shape": shape, "height_mm": 2.0, "faces": "both", "material": soft, **size}
    choice = cell_model_choice(case_of(pillar=stub))
    assert choice.kind == "hex" and choice.reduction
    design = case_of(pillar=stub).design
    cell = Reductions(design.stack, design.pillar, replace(REDUCTION, top_hz=2e3)).cell(lattice_panel(design))
    tones = ReducedLattice(cell).waves(np.zeros(2), 8).frequency_hz[3:]
    pairs = np.abs(tones[1:] / tones[:-1] - 1.0) < 1e-9
    assert pairs.sum() == 2 and not (pairs[1:] & pairs[:-1]).any()


def test_a_driven_plate_is_confined_by_the_definition_of_its_modes() -> None:
    """The touch face ends where pillars hang from it: its area is what is left, for the motion of patches as for modes."""
    design, tone = case_of().design, 30e3
    model = PlateModel(design, Reductions(design.stack, design.pillar, REDUCTION))
    patch = bonded_patch(PIEZO_MATERIALS["pz26"], np.array([-2e-3, 2e-3, -1e-3, 1e-3]), 0.3e-3, True)
    plate = PatchedPlate({each: model.assembled(each) for each in CLASSES}, [patch], True)
    forced = ForcedPlate(plate, design, Drive((0,), (), (20e3, 40e3), 300.0))
    (group,) = forced.modes
    (field,) = group.group.touch(group.columns)
    eigenvalue = plate.scale.eigenvalue(tone)
    moved = field.values @ group.amplitudes(eigenvalue, forced.volts(eigenvalue))
    curve = forced.curve(np.array([tone]))
    assert curve.passive_rms_m_per_v is not None
    level = ratio_db(curve.zone_rms_m_per_v, curve.passive_rms_m_per_v)
    assert level == pytest.approx(measure(replace(field, values=moved[:, None]), design, "SS").confinement_db, abs=1e-9)


@pytest.mark.parametrize(
    ("more", "line"),
    [
        ({"tolerance": {"height_mm": 0.1}}, "of one section without fillet, on the back alone"),
        ({"patches": {"size_mm": [2.0, 2.0, 0.3], "centres_mm": [[0.0, 5.0]], "face": "touch"}}, "overlaps a pillar's"),
        ({"touch": {"radius_mm": 1.0, "at_mm": [0.0, 5.0]}}, "pillars on the touch face, which begin at |y| = 4 mm"),
        ({"pillar": {**RAW["pillar"], "faces": "touch"}}, "must be back, or both"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(more: dict[str, Any], line: str) -> None:
    with pytest.raises(InputError) as caught:
        case_of(**more)
    assert len(caught.value.lines) == 1 and line in caught.value.lines[0]


@pytest.mark.slow
def test_cells_with_pillars_on_both_faces_have_the_modes_of_the_whole_solid_within_both_bars() -> None:
    check_within_both_bars(RAW, (15e3, 45e3))


@pytest.mark.slow
def test_tetrahedra_of_the_cad_solid_agree() -> None:
    query = Request("plate", band_hz=(15e3, 45e3), symmetry="SS", search=False)
    ours, theirs = (
        solve_modes(case_of(f"solve.mesh={mesh}"), query, TerminalLog(True)).rows for mesh in ("hex", "tet")
    )
    assert len(ours) == len(theirs) > 2
    for one, other in zip(ours, theirs, strict=True):
        assert one.error is not None and other.error is not None
        assert one.frequency_hz == pytest.approx(other.frequency_hz, rel=one.error + other.error)
