"""Every fault of a case file: one line, named key, what came, what is allowed; all of them at once."""

from __future__ import annotations

import re
import time
import tomllib
from math import pi
from pathlib import Path

import pytest

from pipeline.case.model import case_from_dict, load_case
from pipeline.case.supports import dents
from pipeline.errors import InputError
from solvers.analytic.beams import antinodes, free_free_mode

CASE = Path(__file__).parents[3] / "studies" / "three-rows.toml"
SUPPORT_OF = 'support=[{{kind="spring", at_mm=[5, 0], radius_mm=4, damping_Ns_per_m={damping}}}]'
RAW = tomllib.loads(CASE.read_text())


def lines_of(overrides: list[str], raw: dict | None = None) -> list[str]:
    with pytest.raises(InputError) as fault:
        case_from_dict(raw or RAW, source=CASE, overrides=overrides)
    assert fault.value.exit_code == 2
    assert all("\n" not in line for line in fault.value.lines)
    return fault.value.lines


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ('support=[{kind="clamp", edge="up"}]', '--set: support.0.edge = "up": must be x-, x+, y- or y+'),
        (
            'support=[{kind="mass", at_mm=[99, 0], radius_mm=1, mass_g=1}]',
            "--set: support.0.at_mm = [99, 0]: the disc must lie on the plate",
        ),
        ("array.pitch_mm=2", "--set: array.pitch_mm = 2: pillars overlap: must exceed the pillar's footprint 2 mm"),
        ("pillar.side_mm=4", "array.pitch_mm = 4: pillars overlap"),
        ("pillar.fillet_mm=1", "array.pitch_mm = 4: pillars overlap"),
        ("zone.width_mm=3.9", "zone.width_mm = 3.9: zone narrower than two pillar sides: must be at least 4 mm"),
        ("plate.thickness_mm=0.02", "plate.thickness_mm = 0.02: plate too thin to be meshed"),
        ("array.extension_mm=6e3", "plate.thickness_mm = 2: plate too thin to be meshed"),
        ("zone.length_mm=1.9", "zone.length_mm = 1.9: pillars reach beyond the plate: must be at least the foot"),
        ("zone.nodal_lines=-1", "zone.nodal_lines = -1: must be a whole number from 0 to 1000"),
        ("zone.nodal_lines=8.5", "zone.nodal_lines = 8.5: must be a whole number"),
        ("plate.thickness_mm=-2", "plate.thickness_mm = -2: must be a finite number above 0"),
        ("plate.thickness_mm=0", "plate.thickness_mm = 0: must be a finite number above 0"),
        ("plate.thickness_mm=nan", "plate.thickness_mm = nan: must be a finite number above 0"),
        ("pillar.height_mm=inf", "pillar.height_mm = inf: must be a finite number above 0"),
        ("pillar.height_mm=true", "pillar.height_mm = true: must be a finite number"),
        ('array.pitch_mm="4"', 'array.pitch_mm = "4": must be a finite number'),
        ("array.rows=-1", "array.rows = -1: must be a whole number from 0"),
        ("array.extension_mm=-1", "array.extension_mm = -1: must be a finite number of 0 or more"),
        ("pillar.fillet_mm=7", "pillar.fillet_mm = 7: must be smaller than the pillar's height 6.3 mm"),
        ("pillar.diameter_mm=2", "pillar.diameter_mm = 2: does not belong to a square pillar"),
        ("pillar.shape=round", "pillar.diameter_mm: missing, a round pillar needs it"),
        ("pillar.shape=rond", 'pillar.shape = "rond": must be square, round, tapered, hexagonal, cross or step (did'),
        ("pillar.height_mm=6,3", '"6,3": must be a finite number above 0, from 1e-06 to 1e+07 (did you mean 6.3?)'),
        ("pillar.height_mm=6.3 mm", "from 1e-06 to 1e+07 (did you mean 6.3?)"),
        ("pillar.height_mm=0.63 cm", "(a number alone: its unit is in the name of the key)"),
        ("height_mm=7", "height_mm = 7: unknown key (did you mean pillar.height_mm?)"),
        ("material=Plexiglass", "or a table (did you mean pmma?)"),
        ("pillar.hieght_mm=6", "pillar.hieght_mm = 6: unknown key (did you mean pillar.height_mm?)"),
        ("pitch_mm=6", "pitch_mm = 6: unknown key (did you mean array.pitch_mm?)"),
        ("zonee.width_mm=6", "unknown table (did you mean zone?)"),
        ("material=Aluminium", 'material = "Aluminium": must be one of aluminium, AlSi7Mg0.6'),
        ("material=3", "material = 3: must be the name of a material or a table"),
        ("material.poisson=0.5", "material.poisson = 0.5: must be a number between -1 and 0.5, both excluded"),
        ("material.poisson=-1", "material.poisson = -1: must be a number between -1 and 0.5"),
        ("material.young_GPa=0", "material.young_GPa = 0: must be a finite number above 0"),
        ("material.nu=0.3", "material.nu = 0.3: unknown key"),
        ("material={density_kg_m3=1000}", "material.young_GPa: missing, must be given with poisson, or one of cubic_GPa"),
        ("material={density_kg_m3=1000,young_GPa=3}", "material.poisson: missing, must be a number between -1 and 0.5"),
        ("material={young_GPa=3,poisson=0.3}", "material.density_kg_m3: missing, must be a finite number above 0"),
        ("material.C_GPa=[[1]]", "material.C_GPa = [[1]]: must be six rows of six numbers in GPa"),
        ("material.cubic_GPa={C11=160,C12=60,C44=80}", "cannot be combined with young_GPa: one law only"),
        ("material={density_kg_m3=2330,cubic_GPa={C11=160,C12=170,C44=80}}", "material.cubic_GPa = {C11 = 160, "),
        ("material={density_kg_m3=2330,cubic_GPa={C11=1,C12=0.9999999999999999,C44=1}}", "material.cubic_GPa = {C11 = 1, "),
        ("material={density_kg_m3=2330,cubic_GPa={C11=160,C12=60,C44=80},poisson=0.3}", "must be left out with cubic_GPa"),
        ("material.axes_deg=[1,2,3]", "must be left out of an isotropic law, which has no axes"),
        ("material.axes_deg=[1,2]", "material.axes_deg = [1, 2]: must be three angles [phi, theta, psi]"),
        ("material.loss_factor=-1", "material.loss_factor = -1: must be a finite number of 0 or more"),
        ("material.dE_dT=-1e-4", "unknown key (did you mean material.dE_dT_per_K?)"),
        ("solve.temperature_C=3000", "no stiffness is left at 3000 C"),
        ("solve.accuracy=0", "solve.accuracy = 0: must be a number above 0, at most 0.1"),
        ("solve.accuracy=0.11", "solve.accuracy = 0.11: must be a number above 0, at most 0.1"),
        ("solve.band_kHz=[45,25]", "solve.band_kHz = [45, 25]: must be two numbers [low, high], 0 <= low < high"),
        ("solve.band_kHz=[25]", "solve.band_kHz = [25]: must be two numbers"),
        ("solve.count=3", "solve.count = 3: applies to near_kHz"),
        ("bands.path=GXQ", 'bands.path = "GXQ": must be at least two labels of the lattice'),
        ("bands.path=GXXM", 'bands.path = "GXXM": must not contain the same point'),
        ("damping.quality=0", "damping.quality = 0: must be a number above 0.5"),
        ("patches.sensors=[9]", "patches.sensors = [9]: no such patch: must be numbers from 0 to 8"),
        ("patches.sensors=[0,1,2,3,4,5,6,7,8]", "every patch is a sensor: at least one must drive"),
        ("patches.sensors=[1,1]", "patches.sensors = [1, 1]: must name each patch only once"),
        ("patches.size_mm=[12,80.1,0.3]", "patches.size_mm = [12, 80.1, 0.3]: patch 0 on the back overlaps"),
        ("patches.size_mm=[12,91,0.3]", "larger than the plate of 115.5 x 90 mm"),
        ("patches.size_mm=[20,3,0.3]", "patches 1 and 2 overlap"),
        ("patches.centres_mm=[[55,0]]", "patch 0 extends beyond the plate"),
        ("patches.centres_mm=[[0,11]]", "patch 0 on the back overlaps a pillar's foot"),
        (  # 10 mm of the zone, a foot of 2 mm, two pitches of 4 mm on either side
            "plate={thickness_mm=2, length_mm=200, width_mm=39.9}",
            "plate.width_mm = 39.9: 3 rows do not fit between zone and edge: must be at least 40 along y",
        ),
        ("patches.material=pz62", 'patches.material = "pz62": must be one of pz26'),
        ("plate=3", "plate = 3: must be a table [plate]"),
        ("name=a/b", 'name = "a/b": must be a text of 1 to 100 characters'),
        ("array.rows=" + "9" * 400, "array.rows = an integer beyond 1e30: must be a whole number"),
    ],
)  # fmt: skip
def test_one_fault_one_line(override, expected):
    assert any(expected in line for line in lines_of([override]))


