"""Study files: the grid, its ids, and what is refused."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from pipeline.batch import case_study, study_file
from pipeline.batch.study_file import STUDIES, load_study
from pipeline.case.model import case_from_dict, load_case, read_case
from pipeline.case.reading import toml_text
from pipeline.errors import InputError
from pipeline.records.record import KeysRecord
from pipeline.report import text

STUDY = '[study]\nname = "s"\ncase = "three-rows.toml"\nmeasure = ["modes"]\n'


@pytest.fixture
def study(tmp_path):
    shutil.copy(STUDIES / "three-rows.toml", tmp_path)

    def write(sweep: str, head: str = STUDY) -> Path:
        path = tmp_path / "s.toml"
        path.write_text(head + sweep)
        return path

    return write


def lines_of(path: Path) -> list[str]:
    with pytest.raises(InputError) as fault:
        load_study(path)
    return fault.value.lines


@pytest.mark.parametrize(
    "file",
    sorted(path for path in STUDIES.glob("*.toml") if "script = " not in path.read_text()),
    ids=lambda file: file.stem,
)
def test_committed_studies_load_with_every_case(file):
    if "[study]" not in file.read_text():
        load_case(file)
        return
    study = load_study(file.stem)
    assert study.name == file.stem
    for _, overrides in study.cases():
        load_case(study.case_path, overrides)


def test_full_grid_last_key_fastest(study):
    loaded = load_study(study('[sweep]\n"array.pitch_mm" = [4, 5.5]\n"array.rows" = [1, 2, 3]\n'))
    ids = [case_id for case_id, _ in loaded.cases()]
    assert ids[:4] == ["pitch_mm=4,rows=1", "pitch_mm=4,rows=2", "pitch_mm=4,rows=3", "pitch_mm=5.5,rows=1"]
    assert len(ids) == 6
    design = load_case(loaded.case_path, loaded.cases()[-1][1]).design
    assert (design.pitch_x_m, design.rows) == (5.5e-3, 3)


def test_zip_pairs_the_lists(study):
    loaded = load_study(study('[sweep]\nzip = true\n"array.rows" = [1, 2]\n"array.extension_mm" = [5, 25]\n'))
    assert [case_id for case_id, _ in loaded.cases()] == ["rows=1,extension_mm=5", "rows=2,extension_mm=25"]


def test_paired_lists_hold_the_sizes_of_each_shape(study):
    """Each case has those of its own; without zip, cases of one shape would differ in a size that it lacks."""
    lists = '"pillar.side_mm" = [2, 2.1]\n"pillar.diameter_mm" = [2.2, 2.3]\n"pillar.shape" = ["square", "round"]\n'
    file = study(f"[sweep]\nzip = true\n{lists}")
    raw, built = read_case(load_study(file).case_path), []
    for _, overrides in load_study(file).cases():
        pillar = case_from_dict(raw, None, overrides).design.pillar
        built.append((pillar.shape, pillar.base_m))
    assert built == [("square", 2e-3), ("round", 2.3e-3)]
    with pytest.raises(InputError, match=r"pillar\.side_mm exclude each other"):
        load_study(study(f"[sweep]\n{lists}"))
    with pytest.raises(InputError, match=r"pillar\.side_mm exclude each other"):
        load_study(study('[sweep]\nzip = true\n"pillar.side_mm" = [2, 3]\n"pillar.shape" = ["round", "step"]\n'))


def test_dotted_keys_without_quotes(study):
    assert load_study(study("[sweep]\narray.rows = [1, 2]\n")).sweep == {"array.rows": (1, 2)}


def test_no_sweep_is_one_case(study):
    assert load_study(study("")).cases() == [("base", [])]


def test_ids_are_safe_and_unique_for_texts_lists_and_long_grids(study):
    sweep = (
        '[sweep]\n"pillar.material" = ["steel", "AlSi7Mg0.6"]\n"solve.band_kHz" = [[30, 34], [30.5, 34]]\n'
        '"pillar.file" = ["a/b.step", "a_b.step", "../c d.step"]\n'
    )
    cases = load_study(study(sweep)).cases()
    ids = [case_id for case_id, _ in cases]
    assert len(set(ids)) == 12
    assert all(re.fullmatch(r"[A-Za-z0-9._+=,-]{1,120}", case_id) for case_id in ids)
    assert ("solve.band_kHz", [30, 34]) in cases[0][1] and ("pillar.material", "steel") in cases[0][1]


def test_numbers_that_are_equal_have_one_id(study):
    first = load_study(study("[sweep]\narray.pitch_mm = [4, 5]\n")).cases()
    assert first == load_study(study("[sweep]\narray.pitch_mm = [4.0, 5.0]\n")).cases()


def test_same_leaf_twice_keeps_the_whole_key(study):
    sweep = '[sweep]\n"material.young_GPa" = [70]\n"pillar.material.young_GPa" = [70]\n'
    assert load_study(study(sweep)).cases()[0][0] == "material.young_GPa=70,pillar.material.young_GPa=70"


@pytest.mark.parametrize(
    ("sweep", "expected"),
    [
        ("[sweep]\narray.pich_mm = [4]\n", 'sweep."array.pich_mm" = [4]: unknown key (did you mean array.pitch_mm?)'),
        ("[sweep]\narray.rows = []\n", "must be a list of at least one value"),
        ("[sweep]\narray.rows = 3\n", "must be a list of at least one value"),
        ("[sweep]\narray.rows = [1, 1]\n", "must contain each value only once"),
        ("[sweep]\narray.pitch_mm = [4, 4.0]\n", "must contain each value only once"),
        (
            "[sweep]\nzip = true\narray.rows = [1, 1]\narray.extension_mm = [5, 5.0]\n",
            "must contain each combination only once",
        ),
        ("[sweep]\nzip = true\narray.rows = [1, 2]\narray.pitch_mm = [4]\n", "needs lists of equal length"),
        ("[sweep]\nzip = 3\n", "sweep.zip = 3: must be true or false"),
        (
            "[sweep]\narray.heights_mm = [[6, 6, 6]]\npillar.height_mm = [6, 7]\n",
            'sweep."pillar.height_mm" = [6, 7]: and array.heights_mm exclude each other: give only one of them',
        ),
        ("[sweeps]\n", "unknown table (did you mean sweep?)"),
    ],
)
def test_faults_of_the_sweep(study, sweep, expected):
    (line,) = lines_of(study(sweep))
    assert expected in line


def test_faults_of_the_head_come_together(study):
    lines = lines_of(study("", '[study]\nname = "a b"\ncase = "no.toml"\nmeasure = ["mode", "bands"]\nmesure = 1\n'))
    for expected in (
        'study.name = "a b": must be 1 to 100 letters',
        'study.case = "no.toml": no such file',
        'study.measure = "mode": must be a list of modes,',
        "(did you mean modes?)",
        "study.mesure = 1: unknown key (did you mean study.measure?)",
    ):
        assert sum(expected in line for line in lines) == 1, (expected, lines)
    assert len(lines) == 4


def test_a_case_file_is_not_a_study():
    assert "a case file" in lines_of(STUDIES / "three-rows.toml")[0]


def test_unknown_name_gets_the_nearest():
    assert "did you mean rows?" in lines_of("row")[0]


@pytest.mark.parametrize("where", ["study", "sweep"])
def test_paired_values_may_repeat_while_their_pairs_do_not(tmp_path: Path, where: str):
    sweep = "[sweep]\narray.rows = [1, 1, 2]\narray.extension_mm = [0, 8, 8]\n"
    zipped = "zip = true\n"
    text = f'[study]\ncase = "three-rows.toml"\n{zipped if where == "study" else ""}{sweep}{zipped if where == "sweep" else ""}'
    (tmp_path / "three-rows.toml").write_text((STUDIES / "three-rows.toml").read_text())
    (tmp_path / "paired.toml").write_text(text)
    assert [case for case, _ in load_study(tmp_path / "paired.toml").cases()] == [
        "rows=1,extension_mm=0",
        "rows=1,extension_mm=8",
        "rows=2,extension_mm=8",
    ]


def test_paired_sweeps_are_bounded_as_grids_are(study, monkeypatch):
    monkeypatch.setattr(study_file, "MAX_CASES", 3)
    path = study('[sweep]\nzip = true\n"array.pitch_mm" = [4, 5, 6, 7]\n"array.rows" = [1, 2, 3, 4]\n')
    assert any("4 cases" in line and "at most 3" in line for line in lines_of(path))


def test_the_name_of_the_committed_references_is_taken(study):
    (line,) = lines_of(study("", STUDY.replace('"s"', '"reference"')))
    assert "study.name" in line and "choose another name" in line


@pytest.mark.parametrize("text", ["\U0001f600", "a\tb", "\x7f", 'say "x"\\'])
def test_a_text_is_written_as_toml_reads_it(text):
    assert tomllib.loads(f"key = {toml_text(text)}") == {"key": text}


def test_the_command_of_a_paired_case_leaves_out_the_sizes_of_other_shapes(monkeypatch):
    monkeypatch.setattr(text, "case_file", lambda study: "plate.toml")
    sweep = {"pillar.side_mm": 2.1, "pillar.diameter_mm": 2.3, "pillar.shape": "round"}
    command = text.command(None, SimpleNamespace(sweep=sweep))
    assert command == "antinode modes plate.toml --set pillar.diameter_mm=2.3 --set 'pillar.shape=\"round\"'"


@pytest.mark.parametrize(
    ("override", "shared"),
    [
        ("array.rows=1", {"cell_bands"}),
        ("array.pitch_mm=5", set()),
        ('material="glass"', set()),
        ("damping.quality=77.0", {"cell_bands"}),
        ("solve.temperature_C=60", set()),
        ("solve.near_kHz=20", set()),
        ("solve.accuracy=0.01", {"plate"}),
        ('bands.path="GX"', {"plate", "plate_modes"}),
    ],
)
def test_cases_share_a_plate_its_modes_or_its_cell_where_they_are_the_same(study, override, shared):
    path = study("").parent / "three-rows.toml"
    one, other = case_study.keys_of(load_case(path)), case_study.keys_of(load_case(path, [override]))
    assert one == case_study.keys_of(load_case(path, ['name="another"']))
    assert {name for name in KeysRecord.model_fields if getattr(one, name) == getattr(other, name)} == shared
