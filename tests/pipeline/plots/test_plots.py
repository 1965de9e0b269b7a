from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Circle

from geometry.decimation import with_sides
from pipeline.case.model import case_from_dict, load_case
from pipeline.paths import ROOT
from pipeline.plots import fields, rendering, style
from pipeline.plots import fields as plots_fields
from pipeline.quantity import MM
from pipeline.questions.bands import BandPoint, BandsResult
from pipeline.questions.modes import ShapesResult
from pipeline.records.record import DesignRecord, Record
from pipeline.records.study import StoredCase, StoredStudy, read_study
from pipeline.report import gallery, heat_map
from tests.helpers import synthetic
from tests.helpers.plate_files import drilled, panel, raw_case, written


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> StoredStudy:
    return read_study(synthetic.put_study(tmp_path_factory.mktemp("plots") / "rows"))


@pytest.fixture
def case(study: StoredStudy) -> StoredCase:
    return study.cases[1]


@pytest.fixture
def by_hand(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(rendering, "_faults", ["not target in this test"])


def labels(figure) -> str:
    texts = [figure.get_suptitle(), figure.get_supxlabel()]
    for axes in figure.axes:
        texts += [
            axes.get_xlabel(),
            axes.get_ylabel(),
            axes.get_title("left"),
            axes.get_title(),
            *(text.get_text() for text in axes.texts),
        ]
    return "\n".join(texts)


def test_units_on_every_axis(case: StoredCase):
    arrays = case.arrays()
    with style.style():
        report_figures = [
            fields.touch_face(case, arrays),
            plots_fields.mode_on_both_meshes(case, arrays),
            gallery.dispersion(case, arrays),
        ]
    for report_figure in report_figures:
        for axes in report_figure.figure.axes:
            visible = [label for label in (axes.get_xlabel(), axes.get_ylabel()) if label]
            assert all("(" in label or "/" in label for label in visible), (report_figure.name, visible)
        assert "(mm)" in labels(report_figure.figure) or "(kHz)" in labels(report_figure.figure)


@pytest.mark.slow
def test_the_same_record_gives_the_same_bytes(case: StoredCase, tmp_path: Path):
    for folder in ("a", "b"):
        with style.style():
            style.save(fields.touch_face(case, case.arrays()), tmp_path / folder)
            style.save(gallery.dispersion(case, {}), tmp_path / folder)
    for one in (tmp_path / "a").iterdir():
        assert one.read_bytes() == (tmp_path / "b" / one.name).read_bytes(), one.name


def test_the_gap_and_the_bending_bands_are_told_with_their_numbers(case: StoredCase):
    report_figure = gallery.dispersion(case, {})
    text = labels(report_figure.figure)
    assert "complete gap 163 to 176 kHz" in text and "bending at M\n32.54 kHz" in text
    assert [tick.get_text() for tick in report_figure.figure.axes[0].get_xticklabels()] == ["Γ", "X", "M", "Γ"]
    assert "163 to 176 kHz" in report_figure.alt and "32.54" in report_figure.alt
    cut = [
        replace(point, frequencies_hz=point.frequencies_hz[:4], error=point.error[:4])
        for point in case.record.of(BandsResult).points
    ]
    gapless = replace(case.record.of(BandsResult), gaps=[], points=cut)
    known = min(point.frequencies_hz[3] for point in case.record.of(BandsResult).points) / 1e3
    none = replace(case, record=case.record.model_copy(update={"answers": {"bands": gapless}}))
    gapless_figure = gallery.dispersion(none, {})  # a gap above the last band would not have been seen
    said = f"o complete gap along the path up to {known:.2f} kHz, where the lowest 4 bands end"
    assert said in labels(gapless_figure.figure) and f"opens {said[15:]}" in gapless_figure.alt


def test_normalised_frequency_is_f_a_over_the_shear_speed(case: StoredCase):
    speed = np.sqrt(70e9 / (2 * 1.34) / 2700)
    assert gallery.shear_speed(case) == pytest.approx(speed)
    axes = gallery.dispersion(case, {}).figure.axes[0]
    right = axes.child_axes[0]
    forward, _ = right._functions
    assert forward(100.0) == pytest.approx(100e3 * 0.004 / speed) and "f a / c" in right.get_ylabel()
    (case.folder / "input.json").rename(case.folder / "kept")
    assert gallery.shear_speed(case) is None and not gallery.dispersion(case, {}).figure.axes[0].child_axes
    (case.folder / "kept").rename(case.folder / "input.json")


def test_the_path_is_drawn_to_scale():
    bands = synthetic.bands(0.004)
    points, s = bands.points, bands.distance_per_m
    marks = [x for x, point in zip(s, points, strict=True) if point.label]
    assert np.diff(marks) == pytest.approx(np.pi / 0.004 * np.array([1, 1, np.sqrt(2)]))


@pytest.mark.slow
def test_the_moving_plate_states_its_factor_truly(case: StoredCase, by_hand):
    arrays, design = case.arrays(), case.record.design
    drawn = {each.name: each for each in rendering.report_figures(case, arrays)}
    text = float(drawn["moving_plate"].title.split("enlarged ")[1].split(" times")[0].replace("\u202f", ""))
    largest = np.abs(arrays["surface_u"][0]).max() / plots_fields.zone_peak(arrays, design) * 1e-6
    limit = rendering.DRAWN_SHARE * design.pillar.height_m
    assert limit / 2.5 < largest * text <= limit  # the largest of 1, 2, 5 that fits
    surfaces = rendering._surfaces(case, arrays, text)
    assert np.abs(surfaces["mode"].points - surfaces["geometry"].points).max() == pytest.approx(largest * text)
    level = surfaces["mode"].values
    assert 0.0 <= level.min() < 0.2 and 0.8 < level.max() <= 1.0  # of the signed scale
    assert "(no unit)" in labels(drawn["moving_plate"].figure) and "(no unit)" in labels(
        drawn["pillars_in_plane"].figure
    )


def test_face_quality_by_hand():
    points = np.array(
        [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, np.sqrt(0.75), 0], [3, 0, 0], [3, 1, 0], [2, 0, 0]]
    )
    quads, triangles = np.array([[0, 1, 2, 3], [0, 5, 6, 3]]), np.array([[0, 1, 4], [0, 1, 7]])
    assert rendering.face_quality(points, quads) == pytest.approx([1.0, 2 * 3 / 10])
    assert rendering.face_quality(points, triangles) == pytest.approx([1.0, 0.0])