LENGTHS = ("plate.thickness_mm", "zone.length_mm", "zone.width_mm", "pillar.side_mm", "pillar.height_mm",
           "array.pitch_mm")  # fmt: skip
SPANS = [
    *((key, 1e-6, 1e7) for key in LENGTHS),
    ("material.young_GPa", 1e-9, 2000.0),
    ("material.density_kg_m3", 1.0, 1e5),
    ("solve.near_kHz", 1e-9, 1e10),
    ("solve.accuracy", 1e-6, 0.1),
    ("patches.drive_V", 1e-9, 1e6),
]


@pytest.mark.parametrize(("key", "low", "high"), SPANS)
def test_every_number_has_physical_limits_that_its_line_names(key, low, high):
    for value in (low / 2.0, 1e-300, 2.0 * high, 1e308):
        (line,) = [line for line in lines_of([f"{key}={value!r}"]) if f" {key} = " in line]
        assert (
            line.startswith(f"--set: {key} = {value:.12g}: must be a ") and f"{low:g}" in line and f"{high:g}" in line
        )


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("pillar.shape=[]", "pillar.shape = []: must be square, round"),
        ("pillar.shape={a=1}", "pillar.shape = {a = 1}: must be square, round"),
        ("solve.band_kHz=[0,1e300]", "solve.band_kHz = [0, 1e+300]: must be two numbers [low, high]"),
        ("solve.band_kHz=[0,1e-300]", "high at least 1e-09"),
        ("pillar.fillet_mm=1e-300", "pillar.fillet_mm = 1e-300: must be a finite number of 0 or more: 0, or from 1e-06"),
        ("array.extension_mm=1e-9", "array.extension_mm = 1e-09: must be a finite number of 0 or more: 0, or from 1e-06"),
        ("array.extension_mm=0.0011", "must be 0, or at least 0.002, 0.001 of plate.thickness_mm"),
        ("damping.quality=1e300", "damping.quality = 1e+300: must be a number above 0.5 (at 0.5 nothing resonates), at most"),
        ("pillar.height_mm=0.0015", "pillar.height_mm = 0.0015: must be from 0.002 to 2000, 0.001 to 1000 times pillar.side"),
        ("array.pitch_mm=2.0000001", "pillars almost touch: must exceed the footprint 2 mm by at least 0.00025 of it"),
        ("array.pitch_mm=2.01", None),
        ("zone.nodal_lines=116", "zone.nodal_lines = 116: must be at most 115: the wave would be shorter than the plate"),
        ("material.poisson=0.4999999", "must be a number between -1 and 0.5, both excluded and 1e-06 away"),
        ("pillar.material={young_GPa=1e-7,density_kg_m3=1000,poisson=0.3}", "within a factor of 1e+08 of the plate's 70"),
        ("bands.path=" + "GX" * 11, "at most 20"),
        ("tolerance.seed=" + "9" * 30, "tolerance.seed = 999"),
        ("a" + ".a" * 900 + "=1", "nested deeper than the limit of 8"),
        ("x=" + "[" * 60 + "]" * 60, "nested deeper than the limit of 8"),
        ("measured.sweep=" + "s" * 5000, "measured.sweep = "),
        ('pillar.side_mm="\\n"', 'pillar.side_mm = "\\n"'),
        ("'a\nb'", "must be key.path=value"),
    ],
)  # fmt: skip
def test_no_value_is_too_odd_for_one_line(override, expected):
    if expected is None:
        assert load_case(CASE, ["array.pitch_mm=2.01", "zone.nodal_lines=8", "patches.size_mm=[6,2,0.3]"])
        return
    lines = lines_of([override])
    assert any(expected in line for line in lines) and all(len(line) <= 2100 for line in lines)


