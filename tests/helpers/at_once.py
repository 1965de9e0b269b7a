"""What other processes would do, done in the test's own: they would prove nothing of pages and tables."""

from __future__ import annotations

import io
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import pytest

from antinode import sweeps
from pipeline.batch import runner


class AtOnce(Executor):
    """Does at once what it is given; `antinode run` uses processes in tests of the runner."""

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def sweep_here(patch: pytest.MonkeyPatch) -> None:
    """Sweeps of `import antinode` on this process' meshes; else they start others."""

    def computed(place: Path, jobs: int | None, quiet: bool) -> list[str]:
        with redirect_stdout(io.StringIO()) as said:
            sweeps.main([str(place), str(jobs or 0), "--quiet"])
        return said.getvalue().splitlines()

    patch.setattr(runner, "_local", lambda count: AtOnce())
    patch.setattr(sweeps, "_computed", computed)
