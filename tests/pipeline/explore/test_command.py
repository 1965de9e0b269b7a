"""`antinode explore`: what it refuses before anything is computed."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from pipeline.case.model import case_from_dict
from pipeline.case.reading import read_toml
from pipeline.cli.main import main
from pipeline.explore import offline
from pipeline.explore.answer import LIMITS, Scene
from pipeline.models import parametric as cell_model
from tests.helpers.exploring import SMALL, small_explorer


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["--set", "pillar.fillet_mm=0.3"],
            "pillar.shape must be square, round, hexagonal, tapered or cross, without fillet",
        ),
        (["--set", "array.pitch_y_mm=9"], "array.pitch_y_mm must lie between 0.5 and 2 times pitch_x_mm"),
        (["--set", "pillar.heigth_mm=6"], "heigth_mm"),
    ],
)
def test_a_case_that_the_bases_cannot_follow_is_refused(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explore", str(SMALL), "--no-browser", *words]) == 2
    output = capsys.readouterr()
    assert said in output.err and output.out == ""
    assert "Traceback" not in output.err


@pytest.mark.parametrize("port", ["-1", "70000", "no"])
def test_a_port_that_is_none_is_refused(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["explore", str(SMALL), "--port", port])
    assert ended.value.code == 2
    assert "--port" in capsys.readouterr().err


@pytest.mark.slow
def test_the_page_is_exported_as_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = small_explorer(tmp_path).model
    monkeypatch.setattr(cell_model, "cell_model", lambda case, log, offline: model)
    place = tmp_path / "explorer.html"
    assert main(["explore", str(SMALL), "--export", str(place), "--quiet"]) == 0
    html = place.read_text(encoding="utf-8")
    assert "http://" not in html.replace("http://www.w3.org/2000/svg", "") and "src=" not in html
    assert offline.POLICY in html and 'id="numbers-of-model"' in html
    assert len(html) < offline.MAX_BYTES


def test_a_place_that_cannot_be_written_is_refused_before_anything_is_computed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cell_model, "cell_model", lambda case, log, offline: pytest.fail("computed"))
    assert main(["explore", str(SMALL), "--export", str(tmp_path / "none" / "explorer.html")]) == 2
    assert "--export" in capsys.readouterr().err


def test_the_sliders_are_laid_about_a_thin_plate() -> None:
    raw = read_toml(SMALL)
    scene = Scene(case_from_dict(raw, SMALL, ["plate.thickness_mm=0.7"]), raw, ("plate.thickness_mm=0.7",))
    scene.check()
    limits = scene.limits
    assert (limits["thickness"].low, limits["thickness"].high, limits["thickness"].step) == (0.4, 1.2, 0.02)
    assert {name: limit for name, limit in limits.items() if name != "thickness"} == {
        name: limit for name, limit in LIMITS.items() if name != "thickness"
    }


def test_a_case_outside_the_sliders_is_refused_before_anything_is_computed(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cell_model, "cell_model", lambda case, log, offline: pytest.fail("computed"))
    assert main(["explore", str(SMALL), "--set", "array.rows=9", "--no-browser", "--quiet"]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "explore: array.rows = 9: must be from 0 to 8" in line


def test_the_vendored_solver_is_the_one_its_readme_names() -> None:
    script = offline.SOLVER.read_bytes()
    assert hashlib.sha256(script).hexdigest() in (offline.SOLVER.parent / "README.md").read_text()
    assert b"</script" not in script.lower() and b"<!--" not in script
    assert "MIT" in (offline.SOLVER.parent / "LICENSE.ml-matrix").read_text()
