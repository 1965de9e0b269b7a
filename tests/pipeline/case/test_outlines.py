"""Cases with plate.file: what the file sets, faults in one line, and the content of the file in what a case is."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cadquery as cq
import numpy as np
import pytest

from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.planning.model_choice import model_choice_of
from pipeline.records import store
from pipeline.records.record import DesignRecord
from tests.helpers.plate_files import drilled, panel, raw_case, written


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("plates")
    written(drilled(panel(), 11.0, 6.0, 1.5), place)
    written(panel().translate((40.0, 0.0, 0.0)), place, "away.step")
    written(cq.Workplane(panel().val().scale(1e-3)), place, "metres.step")
    (place / "text.step").write_text("solid\n")
    return place


def case_of(folder: Path, *settings: str, **tables: Any) -> Case:
    return case_from_dict(raw_case(**tables), folder / "case.toml", settings)


def test_the_file_sets_the_plate_and_the_case_places_the_zone_from_its_origin(folder: Path) -> None:
    design = case_of(folder).design
    assert design.thickness_m == pytest.approx(1e-3) and design.plate_m == pytest.approx((30e-3, 20e-3))
    assert design.goes_on == (True, True) and not design.is_mirrored
    away = case_of(folder, "plate.file=away.step", "zone.centre_mm=[40, 0]").design
    assert away.ends_m == pytest.approx((25e-3, 55e-3, -10e-3, 10e-3), abs=1e-9)
    assert away.pillar_centres() == pytest.approx(design.pillar_centres() + np.array([40e-3, 0.0]), abs=1e-12)
    drawn = DesignRecord.of_design(away)
    assert drawn.ends_m == pytest.approx(away.ends_m, abs=1e-7)


def test_zones_that_end_with_the_plate_have_free_ends(folder: Path) -> None:
    alone = {"pillar.side_mm": 1.5, "array.rows": 0, "array.surround": False}
    long = case_of(folder).but({**alone, "zone.length_mm": 30.0})
    right = case_of(folder).but({**alone, "zone.length_mm": 20.0, "zone.centre_mm": [5.0, 0.0]})
    assert (long.design.goes_on, right.design.goes_on) == ((False, False), (True, False))


def test_a_thickness_beside_the_file_has_to_agree(folder: Path) -> None:
    assert case_of(folder, plate={"file": "plate.step", "thickness_mm": 1.0}).design == case_of(folder).design
    with pytest.raises(InputError, match=r"plate\.thickness_mm = 1\.1: must be 1, the thickness of plate\.file"):
        case_of(folder, plate={"file": "plate.step", "thickness_mm": 1.1})


FAULTS: dict[str, tuple[str, ...]] = {
    r"plate\.file = \"none\.step\": no such STEP file": ("plate.file=none.step",),
    r"plate\.file = \"text\.step\": not a readable STEP file": ("plate.file=text.step",),
    r"plate\.file = \"metres\.step\": is 0\.03 x 0\.02 mm, .*: is it in metres": ("plate.file=metres.step",),
    r"zone\.length_mm = 40: the zone of 40 x 5 mm about \(0, 0\) reaches beyond the outline": ("zone.length_mm=40",),
    r"zone\.centre_mm = \[10, 3\]: .* over a hole or a pocket": (
        "zone.centre_mm=[10, 3]", "array.rows=0", "array.surround=false",
    ),
    r"array\.rows = 3: \d+ of \d+ pillars, such as .* beyond the outline of plate\.file": ("array.rows=3",),
    r"array\.rows = 2: 1 of \d+ pillars, such as the one at \(10\.5, 5\.5\) mm, would stand over a hole": (
        "array.rows=2", "zone.centre_mm=[3, -0.5]", "pillar.side_mm=1",
    ),
    r"array\.extension_mm = 5: must be left out of a plate with file": ("array.extension_mm=5",),
    r"support = .*: must be left out with plate\.file": ('support=[{kind="clamp", edge="y-"}]',),
    r"patches\.centres_mm = .*: patch 0 extends beyond the outline of plate\.file, or over a hole": (
        "patches={size_mm=[3, 2, 0.3], face='touch', centres_mm=[[11, 6]]}",
    ),
    r"touch\.at_mm = .*: the contact extends beyond the plate": ("touch={radius_mm=1, at_mm=[14, 9]}",),
}  # fmt: skip


@pytest.mark.parametrize("line", FAULTS)
def test_each_fault_is_one_line(folder: Path, line: str) -> None:
    with pytest.raises(InputError) as fault:
        case_of(folder, *FAULTS[line])
    assert len(fault.value.lines) == 1 and re.search(line, fault.value.lines[0]), fault.value.lines


@pytest.mark.parametrize("beside", [{"length_mm": 30.0}, {"width_mm": 20.0}, {"layer": [{}]}])
def test_sizes_and_layers_are_the_files(folder: Path, beside: dict[str, Any]) -> None:
    with pytest.raises(InputError) as fault:
        case_of(folder, plate={"file": "plate.step"} | beside)
    assert any(f"plate.{next(iter(beside))}" in line and "plate.file" in line for line in fault.value.lines)


@pytest.mark.parametrize(("setting", "what"), [("solve.mesh=hex", "hex"), ("solve.model=superelement", "superelement")])
def test_models_that_cannot_follow_an_outline_are_refused(folder: Path, setting: str, what: str) -> None:
    with pytest.raises(InputError, match=f"'{what}': must be auto or .*plate.file"):
        model_choice_of(case_of(folder, setting), "plate", 50e3)
    assert model_choice_of(case_of(folder), "plate", 50e3).name == "solid tet2"


def test_a_size_set_in_place_of_the_file_gives_a_rectangle(folder: Path) -> None:
    case = case_of(folder).but({"plate.length_mm": 30.0, "plate.width_mm": 20.0, "plate.thickness_mm": 1.0})
    assert case.design.outline is None and case.design.larger_m == (30e-3, 20e-3)
    back = case.but({"plate.file": "plate.step"})
    assert back.design == case_of(folder).design


def test_a_case_is_another_one_when_the_content_of_its_file_changes(tmp_path: Path) -> None:
    def hashed(shape: Callable[[], cq.Workplane]) -> str:
        written(shape(), tmp_path)
        plain = case_of(tmp_path).to_dict()
        assert plain["design"]["outline"].keys() == {"file", "file_sha256"}
        return store.input_hash(plain)

    first = hashed(panel)
    same = store.input_hash(case_of(tmp_path).to_dict())
    assert first == same != hashed(lambda: panel(corner=3.0))


def test_every_foot_flush_with_the_rim_stands_on_the_plate(folder: Path, tmp_path: Path) -> None:
    """Rows whose last feet end with a rectangle are taken; a nanometre less plate than that is within the tolerance."""
    written(panel(8.0 + 2 * 1.5, 5.0 + 2 * 1.5, 1.0, 0.0), tmp_path)
    design = case_of(tmp_path).design
    assert np.abs(design.pillar_centres()).max(axis=0) == pytest.approx([4.75e-3, 3.25e-3])
