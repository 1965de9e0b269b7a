"""`antinode explore`: what it refuses before anything is computed."""

from __future__ import annotations

import pytest

from pipeline.cli.main import main
from tests.helpers.exploring import SMALL


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--set", "pillar.shape=round", "--set", "pillar.diameter_mm=2"], "pillar.shape must be square"),
        (["--set", "pillar.fillet_mm=0.3"], "without fillet"),
        (["--set", "array.pitch_y_mm=5"], "pitch_x_mm and pitch_y_mm must be equal"),
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
