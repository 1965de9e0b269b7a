"""The tolerance command on a small plate: repeatable, seeded, told in words and numbers; faults in one line."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.case.model import load_case
from pipeline.cli.main import main
from pipeline.errors import InputError
from pipeline.models import tolerance
from pipeline.models.answer_parts import SampleRecord
from solvers.variation.samples import PlateSpace

pytestmark = pytest.mark.usefixtures("coarsest_cells")
CASE = """name = "small"
material = "aluminium"
[plate]
thickness_mm = 2.0
[zone]
length_mm = 24.0
width_mm = 18.0
nodal_lines = 2
[pillar]
side_mm = 2.0
height_mm = 6.0
[array]
pitch_mm = 6.0
rows = 1
extension_mm = 3.0
[solve]
band_kHz = [20.0, 50.0]
accuracy = 0.03
[damping]
quality = 100.0
[tolerance]
height_mm = 0.05
samples = 3
"""
PATCHES = "[patches]\nsize_mm = [4.0, 2.0, 0.3]\nsensors = [1]\n"


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("tolerance") / "small.toml"
    path.write_text(CASE)
    return path


def run(case: Path, *more: str) -> dict:
    out = case.parent / f"out-{len(list(case.parent.iterdir()))}"
    assert main(["tolerance", str(case), "--quiet", "--out", str(out), *more]) == 0
    assert (out / "tolerance.png").exists()
    rows = (out / "tolerance.csv").read_text().splitlines()
    result = json.loads((out / "tolerance.json").read_text())
    assert len(rows) == 1 + len(result["samples"])
    return result


@pytest.fixture(scope="module")
def document(case: Path) -> dict:
    return run(case)


@pytest.mark.slow
def test_the_document_holds_samples_and_their_statistics(document: dict) -> None:
    assert document["schema"] == 2 and document["pillars"] == 8
    assert document["drive"] == "pressure in the target shape" and document["rms_unit"] == "m/N"
    peaks = [one["peak_hz"] for one in document["samples"]]
    assert len(set(peaks)) == 3
    assert document["peak_hz"]["mean"] == pytest.approx(np.mean(peaks))
    assert document["peak_hz"]["deviation"] == pytest.approx(np.std(peaks, ddof=1))
    levels = [one["confinement_db"] for one in document["samples"]]
    assert document["confinement_db"]["lowest"] == min(levels)
    assert document["confined"] == sum(level >= 10.0 for level in levels)
    shift = document["peak_shift_hz"]["mean"]
    assert shift == pytest.approx(np.mean(peaks) - document["nominal"]["peak_hz"])
    assert document["nominal"]["quality_factor"] == pytest.approx(100.0, rel=0.1)
    off = document["interpolation_check"]
    assert 0.0 < off["peak_hz"] < 0.1 * document["peak_hz"]["deviation"], "interpolation is no part of the spread"
    assert off["confinement_db"] < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    "shape",
    [
        pytest.param("shape='round'\ndiameter_mm=2.0", marks=pytest.mark.slow),
        pytest.param("shape='hexagonal'\nside_mm=2.0", marks=pytest.mark.slow),
        "shape='tapered'\nbase_mm=2.0\ntip_mm=1.6",
    ],
)
def test_pillars_of_other_shapes_scatter_too(shape: str, tmp_path: Path) -> None:
    """Heights alone: a lone pillar's frequency goes as the inverse square of its height, and the plate's follows it."""
    path = tmp_path / "shaped.toml"
    path.write_text(CASE.replace("side_mm = 2.0", shape))
    result = run(path, "--samples", "2")
    assert len(result["samples"]) == 2 and result["pillars"] == 8
    assert 0.0 < result["interpolation_check"]["peak_hz"] < 1e-4 * result["nominal"]["peak_hz"]


@pytest.mark.slow
def test_the_same_seed_draws_the_same_plates_and_more_samples_go_on(case: Path, document: dict) -> None:
    more, one = run(case, "--samples", "4"), run(case, "--samples", "1")
    assert more["with_defaults"]["tolerance"]["samples"] == 4
    assert one["peak_hz"]["mean"] == pytest.approx(document["samples"][0]["peak_hz"], rel=1e-9)
    assert one["peak_hz"]["deviation"] is None and one["confinement_db"]["deviation"] is None, "one tells no spread"
    for one, other in zip(document["samples"], more["samples"][:3], strict=True):
        assert one["peak_hz"] == pytest.approx(other["peak_hz"], rel=1e-9)
    other_seed = run(case, "--seed", "2")
    assert other_seed["samples"][0]["peak_hz"] != pytest.approx(document["samples"][0]["peak_hz"], rel=1e-9)
    assert other_seed["nominal"]["peak_hz"] == pytest.approx(document["nominal"]["peak_hz"], rel=1e-9)


@pytest.mark.slow
def test_with_patches_they_drive(case: Path, tmp_path: Path) -> None:
    path = tmp_path / "patched.toml"
    path.write_text(CASE + PATCHES)
    result = run(path, "--samples", "1", "--set", "tolerance.position_mm=0.01")
    assert result["drive"] == "patches" and result["rms_unit"] == "m/V"
    assert result["peak_hz"]["deviation"] is None


@pytest.mark.parametrize(
    ("text", "more", "words"),
    [
        (CASE.split("[tolerance]")[0], [], "[tolerance]"),
        (CASE, ["--set", "tolerance.height_mm=0"], "nothing varies"),
        (CASE, ["--set", "tolerance.height_mm=2.5"], "a third of pillar.height_mm"),
        (CASE, ["--set", "tolerance.position_mm=0.8"], "pillars may touch"),
        (CASE, ["--set", "tolerance.young_percent=11"], "tolerance.young_percent = 11: must be"),
        (CASE, ["--set", "array.rows=0"], "array.rows above 0"),
        (CASE, ["--set", "pillar.fillet_mm=0.2"], "cross-shaped pillars of one section without fillet"),
        (CASE, ["--set", "tolerance.samples=0"], "from 1 to 10000"),
        (CASE, ["--set", 'solve.model="solid"'], "set solve.model to auto or superelement"),
        (CASE, ["--set", 'solve.mesh="tet"'], "solve.mesh to auto or hex"),
        (CASE, ["--band", "3"], "--band"),
    ],
)
def test_wrong_input_is_one_line(
    tmp_path: Path, text: str, more: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "case.toml"
    path.write_text(text)
    assert main(["tolerance", str(path), "--quiet", *more]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and words in lines[0]


def test_a_case_without_the_table_is_understood_as_before(tmp_path: Path) -> None:
    """Records of cases without it stay valid."""
    path = tmp_path / "case.toml"
    path.write_text(CASE.split("[tolerance]")[0])
    assert "tolerance" not in load_case(path).to_dict()
    given = load_case(path, ["tolerance.side_mm=0.02"]).to_dict()["tolerance"]
    assert given == {"height_m": 0.0, "side_m": 2e-5, "position_m": 0.0, "young_percent": 0.0, "samples": 20, "seed": 1}
    with pytest.raises(InputError, match=r"did you mean tolerance\.side_mm"):
        load_case(path, ["tolerance.sides_mm=0.02"])


@pytest.mark.parametrize(("tones_hz", "known"), [((30e3,), False), ((20e3, 30e3), True)])
def test_a_narrower_space_that_is_the_same_one_checks_nothing(tones_hz: tuple[float, ...], known: bool) -> None:
    """With a single mode in the margin the narrower band leaves none out."""
    one, other = (
        SampleRecord(peak_hz=p, zone_rms=1.0, confinement_db=9.0, quality_factor=None, tracking="single")
        for p in (3e4, 3.1e4)
    )
    space = object.__new__(PlateSpace)
    space.bases = [SimpleNamespace(frequency_hz=np.array(tones_hz))]  # type: ignore[list-item]
    plate = SimpleNamespace(space=space, sample=lambda *_: other)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tolerance, "_measured", lambda sample: sample)
        check = tolerance._space_check(plate, np.zeros((1, 4)), one, (25e3, 35e3))  # type: ignore[arg-type]
    assert check["peak_hz"] == (pytest.approx(1e3) if known else None)
