"""Pillar shapes in the case file: their keys, what is refused, and that a new shape is one class and one line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from geometry.pillar_shapes import Square
from pipeline.case.model import Case, case_from_dict, load_case, parsed, read_case
from pipeline.case.reading import apply_overrides
from pipeline.errors import InputError
from pipeline.planning import simplifications
from pipeline.planning.model_choice import cell_model_choice, model_choice_of
from pipeline.search import space
from pipeline.search.terms import mass_kg

ROOT = Path(__file__).parents[3]
CASE = ROOT / "studies" / "three-rows.toml"
HEXAGON = ("pillar.shape=hexagonal",)
CROSS = ("pillar.shape=cross", "pillar.arm_mm=0.8")


def case(*overrides: str) -> Case:
    return load_case(CASE, overrides)


def pathless(*overrides: str) -> Case:
    """The case without a path of its own."""
    raw = read_case(CASE)
    del raw["bands"]
    return case_from_dict(raw, CASE, overrides)


def test_shapes_are_read_with_their_own_sizes() -> None:
    hexagon, cross = case(*HEXAGON).design.pillar, case(*CROSS).design.pillar
    assert hexagon and cross
    assert (hexagon.shape, hexagon.base_m, hexagon.tip_m, hexagon.more_m) == ("hexagonal", 2e-3, 2e-3, ())
    assert (cross.shape, cross.base_m, cross.tip_m, cross.more_m) == ("cross", 2e-3, 2e-3, (("arm_m", 0.8e-3),))
    assert case(*CROSS).to_dict()["design"]["pillar"]["arm_m"] == 0.8e-3
    square = case().to_dict()["design"]["pillar"]
    assert {*square} == {"shape", "base_m", "tip_m", "height_m", "material", "fillet_m", "file"}


def test_another_shape_keeps_the_sizes_that_it_shares() -> None:
    cross = apply_overrides(read_case(CASE), parsed(CROSS))
    for shapes in (("square",), ("hexagonal",), ("hexagonal", "square"), ("square", "hexagonal")):
        pillar = case_from_dict(cross, CASE, [f"pillar.shape={shape}" for shape in shapes]).design.pillar
        assert pillar and (pillar.shape, pillar.base_m, pillar.more_m) == (shapes[-1], 2e-3, ())


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        (("pillar.shape=cross",), "pillar.arm_mm: missing, a cross pillar needs it"),
        ((*CROSS, "pillar.arm_mm=2"), "pillar.arm_mm = 2: must be smaller than the pillar's overall width, side_mm = 2"),
        ((*CROSS, "pillar.arm_mm=2.5"), "pillar.arm_mm = 2.5: must be smaller than"),
        ((*CROSS, "pillar.side_mm=9", "array.pitch_mm=12", "pillar.arm_mm=0.008"), "arm_mm = 0.008: must be from 0.009"),
        ((*CROSS, "pillar.fillet_mm=0.6"), "pillar.fillet_mm = 0.6: must be smaller than 0.6, the depth of the notch"),
        ((*CROSS, "array.pitch_mm=2"), "pillars overlap: must exceed the pillar's footprint 2 mm"),
        ((*HEXAGON, "pillar.arm_mm=1"), "pillar.arm_mm = 1: does not belong to a hexagonal pillar, which takes side_mm and"),
        ((*HEXAGON, "array.pitch_mm=2.3"), "pillars overlap: must exceed the pillar's footprint 2.3094"),
        ((*HEXAGON, "solve.mesh=hex", "solve.model=solid"), "must be auto or tet; hexahedra cannot follow a hexagonal pillar"),
        ((*CROSS, "pillar.fillet_mm=0.2", "solve.mesh=hex"), "hexahedra cannot follow a cross pillar with a fillet"),
        ((*HEXAGON, "array.pitch_mm=8", "tolerance.side_mm=0.7"), "must be below 0.666667, a third of pillar.side_mm"),
        ((*HEXAGON, "tolerance.side_mm=0.5"), "pillars may touch: 3 side_mm + 6 position_mm must be below the room 1.6"),
        ((*HEXAGON, "pillar.fillet_mm=0.2", "tolerance.side_mm=0.01"), "cross-shaped pillars of one section without fillet"),
        ((*CROSS, "pillar.faces=both", "tolerance.side_mm=0.01"), "cross-shaped pillars of one section without fillet"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_line(overrides: tuple[str, ...], expected: str) -> None:
    with pytest.raises(InputError) as fault:
        cell_model_choice(case(*overrides))
    assert fault.value.exit_code == 2
    assert len(fault.value.lines) == 1 and expected in fault.value.lines[0], fault.value.lines


def test_hexahedra_only_where_they_follow_the_solid() -> None:
    for part in ("plate", "pillar", "cell"):
        assert simplifications.hexahedra(case(*CROSS), part)
        assert bool(simplifications.hexahedra(case(*HEXAGON), part)) == (part != "pillar")
        assert not simplifications.hexahedra(case(*CROSS, "pillar.fillet_mm=0.2"), part)
    kinds = [model_choice_of(case(*HEXAGON, *more), "plate", 50e3).kind for more in ((), ("solve.mesh=tet",))]
    assert model_choice_of(case(*CROSS), "plate", 50e3).kind == "hex" and kinds == ["hex", "tet"]
    edge = model_choice_of(case(*CROSS, "solve.mesh=tet", "solve.accuracy=0.01"), "pillar", 50e3).edge_m
    assert edge == pytest.approx(0.8e-3 / 3.0)  # three edges across an arm


def test_wavevectors_off_the_path_are_kept_for_a_hexagon() -> None:
    """On a square pitch its irreducible zone is twice a square pillar's: G-X-M-G does not bound it, G-X-M-Y-G does."""
    hexagon, cross = case(*HEXAGON).design, case(*CROSS).design
    assert simplifications.off_path(cross, "GXMG")
    assert not simplifications.off_path(hexagon, "GXMG") and simplifications.off_path(hexagon, "GXMYG")
    assert pathless(*HEXAGON).bands.path == pathless(*CROSS).bands.path == pathless().bands.path == "GXMG"


