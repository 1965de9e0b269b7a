"""Rows of own cells: attenuation against the case's own cell and the unreduced quadratic eigenproblem, and broadband."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eig

from geometry.elements import FloatArray
from geometry.hex.boxes import Boxes, cell_boxes, hex_mesh
from geometry.hex.scenes import HexSettings
from geometry.lattice import Lattice
from geometry.materials import MATERIALS
from geometry.mesh import Mesh
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.cell_cache import CellCache
from pipeline.planning import mesh_rules
from pipeline.questions.attenuation import Attenuation, AttenuationResult, MeshAttenuation
from pipeline.questions.broadband import Broadband, MeshBroadband
from pipeline.questions.question import Run, ask
from solvers.fem.assembly import assemble
from solvers.plates.assembled import Reductions
from solvers.plates.column import Column
from solvers.waves.bloch import BlochCell
from tests.pipeline.models.test_own_cell import written

LOG = TerminalLog(True)
PITCH_M, THICK_M = 4e-3, 2e-3
KX = 2e2  # rad/m
ERROR = 0.005  # relative, of frequencies: more than the reduction states


def case(**own: Any) -> Case:
    plain: dict[str, Any] = {"name": "own", "material": "aluminium", "plate": {"thickness_mm": 1e3 * THICK_M}}
    plain |= {"array": {"pitch_mm": 1e3 * PITCH_M}, "solve": {"accuracy": 0.01}, "bands": {"count": 6}}
    return case_from_dict(plain | own)


def plate(rows: int, **own: Any) -> Case:
    """A zone between rows."""
    own = {"pillar": {"side_mm": 2.0, "height_mm": 6.3}} | own
    array = {"pitch_mm": 1e3 * PITCH_M, "rows": rows, "extension_mm": 0.0}
    return case(zone={"length_mm": 60.0, "width_mm": 12.0, "nodal_lines": 4}, array=array, **own)


def cell(kind: str = "plate", count: int = 4) -> Mesh:
    """A cell of hexahedra: bare, with a hole, or with two unequal pillars of steel, one at a corner of the hole's place."""
    lines = [PITCH_M * np.linspace(0.0, 1.0, count + 1)] * 2
    levels = THICK_M * np.linspace(0.0, 2.0, 5)
    x, y, z = np.meshgrid(*((line[:-1] + line[1:]) / 2.0 for line in (*lines, levels)), indexing="ij")
    x, y, region = x / PITCH_M, y / PITCH_M, np.where(z < THICK_M, 0, -1)
    if kind == "hole":
        region[(x > 0.25) & (x < 0.75) & (y > 0.25) & (y < 0.5)] = -1
    if kind == "two pillars":
        region[(z > THICK_M) & (x > 0.25) & (x < 0.5) & (y > 0.25) & (y < 0.5)] = 1
        region[(z > THICK_M) & (z < 1.5 * THICK_M) & (x > 0.5) & (x < 0.75) & (y > 0.5) & (y < 0.75)] = 1
    return hex_mesh(Boxes(*lines, levels, region, ("plate", "steel")), 2)