def test_a_tetrahedral_field_of_the_other_sign_is_turned(case: StoredCase):
    arrays = case.arrays()
    report_figures = [
        plots_fields.mode_on_both_meshes(case, {**arrays, "tet_u": sign * arrays["tet_u"]}) for sign in (1, -1)
    ]
    fields = [report_figure.figure.axes[1].collections[0].get_array() for report_figure in report_figures]
    np.testing.assert_allclose(fields[0], fields[1])


@pytest.mark.parametrize("length_mm", [115.5, 115.4, 118.3])
def test_the_ends_of_a_zone_belong_to_it_however_their_places_are_rounded(length_mm: float):
    settings = [f"zone.length_mm={length_mm}", "array.rows=0"]
    design = DesignRecord.of_design(load_case(ROOT / "studies/three-rows.toml", settings).design)
    ends = np.array([[0.0, 0.0], [design.half_length_m, 0.0], [0.0, design.width_m]], dtype=np.float32).astype(float)
    arrays = {"touch_xy": ends, "touch_uz": np.array([[0.6, -1.0, 3.0]])}
    assert plots_fields.zone_peak(arrays, design) == 1.0


def test_a_field_by_tetrahedra_is_relative_to_its_maximum_on_the_zone_however_much_the_rest_moves(case: StoredCase):
    arrays, design = case.arrays(), case.record.design
    points, moved = arrays["tet_points"], arrays["tet_u"][:, 2].copy()
    nodes = np.unique(arrays["tet_triangles"])
    inside = np.abs(points[nodes, 1]) <= design.width_m / 2.0
    assert inside.any() and not inside.all()
    moved[nodes[~inside]] *= 50.0
    drawn = plots_fields._aligned(arrays, points, moved, nodes, design)[nodes]
    assert np.abs(drawn[inside]).max() == pytest.approx(1.0) and np.abs(drawn).max() > 1.0


def test_prediction_and_finite_plates_share_a_picture(study: StoredStudy):
    report_figure = gallery.how_many_rows(study)
    assert report_figure is not None and "predicted 9.0 dB" in report_figure.alt
    words = labels(report_figure.figure)
    assert "zone to margin (dB)" in words and "rows on each side" in words


