"""Which case, which step, time left: a live display on a terminal, a line now and then elsewhere, silence if asked."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from pipeline.records.run_log import current_step
from pipeline.records.store import RUN_LOG

if TYPE_CHECKING:
    from pipeline.batch.job import Planned

HEARTBEAT_S = 30.0
LOOK_S = 1.0  # between two looks at which cases have begun
LONGER = 1.2  # times what it took before: less is as usual
MAX_NAMED = 4
MAX_REASONS = 8
EXPECTED = {"new", "not finished before", "forced"}


class Progress:
    """Progress of a study on standard error."""

    def __init__(self, quiet: bool = False, stream: TextIO | None = None) -> None:
        self.quiet = quiet
        self.stream = stream or sys.stderr
        self._live: Any = None
        self._task: Any = None
        self._running: dict[str, int | None] = {}  # handed out, with the time of the log that an earlier run left
        self._begun: dict[str, float] = {}  # when their own log appeared: a case may wait for a worker before
        self._looked = 0.0
        self._known: dict[str, float] = {}
        self._left: set[str] = set()
        self._folder = Path()
        self._total = self._done = 0
        self._spoke = self._began = time.monotonic()
        self._spent: list[float] = []

    def begin(self, folder: Path, planned: Sequence[Planned], known_seconds: dict[str, float]) -> None:
        """Start the display; `known_seconds` are durations of earlier runs."""
        todo = [item.case_id for item in planned if item.why is not None]
        self._folder, self._total, self._known, self._left = folder, len(todo), known_seconds, set(todo)
        self._began = self._spoke = time.monotonic()
        if self.quiet:
            return
        reused = len(planned) - len(todo)
        kept = f", {reused} already computed" if reused else ""
        self.say(f"{folder}: {len(planned)} case{'s' * (len(planned) != 1)}{kept}, {len(todo)} to compute")
        again = [item for item in planned if item.why and item.why not in EXPECTED]
        for item in again[:MAX_REASONS]:
            self.say(f"{item.case_id}: computed again, {item.why}")
        if len(again) > MAX_REASONS:
            self.say(f"and {len(again) - MAX_REASONS} more (antinode run --dry-run tells why)")
        if todo and self.stream.isatty():
            self._open_live()

    def _open_live(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as Bar

        columns = (BarColumn(bar_width=24), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
        self._live = Bar(*columns, console=Console(file=self.stream), transient=True)
        self._task = self._live.add_task("", total=self._total)
        self._live.start()

    def say(self, text: str) -> None:
        """One line for the reader."""
        if self.quiet:
            return
        if self._live:
            self._live.console.print(text, markup=False, highlight=False)
        else:
            print(text, file=self.stream, flush=True)
        self._spoke = time.monotonic()

    def case_started(self, case_id: str) -> None:
        """A case went to a worker."""
        self._running[case_id] = self._log_time(case_id)
        if not self._live:
            self.say(f"{case_id}: started")

    def case_ended(self, case_id: str, status: str, diagnosis: str, seconds: float) -> None:
        """A case ended."""
        self._running.pop(case_id, None)
        self._begun.pop(case_id, None)
        self._left.discard(case_id)
        self._done += 1
        if status != "FAILED":
            self._spent.append(seconds)
        left = f"; {self.time_left()}" if self._left else ""
        self.say(f"[{self._done}/{self._total}] {case_id}: {status}, {seconds:.1f} s, {diagnosis}{left}")
        if self._live:
            self._live.update(self._task, completed=self._done)

    def tick(self) -> None:
        """Called a few times a second."""
        if self.quiet or not self._running:
            return
        self._look()
        if self._live:
            self._live.update(self._task, description=self._now())
        elif time.monotonic() - self._spoke > HEARTBEAT_S:
            self.say(f"[{self._done}/{self._total}] {self._now()}")

    def end(self) -> None:
        """Close the display."""
        if self._live:
            self._live.stop()
            self._live = None

    def _now(self) -> str:
        first = sorted(self._running, key=lambda case_id: case_id not in self._begun)[:MAX_NAMED]
        logs = {case_id: self._folder / case_id / RUN_LOG for case_id in first}
        steps = {case_id: current_step(logs[case_id]) if case_id in self._begun else "" for case_id in first}
        at_work = [f"{case_id} ({step or 'starting'})" for case_id, step in steps.items()]
        if len(self._running) > len(first):
            at_work.append(f"and {len(self._running) - len(first)} more")
        return f"{', '.join(at_work)}; {self.time_left()}"

    def _log_time(self, case_id: str) -> int | None:
        with suppress(OSError):
            return (self._folder / case_id / RUN_LOG).stat().st_mtime_ns
        return None

    def _look(self) -> None:
        """See which cases have begun by now."""
        now = time.monotonic()
        if now - self._looked < LOOK_S:
            return
        self._looked = now
        for case_id, earlier in self._running.items():
            if case_id not in self._begun and self._log_time(case_id) != earlier:
                self._begun[case_id] = now

    def time_left(self) -> str:
        """Rough remaining time: earlier durations where known, else the mean of this run's cases, less what was computed."""
        mean = sum(self._spent) / len(self._spent) if self._spent else None
        guesses = [self._known.get(case_id, mean) for case_id in self._left]
        if not guesses or any(guess is None for guess in guesses):
            return "time left not known yet"
        spent = {case_id: time.monotonic() - start for case_id, start in self._begun.items()}
        usual = {case_id: self._known.get(case_id, mean or 0.0) for case_id in self._left}
        remaining_s = sum(max(0.0, usual[case_id] - spent.get(case_id, 0.0)) for case_id in usual)
        if remaining_s <= 0.0:
            late = any(seconds > LONGER * usual.get(case_id, 0.0) for case_id, seconds in spent.items())
            return "taking longer than the cases before" if late else "about to end"
        return f"about {_duration(remaining_s / max(1, len(self._begun)))} left"


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    return f"{round(seconds / 60)} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
