"""Print and CAD files read back by readers that did not write them: trimesh for STL and 3MF, CadQuery for STEP."""

import re
import time
from dataclasses import replace
from math import atan, degrees, pi

import numpy as np
import pytest
import trimesh

from geometry.cad import printing
from geometry.cad.printing import check_print, overhang, write_3mf, write_step, write_stl
from geometry.cad.solids import plate_solid
from geometry.errors import GeometryError
from geometry.layout import Design, Pillar, Section
from geometry.materials import MATERIALS

ALUMINIUM, BRASS = MATERIALS["aluminium"], MATERIALS["brass"]


def design(shape: str = "square", rows: int = 2, fillet: float = 0.0) -> Design:
    pillar = Pillar(shape, 2e-3, 2e-3, 6.3e-3, ALUMINIUM, fillet)
    return Design(21.5e-3, 10e-3, 2e-3, 1, ALUMINIUM, pillar, 4e-3, 5e-3, rows, 3e-3)


SCENES = [design(), design("round", fillet=0.3e-3)]


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES, ids=["square", "round"])
def test_stl_is_one_closed_body_with_the_solids_volume(tmp_path, scene):
    body, path = plate_solid(scene), tmp_path / "plate_mm.stl"
    write_stl(body, path, "plate")
    report = check_print(path, body, scene)
    assert report.faults == []
    assert report.watertight
    assert report.bodies == 1
    assert abs(report.volume_error) < 1e-3
    assert report.extent_m == pytest.approx((21.5e-3, 2 * scene.half_span_m, 8.3e-3), rel=1e-6)
    assert report.mass_kg == pytest.approx(body.volume_m3 * 2700.0, rel=1e-3)
    mesh = trimesh.load_mesh(path)
    assert mesh.bounds[0][2] == 0.0
    assert mesh.volume == pytest.approx(1e9 * report.volume_m3)
    assert b"units=mm" in path.read_bytes()[:80]


def test_box_pillars_print_exactly(tmp_path):
    scene = design()
    body = plate_solid(scene)
    write_stl(body, tmp_path / "a.stl")
    exact = 21.5 * 2e3 * scene.half_span_m * 2.0 + len(scene.pillar_centres()) * 25.2
    assert trimesh.load_mesh(tmp_path / "a.stl").volume == pytest.approx(exact, rel=1e-6)


def test_smallest_feature_is_named(tmp_path):
    body = plate_solid(design())
    write_stl(body, tmp_path / "a.stl")
    round_feet = replace(design("round", fillet=0.3e-3), pitch_x_m=2.8e-3)
    assert check_print(tmp_path / "a.stl", body, round_feet).smallest_feature == (
        "gap between pillars along x",
        pytest.approx(0.2e-3),
    )
    one_row = replace(design(rows=1), pitch_y_m=2.1e-3)
    assert check_print(tmp_path / "a.stl", body, one_row).smallest_feature[1] == pytest.approx(2e-3)


def test_faults_are_seen_in_the_file_not_in_the_solid(tmp_path):
    scene = design()
    body, path = plate_solid(scene), tmp_path / "a.stl"
    write_stl(body, path)
    good = trimesh.load_mesh(path)
    trimesh.Trimesh(good.vertices, good.faces[1:], process=False).export(path)
    assert "the surface is not closed" in check_print(path, body, scene).faults
    trimesh.util.concatenate([good, good.copy().apply_translation([50.0, 0.0, 0.0])]).export(path)
    faults = check_print(path, body, scene).faults
    assert faults[0] == "2 separate bodies, must be 1"
    assert "volume is +100.00%" in faults[1]
    good.copy().apply_scale(1.0005).export(path)
    assert len(check_print(path, body, scene).faults) == 1


def test_unreadable_stl_is_one_clear_line(tmp_path):
    scene = design()
    body, path = plate_solid(scene), tmp_path / "a.stl"
    for content in (b"", b"solid nothing\nendsolid\n", bytes(84)):
        path.write_bytes(content)
        with pytest.raises(GeometryError, match=r"a\.stl: (not a readable STL file|holds no triangle)"):
            check_print(path, body, scene)