def test_confinement_against_what_was_swept(study: StoredStudy):
    report_figure = gallery.against_sweep(study)
    level, tone = report_figure.figure.axes
    assert level.get_ylabel() == "confinement (dB)" and tone.get_xlabel() == "array pitch (mm)"
    named = {line.get_label() for line in tone.lines if not line.get_label().startswith("_")}
    assert named == {"array rows = 1", "array rows = 2", "unit cell: bending at M"}
    assert "3 of 4 reach 10 dB" in report_figure.alt
    lone = StoredStudy(study.folder, study.about, study.cases[:1])
    assert gallery.against_sweep(lone) is None


def test_two_and_three_swept_keys_are_heat_maps_with_the_confined_designs_framed():
    """Levels pitch + 3 rows, 0.5 dB more at the second height: 10 dB or more are framed."""

    def case(pitch: int, rows: int, height: float | None = None) -> StoredCase:
        sweep = {"array.pitch_mm": pitch, "array.rows": rows} | ({} if height is None else {"pillar.height_mm": height})
        level = pitch + 3.0 * rows + (0.5 if height == 6.5 else 0.0)
        return synthetic.case(f"{pitch}-{rows}-{height}", sweep, modes=synthetic.modes(synthetic.target(level, 35e3)))

    pitches, rows = (3, 4, 5, 6), (1, 2, 3)
    study = StoredStudy(Path("s"), {"name": "s"}, tuple(case(p, r) for p in pitches for r in rows))
    report_figure = heat_map.over_grid(study)
    panel = report_figure.figure.axes[0]
    assert panel.get_xlabel() == "array pitch (mm)" and panel.get_ylabel() == "array rows"
    assert np.asarray(panel.images[0].get_array()).tolist() == [[p + 3.0 * r for p in pitches] for r in rows]
    corners = {(round(box.get_x() + 0.46), round(box.get_y() + 0.44)) for box in panel.patches}
    assert corners == {(x, y) for x, p in enumerate(pitches) for y, r in enumerate(rows) if p + 3 * r >= 10}
    assert "best is 6-3-None with 15.0 dB" in report_figure.alt
    three = StoredStudy(Path("s"), {"name": "s"}, tuple(case(p, r, h) for p in pitches for r in rows for h in (6, 6.5)))
    first, second, _ = heat_map.over_grid(three).figure.axes
    assert [first.get_title(), second.get_title()] == ["pillar height (mm) = 6", "pillar height (mm) = 6.5"]
    apart = np.asarray(second.images[0].get_array()) - np.asarray(first.images[0].get_array())
    assert (apart == 0.5).all()
    assert heat_map.over_grid(StoredStudy(Path("s"), {}, study.cases[:6])) is None  # two pitches


def test_only_points_of_one_and_the_same_mode_are_joined(tmp_path: Path):
    """Three plates whose target shape is tracked from the first to the second and is another mode's at the third."""
    folder = synthetic.put_study(tmp_path / "sweep", pitches=(0.004, 0.005, 0.006), rows=(3,))
    shapes = {4: [[1.0, 0.0], [0.0, 1.0]], 5: [[0.99, 0.1], [0.0, 1.0]], 6: [[0.0, 1.0], [1.0, 0.0]]}
    for pitch, coefficients in shapes.items():
        (path,) = folder.glob(f"pitch_mm={pitch}*/record.json")
        kept = ShapesResult(target=0, frequency_hz=[31e3, 33e3], share=[0.9] * 2, coefficients=coefficients)
        synthetic.change(path.parent, shapes=kept)
    level, tone = gallery.against_sweep(read_study(folder)).figure.axes
    for axes in (level, tone):
        joined = [line.get_xdata().tolist() for line in axes.lines if line.get_linestyle() == "-"]
        assert [4.0, 5.0] in joined and not any(
            6.0 in points for points in joined if len(points) == 2 and 0 not in points
        )
        assert [4.0, 5.0, 6.0] not in joined


