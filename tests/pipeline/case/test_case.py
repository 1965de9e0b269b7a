"""A good case file read right, in SI, and everything a user may leave out or set."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
import tomllib
from math import isnan, pi
from pathlib import Path

import numpy as np
import pytest

from pipeline.case.model import case_from_dict, load_case
from pipeline.case.reading import apply_overrides
from pipeline.errors import InputError

ROOT = Path(__file__).parents[3]
CASE = ROOT / "studies" / "three-rows.toml"
RAW = tomllib.loads(CASE.read_text())


def without(*tables: str) -> dict:
    return {key: value for key, value in RAW.items() if key not in tables}


def test_every_value_in_si():
    case = load_case(CASE)
    design, pillar = case.design, case.design.pillar
    assert (design.length_m, design.width_m, design.thickness_m) == pytest.approx((0.1155, 0.02, 0.002), rel=1e-15)
    assert (pillar.base_m, pillar.tip_m, pillar.height_m) == pytest.approx((2e-3, 2e-3, 6.3e-3), rel=1e-15)
    assert (design.pitch_x_m, design.pitch_y_m, design.extension_m) == pytest.approx((4e-3, 4e-3, 25e-3), rel=1e-15)
    assert (design.rows, design.nodal_lines) == (3, 8)
    assert case.solve.band_hz == (25_000.0, 45_000.0)
    assert (case.solve.near_hz, case.solve.count) == (None, None)
    assert (case.solve.accuracy, case.solve.model, case.solve.mesh) == (0.003, "auto", "auto")
    assert (case.bands.path, case.bands.points, case.bands.count, case.quality_factor) == ("GXMG", 25, 10, 300.0)
    assert case.patches.size_m == pytest.approx((12e-3, 3e-3, 0.3e-3), rel=1e-15)
    assert case.target_kx_per_m == pytest.approx(7.5 * pi / 0.1155)


def test_defaults_when_settings_are_left_out():
    case = case_from_dict(without("solve", "bands", "damping", "patches", "name"))
    assert case.solve.band_hz is None and case.solve.accuracy == 0.003
    assert (case.bands.path, case.bands.points, case.bands.count, case.quality_factor) == ("GXMG", 25, 10, 300.0)
    assert case.patches is None


def test_a_rectangular_lattice_walks_the_other_corner_too():
    raw = without("bands") | {"array": {"pitch_x_mm": 4.0, "pitch_y_mm": 5.0, "rows": 1}}
    assert case_from_dict(raw).bands.path == "GXMYG"


@pytest.mark.parametrize(("lines", "symmetry"), [(0, "SS"), (1, "AS"), (2, "SS"), (7, "AS"), (8, "SS")])
def test_parity_of_the_target_mode(lines, symmetry):
    case = case_from_dict(without("patches"), overrides=[f"zone.nodal_lines={lines}"])
    assert case.target_symmetry == symmetry


def test_rigid_shapes_have_no_wavenumber():
    assert case_from_dict(without("patches"), overrides=["zone.nodal_lines=1"]).target_kx_per_m == 0.0


def test_tables_may_be_absent_until_a_command_needs_them():
    cell = case_from_dict(without("zone", "patches"))
    assert isnan(cell.design.length_m) and cell.design.pitch_x_m == 4e-3
    assert cell.target_symmetry is None
    cell.require("plate", "array", "array.pitch_mm")
    with pytest.raises(InputError, match=r"\[zone\]: missing, antinode response needs it") as fault:
        cell.require("zone", "patches", command="antinode response")
    assert len(fault.value.lines) == 2


def test_a_plate_with_pillars_needs_its_rows_said():
    case_from_dict(without("array", "pillar", "patches")).require_plate()
    with pytest.raises(InputError, match=r"array\.rows: missing"):
        case_from_dict(without("patches") | {"array": {"pitch_mm": 4.0}}).require_plate()


def test_to_dict_is_plain_json_and_follows_every_value():
    base = load_case(CASE).to_dict()
    assert json.loads(json.dumps(base, allow_nan=False)) == base
    changes = [
        "material.young_GPa=71",
        "plate.thickness_mm=2.1",
        "zone.length_mm=115",
        "zone.width_mm=21",
        "zone.nodal_lines=7",
        "pillar.height_mm=6.4",
        "pillar.side_mm=1.9",
        "pillar.fillet_mm=0.1",
        "pillar.material=steel",
        "array.pitch_mm=5",
        "array.rows=2",
        "array.extension_mm=24",
        "solve.band_kHz=[25,44]",
        "solve.accuracy=0.002",
        "solve.model=solid",
        "solve.mesh=tet",
        "bands.path=GXM",
        "bands.points=24",
        "bands.count=9",
        "damping.quality=299",
        "patches.size_mm=[11,3,0.3]",
        "patches.face=touch",
        "patches.sensors=[6]",
        "patches.drive_V=2",
        "patches.material=pzt-4",
    ]
    seen = [json.dumps(load_case(CASE, [change]).to_dict()) for change in changes]
    assert len({json.dumps(base), *seen}) == len(changes) + 1
    assert load_case(CASE, ["name=other"]).to_dict() == base


def test_bands_only_case_is_json_without_nan():
    plain = case_from_dict(without("zone", "patches")).to_dict()
    assert plain["design"]["length_m"] is None
    json.dumps(plain, allow_nan=False)


@pytest.mark.parametrize(
    ("override", "read"),
    [
        ("array.pitch_mm=6", lambda c: c.design.pitch_y_m == 6e-3),
        ("array.pitch_x_mm=6", lambda c: (c.design.pitch_x_m, c.design.pitch_y_m) == (6e-3, 4e-3)),
        ("solve.near_kHz=32", lambda c: (c.solve.near_hz, c.solve.band_hz) == (32e3, None)),
        ("solve.model = solid", lambda c: c.solve.model == "solid"),
        ('solve.model="solid"', lambda c: c.solve.model == "solid"),
        ("material=steel", lambda c: c.design.material.name == "steel"),
        (
            "material.young_GPa=65",
            lambda c: (c.design.material.as_isotropic.young_pa, c.design.material.as_isotropic.poisson) == (65e9, 0.34),
        ),
        ("pillar.material=steel", lambda c: c.design.pillar.material.name == "steel" != c.design.material.name),
        (
            "patches.centres_mm=[[0,0],[20,0],[-20,0],[40,0],[-40,0],[0,5],[20,5],[0,-5]]",
            lambda c: c.patches.count == 8,
        ),
    ],
)
def test_set(override, read):
    assert read(load_case(CASE, [override]))


def test_setting_a_centres_y_keeps_its_x():
    raw = {"zone": {"centre_mm": [10.0, -8.0]}}
    assert apply_overrides(raw, [("zone.centre_y_mm", 3.0)]) == {"zone": {"centre_mm": [10.0, 3.0]}}
    assert apply_overrides(raw, [("zone.centre_x_mm", 3.0)])["zone"]["centre_mm"][0] == 3.0
    assert apply_overrides({"zone": {}}, [("zone.centre_y_mm", 3.0)]) == {"zone": {"centre_y_mm": 3.0}}


def test_set_another_shape_with_its_keys():
    round_one = load_case(CASE, ["pillar.shape=round", "pillar.diameter_mm=2"]).design.pillar
    assert (round_one.shape, round_one.base_m, round_one.tip_m) == ("round", 2e-3, 2e-3)
    tapered = load_case(CASE, ["pillar.shape=tapered", "pillar.base_mm=3", "pillar.tip_mm=1"]).design.pillar
    assert (tapered.base_m, tapered.tip_m) == pytest.approx((3e-3, 1e-3))


def test_set_creates_an_absent_table():
    case = case_from_dict(without("damping"), overrides=["damping.quality=50"])
    assert case.quality_factor == 50.0


def test_overrides_are_texts_or_keys_with_values():
    texts, pairs = ["array.pitch_mm=6", "material=steel"], [("array.pitch_mm", 6), ("material", "steel")]
    assert load_case(CASE, pairs).to_dict() == load_case(CASE, texts).to_dict()


def test_last_set_wins():
    assert load_case(CASE, ["array.rows=1", "array.rows=2"]).design.rows == 2


def test_step_pillar_is_measured_and_hashed(tmp_path):
    cadquery = pytest.importorskip("cadquery", reason="CadQuery makes the STEP file")
    solid = cadquery.Workplane().rect(2.0, 2.0).extrude(6.3)
    cadquery.exporters.export(solid, str(tmp_path / "pillar.step"))
    (tmp_path / "case.toml").write_text(CASE.read_text())
    case = load_case(tmp_path / "case.toml", ["pillar.shape=step", "pillar.file=pillar.step"])
    pillar = case.design.pillar
    assert (pillar.base_m, pillar.height_m) == pytest.approx((2e-3, 6.3e-3), rel=1e-6)
    first = case.to_dict()["design"]["pillar"]
    assert first["file"] == "pillar.step" and len(first["file_sha256"]) == 64
    cadquery.exporters.export(solid.rotate((0, 0, 0), (0, 0, 1), 90), str(tmp_path / "pillar.step"))
    assert case.to_dict()["design"]["pillar"]["file_sha256"] != first["file_sha256"]


def test_reading_a_case_imports_no_cad_and_no_mesher():
    code = (
        f"import sys; from pipeline.case.model import load_case; load_case({str(CASE)!r});"
        "bad = {'cadquery', 'OCP', 'vtk', 'vtkmodules', 'pyvista', 'pytetwild', 'meshio'} & set(sys.modules);"
        "sys.exit(str(bad) if bad else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_case_with_a_band_can_be_hashed_and_sent_to_a_worker() -> None:
    case = load_case(CASE, ["solve.band_kHz=[30.0, 34.0]", "tolerance.height_mm=0.05"])
    sent = pickle.loads(pickle.dumps(case))
    assert sent == case and hash(sent) == hash(case)
    assert sent.solve.band_hz == (30e3, 34e3) and sent.tolerance.height_m == pytest.approx(5e-5)


def test_every_zone_has_the_same_patches_and_those_behind_a_zone_stand_in_line_with_it() -> None:
    """Sensors are numbered zone by zone; behind both rows stand as many patches as in the zone, as long as those."""
    settings = ["patches={material='pz26', size_mm=[6.0, 3.0, 0.3], sensors=[1]}"]
    alone, both = (load_case(ROOT / name, settings) for name in ("examples/small.toml", "examples/37-two-zones.toml"))
    assert alone.patches and both.patches
    count = both.patches.count // 2
    low, high = (np.array(own) for own in (both.patches.centres_m[:count], both.patches.centres_m[count:]))
    apart = float(np.diff(both.design.zone_centres_m)[0])
    np.testing.assert_allclose(high - low, np.tile([0.0, apart], (count, 1)), atol=1e-15)
    assert both.patches.sensors == (1, count + 1)
    behind = load_case(ROOT / "examples/small.toml", [*settings, "patches.behind_mm=3.0"])
    assert behind.patches and behind.patches.sensors == alone.patches.sensors
    assert behind.patches.lengths_m == 3 * alone.patches.lengths_m
    x, y = np.array(behind.patches.centres_m).T.reshape(2, 3, -1)
    assert (x == x[0]).all() and (y[0] == 0.0).all()
    assert (y[1] == y[1][0]).all() and (y[2] == -y[1]).all() and y[2][0] > behind.design.reach_m[-1]


def test_lengths_of_glue_and_of_further_zones_are_in_metres() -> None:
    glued = load_case(
        ROOT / "examples/small.toml",
        ["patches={size_mm=[8.0, 3.0, 0.3], centres_mm=[[0, 0]], glue={material='epoxy', thickness_mm=0.04}}"],
    )
    assert glued.patches and glued.patches.glue and glued.patches.glue[1] == pytest.approx(4e-5, rel=1e-12)
    raw = tomllib.loads((ROOT / "examples/46-zones-anywhere.toml").read_text())
    raw["zone"][1]["centre_mm"] = [16.5, 4.0]
    assert case_from_dict(raw).design.others_m == (pytest.approx((16.5e-3, 4e-3), rel=1e-12),)
