"""The broadband command: rows alike and rows that differ over frequency, and what is refused of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli.main import main
from pipeline.models.broadband import stretches

pytestmark = pytest.mark.usefixtures("coarsest_cells")
CASE = """name = "small"
material = "aluminium"
[plate]
thickness_mm = 2.0
[zone]
length_mm = 60.0
width_mm = 20.0
nodal_lines = 4
[pillar]
side_mm = 2.0
height_mm = 6.3
[array]
pitch_mm = 4.0
rows = 2
extension_mm = 6.0
[solve]
accuracy = 0.05
band_kHz = [25, 45]
"""


def test_stretches_end_where_the_level_crosses_between_two_points() -> None:
    tones = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert stretches(tones, np.array([0.0, 20.0, 20.0, 0.0, np.nan, 30.0])) == [
        pytest.approx((1.5, 3.5)),
        pytest.approx((6.0 - 20.0 / 1030.0, 6.0)),
    ]
    assert stretches(tones, np.full(6, 9.9)) == [] and stretches(tones, np.full(6, 10.0)) == [(1.0, 6.0)]


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict:
    folder = tmp_path_factory.mktemp("broadband")
    (folder / "case.toml").write_text(CASE)
    listed = ["--set", "array.heights_mm=[6.3,5.9]", "--points", "21", "--quiet"]
    answer = ["--json", str(folder / "b.json"), "--csv", str(folder / "b.csv"), "--plot", str(folder / "b.svg")]
    assert main(["broadband", str(folder / "case.toml"), *listed, *answer]) == 0
    assert (folder / "b.svg").stat().st_size > 0 and len((folder / "b.csv").read_text().splitlines()) == 22
    return json.loads((folder / "b.json").read_text())


@pytest.mark.slow
def test_power_is_shared_out_whole_and_the_intervals_are_those_of_the_points(document: dict) -> None:
    assert document["rows"] == 2 and len(document["points"]) == 21
    assert [pillar["height_m"] for pillar in document["with_defaults"]["design"]["graded"]] == pytest.approx(
        [6.3e-3, 5.9e-3]
    )
    for point in document["points"]:
        shares = point["transmission"]
        assert shares["reflected"] + shares["flexural"] + shares["shear"] + shares["longitudinal"] == pytest.approx(1.0)
        inside = any(low <= point["frequency_hz"] <= high for low, high in document["stopped"])
        assert inside == (shares["flexural"] <= 0.1)
    assert 30e3 < document["target_hz"] < 42e3 and document["target_db"] is not None


def test_a_mesh_without_a_coarser_one_gives_no_bars(document: dict) -> None:
    assert document["frequency_error"] is None and document["target_error"] is None
    assert {point[name] for point in document["points"] for name in ("confinement_error_db", "taken_error_db")} == {
        None
    }


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("array.rows=0", "must be 1 or more"),
        ("pillar.shape=round", "pillar.diameter_mm: missing"),
        ("solve.mesh=tet", "hexahedra"),
        ("solve.model=solid", "must be auto or superelement"),
    ],
)
def test_what_cannot_be_is_one_line_and_exit_code_2(
    override: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "case.toml").write_text(CASE)
    assert main(["broadband", str(tmp_path / "case.toml"), "--set", override]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and said in lines[0]