@pytest.mark.slow
def test_each_line_has_its_own_cell_where_the_cells_differ(tmp_path: Path):
    folder = synthetic.put_study(tmp_path / "rows", pitches=(0.004, 0.006), rows=(1, 2, 3))
    for path in folder.glob("pitch_mm=6*/record.json"):
        bands = synthetic.record_of(path.parent).of(BandsResult)
        corner = BandPoint(label="M", kx_per_m=1.0, ky_per_m=1.0, frequencies_hz=[31000.0, 31100.0])
        synthetic.change(path.parent, bands=replace(bands, points=[corner]))
    study = read_study(folder)
    _, tone = gallery.against_sweep(study).figure.axes
    cells = [line for line in tone.lines if line.get_label() == "_cell"]
    pitches = [line for line in tone.lines if line.get_label().startswith("array pitch")]
    assert [line.get_color() for line in cells] == [line.get_color() for line in pitches] and len(cells) == 2
    assert {float(line.get_ydata()[0]) for line in cells} == {32.541, 31.0}


@pytest.mark.parametrize(("key", "label"), [("array.pitch_mm", "array pitch (mm)"), ("array.rows", "array rows")])
def test_swept_keys_in_words(key: str, label: str):
    assert gallery.axis_label(key) == label


def test_records_with_little_in_them_give_few_pictures(study: StoredStudy, tmp_path: Path, by_hand):
    case = study.cases[0]
    bare = StoredCase(tmp_path / "bare", Record(case_id="bare", status="OK", bands=case.record.answers["bands"]))
    assert [picture.name for picture in gallery.draw_case(bare).pictures] == ["dispersion"]
    nothing = StoredCase(tmp_path / "none", Record(case_id="none", status="OK"))
    assert gallery.draw_case(nothing).pictures == [] and not (tmp_path / "none").exists()
    assert gallery.draw_case(study.cases[-1]).pictures == []  # the failed one


def test_a_bare_plate_has_its_pictures(tmp_path: Path, by_hand):
    shape = synthetic.design(0, 0.004, 0.005)
    arrays = synthetic.shapes(shape, 12.0)
    case = StoredCase(tmp_path, synthetic.record("bare-plate", {}, shape, 3.0))
    names = [
        report_figure.name
        for report_figure in (fields.touch_face(case, arrays), *rendering.report_figures(case, arrays))
        if report_figure
    ]
    assert "touch_face" in names and "moving_plate" in names and "pillars_in_plane" not in names


def test_nice_below():
    assert [rendering.nice_below(value) for value in (1.0, 1.99, 2.0, 4.9, 5.0, 9.99, 0.07)] == pytest.approx(
        [1, 1, 2, 2, 5, 5, 0.05]
    )


@pytest.mark.parametrize("corners", [3, 4])
def test_a_skin_without_edge_faces_gets_them_once(corners: int):
    shape = synthetic.design(1, 0.004, 0.005)
    points, faces = synthetic.skin(shape)
    faces = faces if corners == 4 else np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    assert with_sides(points, faces, shape.thickness_m) is faces  # closed already
    flat = [np.abs(points[:, axis]) > half * (1 - 1e-9) for axis, half in ((0, 0.1155 / 2), (1, shape.half_span_m))]
    open_faces = faces[~(flat[0][faces].all(axis=1) | flat[1][faces].all(axis=1))]
    closed_faces = with_sides(points, open_faces, shape.thickness_m)
    added = points[closed_faces[len(open_faces) :]]
    sides = np.linalg.norm(np.cross(added[:, 1] - added[:, 0], added[:, -1] - added[:, 0]), axis=1)
    sides *= 1.0 if corners == 4 else 0.5
    assert sides.sum() == pytest.approx(4 * (0.1155 / 2 + shape.half_span_m) * 0.002)


def test_a_plate_of_a_file_is_drawn_by_its_rims_in_its_own_place(tmp_path: Path):
    """Pictures frame the plate where its file has it, and draw every rim; a whole mesh of tetrahedra is named as such."""
    written(drilled(panel(), 11.0, 6.0, 1.5).translate((40.0, 10.0, 0.0)), tmp_path)
    settings = ["zone.centre_mm=[40, 10]", "array.rows=0", "array.surround=false"]
    design = DesignRecord.of_design(case_from_dict(raw_case(), tmp_path / "case.toml", settings).design)
    _, axes = style.panels(3.0)
    fields.draw_outlines(axes, design)
    fields.frame_plate(axes, design)
    assert axes.get_xlim() == pytest.approx((25.0, 55.0), abs=0.2) and axes.get_ylim() == pytest.approx(
        (0.0, 20.0), abs=0.2
    )
    sides = np.concatenate([np.array(each.get_segments()).reshape(-1, 2) for each in axes.collections[:1]])
    assert sides.min(axis=0) == pytest.approx([25.0, 0.0], abs=1e-3)
    assert np.linalg.norm(sides - [51.0, 16.0], axis=1).min() == pytest.approx(1.5, rel=1e-3)  # the hole
    sketch = gallery.sketch(design)
    assert 'viewBox="' in sketch and '<path class="plate"' in sketch and "30 × 20 × 1 mm" in sketch
    assert "rows" not in rendering._dimensions(design, None)


