from __future__ import annotations

import hashlib
import json
import re
import shutil
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import get_args
from urllib.parse import unquote

import numpy as np
import pytest
from PIL import Image

from pipeline.plots import rendering, style
from pipeline.plots.style import ReportFigure, StoredFigure
from pipeline.questions import study as asked
from pipeline.questions.bands import BandsResult
from pipeline.records import store, tables
from pipeline.records.record import Record
from pipeline.records.study import StoredCase, StoredStudy, read_study
from pipeline.report import gallery, html, text
from pipeline.report import page as report_page
from pipeline.report.html import Page as Script
from pipeline.report.html import Section, Table, write_page
from tests.helpers import synthetic

VOID = {"meta", "link", "img", "input", "br", "hr", "wbr"}


class Page(HTMLParser):
    """Tags with their attributes, and complaints about what does not nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.open: list[str] = []
        self.read_errors: list[str] = []
        self.words: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.read_errors.append(tag)

    def handle_data(self, data):
        if not self.open or self.open[-1] not in {"style", "script"}:
            self.words.append(data)

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attrs for name, attrs in self.tags if name == tag]

    @property
    def text(self) -> str:
        return re.sub(r"[ \n]+", " ", " ".join(self.words))


def table(study: StoredStudy) -> str:
    return tables.table_bytes(study, asked.columns_of(study)).decode()


def saved_blank(figure: ReportFigure, folder: Path) -> StoredFigure:
    """The files of a figure without what is drawn in them, for a test that only asks which there are."""
    folder.mkdir(parents=True, exist_ok=True)
    names = [f"{figure.name}.{kind}" for kind in ("svg", "png")]
    for name in names:
        (folder / name).write_text('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>')
    return StoredFigure(figure.name, figure.title, figure.alt, *names, names[0], 1, 1, figure.vector)


@pytest.fixture
def blank_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are drawn, but not saved: for tests that ask which there are."""
    monkeypatch.setattr(gallery, "save", saved_blank)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = synthetic.put_study(tmp_path_factory.mktemp("report") / "rows", pitches=(0.004, 0.006), rows=(1,))
    synthetic.change(folder / "pitch_mm=4,rows=1", warnings=["a thin element", "faces <clamped>"])
    (folder / "pitch_mm=6,rows=1/arrays.npz").unlink()  # nothing but its bands can be drawn
    synthetic.change(folder / "pitch_mm=6,rows=1")  # and kept: it has none, none is missed
    asked.write_table(folder)
    report_page.build(folder)
    return folder


@pytest.fixture(scope="module")
def page(folder: Path) -> Page:
    return Page((folder / report_page.REPORT).read_text())


@pytest.mark.slow
def test_it_is_one_sound_file_that_needs_nothing_else(folder: Path, page: Page):
    assert page.read_errors == [] and page.open == []
    assert all(image["src"].startswith("data:image/") for image in page.all("img"))
    assert page.all("script") and not any(script.get("src") for script in page.all("script"))
    assert all(link["href"].startswith("data:") for link in page.all("link"))
    assert not re.search(r"(src|href)=\"(https?:)?//", (folder / report_page.REPORT).read_text())
    assert (folder / report_page.REPORT).stat().st_size < 4e6


def test_every_status_of_a_case_has_its_colour():
    css = (Path(report_page.__file__).parent / "templates" / "report.css").read_text()
    assert all(f".status-{status}" in css for status in get_args(Record.model_fields["status"].annotation))


def test_every_link_leads_somewhere(folder: Path, page: Page):
    ids = {attrs["id"] for _, attrs in page.tags if "id" in attrs}
    assert len(ids) == sum("id" in attrs for _, attrs in page.tags)
    for link in page.all("a"):
        target = link["href"]
        assert (target[1:] in ids) if target.startswith("#") else (folder / unquote(target)).is_file(), target


def test_every_picture_has_words_and_every_table_headings(page: Page):
    assert len(page.all("img")) == 2 + 12 + 3
    assert all(len(image["alt"]) > 60 for image in page.all("img"))
    assert all(
        image["loading"] == "lazy" and int(image["width"]) > int(image["height"]) / 3 > 15 for image in page.all("img")
    )
    assert all(heading.get("scope") in {"col", "row"} for heading in page.all("th"))


