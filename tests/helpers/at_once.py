"""What other processes would do, done in the test's own: they would prove nothing of pages and tables."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

import pytest

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
    """Sweeps of `import antinode` on this process' meshes; else workers compute them."""
    patch.setattr(runner, "_local", lambda count: AtOnce())
