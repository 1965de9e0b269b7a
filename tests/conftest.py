"""What every test may rely on."""

from __future__ import annotations

import gc
import os
import signal
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from pipeline.workers import limit_threads

LONGEST = """
    test_offline_model test_six test_report test_touch test_active test_docstrings test_one_table test_forced test_explore
    test_runner test_lattice test_plan test_search test_tutorials test_hybrid test_bands test_extremes test_resource_estimate
    test_new_and_compare test_line test_travel test_free_blocks test_target_mode test_emulated_board test_column
""".split()  # noqa: SIM905 five seconds and more, not a line each

UNTIL = float(os.environ.get("SLOW_UNTIL") or "inf")  # make slow UNTIL=: seconds since the epoch

if "PYTEST_XDIST_WORKER" in os.environ:  # a worker a core: their libraries' own threads would wait for each other
    limit_threads(1)


def pytest_configure() -> None:
    """Ctrl-C is heard: a shell's background job starts with it ignored, and so would every process started here.

    Nothing that imports and collecting make is garbage: it is not searched for.
    """
    gc.disable()
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first: whoever gets one last would work alone at the end."""
    items.sort(key=lambda item: LONGEST.index(item.path.stem) if item.path.stem in LONGEST else len(LONGEST))


def pytest_collection_finish() -> None:
    """What was imported stays: the search for garbage leaves it out, and comes less often."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(20_000, 20, 20)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """No proof is begun after the time that its run has."""
    if time.time() > UNTIL:
        pytest.skip("the time of this run was up")


@pytest.fixture(scope="session", autouse=True)
def no_study_is_remembered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Names of studies that tests run are not left in the user's own state folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@contextmanager
def _coarsest(folder: Path) -> Iterator[None]:
    from pipeline.search.fidelity import EvaluationCache
    from tests.helpers import coarse_cells

    with pytest.MonkeyPatch.context() as patch:
        coarse_cells.mesh_coarsest(patch)
        patch.setattr(EvaluationCache.__init__, "__defaults__", (folder,))
        yield


@pytest.fixture(scope="module")
def coarsest_cells(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Plates and cells on the fewest elements, for the rest of a module whose assertions hold on any mesh.

    Designs that a search evaluated on them are kept for no later search.
    """
    with _coarsest(tmp_path_factory.mktemp("evaluations")):
        yield


@pytest.fixture
def coarsest_here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The same for one test of a module whose others need error bars, which the fewest elements have not."""
    with _coarsest(tmp_path_factory.mktemp("evaluations")):
        yield


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """One line tells how many tests this machine cannot run, and why."""
    skipped = terminalreporter.stats.get("skipped", ())
    reasons = Counter(str(report.longrepr[-1]).removeprefix("Skipped: ") for report in skipped)
    if reasons:
        summary = "; ".join(f"{count} ({reason})" for reason, count in reasons.most_common())
        terminalreporter.write_line(f"{len(skipped)} tests were skipped: {summary}")


@pytest.fixture
def analysed(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Entries of each matrix whose pattern rslab analyses from now on."""
    from solvers.fem import factor

    entries: list[int] = []
    analyse = factor._analysed

    def noted(matrix: Any) -> Any:
        entries.append(matrix.nnz)
        return analyse(matrix)

    monkeypatch.setattr(factor, "_analysed", noted)
    return entries