def test_a_million_pillars_are_too_many():
    small = ["array.pitch_mm=0.02", "pillar.side_mm=0.01", "pillar.height_mm=1", "array.rows=1000"]
    assert any("at most 1000000 can be assembled" in line for line in lines_of(small))


def timed_lines(tmp_path, text: str, *overrides: str) -> list[str]:
    """The faults of a file, found within a second of work: what took 14 s to minutes did so by growing squares."""
    (tmp_path / "case.toml").write_text(text)
    start = time.process_time()
    with pytest.raises(InputError) as fault:
        load_case(tmp_path / "case.toml", overrides)
    assert time.process_time() - start < 3.0
    return fault.value.lines


class TestWorkOfLoading:
    """A case file is refused at once, however much it asks for."""

    text = CASE.read_text()

    def test_a_thousand_nodal_lines_with_patches(self, tmp_path):
        lines = timed_lines(tmp_path, self.text, "zone.nodal_lines=1000")
        assert any("zone.nodal_lines = 1000: must be at most 115" in line for line in lines)

    def test_antinodes_of_a_thousand_nodal_lines(self):
        start = time.process_time()
        assert len(antinodes(free_free_mode(1000))) == 999
        assert time.process_time() - start < 3.0

    def test_unknown_keys(self, tmp_path):
        lines = timed_lines(tmp_path, "\n".join(f"k{i} = 1" for i in range(15_000)) + "\n" + self.text)
        assert len(lines) == 51 and lines[-1].endswith(": 14950 more errors")

    def test_more_bytes_than_a_case_has(self, tmp_path):
        lines = timed_lines(tmp_path, "\n".join(f"k{i} = 1" for i in range(100_000)))
        assert lines == [f"{tmp_path / 'case.toml'}: larger than 200000 bytes, the limit for a TOML file"]

    def test_patch_centres(self, tmp_path):
        def centred(count: int) -> str:
            return self.text.replace('at = "antinodes"', f"centres_mm = [{', '.join(['[0, 0]'] * count)}]")

        assert any("at most 2000" in line for line in timed_lines(tmp_path, centred(20_000)))
        assert any("patches 0 and 1 overlap" in line for line in timed_lines(tmp_path, centred(2000)))

    def test_a_key_of_many_parts(self, tmp_path):
        for text in ("a." * 900 + "a = 1\n", "a." * 90_000 + "a = 1\n", "x = " + "[" * 300 + "]" * 300 + "\n"):
            (line,) = timed_lines(tmp_path, text + self.text)
            assert "nested deeper than the limit of 8" in line