def test_every_picture_is_drawn_named_and_kept(folder: Path):
    """As the page left them: nothing is drawn again while nothing has changed."""
    case = read_study(folder).cases[0]
    drawing = gallery.draw_case(case)
    pictures = drawing.pictures
    assert drawing.troubles == []
    assert [picture.name for picture in pictures] == [
        *("geometry", "moving_plate", "pillars_in_plane", "touch_face", "neighbours", "dispersion", "attenuation"),
        *("response", "board", "plate_meshes", "cell_meshes", "mode_on_both_meshes"),
    ]  # no measured one, no tolerance in this record: test_measured_response and test_tolerance draw them
    place = case.folder / style.PICTURES
    for picture in pictures:
        assert len(picture.alt) > 60 and picture.title
        with Image.open(place / picture.png) as image:
            assert rendering.image_fault(np.asarray(image.convert("RGB"))) == ""
        root = ET.parse(place / picture.svg).getroot()
        assert root.tag.endswith("svg") and picture.title in (place / picture.svg).read_text()
    stamp = {path.name: path.stat().st_mtime_ns for path in place.iterdir()}
    assert gallery.draw_case(case).pictures == pictures
    assert {path.name: path.stat().st_mtime_ns for path in place.iterdir()} == stamp
    (place / "touch_face.png").rename(place / "lost")
    assert gallery.kept_pictures(case) is None  # a lost file, and:
    (place / "lost").rename(place / "touch_face.png")
    modes = replace(case.record.modes, target=synthetic.target(3.0))
    changed = replace(case, record=case.record.with_parts(modes=modes))
    assert gallery.kept_pictures(case) is not None and gallery.kept_pictures(changed) is None


@pytest.mark.slow
@pytest.mark.usefixtures("blank_pictures")
def test_what_the_page_has_no_room_for_is_drawn_of_a_sweeps_best_case_alone(tmp_path: Path):
    """And nothing of an earlier record stays: plates whose pillars are of another material have the same cell by its sizes, but
    other bands.
    """
    folder = synthetic.put_study(tmp_path / "rows", pitches=(0.004,), rows=(1, 2))

    def pictures(case: StoredCase) -> set[str]:
        return {file.stem for file in (case.folder / "pictures").glob("*.svg")}

    best = text.best_case(read_study(folder))
    (other,) = (case for case in read_study(folder).cases if case.record.answered and case.case_id != best.case_id)
    note, of_best = (
        "antinode report rows --all-pictures",
        {"geometry", "plate_meshes", "cell_meshes", "pillars_in_plane", "moving_plate"},
    )
    assert note in Page(report_page.build(folder).read_text()).text
    assert pictures(best) - pictures(other) == {*of_best, "dispersion"}
    assert gallery.kept_pictures(other) is None
    for all_pictures in (True, False):  # the second time all of them stand, and are kept
        assert note not in Page(report_page.build(folder, all_pictures=all_pictures).read_text()).text
        assert pictures(best) == pictures(other) and gallery.kept_pictures(other)
    bands = other.record.of(BandsResult)
    moved = [replace(point, frequencies_hz=[1.01 * f for f in point.frequencies_hz]) for point in bands.points]
    synthetic.change(other.folder, bands=replace(bands, points=moved))
    assert note in Page(report_page.build(folder).read_text()).text
    assert pictures(best) - pictures(other) == of_best


@pytest.mark.slow
def test_a_long_study_draws_its_best_case(tmp_path: Path):
    """Of several that are confined alike the first is the best, wherever the even spread falls."""
    folder = synthetic.put_study(tmp_path / "rows", pitches=(0.004, 0.005, 0.006, 0.008), rows=(1, 2, 3))
    study = read_study(folder)
    for case in study.cases:
        if case.record.answered:
            synthetic.change(case.folder, modes=replace(case.record.modes, target=synthetic.target(12.0)))
    study = read_study(folder)
    best = text.best_case(study)
    assert best and all(best in report_page.chosen(study, most) for most in range(2, 9))


