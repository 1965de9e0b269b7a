"""CAD solids against volumes known in closed form, and STEP pillars that must be refused."""

import subprocess
import sys
from dataclasses import replace
from math import pi

import cadquery as cq
import pytest

from geometry.cad import solids
from geometry.cad.solids import cell_solid, pillar_solid, plate_solid, zone_solid
from geometry.errors import GeometryError
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from geometry.pillar_shapes import Step

ALUMINIUM, BRASS = MATERIALS["aluminium"], MATERIALS["brass"]
MM3 = 1e-9
KERNEL = 1e-6  # relative: booleans on curved faces hold to the kernel's own tolerance


def pillar(shape: str = "square", tip: float = 2e-3, fillet: float = 0.0, file: str | None = None) -> Pillar:
    return Pillar(shape, 2e-3, tip, 6.3e-3, ALUMINIUM, fillet, file)


def design(standing: Pillar | None, rows: int = 3, pitch: float = 4e-3, length: float = 115.5e-3) -> Design:
    return Design(length, 20e-3, 2e-3, 8, ALUMINIUM, standing, pitch, pitch, rows, 25e-3)


def flare_mm3(radius: float, fillet: float) -> float:
    """Round foot fillet by Pappus: a square minus a quarter disc, turned about the axis."""
    area = fillet**2 * (1.0 - pi / 4.0)
    inside = fillet * (10.0 - 3.0 * pi) / (12.0 - 3.0 * pi)  # centroid of that corner from the two straight sides
    return 2.0 * pi * (radius + inside) * area


def frustum_mm3(base: float, tip: float, height: float) -> float:
    return height / 3.0 * (base**2 + tip**2 + base * tip)


@pytest.mark.parametrize(
    ("standing", "exact"),
    [
        (pillar(), 2 * 2 * 6.3),
        (pillar("round"), pi * 6.3),
        (pillar("tapered", tip=1e-3), frustum_mm3(2, 1, 6.3)),
        (pillar("tapered", tip=2e-3), 2 * 2 * 6.3),
        (pillar("round", fillet=0.3e-3), pi * 6.3 + flare_mm3(1.0, 0.3)),
    ],
)
def test_lone_pillar_has_its_closed_form_volume(standing, exact):
    body = pillar_solid(standing)
    assert body.volume_m3 == pytest.approx(exact * MM3, rel=KERNEL)
    box = body.shape.BoundingBox()
    assert box.zmin == pytest.approx(0.0, abs=1e-6)
    assert box.zmax == pytest.approx(6.3, abs=1e-6)
    assert box.xlen == pytest.approx(1e3 * standing.footprint_m, abs=1e-4)


def test_square_foot_fillet_lies_between_four_straight_fillets_and_the_same_with_square_corners():
    flare = pillar_solid(pillar(fillet=0.4e-3)).volume_m3 / MM3 - 2 * 2 * 6.3
    area = 0.4**2 * (1.0 - pi / 4.0)
    assert 4 * 2 * area < flare < 4 * (2 + 2 * 0.4) * area


@pytest.mark.slow
@pytest.mark.parametrize("standing", [pillar(), pytest.param(pillar("round", fillet=0.3e-3), marks=pytest.mark.slow)])
def test_whole_design_of_174_pillars_is_one_solid(standing):
    scene = design(standing)
    body = plate_solid(scene)
    assert len(scene.pillar_centres()) == 174
    assert len(body.shape.Solids()) == 1
    assert body.shape.isValid()
    one = pillar_solid(standing).volume_m3
    block = scene.length_m * 2 * scene.half_span_m * scene.thickness_m
    assert body.volume_m3 == pytest.approx(block + 174 * one, rel=KERNEL)
    box = body.shape.BoundingBox()
    assert [box.xlen, box.ylen] == pytest.approx([115.5, 2e3 * scene.half_span_m], abs=1e-5)