@pytest.mark.parametrize(
    ("mirrors", "bounding"), [(("x",), {"GXMYG"}), (("y",), {"GXMYG"}), (("d",), set()), (("x", "y", "d"), {"GXMG"})]
)
def test_the_path_that_bounds_the_zone_follows_the_mirrors(
    mirrors: tuple[str, ...], bounding: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One mirror and time reversal (k and -k alike) leave a quarter of the zone; an exchange of x and y alone has no
    such border.
    """
    monkeypatch.setattr(Square, "mirrors", mirrors)
    design = case().design
    assert {path for path in ("GXMG", "GXMYG") if simplifications.off_path(design, path)} == bounding


def test_a_search_varies_the_sizes_of_every_shape() -> None:
    assert {"pillar.arm_mm", "pillar.side_mm", "pillar.diameter_mm"} <= {*space.searchable_keys()}
    assert "pillar.file" not in space.searchable_keys() and "pillar.shape" not in space.searchable_keys()
    square, cross = mass_kg(case().design), mass_kg(case(*CROSS).design)
    pillars = 2 * 3 * 29
    assert square - cross == pytest.approx(pillars * 2700.0 * 6.3e-9 * (4.0 - (2 * 2 * 0.8 - 0.64)), rel=1e-9)


TOY = """
import json, sys
from pathlib import Path
import numpy as np
from geometry.pillar_shapes import PillarShape
from geometry.pillar_shapes import register

class Plank(PillarShape):
    name = "plank"
    keys = ("side_mm", "depth_mm")
    def outline(self, grow_m=0.0):
        half = np.array([self.width_m, self.size_m("depth_m")]) / 2.0 + grow_m
        return np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half
    def shear_factor(self, poisson):
        return 5.0 / 6.0
    @property
    def rectangles(self):
        (x, y), *_ = self.outline()
        return np.array([[-x, x, -y, y]])

register(Plank)

from geometry.cad.solids import pillar_solid
from geometry.hex.boxes import hex_mesh, pillar_boxes
from geometry.hex.scenes import HexSettings
from geometry.mesh import check_mesh
from pipeline.case.model import load_case
from pipeline.cli.main import main
from pipeline.planning import simplifications
from pipeline.plots.fields import footprints_mm
from pipeline.records.record import DesignRecord

case, folder = sys.argv[1], Path(sys.argv[2])
settings = ["pillar.shape=plank", "pillar.depth_mm=1"]
design = load_case(case, settings).design
pillar = design.pillar
sets = [word for each in settings for word in ("--set", each)]
codes = [main(["predesign", case, *sets, "--json", str(folder / "p.json")]),
         main(["predesign", case, "--json", str(folder / "q.json")]),
         main(["export", "step", case, *sets, "-o", str(folder / "p.step")])]
found = {
    "codes": codes,
    "cad_m3": pillar_solid(pillar).volume_m3,
    "boxes_m3": 4.0 * check_mesh(hex_mesh(pillar_boxes(pillar, HexSettings(2, 2e-3, 0)), 2)).volume_m3,
    "mirrors": design.cell_mirrors,
    "left_out": bool(simplifications.off_path(design, "GXMG")),
    "footprint_m": design.footprint_m,
    "square_prism": pillar.is_square_prism,
    "drawn_mm": np.ptp(footprints_mm(DesignRecord.of_design(design), np.zeros((1, 2)))[0], axis=0).tolist(),
    "plank_hz": json.loads((folder / "p.json").read_text())["pillar"]["given_euler_hz"],
    "square_hz": json.loads((folder / "q.json").read_text())["pillar"]["given_euler_hz"],
}
print(json.dumps(found))
"""


@pytest.mark.slow
def test_a_shape_of_ones_own_is_one_class_and_one_line(tmp_path: Path) -> None:
    """A plank 2 mm along x and 1 mm along y, registered here, goes from the case file to solids, meshes, plans and drawings."""
    done = subprocess.run(
        [sys.executable, "-c", TOY, str(ROOT / "examples" / "small.toml"), str(tmp_path)],
        cwd=ROOT, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["codes"] == [0, 0, 0] and (tmp_path / "p.step").stat().st_size > 0
    assert result["cad_m3"] == pytest.approx(12.6e-9, rel=1e-6) and result["boxes_m3"] == pytest.approx(
        12.6e-9, rel=1e-12
    )
    assert result["mirrors"] == ["x", "y"] and not result["left_out"] and not result["square_prism"]
    assert result["footprint_m"] == 2e-3 and result["drawn_mm"] == pytest.approx([2.0, 1.0])
    assert result["plank_hz"] == pytest.approx(result["square_hz"] / 2.0, rel=1e-9)  # it bends where it is thin
