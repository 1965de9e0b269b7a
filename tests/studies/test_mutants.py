"""Small faults are planted, found by tests that run their lines, and mended again."""

from __future__ import annotations

import ast
import random
import shutil
from collections import Counter
from pathlib import Path

import pytest

from studies import mutants
from studies.faults import faults
from studies.mutants import of_folder

SOURCE = '''\
LIMIT = 1e-9


def spring(k: float, x: float, é: float) -> float:
    """Force - with an offset."""
    if x > LIMIT and k > 0.0:
        return -k * x + é
    return [k, x][0] ** 2


def unused(a: float) -> float:
    return 2.5 * a
'''
SOURCE_IN_C = """\
#define AN_HALF 0.5f /* a * b - c */

static const float table[2] = {1.0f, -2.0f};

float spring(float k, const float *x, bool held)
{
    AN_ASSERT(k > 0.0f && x[0] > 0.0f);
    float force = 0.0f; /* x + y */
    if (k > 1.0f && !held) {
        force = -k * x[0] + AN_HALF;
    }
    return force < k ? force : k;
}
"""
TEST = """\
from source import spring


def test_force():
    assert spring(2.0, 3.0, 0.5) == -5.5
    assert spring(2.0, 0.0, 0.5) == 4.0


def test_slow():
    assert sum(spring(2.0, 3.0, 0.5) for _ in range(300)) < 0.0


def test_broken():
    assert spring(2.0, 3.0, 0.5) == 0.0
"""


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one source, one file of tests, and this project behind it for the plugin."""
    (tmp_path / "source.py").write_text(SOURCE)
    (tmp_path / "test_source.py").write_text(TEST)
    (tmp_path / "studies").symlink_to(mutants.ROOT / "studies")
    (tmp_path / "pipeline").symlink_to(mutants.ROOT / "pipeline")
    return tmp_path


def test_every_fault_is_another_program() -> None:
    found = list(faults("source.py", SOURCE))
    kinds = Counter(fault.kind for fault in found)
    assert kinds == {
        "sign": 2, "dropped term": 1, "dropped power": 1, "comparison": 2, "guard": 1, "index": 1, "tolerance": 1,
        "dropped factor": 1, "factor": 1,
    }  # fmt: skip
    for fault in found:
        assert SOURCE[slice(*fault.span)] == fault.before
        assert ast.dump(ast.parse(fault.planted(SOURCE))) != ast.dump(ast.parse(SOURCE))
    by = {(fault.kind, fault.before): fault for fault in found}
    assert by["sign", "-k * x + é"].after == "(-k * x - é)" and by["sign", "-k * x + é"].lines == (7,)
    assert by["comparison", "x > LIMIT"].after == "(x >= LIMIT)"
    assert by["index", "[k, x][0]"].after == "([k, x][1])"
    assert by["tolerance", "1e-9"].lines == (6,)  # where it is used


def test_every_fault_in_c_is_in_a_function_and_no_assertion() -> None:
    found = list(faults("source.c", SOURCE_IN_C))
    assert Counter((fault.kind, fault.lines) for fault in found) == {
        ("sign", (10,)): 2, ("dropped factor", (10,)): 1, ("dropped statement", (10,)): 1, ("index", (10,)): 1,
        ("comparison", (9,)): 1, ("guard", (9,)): 2, ("factor", (9,)): 1, ("factor", (10,)): 1,
    }  # fmt: skip
    planted = {fault.planted(SOURCE_IN_C) for fault in found}
    assert len(planted) == len(found) and SOURCE_IN_C not in planted
    assert any("force = k * x[0] + AN_HALF;" in text for text in planted)


@pytest.mark.slow
def test_faults_in_c_are_judged_by_files_of_tests(tmp_path: Path) -> None:
    """A wrong sign in the sine is seen, a comparison of equal values is none, and a name that is not there no fault."""
    if not shutil.which("gcov") or not shutil.which("gcc"):
        pytest.skip("gcc and gcov are not installed: they count")
    folder, path = mutants.copied(tmp_path / "copy"), "firmware/core/an_sine.c"
    known = mutants.recorded_in_c(folder, ["tests/firmware/test_sine.py"])
    assert list(known) == ["tests/firmware/test_sine.py"] and known["tests/firmware/test_sine.py"]["lines"][path]
    text = (folder / path).read_text()
    own = [fault for fault in faults(path, text) if fault.kind == "sign"]
    fault = random.Random(1).choice(own)
    assert mutants.judged(fault, folder, known, 60.0) == mutants.KILLED
    broken = type(fault)(path, "sign", fault.span, fault.before, " nothing ", fault.lines)
    assert mutants.judged(broken, folder, known, 60.0) == mutants.NONE
    assert (folder / path).read_text() == text


@pytest.mark.slow
def test_faults_are_judged_by_the_tests_that_run_them(checkout: Path) -> None:
    known = mutants.recorded(checkout, ["test_source.py"])
    assert {name.partition("::")[2] for name in known} == {"test_force", "test_slow"}, "a test that fails counts"
    verdicts = {
        (fault.kind, fault.before): mutants.judged(fault, checkout, known, 60.0)
        for fault in faults("source.py", SOURCE)
    }
    assert verdicts["sign", "-k * x + é"] == verdicts["index", "[k, x][0]"] == mutants.KILLED
    assert verdicts["tolerance", "1e-9"] == verdicts["comparison", "k > 0.0"] == mutants.SURVIVED
    assert (checkout / "source.py").read_text() == SOURCE
    unused = next(fault for fault in faults("source.py", SOURCE.replace("2.5 * a", "a - 2.5")) if fault.lines == (12,))
    assert mutants.chosen_tests(unused, known, 60.0) == []
    assert mutants.judged(unused, checkout, known, 60.0) == mutants.UNSEEN


def test_the_quickest_tests_are_chosen_first() -> None:
    fault = next(iter(faults("source.py", SOURCE)))
    known = {
        name: {"seconds": s, "lines": {"source.py": list(fault.lines)}}
        for name, s in (("c", 9.0), ("a", 1.0), ("b", 2.0))
    }
    assert mutants.chosen_tests(fault, known, 5.0) == ["a", "b"]
    assert mutants.chosen_tests(fault, known, 0.5) == ["a"]  # one at least


def test_the_command_draws_by_its_seed_and_scores(
    checkout: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(mutants, "ROOT", checkout)
    monkeypatch.setattr(mutants, "copied", lambda target: checkout)
    drawn = []
    monkeypatch.setattr(mutants, "recorded", lambda folder, tests: {"one": {}})
    monkeypatch.setattr(mutants, "judged", lambda fault, *rest: drawn.append(str(fault)) or mutants.SURVIVED)
    monkeypatch.setattr(mutants, "of_folder", lambda root, name: list(faults("solvers/source.py", SOURCE)))
    assert mutants.main(["--folders", "solvers", "--count", "3", "--seed", "5"]) == 0
    printed = capsys.readouterr().out
    assert (
        "seed 5" in printed and "0 of 3 killed (0%), 3 survived" in printed and all(each in printed for each in drawn)
    )
    first, drawn[:] = drawn[:], []
    assert mutants.main(["--folders", "solvers", "--count", "3", "--seed", "5"]) == 0 and drawn == first
    assert (
        mutants.place("pipeline/case/model.py") == "pipeline/case"
        and mutants.place("solvers/fem/eigen.py") == "solvers"
    )


def test_a_file_is_a_folder_of_one_and_no_source_is_refused(checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert of_folder(checkout, "source.py") == list(faults("source.py", SOURCE))
    with pytest.raises(SystemExit):
        mutants.main(["--folders", "nowhere"])
    assert "no source with a fault to plant in nowhere" in capsys.readouterr().err