@pytest.mark.parametrize("override", ["array.pitch_mm", "=3", "array..rows=3", "array.rows="])
def test_malformed_override(override):
    assert "must be key.path=value" in lines_of([override])[0]


@pytest.mark.parametrize(
    ("overrides", "pair"),
    [
        (["array.heights_mm=[6,6,6]", "pillar.height_mm=6"], "array.heights_mm and pillar.height_mm"),
        (["pillar.height_mm=6", "array.heights_mm=[6,6,6]"], "pillar.height_mm and array.heights_mm"),
        (["solve.near_kHz=30", "solve.band_kHz=[30,34]"], "solve.near_kHz and solve.band_kHz"),
        (["pillar.side_mm=3", "pillar.shape=round", "pillar.diameter_mm=3"], "pillar.side_mm and pillar.shape"),
        (["pillar.side_mm=3", 'pillar={shape="round",diameter_mm=2,height_mm=5}'], "pillar.side_mm and pillar"),
    ],
)
def test_of_two_given_keys_none_drops_the_other_in_silence(overrides, pair):
    """Whereas one drops what the file says."""
    with pytest.raises(InputError) as fault:
        load_case(CASE, overrides)
    assert fault.value.lines == [f"--set: {pair} exclude each other: give only one of them"]
    assert fault.value.exit_code == 2
    assert load_case(CASE, ["array.heights_mm=[6,6,6]"]).given >= {"array.heights_mm"}
    assert load_case(CASE, ["array.pitch_mm=4", "array.pitch_x_mm=5"]).design.pitch_x_m == 0.005
    within = ['pillar={shape="square",side_mm=2.0,height_mm=5.0}', "pillar.height_mm=6"]
    assert load_case(CASE, within).design.pillar.height_m == 0.006


