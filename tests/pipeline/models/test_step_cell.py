"""Unit cells from STEP files: bands against the case's own cell and an independent finite-element cell, names and refusals."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry.cad.printing import write_step
from geometry.cad.solids import cell_solid
from geometry.cad.step_cell import step_cell
from geometry.errors import GeometryError
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.lattice import Lattice
from geometry.materials import MATERIALS
from geometry.mesh import Mesh
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.questions.attenuation import Attenuation
from pipeline.questions.bands import Bands, SupercellBands
from pipeline.questions.broadband import Broadband
from pipeline.questions.modes import Modes
from pipeline.questions.question import Run, ask
from tests.helpers.other_program import other_bands

LOG = TerminalLog(True)
PITCH_M, THICK_M = 4e-3, 1e-3
PILLAR = {"side_mm": 1.6, "height_mm": 3.0}
HOLE = (1.0, 1.0, 2.0, 1.0)  # corner and sides, mm
TALL, LOW = (1.0, 1.0, 1.0, 2.0, 3.0), (2.0, 1.0, 1.0, 1.0, 2.0)  # corner, sides and top, mm


def case(**own: Any) -> Case:
    plain: dict[str, Any] = {"name": "own", "material": "aluminium", "plate": {"thickness_mm": 1e3 * THICK_M}}
    plain |= {"array": {"pitch_mm": 1e3 * PITCH_M}, "solve": {"accuracy": 0.01}, "bands": {"points": 1, "count": 6}}
    return case_from_dict(plain | own)


def box(x: float, y: float, length: float, width: float, low: float, high: float) -> Any:
    """A box by its corner, in mm."""
    import cadquery as cq

    return cq.Workplane().box(length, width, high - low, centered=False).translate((x, y, low))


def written(kind: str, folder: Path) -> str:
    """A STEP file of the cell with a pillar, with a hole, or with two pillars as named parts of an assembly."""
    import cadquery as cq

    place, plate = folder / f"{kind}.step", box(0.0, 0.0, 4.0, 4.0, 0.0, 1.0)
    if kind == "pillar":
        write_step(cell_solid(case(pillar=PILLAR).design), place)
    elif kind == "hole":
        x, y, length, width = HOLE
        cq.exporters.export(plate.cut(box(x, y, length, width, 0.0, 1.0)), str(place))
    else:
        parts = cq.Assembly(name="cell")
        parts.add(plate, name="sheet")
        for name, (x, y, length, width, top) in (("Tall", TALL), ("low", LOW)):
            parts.add(box(x, y, length, width, 1.0, top), name=name)
        parts.export(str(place))
    return str(place)


def grid(kind: str, finer: int) -> Mesh:
    """Hexahedra of a millimetre or less that follow the hole or the pillars."""
    lines = [PITCH_M * np.linspace(0.0, 1.0, 4 * finer + 1)] * 2
    top = 1 if kind == "hole" else 3
    levels = THICK_M * np.linspace(0.0, top, top * finer + 1)
    x, y, z = np.meshgrid(*(1e3 * (line[:-1] + line[1:]) / 2.0 for line in (*lines, levels)), indexing="ij")
    region = np.where(z < 1.0, 0, -1)
    for each in (TALL, LOW) if kind != "hole" else ():
        at, size, high = each[:2], each[2:4], each[4]
        region[_inside(x, y, at, size) & (z > 1.0) & (z < high)] = 1
    if kind == "hole":
        region[_inside(x, y, HOLE[:2], HOLE[2:])] = -1
    return hex_mesh(Boxes(*lines, levels, region, ("plate", "steel")), 2)


def _inside(x: Any, y: Any, at: Any, size: Any) -> Any:
    return (x > at[0]) & (x < at[0] + size[0]) & (y > at[1]) & (y < at[1] + size[1])


@pytest.mark.slow
def test_the_reference_cell_as_a_solid_has_its_bands_and_decay_within_both_bars(tmp_path: Path) -> None:
    file = written("pillar", tmp_path)
    ours, theirs = ask(case(pillar=PILLAR), Bands(), Run(LOG)), ask(case(cell={"file": file}), Bands(), Run(LOG))
    for one, two in zip(ours.points, theirs.points, strict=True):
        for hz, bar, other, its in zip(one.frequencies_hz, one.error, two.frequencies_hz, two.error, strict=True):
            assert bar is not None and its is not None and its < 0.01
            assert hz < 1.0 or abs(other / hz - 1.0) <= bar + its
    window: dict[str, Any] = {"band_kHz": (112.0, 200.0), "points": 4, "kx_per_m": 200.0}
    rows = {"pitch_mm": 4.0, "rows": 2}
    own = ask(case(pillar=PILLAR, array=rows), Attenuation(**window), Run(LOG))
    step = ask(case(cell={"file": file}, array=rows), Attenuation(**window), Run(LOG))
    for one, two in zip(own.points, step.points, strict=True):
        assert one.db_per_row is not None and two.db_per_row is not None
        assert one.db_error is not None and two.db_error is not None and one.taken_error_db and two.taken_error_db
        assert abs(one.db_per_row - two.db_per_row) <= one.db_error + two.db_error + 1e-9
        assert one.taken_db is not None and two.taken_db is not None
        assert abs(one.taken_db - two.taken_db) <= one.taken_error_db + two.taken_error_db
    assert any(point.db_per_row for point in step.points)


def leaning(a2_mm: tuple[float, float], folder: Path) -> str:
    """A STEP file of the cell along (4, 0) and a2 with the pillar in its middle."""
    import cadquery as cq

    place, (x, y) = folder / "leaning.step", a2_mm
    plate = cq.Workplane().polyline([(0.0, 0.0), (4.0, 0.0), (4.0 + x, y), (x, y)]).close().extrude(1.0)
    side, height = PILLAR.values()
    corner = (4.0 + x - side) / 2.0, (y - side) / 2.0
    cq.exporters.export(plate.union(box(*corner, side, side, 1.0, 1.0 + height)), str(place))
    return str(place)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("array", "a2_mm", "path"),
    [
        ({"pitch_mm": 4.0, "lattice": "triangular"}, (2.0, 2.0 * 3.0**0.5), "GM"),
        ({"a1_mm": [4.0, 0.0], "a2_mm": [1.3, 4.2]}, (-2.7, 4.2), "GXC"),
    ],
)
def test_an_oblique_cell_of_a_file_has_the_bands_and_decay_of_its_pillars(
    array: dict[str, Any], a2_mm: tuple[float, float], path: str, tmp_path: Path
) -> None:
    """A cell may lean either way: the second one does not lean as its vector does."""
    more: dict[str, Any] = {"array": array, "bands": {"path": path, "points": 2, "count": 6}}
    step, own = case(cell={"file": leaning(a2_mm, tmp_path)}, **more), case(pillar=PILLAR, **more)
    for one, two in zip(ask(own, Bands(), Run(LOG)).points, ask(step, Bands(), Run(LOG)).points, strict=True):
        for hz, bar, other, its in zip(one.frequencies_hz, one.error, two.frequencies_hz, two.error, strict=True):
            assert bar is not None and its is not None and its < 0.01
            assert hz < 1.0 or abs(other / hz - 1.0) <= bar + its
        assert (one.kx_per_m, one.ky_per_m) == pytest.approx((two.kx_per_m, two.ky_per_m), abs=1e-6)
    decays = [
        ask(each, Attenuation(band_kHz=(112.0, 200.0), points=4, kx_per_m=200.0), Run(LOG)).points
        for each in (own, step)
    ]
    for one, two in zip(*decays, strict=True):
        assert one.db_per_row is not None and two.db_per_row is not None
        assert one.db_error is not None and two.db_error is not None
        assert abs(one.db_per_row - two.db_per_row) <= one.db_error + two.db_error + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hole", "two pillars"])
def test_cells_have_the_bands_of_an_independent_finite_element_cell(kind: str, tmp_path: Path) -> None:
    """Complete hexahedra overestimate a frequency f by at most f' - f, f' on elements twice as long."""
    more = {} if kind == "hole" else {"materials": {"TALL": "steel", "low": "steel"}}
    found = ask(
        case(cell={"file": written(kind, tmp_path)}, bands={"points": 2, "count": 6}, **more), Bands(), Run(LOG)
    )
    lattice, own = Lattice.of_rows(PITCH_M, PITCH_M), {"plate": MATERIALS["aluminium"], "steel": MATERIALS["steel"]}
    for point in found.points[1:3]:
        k = np.array([point.kx_per_m, point.ky_per_m])
        coarse, fine = (other_bands(grid(kind, finer), lattice, k, 6, own) for finer in (1, 2))
        for hz, bar, above, over in zip(point.frequencies_hz, point.error, fine, coarse - fine, strict=True):
            assert bar is not None and bar < 0.01
            assert above - over - bar * hz <= hz <= above + bar * hz


@pytest.mark.slow
def test_broadband_puts_cells_of_a_file_next_to_the_zone(tmp_path: Path) -> None:
    zone, window = {"length_mm": 60.0, "width_mm": 12.0, "nodal_lines": 4}, {"band_kHz": (112.0, 150.0), "points": 3}
    array = {"pitch_mm": 4.0, "rows": 2, "extension_mm": 8.0}
    step = case(cell={"file": written("pillar", tmp_path)}, array=array, zone=zone, solve={"accuracy": 0.03})
    found = ask(step, Broadband(**window), Run(LOG))  # type: ignore[arg-type]
    own = ask(case(pillar=PILLAR, array=array, zone=zone), Broadband(**window), Run(LOG))  # type: ignore[arg-type]
    for one, two in zip(found.points, own.points, strict=True):
        assert one.taken_error_db is not None and two.taken_error_db is not None
        assert abs(one.taken_db - two.taken_db) <= one.taken_error_db + two.taken_error_db


def test_bodies_keep_their_names_and_re_entrant_edges_are_found(tmp_path: Path) -> None:
    body = step_cell(written("two pillars", tmp_path), (PITCH_M, PITCH_M), THICK_M)
    assert body.regions == ("sheet", "Tall", "low")
    places = np.array([[0.0, 0.0, 0.5], [-0.5, 0.0, 2.0], [0.5, -0.5, 1.5]]) * 1e-3
    assert body.region_of(places).tolist() == ["sheet", "Tall", "low"]
    assert len(body.singular_lines()) == 11  # of both feet, and of the face where the pillars touch
    upright = step_cell(written("hole", tmp_path), (PITCH_M, PITCH_M), THICK_M).singular_lines()
    assert len(upright) == 4 and np.ptp(upright[:, :, 2], axis=1) == pytest.approx([THICK_M] * 4)


def test_a_file_in_metres_is_doubted_in_one_line(tmp_path: Path) -> None:
    file = Path(written("hole", tmp_path))
    text = file.read_text(encoding="utf-8")
    metres = tmp_path / "metres.step"
    metres.write_text(text.replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT($,.METRE.)"), encoding="utf-8")
    with pytest.raises(GeometryError, match=r"the cell is 4000 x 4000 mm, must be .* 4 x 4 mm \(the file says metres"):
        step_cell(metres, (PITCH_M, PITCH_M), THICK_M)
    with pytest.raises(GeometryError, match=r"must be a pitch wide, 4000 x 4000 mm \(its lengths look like metres"):
        step_cell(file, (1e3 * PITCH_M, 1e3 * PITCH_M), THICK_M)
    with pytest.raises(GeometryError, match=r"the cell is 4 x 4 mm, must be a pitch wide, 5 x 5 mm$"):
        step_cell(file, (5e-3, 5e-3), THICK_M)
    broken = tmp_path / "broken.step"
    broken.write_text("ISO-10303-21;", encoding="utf-8")
    with pytest.raises(GeometryError, match="not a readable STEP file"):
        step_cell(broken, (PITCH_M, PITCH_M), THICK_M)


@pytest.mark.slow
def test_what_a_cell_from_a_file_cannot_have_is_refused(tmp_path: Path) -> None:
    file = written("hole", tmp_path)
    own: dict[str, Any] = {"cell": {"file": file}}
    for more, words in (
        ({"pillar": PILLAR}, r"cell.file = .*: cannot be combined with \[pillar\]"),
        ({"cell": {"file": "none.step"}}, r"cell.file = .none.step.: no such file"),
        ({"cell": {"files": file}}, "cell.files"),
    ):
        with pytest.raises(InputError, match=words):
            case(**(own | more))
    with pytest.raises(InputError, match=r"^.*\[cell\] file: modes cannot honour it: it is the unit cell of bands"):
        ask(case(**own), Modes(), Run(LOG))
    with pytest.raises(InputError, match=r"\[cell\] file: bands --supercell cannot honour it"):
        ask(case(**own), SupercellBands(supercell="2x1"), Run(LOG))
    with pytest.raises(InputError, match=r"solve.model = 'solid': must be auto or superelement for bands"):
        ask(case(**own, solve={"model": "solid"}), Bands(), Run(LOG))
    with pytest.raises(InputError, match=r"\[materials\] CORE: no such body of cell.file; it has"):
        ask(case(**own, materials={"CORE": "steel"}), Bands(), Run(LOG))
    shifted = case(**own, array={"a1_mm": [4.0, 0.0], "a2_mm": [1.0, 4.0]}, solve={"accuracy": 0.1})
    with pytest.raises(InputError, match=r"its upper side lies 0 mm further .* rows of the lattice are shifted by 1, "):
        ask(shifted, Bands(), Run(LOG))
    thick = case(**own, plate={"thickness_mm": 1.25}, solve={"accuracy": 0.1})
    with pytest.raises(
        InputError, match=r"cell.file = 'hole.step': side x- ends at z = 1 mm: must be a face of the plate"
    ):
        ask(thick, Bands(), Run(LOG))


def test_an_edited_file_is_another_cell(tmp_path: Path) -> None:
    file = Path(written("hole", tmp_path))
    one = case(cell={"file": str(file)}).to_dict()["design"]
    file.write_text(re.sub("cell", "Cell", file.read_text(encoding="utf-8")) + "\n", encoding="utf-8")
    assert one["cell_file"] == "hole.step" and one != case(cell={"file": str(file)}).to_dict()["design"]
