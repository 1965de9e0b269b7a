"""Examples in the docstrings of `import antinode`: run, and there for every public name and computation with its result."""

from __future__ import annotations

import doctest
import inspect
import re
import shutil
from importlib import import_module
from pathlib import Path

import pytest

import antinode
from antinode import ANSWERS
from pipeline.models import parametric
from pipeline.models.parametric import CellModel
from pipeline.questions import registered
from tests.helpers.exploring import small_explorer

ROOT = Path(__file__).resolve().parents[2]
HOMES = [*(f"antinode.{name}" for name in ("plate", "sweeps")),
         *sorted({each.__module__ for each in registered().values()}),
         "pipeline.case.schema", "pipeline.models.answer_parts",
         "pipeline.records.outputs", "pipeline.errors", "solvers.errors"]  # fmt: skip
NAMES = sorted(set(antinode.__all__) - {"__version__"})
COMPUTATIONS = [name for name, each in inspect.getmembers(antinode.Plate, inspect.isfunction) if name[0] != "_"]
SLOW = {  # a second and more, run by `make slow`
    "antinode.sweeps.sweep",
    *(f"antinode.plate.Plate.{name}"
      for name in ("explore", "export", "view")),
    *(f"pipeline.questions.{name.lower()}.{name}" for name in ("Crosstalk", "Drift", "Hybrid", "Touch", "Travel")),
    *(f"pipeline.questions.active.Active{name}" for name in ("Beam", "Shaping")),
    "pipeline.questions.tolerance.Tolerance",
    "pipeline.questions.tolerance.AlikeTolerance",
    *(f"pipeline.questions.response.{name}Response" for name in ("", "Measured", "Synthetic")),
    "pipeline.questions.response.ResponseResult.to_pyvista",
}  # fmt: skip


def outcome(module: str, slow: bool) -> doctest.TestResults:
    """How many of a module's examples ran and failed, each with nothing but what it imports; without `slow` the quick ones."""
    runner = doctest.DocTestRunner(verbose=False)
    for test in doctest.DocTestFinder().find(import_module(module), globs={}):
        if slow or test.name not in SLOW:
            runner.run(test)
    return runner.summarize(verbose=False)


@pytest.fixture
def examples_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with nothing but `examples/`, as the tutorials begin with."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)


def has_a_result(thing: object) -> bool:
    """Whether an example of its docstring shows what comes out, other than a refusal."""
    examples = doctest.DocTestParser().get_examples(inspect.getdoc(thing) or "")
    return any(each.want and each.exc_msg is None for each in examples)


@pytest.fixture(scope="module")
def small_model(tmp_path_factory: pytest.TempPathFactory) -> CellModel:
    return small_explorer(tmp_path_factory.mktemp("model")).model


@pytest.mark.slow
@pytest.mark.parametrize("module", HOMES)
@pytest.mark.filterwarnings("ignore::antinode.AntinodeWarning")
def test_quick_examples_hold_on_coarse_plates(module: str, coarsest_here: None, examples_alone: None) -> None:
    done = outcome(module, slow=False)
    assert done.attempted and not done.failed


@pytest.mark.slow
@pytest.mark.parametrize("module", HOMES)
@pytest.mark.filterwarnings("ignore::antinode.AntinodeWarning")
def test_every_example_holds_as_its_reader_runs_it(
    module: str, small_model: CellModel, examples_alone: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for the explorer's model, which takes minutes: a small one stands in."""
    monkeypatch.setattr(parametric, "cell_model", lambda case, log, offline: small_model)
    done = outcome(module, slow=True)
    assert done.attempted and not done.failed


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_has_an_example_with_its_result(name: str) -> None:
    thing = getattr(antinode, name)
    assert thing.__module__ in HOMES and has_a_result(thing)


@pytest.mark.parametrize("name", COMPUTATIONS)
def test_every_computation_of_a_plate_has_an_example_with_its_result_and_names_its_units(name: str) -> None:
    method = getattr(antinode.Plate, name)
    assert has_a_result(method) and re.search(r"Hz|dB|mm|units|keys", inspect.getdoc(method) or "")


@pytest.mark.parametrize("name", ANSWERS)
def test_every_property_of_a_result_says_what_it_holds(name: str) -> None:
    held = inspect.getmembers(getattr(antinode, name), lambda each: isinstance(each, property))
    assert not [each for each, own in held if each[0] != "_" and own.__doc__ in (None, "", type(own).__doc__)]


@pytest.mark.parametrize("module", HOMES)
def test_help_shows_examples_without_the_tests_own_marks(module: str) -> None:
    tests = doctest.DocTestFinder().find(import_module(module))
    assert not [test.name for test in tests if "doctest:" in (test.docstring or "")]


def test_every_slow_example_is_there() -> None:
    tests = [test for module in HOMES for test in doctest.DocTestFinder().find(import_module(module))]
    assert {test.name for test in tests if test.examples} >= SLOW


def test_a_refusal_or_a_lone_call_is_no_result() -> None:
    def refused() -> None:
        """Refuse.

        >>> one = 1
        >>> one / 0
        Traceback (most recent call last):
        ...
        ZeroDivisionError: division by zero
        """

    assert not has_a_result(refused)