def test_it_says_what_matters(page: Page):
    text = page.text
    assert "31.5\u202fkHz" in text and "163\u202fkHz to 176\u202fkHz" in text
    assert "confined; driven at its own peak, 11.0\u202fdB as a mode, best of 2 plates" in text
    assert "1 of 2 plates confine the target mode by at least 10 dB: pitch_mm=4,rows=1." in text
    assert "pitch_mm=12,rows=1 has no result: the mesh has a cell with a negative Jacobian <7>." in text
    assert "faces <clamped>" in text
    assert "a thin element" in text and "patches: no response is requested (2 of 3" in text
    assert "python 3.11.7" in text and "antinode run rows" in text


def test_case_names_and_texts_are_escaped(folder: Path):
    raw = (folder / report_page.REPORT).read_text()
    assert "faces &lt;clamped&gt;" in raw and "<clamped>" not in raw and "Jacobian &lt;7&gt;" in raw


def test_again_it_is_the_same(folder: Path):
    before = (folder / report_page.REPORT).read_bytes()
    report_page.build(folder)
    assert (folder / report_page.REPORT).read_bytes() == before


def test_what_does_not_fit_is_named_and_no_picture_is_missing(
    folder: Path, page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A page sent alone shows every picture that it has; those left out stand in the case's folder."""
    copy = Path(shutil.copytree(folder, tmp_path / "rows"))
    room = sum(len(image["src"]) for image in page.all("img")) // 2
    monkeypatch.setattr(html, "EMBEDDED_BYTES", room)
    page = Page(report_page.build(copy).read_text())
    assert 2 < len(page.all("img")) < 12 and all(i["src"].startswith("data:") for i in page.all("img"))
    assert sum(len(image["src"]) for image in page.all("img")) < room
    assert "Further pictures in the case's folder pictures" in page.text
    stored_pictures = store.read_json(copy / "pitch_mm=4,rows=1/pictures/index.json")["pictures"]
    alt_texts = {image["alt"] for image in page.all("img")}
    assert all(picture["alt"] in alt_texts or picture["title"] in page.text for picture in stored_pictures)


@pytest.mark.usefixtures("blank_pictures")
def test_torn_arrays_and_a_lost_record_spoil_nothing_else(folder: Path, tmp_path: Path):
    copy = Path(shutil.copytree(folder, tmp_path / "rows"))
    (copy / "pitch_mm=4,rows=1/arrays.npz").write_bytes(b"PK torn")
    (copy / "pitch_mm=6,rows=1/record.json").write_text("{")
    page = Page(report_page.build(copy).read_text())
    assert page.read_errors == [] and "record.json is unreadable" in page.text and "MISSING" in page.text


@pytest.mark.usefixtures("blank_pictures")
def test_a_picture_that_cannot_be_drawn_is_told_and_spoils_no_other(folder: Path, tmp_path: Path):
    copy = Path(shutil.copytree(folder, tmp_path / "rows"))
    arrays = store.load_arrays(copy / "pitch_mm=4,rows=1")
    kept = {key: a for key, a in arrays.items() if key.startswith("touch_")} | {"board_time_s": np.zeros(3)}
    store.save_arrays(copy / "pitch_mm=4,rows=1", kept)
    synthetic.change(copy / "pitch_mm=4,rows=1")
    page = Page(report_page.build(copy).read_text())
    assert "A picture could not be drawn: board: KeyError: 'board_reference'" in page.text
    assert (
        len(page.all("img")) == 2 + 4 + 3
    )  # over the study; here touch face, bands and curves; bands and curves of the other


def test_what_a_study_computes_once_is_shown_beside_the_same_plate(tmp_path: Path):
    folder = synthetic.put_study(tmp_path / "rows", pitches=(0.004,), rows=(1,))
    whole = synthetic.record_of(folder / "pitch_mm=4,rows=1")
    arrays = store.load_arrays(folder / "pitch_mm=4,rows=1")
    once = whole.with_parts(case_id="base", sweep={}, bands=None, modes=None)
    unchecked = whole.with_parts(tet_modes=None, geometry=None, tet_bands=None)
    (folder / "base").mkdir()
    store.save_arrays(folder / "base", {k: v for k, v in arrays.items() if k.startswith("tet_")})
    store.seal(folder / "base", once.to_dict())
    store.save_arrays(folder / "pitch_mm=4,rows=1", {k: v for k, v in arrays.items() if not k.startswith("tet_")})
    store.seal(folder / "pitch_mm=4,rows=1", unchecked.to_dict())
    listed = store.read_json(folder / "cases.json")
    listed["cases"].insert(0, {"case_id": "base", "sweep": {}})
    store.write_sealed(folder / "cases.json", listed)
    study = read_study(folder)
    visible = study.with_cross_checks(study.cases[1])
    assert visible.record.held("tet_bands") == whole.held("tet_bands") and visible.record.held(
        "tet_modes"
    ) == whole.held("tet_modes")
    assert {"tet_points", "touch_uz"} <= visible.arrays().keys()
    checked = replace(study.cases[1], record=whole)
    own = StoredStudy(folder, {}, (study.cases[0], checked)).with_cross_checks(checked).record
    assert own.held("tet_modes") is whole.held("tet_modes") and own.held("tet_bands") is whole.held("tet_bands")
    assert study.with_cross_checks(study.cases[0]) == study.cases[0]  # what has no answer of its own borrows none
    other = synthetic.design(2, 0.004, 0.005)
    stranger = replace(
        study.cases[1], record=unchecked.model_copy(update={"design": other, "keys": synthetic.keys(other)})
    )
    mixed = StoredStudy(folder, {}, (study.cases[0], stranger)).with_cross_checks(stranger)
    assert mixed.record.held("tet_bands") and not mixed.record.held("tet_modes")  # the same cell, another plate
    text = Page(report_page.build(folder, max_figures=0).read_text()).text
    assert "target mode, tetrahedra (pytetwild)" in text
    assert table(study).splitlines()[2].count("31520.00") == 0  # the table keeps each case's own numbers


@pytest.mark.usefixtures("blank_pictures")
def test_a_long_study_draws_the_extremes_and_a_spread(tmp_path: Path):
    listed = []
    for number in range(40):
        level = 5.0 + (number * 7 % 40)
        case = synthetic.case(f"c{number}", {"n": number}, modes=synthetic.modes(synthetic.target(level)))
        (tmp_path / f"c{number}").mkdir()
        store.seal(tmp_path / f"c{number}", case.record.to_dict())
        listed.append({"case_id": f"c{number}", "sweep": {"n": number}})
    store.write_sealed(tmp_path / "cases.json", {"schema": 2, "about": {"name": "long"}, "cases": listed})
    study = read_study(tmp_path)
    picked = report_page.chosen(study, 12)
    levels = sorted(case.record.confinement_db for case in study.cases)
    assert len(picked) == 12
    assert {levels[0], levels[-1]} <= {case.record.confinement_db for case in picked}
    assert "28 cases have none" in Page(report_page.build(tmp_path).read_text()).text


@pytest.mark.slow
def test_a_thousand_cases_stay_a_light_page(tmp_path: Path):
    """Within 15 MB: what grows with the cases is measured, what does not has its own bound."""
    record = synthetic.record("c", {}, synthetic.design(1, 0.004, 0.005), 12.0)
    forty = replace(record.modes, modes=record.modes.modes * 10)
    sizes = []
    for count in (20, 60):
        folder = tmp_path / str(count)
        names = [f"c{number}" for number in range(count)]
        for number, name in enumerate(names):
            (folder / name).mkdir(parents=True)
            own = record.with_parts(case_id=name, sweep={"n": number}, modes=forty)
            store.seal(folder / name, own.to_dict())
        listed = [{"case_id": name, "sweep": {"n": number}} for number, name in enumerate(names)]
        store.write_sealed(folder / "cases.json", {"schema": 2, "about": {"name": "long"}, "cases": listed})
        sizes.append(report_page.build(folder, max_figures=1).stat().st_size)
    each = (sizes[1] - sizes[0]) / 40
    fixed = html.EMBEDDED_BYTES + 1.2e6  # pictures; viewer, shapes and diagrams
    assert fixed + 1000 * each < 15e6, each


def test_no_study_is_one_clear_line(tmp_path: Path):
    with pytest.raises(store.BadRecord, match="no stored study"):
        report_page.build(tmp_path)


def data(path: Path, name: str) -> dict:
    result = re.search(rf'<script type="application/json" id="{name}">(.*?)</script>', path.read_text(), re.DOTALL)
    return json.loads(result.group(1))


def test_moving_shapes_and_diagram_are_in_the_page(folder: Path, page: Page):
    moving, bands = data(folder / report_page.REPORT, "shapes-data"), data(folder / report_page.REPORT, "bands-data")
    assert {shape["group"] for shape in moving["shapes"]} == {"pitch_mm=4,rows=1"}  # the other one lost its arrays
    ids = {attrs["id"] for _, attrs in page.tags if "id" in attrs}
    assert all(shape["still"] in ids and shape["body"] < len(moving["bodies"]) for shape in moving["shapes"])
    assert len(bands["cells"]) == 2 and bands["cells"][0]["name"] == "pitch_mm=4,rows=1"
    assert len(page.all("option")) == 2 and "Attenuation" in page.text and "Rows for 10\u202fdB" in page.text


@pytest.mark.usefixtures("blank_pictures")
def test_what_has_no_shapes_carries_no_viewer(folder: Path, tmp_path: Path):
    copy = Path(shutil.copytree(folder, tmp_path / "rows"))
    (copy / "pitch_mm=4,rows=1/arrays.npz").unlink()
    raw = report_page.build(copy, max_figures=1).read_text()
    assert 'id="three"' not in raw and 'id="shapes-data"' not in raw and 'id="bands-data"' in raw


def test_the_vendored_viewer_is_the_one_its_readme_names():
    vendor = html.TEMPLATES / "vendor"
    script = (vendor / "three.min.js").read_bytes()
    assert hashlib.sha256(script).hexdigest() in (vendor / "README.md").read_text()
    assert len(script) < 1e6 and b"</script" not in script.lower() and b"<!--" not in script
    assert "MIT" in (vendor / "LICENSE.three").read_text()


@pytest.mark.parametrize(
    "harm",
    [
        {"schema": 0},
        {"schema": 1},
        {"target": [1, 2]},
        {"modes": {"modes": [{"hz": 1.0}]}},
        {"bands": {"gaps": [{"from": 1.0}]}},
        {"left_out": 7},
        {"plan": {"steps": ["modes"]}},
    ],
)
def test_a_record_of_another_version_is_one_line_and_spoils_no_other(folder: Path, tmp_path: Path, harm: dict):
    copy = Path(shutil.copytree(folder, tmp_path / "rows"))
    path = copy / "pitch_mm=6,rows=1/record.json"
    store.seal(path.parent, {**json.loads(path.read_text()), **harm})
    page = Page(report_page.build(copy, max_figures=0).read_text())
    said = re.search(rf"record.json(: {store.EARLIER}| is not a record of schema {store.SCHEMA})", page.text)
    assert page.read_errors == [] and said
    assert "31.5\u202fkHz" in page.text


def test_an_edited_record_is_named_and_its_numbers_are_not_shown(folder: Path, tmp_path: Path):
    copy = Path(shutil.copytree(folder, tmp_path / "rows"))
    path = copy / "pitch_mm=4,rows=1/record.json"
    record = json.loads(path.read_text())
    record["modes"]["target"]["confinement_db"] = 99.25
    path.write_text(json.dumps(record))
    text = Page(report_page.build(copy, max_figures=0).read_text()).text
    assert "99.25" not in text and "record.json and files.json do not match their checksum" in text
    assert "99.25" not in table(read_study(copy))


@pytest.mark.usefixtures("blank_pictures")
def test_arrays_of_another_case_are_named_and_not_drawn(folder: Path, tmp_path: Path):
    copy = Path(shutil.copytree(folder, tmp_path / "rows"))
    store.save_arrays(copy / "pitch_mm=4,rows=1", {"touch_xy": np.zeros((3, 2))})
    page = Page(report_page.build(copy, max_figures=1).read_text())
    assert "pitch_mm=4,rows=1: arrays.npz is unreadable (its content does not match its checksum)" in page.text


@pytest.mark.parametrize("stored", [{"cases": [{"name": "a"}]}, {"about": 3, "cases": 4}])
def test_a_list_of_cases_of_another_version_is_one_clear_line(tmp_path: Path, stored: dict):
    store.write_sealed(tmp_path / "cases.json", stored)
    with pytest.raises(store.BadRecord, match=r"cases.json: written by another version .*run the study again"):
        report_page.build(tmp_path)


@pytest.mark.parametrize("stored", ["[]", '{"about": {}, "cases": [{"case_id": "a"}]}'])
def test_a_list_of_cases_without_its_proof_is_not_believed(tmp_path: Path, stored: str):
    (tmp_path / "cases.json").write_text(stored)
    with pytest.raises(
        store.BadRecord, match=r"cases.json: was changed or written by another version; run the study again"
    ):
        report_page.build(tmp_path)


def test_an_edited_list_of_cases_is_not_believed(folder: Path, tmp_path: Path):
    copy = Path(shutil.copytree(folder, tmp_path / "rows"))
    listed = (copy / "cases.json").read_text()
    (copy / "cases.json").write_text(listed.replace('"array.rows": 1', '"array.rows": 2'))
    assert listed != (copy / "cases.json").read_text()
    with pytest.raises(store.BadRecord, match="run the study again"):
        read_study(copy)


def test_other_studies_of_the_same_folder_are_told_beside(folder: Path, tmp_path: Path):
    copy = Path(shutil.copytree(folder, tmp_path / "rows"))
    # nothing to show, no heading
    assert "Error against run time" not in Page(report_page.build(copy, max_figures=0).read_text()).text
    script = Script([Section("Cheapest", ["words of it"], [Table("cheap", ["what", "seconds"], [["cell", 1.5]])])])
    (tmp_path / "accuracy").mkdir()
    write_page(tmp_path / "accuracy", "accuracy", "Error against run time", "Its lead.", script)
    page = Page(report_page.build(copy, max_figures=0).read_text())
    assert "words of it" in page.text and "1.5" in page.text and "../accuracy/report.html" in str(page.all("a"))
    assert page.read_errors == [] and all(
        (copy / unquote(a["href"])).is_file() for a in page.all("a") if "accuracy" in a["href"] and a["href"][0] != "#"
    )
    (tmp_path / "accuracy/page.json").write_text('{"schema": 7}')
    assert "written by another version" in Page(report_page.build(copy, max_figures=0).read_text()).text


def test_numbers_for_reading():
    assert text.si(1234567) == "1\u202f234\u202f567" and text.si(None) == "–"
    assert text.si(39.8123) == "39.8" and text.khz(31499.9) == "31.5\u202fkHz"
    assert text.khz(31499.9, 0.003) == "31.50\u202fkHz" and text.khz(31499.9, 3e-5) == "31.4999\u202fkHz"


def test_the_difference_of_two_meshes_is_the_largest_relative_one(folder: Path):
    case = read_study(folder).cases[0]
    assert text.band_difference(case.record) == pytest.approx(0.003)


@pytest.mark.slow
def test_many_cases_fold_below_the_best_and_the_appendix_holds_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report_page.gallery, "draw_study", lambda study: report_page.gallery.FigureSet([]))
    folder = synthetic.put_study(tmp_path / "rows", pitches=tuple(1e-3 * p for p in range(4, 11)), rows=(1, 2))
    raw = report_page.build(folder, max_figures=0).read_text()
    best, fold = raw.index("<summary>pitch_mm=4,rows=2 "), raw.index("All other cases (14)</summary>")
    assert best < fold < raw.index("<summary>pitch_mm=5,rows=1 ") and raw.count("<summary>pitch_mm=") == 15
    warnings, appendix = raw.index("<h2>Warnings</h2>"), raw.index("<h2>Appendix</h2>")
    assert " · 16.0\u202fdB as driven, confined · " in raw[best:fold]  # of a plate with patches
    assert fold < warnings < appendix < raw.index("Simplifications and their reasons</summary>")
    assert appendix < raw.index("<summary>Meshes, inertia counts and computing times</summary>")
    assert all(re.search(word, raw).start() > appendix for word in ("of order 2", "Inertia count", "Computing time"))
    few = synthetic.put_study(tmp_path / "few", rows=(1,))
    assert "<summary>Inputs of all cases</summary>" in raw
    assert "All other cases" not in (short := report_page.build(few, max_figures=0).read_text())
    assert "Inputs of all cases" not in short