def test_all_faults_of_a_file_come_together():
    raw = {key: dict(value) if isinstance(value, dict) else value for key, value in RAW.items()}
    raw["array"]["pitch_mm"] = 1.5
    raw["zone"]["width_mm"] = 3.0
    raw["zone"]["nodal_lines"] = -1
    raw["plate"]["thickness_mm"] = float("nan")
    raw["pillar"]["shape"] = "sqare"
    raw["solve"]["accuracy"] = 2.0
    raw["material"] = "unobtainium"
    raw["typo"] = {}
    keys = ("array.pitch_mm", "zone.width_mm", "zone.nodal_lines", "plate.thickness_mm", "pillar.shape",
            "solve.accuracy", "material", "typo")  # fmt: skip
    lines = lines_of([], raw)
    assert len(lines) == len(keys)
    for key in keys:
        assert sum(line.startswith(f"{CASE}: {key} = ") for line in lines) == 1, key


def test_missing_keys_and_material_are_named():
    lines = lines_of([], {"plate": {}, "zone": {"length_mm": 100.0}})
    for key in ("material", "plate.thickness_mm", "zone.width_mm", "zone.nodal_lines"):
        assert any(f": {key}: missing, must be " in line for line in lines), key


def test_rows_without_pillar_and_without_pitch():
    raw = {key: value for key, value in RAW.items() if key not in ("pillar", "array")} | {"array": {"rows": 2}}
    lines = lines_of([], raw)
    assert any("array.rows = 2: must be 0 without a [pillar]" in line for line in lines)
    assert any("array.pitch_mm: missing, rows need a pitch" in line for line in lines)


def test_pitch_and_its_parts():
    assert "cannot be combined with pitch_mm" in lines_of([], RAW | {"array": {"pitch_mm": 4.0, "pitch_x_mm": 5.0}})[0]
    assert "array.pitch_y_mm: missing" in lines_of([], RAW | {"array": {"pitch_x_mm": 4.0, "rows": 1}})[0]


def test_footprint_limit_is_sharp():
    assert load_case(CASE, ["pillar.side_mm=3.999"]).design.footprint_m < 4e-3
    assert load_case(CASE, ["plate.thickness_mm=0.0232"])


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"name = 'a'\nmaterial = \n", "line 2"),
        (b"[pillar]\nheight_mm = 6,3  # mm\n", "(did you mean height_mm = 6.3?)"),
        (b"[plate]\nthickness_mm = 2\nthickness_mm = 3\n", "not valid TOML"),
        (b"[plate]\nthickness_mm = 2,5\n", "(did you mean thickness_mm = 2.5?)"),
        (b"[plate]\nthickness_mm = 2 mm\n", "(did you mean thickness_mm = 2; its unit is in the name of the key?)"),
        (b"[plate]\nthickness_mm: 2\n", "(did you mean thickness_mm = 2?)"),
        (b"material = glass\n", '(did you mean material = "glass"?)'),
        ("material = “glass”\n".encode(), '(did you mean material = "glass"?)'),
        (b"[array]\nstagger = True\n", "(did you mean stagger = true?)"),
        (b"[array]\nrows = 1;\n", "at line 2, column 9)"),
        (b"name = '\xff'\n", "not UTF-8 text at byte 8"),
        (None, "is a directory"),
    ],
)
def test_unreadable_files(tmp_path, content, expected):
    path = tmp_path / "case.toml"
    path.mkdir() if content is None else path.write_bytes(content)
    with pytest.raises(InputError, match=re.escape(expected)) as fault:
        load_case(path)
    assert len(fault.value.lines) == 1 and str(path) in fault.value.lines[0]


def test_missing_file(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_case(tmp_path / "nothing.toml")


def test_a_file_of_the_checkout_is_pointed_at_from_elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        InputError, match=r"examples/small.toml: no such file in this folder; there is /.*/examples/small.toml"
    ):
        load_case("examples/small.toml")