def test_overhang_of_a_cone_on_its_tip_and_of_a_ceiling():
    """A cone on its tip leans out by atan(radius / height); a lid on a post is a ceiling of 90 degrees."""
    import cadquery as cq

    for radius in (0.5, 2.0):
        cone = trimesh.creation.cone(radius, 1.0, sections=256)
        cone.apply_transform(np.diag([1.0, -1.0, -1.0, 1.0]))
        angle, area = overhang(np.asarray(cone.triangles))
        assert angle == pytest.approx(degrees(atan(radius)), abs=0.05)
        slope = pi * radius * (1.0 + radius**2) ** 0.5
        assert area == pytest.approx(slope if radius > 1.0 else 0.0, rel=1e-3)
    post = cq.Workplane().box(2, 2, 6, centered=(True, True, False)).faces(">Z").workplane().rect(3, 3).extrude(1).val()
    points, faces = post.tessellate(0.1)
    angle, area = overhang(np.array([p.toTuple() for p in points])[np.array(faces)])
    assert angle == pytest.approx(90.0)
    assert area == pytest.approx(3 * 3 - 2 * 2)


@pytest.mark.slow
def test_upright_pillars_need_no_support(tmp_path):
    scene = SCENES[1]
    body = plate_solid(scene)
    write_stl(body, tmp_path / "a.stl")
    report = check_print(tmp_path / "a.stl", body, scene)
    assert report.overhang_deg < 0.1
    assert report.overhang_area_m2 == 0.0


@pytest.mark.slow
def test_a_triangulation_held_by_the_kernel_does_not_leak_into_the_file(tmp_path):
    """The kernel hands back a finer triangulation it already holds, whatever tolerance is asked."""
    body = plate_solid(SCENES[1])
    write_stl(body, tmp_path / "fresh.stl")
    body.shape.mesh(5e-4, 0.05)
    write_stl(body, tmp_path / "after.stl")
    assert (tmp_path / "after.stl").read_bytes() == (tmp_path / "fresh.stl").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES, ids=["square", "round"])
def test_3mf_carries_millimetres_and_metadata(tmp_path, scene):
    body, path = plate_solid(scene), tmp_path / "plate.3mf"
    write_3mf(body, path, {"Title": "plate <1> & co", "Application": "antinode"})
    loaded = trimesh.load(path)
    assert loaded.units == "millimeter"
    (mesh,) = loaded.geometry.values()
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(1e9 * body.volume_m3, rel=1e-3)
    from zipfile import ZipFile

    from lxml import etree

    model = etree.fromstring(ZipFile(path).read("3D/3dmodel.model"))
    notes = {node.get("name"): node.text for node in model.iter("{*}metadata")}
    assert notes == {"Title": "plate <1> & co", "Application": "antinode"}
    assert all(int(node.get("id")) > 0 for node in model.iter("{*}object"))
    again = tmp_path / "again.3mf"
    write_3mf(body, again, {"Title": "plate <1> & co", "Application": "antinode"})
    assert again.read_bytes() == path.read_bytes()


def test_3mf_metadata_outside_the_specification_is_refused(tmp_path):
    with pytest.raises(GeometryError, match="'Mass' is not one of"):
        write_3mf(plate_solid(design()), tmp_path / "a.3mf", {"Mass": "1 g"})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("scene", SCENES, ids=["square", "round"])
def test_step_reads_back_as_the_same_solid(tmp_path, scene, capfd):
    import cadquery as cq

    body = plate_solid(scene)
    write_step(body, tmp_path / "plate.step", "plate")
    assert capfd.readouterr().out == ""
    back = cq.importers.importStep(str(tmp_path / "plate.step")).val()
    assert len(back.Solids()) == 1
    assert back.Volume() == pytest.approx(1e9 * body.volume_m3, rel=1e-9)
    assert len(back.Faces()) == len(body.shape.Faces())


BONDED = Pillar("square", 2e-3, 2e-3, 3e-3, BRASS, upper=(Section("round", 1.5e-3, 1.5e-3, 1e-3, ALUMINIUM),))
NAMES = {"plate": "aluminium", "pillar": "brass", "section2": "aluminium (section2)"}


def bonded() -> Design:
    return replace(design(), pillar=BONDED)