def test_supports_are_stored_drawn_and_named() -> None:
    """On the map, a sketch and in words: a clamp is a whole line on its edge, what yields a broken one, a disc a circle."""
    held = 'support=[{kind="clamp", edge="x-"}, {kind="mass", at_mm=[9, -11.5], radius_mm=1.5, mass_g=1}]'
    design, yielding = (
        DesignRecord.of_design(load_case(ROOT / "examples" / "29-held-plate.toml", more).design)
        for more in ([held], [])
    )
    _, axes = style.panels(3.0)
    before = len(axes.lines)
    fields.draw_outlines(axes, replaced := design.model_copy(update={"supports": []}))
    plain = len(axes.lines) - before
    fields.draw_outlines(axes, design)
    edge = axes.lines[-1]
    assert len(axes.lines) == 2 * plain + 1 and edge.get_linestyle() == "-"
    assert set(edge.get_xdata()) == {-16.0} and sorted(edge.get_ydata()) == pytest.approx([-14.0, 14.0])
    (disc,) = (patch for patch in axes.patches if isinstance(patch, Circle))
    assert disc.center == pytest.approx((9.0, -11.5)) and disc.radius == pytest.approx(1.5) and disc.get_fill()
    assert "clamp on edge x-; mass on a disc 3 mm wide at (9, -11.5) mm" in rendering._dimensions(design, None)
    sketch, soft = gallery.sketch(design), gallery.sketch(yielding)
    assert 'd="M-16.00 14.00L-16.00 -14.00"' in sketch and 'cx="9.00" cy="11.50" r="1.50"' in sketch
    assert "support" not in gallery.sketch(replaced) and "dasharray" not in sketch and "dasharray" in soft
    fields.draw_outlines(axes, yielding)
    assert axes.lines[-1].get_linestyle() == ":"


@pytest.mark.parametrize(
    ("name", "rows", "said"),
    [
        ("examples/28-zone-on-glass.toml", "", "64 square pillars 2 mm wide, 6.4 mm high"),
        ("examples/37-two-zones.toml", "", "9 rows of 29 square pillars 2 mm wide, 6.3 mm high"),
        (
            "studies/three-rows.toml",
            "heights_mm=[6, 6.3, 6.6]",
            "2 × 3 rows of 29 square pillars 2 mm wide, 6, 6.3, 6.6 mm high",
        ),
        (
            "studies/three-rows.toml",
            "sides_mm=[2, 1.5, 1]",
            "square pillars 2 mm wide, 1.5 mm wide, 1 mm wide, 6.3 mm high",
        ),
        ("studies/three-rows.toml", "pitches_y_mm=[4, 5, 6]", "square pillars 2 mm wide, 6.3 mm high, 4 mm apart"),
    ],
)
def test_pillars_are_named_as_they_stand_and_no_label_lies_on_them(name: str, rows: str, said: str):
    design = DesignRecord.of_design(load_case(ROOT / name, [f"array.{rows}"] if rows else []).design)
    assert said in rendering._dimensions(design, None)
    if "pitches" in rows:
        assert design.row_gaps_m == pytest.approx([4.5e-3, 5.5e-3])  # between their middles
    (texts,) = ET.fromstring(str(gallery.sketch(design))).findall("g")
    (label,) = [each for each in texts if "zone" in str(each.text)]
    x, y, height = float(label.attrib["x"]), float(label.attrib["y"]), float(texts.attrib["font-size"])
    half = len(str(label.text)) * gallery.LETTER * height / 2.0
    assert not any(
        abs(own_x / MM - x) < half and -height < -own_y / MM - y < height / 3.0
        for own_x, own_y in design.pillar_centres_m
    )