@pytest.mark.parametrize("mirrors", ["x", "y", "xy"])
@pytest.mark.parametrize("length", [43.5e-3, 20e-3])
def test_mirrored_parts_make_the_whole(mirrors, length):
    """11 columns have one on the mirror x = 0, the 5 of the shorter plate too."""
    scene = design(pillar(), length=length)
    assert 0.0 in scene.column_centres()
    part = plate_solid(scene, mirrors)
    assert part.volume_m3 * 2 ** len(mirrors) == pytest.approx(plate_solid(scene).volume_m3, rel=1e-9)
    box = part.shape.BoundingBox()
    assert ("x" not in mirrors) == (box.xmin < -1.0)
    assert ("y" not in mirrors) == (box.ymin < -1.0)


def test_even_columns_leave_the_mirror_free():
    scene = design(pillar(), rows=1, pitch=8e-3, length=20e-3)
    assert len(scene.column_centres()) == 3
    scene = replace(scene, pitch_x_m=18e-3)
    assert len(scene.column_centres()) == 2
    assert 4 * plate_solid(scene, "xy").volume_m3 == pytest.approx(plate_solid(scene).volume_m3, rel=1e-9)


def test_cell_and_zone():
    assert cell_solid(design(pillar())).volume_m3 == pytest.approx((4 * 4 * 2 + 25.2) * MM3)
    assert 4 * cell_solid(design(pillar()), "xy").volume_m3 == pytest.approx((4 * 4 * 2 + 25.2) * MM3)
    assert cell_solid(design(None, 0)).volume_m3 == pytest.approx(4 * 4 * 2 * MM3)
    assert zone_solid(design(None, 0)).volume_m3 == pytest.approx(115.5 * 20 * 2 * MM3)


def test_another_material_keeps_its_solids_apart_and_its_faces_shared():
    scene = design(replace(pillar(), material=BRASS), rows=1, length=20e-3)
    body = plate_solid(scene)
    assert body.bonds == {"pillar"}
    assert len(body.shape.Solids()) == 1 + len(scene.pillar_centres())
    each_side = [face.hashCode() for solid in body.shape.Solids() for face in solid.Faces()]
    assert len(each_side) - len(set(each_side)) == len(scene.pillar_centres())
    volumes = body.part_volumes_m3()
    assert volumes["pillar"] == pytest.approx(10 * 25.2 * MM3)


def test_bonded_parts_that_overlap_are_refused():
    one = cq.Solid.makeBox(2.0, 2.0, 2.0)
    with pytest.raises(GeometryError, match="overlap"):
        solids.share_faces([one, one.moved(cq.Location(cq.Vector(1.0, 0.0, 0.0)))])


def test_fillet_that_does_not_fit_is_refused_by_name():
    with pytest.raises(GeometryError, match="fillet of 9 mm"):
        pillar_solid(pillar(fillet=9e-3))


def step_file(folder, shape, unit: str = "MM"):
    path = folder / "pillar.step"
    cq.exporters.export(cq.Workplane(obj=shape), str(path), unit=unit)
    return path


def box_at(x=-1.0, y=-1.0, z=0.0, sides=(2.0, 2.0, 6.3)):
    return cq.Solid.makeBox(*sides, cq.Vector(x, y, z))


@pytest.mark.parametrize(("unit", "in_mm"), [("MM", 1.0), ("INCH", 25.4), ("M", 1000.0)])
def test_step_pillar_is_read_in_any_unit(tmp_path, unit, in_mm):
    """The exporter labels the model's numbers with the unit, so 2 mm is written as 2 / 25.4 inches."""
    path = step_file(tmp_path, box_at().scale(1.0 / in_mm), unit)
    result = Step.from_file(path)
    assert [result.height_m(0.0), result.width_m, result.tip_m, *result.reach_m()] == pytest.approx(
        [6.3e-3, 2e-3, 2e-3, 2e-3, 2e-3], rel=1e-6
    )
    assert result.volume_m3(0.0) == pytest.approx(25.2 * MM3, rel=1e-6)
    assert 4 * plate_solid(design(pillar("step", file=str(path)), length=20e-3), "xy").volume_m3 == pytest.approx(
        plate_solid(design(pillar(), length=20e-3)).volume_m3, rel=KERNEL
    )


