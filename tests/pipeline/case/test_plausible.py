"""Materials unlike any solid are doubted in one line and computed all the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from geometry.materials import MATERIALS
from pipeline.batch import case_study
from pipeline.case.limits import doubts
from pipeline.case.model import load_case
from pipeline.cli.main import main
from pipeline.errors import InputError
from tests.helpers.recording_log import RecordingLog

CASE = """name = "p"
material = {{ young_GPa = {young}, density_kg_m3 = {density}, poisson = 0.3 }}
plate = {{ thickness_mm = 2.0 }}
zone = {{ length_mm = 20, width_mm = 10, nodal_lines = 2 }}
"""
SOLIDS = {
    "diamond": (1200, 3515),
    "beryllium": (287, 1850),
    "rubber": (1e-3, 1000),
    "gel": (1e-5, 1000),
    "osmium": (560, 22590),
}
SLIPS = {"g/cm3": (70, 2.7), "too stiff": (1500, 1180), "too soft": (1e-9, 1200), "t/mm3": (70, 9e4)}


def written(folder: Path, young: float, density: float) -> Path:
    file = folder / "p.toml"
    file.write_text(CASE.format(young=young, density=density))
    return file


@pytest.mark.parametrize("name", SOLIDS)
def test_what_there_is_is_not_doubted(name: str, tmp_path: Path) -> None:
    assert not doubts(load_case(written(tmp_path, *SOLIDS[name])).design)


def test_no_material_of_the_list_is_doubted(tmp_path: Path) -> None:
    case = load_case(written(tmp_path, 70, 2700))
    for name in MATERIALS:
        assert not doubts(load_case(case.source, [f"material={name}"]).design)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", SLIPS)
def test_a_slip_of_units_gives_one_line(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = written(tmp_path, *SLIPS[name])
    assert main(["predesign", str(file), "--quiet"]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warning MATERIAL")]
    assert len(lines) == 1 and "check the units" in lines[0]


def test_python_and_studies_doubt_it_too(tmp_path: Path) -> None:
    import antinode

    file = written(tmp_path, *SLIPS["too stiff"])
    with pytest.warns(antinode.AntinodeWarning, match="MATERIAL: .*check the units"), pytest.raises(InputError):
        antinode.load(file).response()
    log, case = RecordingLog(), load_case(file)
    with pytest.raises(InputError):
        payload = {"overrides": [], "case": case.to_dict(), "measure": ["response"]}
        case_study.compute(str(file), payload, tmp_path, log)  # type: ignore[arg-type]
    assert "MATERIAL" in log.warnings


def test_the_search_doubts_it_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def begun(*given: object) -> None:
        raise InputError("begun")

    monkeypatch.setattr("pipeline.search.optimiser.check", begun)
    assert main(["search", str(written(tmp_path, *SLIPS["too stiff"])), "--vary", "plate.thickness_mm=1:2"]) == 2
    said = capsys.readouterr().err
    assert "warning MATERIAL" in said and "begun" in said


def test_a_comparison_doubts_each_of_its_cases(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, bad = (tmp_path / name for name in ("good", "bad"))
    for folder, sizes in ((good, (70, 2700)), (bad, SLIPS["g/cm3"])):
        folder.mkdir()
        written(folder, *sizes)
    assert main(["compare", str(good / "p.toml"), str(bad / "p.toml"), "--quiet"]) == 0
    assert capsys.readouterr().err.count("warning MATERIAL") == 1