def unreduced(mesh: Mesh, materials: dict[str, Any], frequency_hz: float) -> FloatArray:
    """Decay in dB of all waves across rows of a mesh whose nodes pair, by the quadratic eigenproblem of all its nodes."""
    system = assemble(mesh, materials)
    own = BlochCell(system, Lattice.of_rows(PITCH_M, PITCH_M))
    value, parts = system.scale.eigenvalue(frequency_hz), dict.fromkeys((-1, 0, 1), 0.0)
    for (dx, dy), stiffness in own.stiffness.items():
        parts[dy] = parts[dy] + np.exp(1j * dx * KX * PITCH_M) * (stiffness - value * own.mass[dx, dy])
    down, here, up = (sp.csr_array(parts[step]).toarray() for step in (-1, 0, 1))
    free = np.flatnonzero(~(np.abs(up).sum(axis=0) + np.abs(down).sum(axis=0) + np.abs(up).sum(axis=1) > 0.0))
    edge = np.setdiff1d(np.arange(len(here)), free)
    inner = np.linalg.solve(here[np.ix_(free, free)], here[np.ix_(free, edge)])
    middle = here[np.ix_(edge, edge)] - here[np.ix_(edge, free)] @ inner
    one, none = np.eye(len(edge)), np.zeros((len(edge),) * 2)
    down, up = down[np.ix_(edge, edge)], up[np.ix_(edge, edge)]
    size = np.abs(middle).max()
    left, right = np.block([[none, one], [-down / size, -middle / size]]), np.block([[one, none], [none, up / size]])
    (above, below), _ = eig(left, right, homogeneous_eigvals=True)
    finite = (np.abs(above) > 1e-9 * np.abs(above).max()) & (np.abs(below) > 1e-9 * np.abs(below).max())
    decay = -20.0 * np.log10(np.abs(above[finite] / below[finite]))
    going = np.count_nonzero(np.abs(decay) < 1e-3)  # one of each pair upwards
    return np.concatenate([np.zeros(going // 2), np.sort(decay[decay > 1e-3])])


def attenuated(scene: Case, *files: str, **own: Any) -> AttenuationResult:
    return ask(scene, MeshAttenuation(mesh_file=files, **own), Run(LOG))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hole", pytest.param("two pillars", marks=pytest.mark.slow)])
def test_waves_decay_as_those_of_all_nodes_do(kind: str, tmp_path: Path) -> None:
    """The reduction overestimates frequencies by its stated error at most: so far may the decay lie from its own."""
    tone_hz = 200e3 if kind == "hole" else 230e3
    mesh, scene = cell(kind), case(materials={"STEEL": "steel"} if kind == "two pillars" else {})
    materials = {"plate": MATERIALS["aluminium"], "steel": MATERIALS["steel"]}
    window = (1e-3 * tone_hz * (1.0 - ERROR), 1e-3 * tone_hz * (1.0 + ERROR))
    found = attenuated(scene, written(mesh, tmp_path / "cell.msh"), band_kHz=window, points=3, kx_per_m=KX)
    assert found.reduction_error is not None and 0.0 < found.reduction_error < ERROR
    ours = np.array([sorted(wave.db_per_row for wave in point.waves)[:3] for point in found.points])
    apart = np.abs(ours[1] - unreduced(mesh, materials, tone_hz)[:3])
    assert (apart <= 1e-6 + np.ptp(ours, axis=0)).all()
    assert found.points[0].db_per_row and found.points[0].db_error is None and found.expected_error is None


WINDOW: dict[str, Any] = {"band_kHz": (31.5, 37.0), "points": 5}


def reference(folder: Path) -> tuple[Case, tuple[str, ...]]:
    """Two rows of pillars, and two meshes of their cell, far coarser than the case's own."""
    scene = plate(2)
    sizes = {size: hex_mesh(cell_boxes(scene.design, HexSettings(2, size, 0)), 2) for size in (1e-3, 0.67e-3)}
    return scene, tuple(written(mesh, folder / f"{size}.msh") for size, mesh in sizes.items())


@pytest.mark.slow
def test_the_reference_cell_read_back_decays_within_both_bars(tmp_path: Path) -> None:
    scene, files = reference(tmp_path)
    theirs, ours = attenuated(scene, *files, **WINDOW), ask(scene, Attenuation(**WINDOW), Run(LOG))
    for one, two in zip(theirs.points, ours.points, strict=True):
        assert one.db_per_row and two.db_per_row and one.db_error and two.db_error is not None
        assert abs(one.db_per_row - two.db_per_row) <= one.db_error + two.db_error
        assert one.taken_db is not None and two.taken_db is not None and one.taken_error_db and two.taken_error_db
        assert abs(one.taken_db - two.taken_db) <= one.taken_error_db + two.taken_error_db


@pytest.mark.slow
def test_rows_of_the_reference_cell_transmit_as_the_pillars_do(tmp_path: Path) -> None:
    scene, files = reference(tmp_path)
    wide = ask(scene, MeshBroadband(mesh_file=files, **WINDOW), Run(LOG))
    pillars = ask(scene, Broadband(**WINDOW), Run(LOG))
    for one, two in zip(wide.points, pillars.points, strict=True):  # rows transmit alike wherever they begin
        assert one.taken_error_db and two.taken_error_db and one.confinement_error_db
        assert abs(one.taken_db - two.taken_db) <= one.taken_error_db + two.taken_error_db


@pytest.mark.slow
def test_rows_of_bare_cells_are_bare_plate(tmp_path: Path) -> None:
    scene = plate(2)
    file = written(cell(count=6), tmp_path / "cell.msh")
    found = ask(scene, MeshBroadband(mesh_file=(file,), band_kHz=(20.0, 40.0), points=5), Run(LOG))
    assert [point.taken_db for point in found.points] == pytest.approx([0.0] * 5, abs=1e-3)
    bare = replace(scene.design, rows=0, extension_m=scene.design.extension_m + 2 * PITCH_M)
    reduction = mesh_rules.plate_reduction(bare, 0.003, 45e3)
    column = Column(bare, Reductions(bare.stack, None, reduction, CellCache()), scene.target_kx_per_m)
    levels = column.driven(found.frequency_hz, scene.one_quality_factor("")).confinement_db
    assert found.confinement_db == pytest.approx(levels, abs=0.2)  # dB: of two reductions within 0.01 of a frequency
    assert found.points[0].confinement_error_db is None


def test_cells_whose_sides_are_not_the_plates_are_refused_by_name(tmp_path: Path) -> None:
    file = written(cell(), tmp_path / "cell.msh")
    window: dict[str, Any] = {"band_kHz": (20.0, 40.0), "points": 2, "kx_per_m": KX}
    thick = case(plate={"thickness_mm": 1.5})
    with pytest.raises(InputError, match=r"cell.msh: side x- ends at z = 2 mm: must be a face of the plate, 4 mm long"):
        attenuated(thick, file, **window)
    with pytest.raises(InputError, match=r"side x- lies 4 mm from the opposite one: must lie a pitch from it, 5 mm"):
        attenuated(case(array={"pitch_x_mm": 5.0, "pitch_y_mm": 4.0}), file, **window)
    ridge = cell()
    full = Boxes(*[PITCH_M * np.linspace(0.0, 1.0, 5)] * 2, THICK_M * np.linspace(0.0, 2.0, 5), _ridge(), ("plate",))
    ridge = hex_mesh(full, 2)
    with pytest.raises(
        InputError, match=r"side x- ends at z = 4 mm: .* \(bands --mesh-file takes any sides that pair\)"
    ):
        attenuated(case(), written(ridge, tmp_path / "ridge.msh"), **window)
    with pytest.raises(InputError, match=r"cell must have two sides along x, 3\.4641 mm apart"):
        attenuated(case(array={"lattice": "triangular", "pitch_mm": 4.0}), file, **window)
    with pytest.raises(InputError, match=r"\[zone\]: missing, attenuation without --kx needs it"):
        attenuated(case(), file, points=2)
    with pytest.raises(InputError, match=r"array\.rows = 0: must be 1 or more"):
        ask(plate(0), MeshBroadband(mesh_file=(file,)), Run(LOG))


def _ridge() -> Any:
    region = np.full((4, 4, 4), -1)
    region[:, :, :2] = 0
    region[:, 1:3, 2:] = 0
    return region