@pytest.mark.slow
def test_bonded_materials_stay_separate_parts_of_a_step_file(tmp_path):
    import cadquery as cq

    body, count = plate_solid(bonded()), len(bonded().pillar_centres())
    with pytest.raises(GeometryError, match="one solid of one material: write 3MF or STEP"):
        write_stl(body, tmp_path / "a.stl")
    write_step(body, tmp_path / "a.step", "touch plate", NAMES)
    back = cq.importers.importStep(str(tmp_path / "a.step"))
    assert len(back.solids().vals()) == 1 + 2 * count
    products = re.findall(r"PRODUCT\('([^']*)'", (tmp_path / "a.step").read_text())
    assert {"touch plate", *NAMES.values()} <= set(products)
    time.sleep(1.1)
    write_step(body, tmp_path / "b.step", "touch plate", NAMES)
    one, two = (_unnumbered((tmp_path / name).read_text()) for name in ("a.step", "b.step"))
    placed = r"(OCCURRENCE\(')\d+"  # parts placed are counted from one file of a process to the next
    assert re.sub(placed, r"\1", one) == re.sub(placed, r"\1", two)


@pytest.mark.slow
def test_the_print_file_of_several_materials_is_checked_part_by_part(tmp_path):
    scene = bonded()
    body, path, count = plate_solid(scene), tmp_path / "plate.3mf", len(scene.pillar_centres())
    write_3mf(body, path, {"Title": "plate"}, NAMES)
    found = check_print(path, body, scene)
    assert found.watertight and found.bodies == found.solids == 1 + 2 * count and not found.faults
    brass, tips = count * 2e-3**2 * 3e-3, count * pi * 0.75e-3**2 * 1e-3
    plate = body.volume_m3 - brass - tips
    exact = plate * ALUMINIUM.density_kg_m3 + brass * BRASS.density_kg_m3 + tips * ALUMINIUM.density_kg_m3
    assert found.mass_kg == pytest.approx(exact, rel=1e-3)  # facets of the round tips
    assert replace(found, bodies=count).faults == [f"{count} separate bodies, must be {1 + 2 * count}"]


def test_a_3mf_of_several_materials_has_an_object_of_each(tmp_path):
    from zipfile import ZipFile

    from lxml import etree

    body, path = plate_solid(bonded()), tmp_path / "plate.3mf"
    write_3mf(body, path, {}, NAMES)
    volumes = dict(zip(NAMES, (1e9 * part for part in body.part_volumes_m3().values()), strict=True))
    loaded = trimesh.load(path)
    found = {name: mesh.volume for name, mesh in loaded.geometry.items()}
    chords = 4.0 / 3.0 * printing.DEFLECTION_MM / 0.75  # what facets take of a disc
    assert sorted(found.values()) == pytest.approx(sorted(volumes.values()), rel=chords)
    assert all(mesh.is_watertight for mesh in loaded.geometry.values())
    assert loaded.bounds[:, 2] == pytest.approx([0.0, 6.0])
    model = etree.fromstring(ZipFile(path).read("3D/3dmodel.model"))
    assert [base.get("name") for base in model.iter("{*}base")] == [*NAMES.values()]
    named = {node.get("name"): node.get("pindex") for node in model.iter("{*}object") if node.get("name")}
    assert named == {name: str(place) for place, name in enumerate(NAMES.values())}
    (item,) = model.iter("{*}item")
    assert len([*model.iter("{*}component")]) == 3 and int(item.get("objectid")) == 5


def test_a_write_that_dies_leaves_the_old_file_whole(tmp_path, monkeypatch):
    body, path = plate_solid(design()), tmp_path / "a.3mf"
    path.write_bytes(b"old")

    def die(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(printing.ZipFile, "writestr", die)
    with pytest.raises(KeyboardInterrupt):
        write_3mf(body, path, {})
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["a.3mf"]


def test_step_has_the_same_bytes_each_time_and_names_its_product(tmp_path):
    body = plate_solid(design(rows=0))
    write_step(body, tmp_path / "one.step", "touch plate")
    time.sleep(1.1)  # STEP counts seconds
    write_step(body, tmp_path / "two.step", "touch plate")
    text = (tmp_path / "one.step").read_text()
    products = re.findall(r"PRODUCT\('([^']*)'", text)
    assert products and all(name.startswith("touch plate") for name in products)
    assert _unnumbered(text) == _unnumbered((tmp_path / "two.step").read_text())


def _unnumbered(text: str) -> str:
    """The kernel numbers the products of a process."""
    return re.sub(r"touch plate \d+", "touch plate", text)
