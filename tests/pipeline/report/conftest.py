"""Pages are built in the tests' own process: others would prove nothing of a page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from typing import Any

import pytest


class Here(Executor):
    """Does in this process at once what it is given; `antinode run` draws in processes of their own in tests of the runner."""

    def __init__(self, count: int, threads: int) -> None:
        assert count >= 1 and threads == 1

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(function(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@pytest.fixture(autouse=True, scope="module")
def drawn_here() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.workers.LocalWorkers", Here)
        yield
