"""What a shell is told could come next, asked as argcomplete's own code asks."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.cli.main import main

ROOT = Path(__file__).resolve().parents[3]
ASK = "import os; os.dup2(1, 8); os.dup2(2, 9); from antinode.__main__ import main; main()"


def offered(line: str, folder: Path) -> list[str]:
    """The completions of a line with the cursor at its end."""
    variables = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "_ARGCOMPLETE_IFS": "\n"}
    variables |= {"_ARGCOMPLETE_COMP_WORDBREAKS": " \t\n", "_ARGCOMPLETE_SHELL": "bash", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", ASK], cwd=folder, env=os.environ | variables, capture_output=True, text=True
    )
    return [word.strip() for word in done.stdout.split("\n")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "target", "unwanted"),
    [
        ("antinode atten", {"attenuation"}, {"modes"}),
        ("antinode modes --sym", {"--symmetry"}, {"--band"}),
        ("antinode modes plate.toml --symmetry ", {"SS", "SA", "AS", "AA"}, {"plate.toml"}),
        ("antinode modes pl", {"plate.toml"}, {"plate.csv"}),
        ("antinode run ro", {"rows"}, {"three-rows"}),
        ("antinode modes plate.toml --set array.pi", {"array.pitch_mm=", "array.pitch_x_mm="}, {"array.rows="}),
        ("antinode modes plate.toml --set solve.mesh=", {"solve.mesh=tet", "solve.mesh=hex"}, {"solve.model=solid"}),
        ("antinode search plate.toml --vary pillar.h", {"pillar.height_mm="}, {"pillar.shape="}),
    ],
)
def test_a_shell_is_told_what_could_come_next(line: str, target: set, unwanted: set, tmp_path: Path) -> None:
    (tmp_path / "plate.toml").touch()
    (tmp_path / "plate.csv").touch()
    words = set(offered(line, tmp_path))
    assert target <= words and not unwanted & words, words


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_gets_its_code(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert "_ARGCOMPLETE" in text and "antinode" in text


def test_the_code_for_bash_is_bash(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["completion", "bash"])
    (tmp_path / "code").write_text(capsys.readouterr().out + "\ncomplete -p antinode\n")
    done = subprocess.run(["bash", str(tmp_path / "code")], capture_output=True, text=True)
    assert done.returncode == 0 and "antinode" in done.stdout, done.stderr