def test_step_pillar_wider_above_tells_its_extent(tmp_path):
    mushroom = box_at().fuse(box_at(-1.5, -1.5, 5.3, (3.0, 3.0, 1.0)))
    result = Step.from_file(step_file(tmp_path, mushroom))
    assert [result.width_m, *result.reach_m()] == pytest.approx([2e-3, 3e-3, 3e-3], rel=1e-6)


@pytest.mark.parametrize(
    ("shape", "reason"),
    [
        (cq.Shell.makeShell(box_at().Faces()[:5]), "open"),
        (cq.Compound.makeCompound([box_at(), box_at(x=5.0)]), "2 solids"),
        (box_at(z=0.5), "z = 0.5 mm"),
        (box_at(z=-0.5), "z = -0.5 mm"),
        (box_at(x=0.0), "centred at"),
        (cq.Solid.makeSphere(1.0, cq.Vector(0, 0, 1.0), angleDegrees1=-90), "no flat face"),
    ],
)
def test_step_that_is_no_pillar_is_refused_with_its_reason(tmp_path, shape, reason):
    path = step_file(tmp_path, shape)
    with pytest.raises(GeometryError, match=reason) as caught:
        Step.from_file(path)
    assert str(path) in str(caught.value)


def test_step_that_is_missing_or_garbage_is_refused_quietly(tmp_path, capfd):
    with pytest.raises(GeometryError, match="no such STEP file"):
        Step.from_file(tmp_path / "none.step")
    garbage = tmp_path / "garbage.step"
    garbage.write_text("not a step file")
    with pytest.raises(GeometryError, match="not a readable STEP file"):
        Step.from_file(garbage)
    assert capfd.readouterr().out == ""


def test_lopsided_step_pillar_is_not_mirrored(tmp_path):
    lopsided = box_at().cut(box_at(x=0.5, y=-1.0, z=5.0))
    scene = design(pillar("step", file=str(step_file(tmp_path, lopsided))), length=20e-3)
    with pytest.raises(GeometryError, match="not symmetric"):
        plate_solid(scene, "x")
    assert len(plate_solid(scene, "y").shape.Solids()) == 1
    assert len(plate_solid(scene).shape.Solids()) == 1


def test_rows_that_differ_stand_on_the_plate_with_their_own_sizes() -> None:
    """Volume in closed form, whole and quartered: two rows of 9 columns each side, 6.3 and 5 mm high, 2 and 1.5 mm wide."""
    kinds = (pillar(), replace(pillar(tip=1.5e-3), base_m=1.5e-3, height_m=5e-3))
    graded = replace(design(pillar(), rows=2, length=36e-3), graded=kinds, extension_m=3e-3)
    assert len(graded.column_centres()) == 9
    exact = 36.0 * 2e3 * graded.half_span_m * 2.0 + 18 * (4.0 * 6.3 + 2.25 * 5.0)
    assert plate_solid(graded).volume_m3 == pytest.approx(exact * MM3, rel=KERNEL)
    assert plate_solid(graded, "xy").volume_m3 == pytest.approx(exact * MM3 / 4.0, rel=KERNEL)


TOGETHER = """
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Barrier

import cadquery

from geometry.cad.solids import cell_solid
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS

sys.setswitchinterval(1e-6)
names = ["aluminium", "brass"] * 4
pillars = [Pillar("square", 2e-3, 2e-3, 6e-3, MATERIALS[name]) for name in names]
designs = [Design(10e-3, 6e-3, 2e-3, 1, MATERIALS["aluminium"], pillar, 4e-3, 4e-3, 1, 1e-3) for pillar in pillars]
start = Barrier(len(designs))
with ThreadPoolExecutor(len(designs)) as pool:
    print(len(list(pool.map(lambda design: (start.wait(), cell_solid(design))[1].volume_m3, designs))))
"""


@pytest.mark.slow
def test_several_threads_build_their_first_solids_at_once():
    """In a process of its own: only the first call of each overload may meet another one."""
    done = subprocess.run([sys.executable, "-c", TOGETHER], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "8", done.stderr[-500:]