@pytest.mark.parametrize("misspelled", ["exampels/small.toml", "examples/smal.toml", "exmples/smll.toml"])
def test_a_misspelled_file_is_told_with_the_nearest_one(tmp_path, monkeypatch, misspelled):
    checkout = CASE.parents[1]
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=rf"no such file \(did you mean {checkout}/examples/small.toml\?\)$"):
        load_case(misspelled)
    (tmp_path / "examples").mkdir()
    (tmp_path / "examples" / "small.toml").write_bytes(CASE.read_bytes())
    with pytest.raises(InputError, match=r"no such file \(did you mean examples/small.toml\?\)$"):
        load_case(misspelled)


def test_a_file_named_like_none_is_told_without_a_guess(tmp_path):
    (tmp_path / "plate.toml").write_bytes(CASE.read_bytes())
    with pytest.raises(InputError, match=r"no such file$"):
        load_case(tmp_path / "beam.toml")


def test_byte_order_mark_is_harmless(tmp_path):
    (tmp_path / "case.toml").write_bytes(b"\xef\xbb\xbf" + CASE.read_bytes())
    assert load_case(tmp_path / "case.toml").design.rows == 3


class TestStep:
    """A pillar from STEP: missing, not STEP, open, several, off its plane, wider than the pitch above its foot."""

    def refused(self, folder: Path, shape=None, text: str | None = None) -> str:
        cadquery = pytest.importorskip("cadquery", reason="CadQuery makes the STEP file")
        path = folder / "pillar.step"
        if shape is not None:
            cadquery.exporters.export(shape(cadquery), str(path))
        elif text is not None:
            path.write_text(text)
        (folder / "case.toml").write_text(CASE.read_text())
        with pytest.raises(InputError) as fault:
            load_case(folder / "case.toml", ["pillar.shape=step", "pillar.file=pillar.step"])
        (line,) = fault.value.lines
        return line

    def test_missing(self, tmp_path):
        assert 'pillar.file = "pillar.step": no such STEP file' in self.refused(tmp_path)

    def test_not_step(self, tmp_path):
        assert "pillar.file" in self.refused(tmp_path, text="solid cube")

    def test_open(self, tmp_path):
        line = self.refused(
            tmp_path, lambda cq: cq.Workplane(cq.Shell.makeShell(cq.Solid.makeBox(2, 2, 6).Faces()[:5]))
        )
        assert "open" in line

    def test_two_solids(self, tmp_path):
        def two(cq):
            return cq.Workplane(
                cq.Compound.makeCompound([cq.Solid.makeBox(1, 1, 6), cq.Solid.makeBox(1, 1, 6, cq.Vector(3, 0, 0))])
            )

        assert "2 solids" in self.refused(tmp_path, two)

    def test_foot_off_the_plane(self, tmp_path):
        assert "z = 0" in self.refused(tmp_path, lambda cq: cq.Workplane(origin=(0, 0, 1)).rect(2, 2).extrude(6))

    def test_a_head_wider_than_the_pitch(self, tmp_path):
        line = self.refused(
            tmp_path, lambda cq: cq.Workplane().rect(2, 2).extrude(5).faces(">Z").workplane().rect(4.5, 4.5).extrude(1)
        )
        assert "pillars overlap: must exceed the pillar's footprint 4.5 mm" in line


@pytest.mark.parametrize(
    "name", ["studies/large-display.toml", "examples/small.toml", "examples/44-target-frequency.toml"]
)
def test_the_patch_that_a_message_proposes_fits_the_case(name: str) -> None:
    file = CASE.parents[1] / name
    with pytest.raises(InputError) as fault:
        load_case(file).require("patches", command="response")
    (words,) = re.findall(r'--set "(.*)"', str(fault.value))
    assert load_case(file, [words]).patches


def test_a_damper_dents_its_disc_as_a_spring_as_stiff_does() -> None:
    """A spring may have E r / 100; a damper is as stiff as 2 pi f c."""
    case = load_case(CASE, [SUPPORT_OF.format(damping=40.0), "zone.width_mm=20"])
    limit = 0.01 * case.design.material.average.young_pa * 4e-3 / (2.0 * pi * 30e3)
    (line,) = dents(case.design, 30e3)
    (least,) = re.findall(r"at most ([0-9.]+) N s/m", line)
    assert line.startswith("support.0.damping_Ns_per_m = 40: ") and float(least) == pytest.approx(limit, rel=5e-3)
    weaker = load_case(CASE, [SUPPORT_OF.format(damping=0.99 * limit), "zone.width_mm=20"])
    assert not [*dents(weaker.design, 30e3)]
