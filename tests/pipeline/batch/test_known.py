"""Where results of a study lie, and that its name is known afterwards from any folder."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from pipeline import paths
from pipeline.batch import study_file
from pipeline.batch.study_file import find_study
from pipeline.cli.main import main

ROOT = Path(__file__).resolve().parents[3]
SWEPT = '[sweep]\n"solve.accuracy" = [0.1]\n"bands.points" = [1]\n'
STUDY = f'[study]\nname = "mine"\ncase = "small.toml"\nmeasure = ["bands"]\n{SWEPT}'


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("ANTINODE_RESULTS", raising=False)
    return tmp_path


def test_the_checkouts_studies_keep_to_the_checkout_and_others_to_their_own_folder(
    state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert study_file.folder_of("rows", ROOT / "studies" / "rows.toml") == paths.RESULTS / "rows"
    assert study_file.folder_of("mine", state / "mine.toml") == state / "results" / "mine"
    assert (
        study_file.folder_of("rows", ROOT / "studies" / "rows.toml", str(state / "there")) == state / "there" / "rows"
    )
    monkeypatch.setenv("ANTINODE_RESULTS", str(state / "said"))
    monkeypatch.setattr(paths, "RESULTS", state / "said")
    assert study_file.folder_of("mine", state / "mine.toml") == state / "said" / "mine"


def test_a_study_is_remembered_while_file_and_results_are_there(state: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, folder = state / "mine.toml", state / "far" / "mine"
    folder.mkdir(parents=True)
    source.write_text(STUDY)
    study_file.remember_place("mine", source, folder)
    assert study_file.known_places() == {"mine": (source, folder)} and find_study("mine") == source
    assert study_file.folder_of("mine", source) == folder  # --results has to be said once
    assert (
        study_file.folder_of("mine", state / "other" / "mine.toml") == state / "other" / "results" / "mine"
    )  # another of that name
    with monkeypatch.context() as elsewhere:  # where new results would go is not where these lie
        elsewhere.setenv("ANTINODE_RESULTS", str(state / "said"))
        elsewhere.setattr(paths, "RESULTS", state / "said")
        assert study_file.stored_folder("mine", source) == folder
        (state / "said" / "mine").mkdir(parents=True)
        assert study_file.stored_folder("mine", source) == state / "said" / "mine"
    shutil.rmtree(folder)
    assert study_file.known_places() == {}


def test_a_study_of_ones_own_is_remembered_wherever_results_go_by_default(
    state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As under ANTINODE_RESULTS, and of a wheel in the folder where it is called: the checkout's own need no note there."""
    monkeypatch.setattr(paths, "RESULTS", state / "said")
    (state / "said" / "mine").mkdir(parents=True)
    (state / "mine.toml").write_text(STUDY)
    study_file.remember_place("mine", state / "mine.toml", state / "said" / "mine")
    study_file.remember_place("rows", ROOT / "studies" / "rows.toml", state / "said" / "rows")
    assert find_study("mine") == state / "mine.toml" and set(study_file.known_places()) == {"mine"}


@pytest.mark.parametrize("text", ["", "[]", "{", '{"mine": 3}', '{"mine": ["a"]}'])
def test_a_broken_note_is_no_note(text: str, state: Path) -> None:
    (state / "state" / "antinode").mkdir(parents=True)
    (state / "state" / "antinode" / "studies.json").write_text(text)
    assert study_file.known_places() == {}


def test_a_state_folder_that_cannot_be_written_is_a_warning(state: Path) -> None:
    (state / "state" / "antinode" / "studies.json").mkdir(parents=True)
    (state / "mine.toml").write_text(STUDY)
    warning = study_file.remember_place("mine", state / "mine.toml", state / "results" / "mine")
    assert warning and "studies.json" in warning and "'mine'" in warning
    assert study_file.known_places() == {}


def test_a_note_nested_without_end_is_no_note(state: Path) -> None:
    (state / "state" / "antinode").mkdir(parents=True)
    (state / "state" / "antinode" / "studies.json").write_text("[" * 100_000)
    assert study_file.known_places() == {}


@pytest.mark.slow
def test_a_study_of_ones_own_is_run_here_and_asked_for_from_elsewhere(
    state: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here, elsewhere = state / "here", state / "elsewhere"
    here.mkdir()
    elsewhere.mkdir()
    shutil.copy(ROOT / "examples" / "small.toml", here)
    (here / "mine.toml").write_text(STUDY)

    def antinode(folder: Path, *words: str) -> str:
        monkeypatch.chdir(folder)
        assert main([*words]) == 0
        return capsys.readouterr().out

    antinode(here, "run", "mine.toml", "--jobs", "1", "--quiet")
    page = here / "results" / "mine" / "report.html"
    assert page.is_file()
    page.unlink()
    assert str(page) in antinode(elsewhere, "report", "mine") and page.is_file()
    assert "mine" in [each["study"] for each in json.loads(antinode(elsewhere, "list", "--json", "-"))["studies"]]
