"""Study without physics, to test the batch machinery, as a module and as a script."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

from pipeline.batch import runner
from pipeline.batch.runner import Progress, StudyBusy
from pipeline.process import terminable
from pipeline.records import store
from solvers.errors import SolverError
from tests.helpers import synthetic


def compute(payload, folder, log):
    """Write arrays slowly; end according to the payload's fate."""
    with (folder.parent / "starts.txt").open("a") as file:
        file.write(f"{folder.name}\n")
    fate = payload.get("fate", "ok")
    with log.step("mesh"):
        time.sleep(payload["seconds"] / 2)
        if fate == "raise":
            raise SolverError("no count by inertia at 31 kHz; try another band")
        if fate == "bug":
            raise KeyError("nobody expected this")
        if fate == "memory":
            raise MemoryError
        if fate == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if fate == "full":
            raise store.DiskFull(f"{folder}: no space left")
        if fate == "alarm":
            log.warning("MESH_1", "a thin element")
    log.left_out("patches", "the case has none")
    with log.step("solve"):
        values = np.random.default_rng(payload["value"]).normal(size=1000)
        store.save_arrays(folder, {"values": values})
        time.sleep(payload["seconds"] / 2)
    target = synthetic.target(12.0, 30e3 + float(values.sum()))
    return {"modes": synthetic.modes(target, dof=values.size), "threads": os.environ["OMP_NUM_THREADS"]}


def signals_held_back():
    """Names of the signals that this process ignores."""
    return {clamped.name for clamped in signal.pthread_sigmask(signal.SIG_BLOCK, [])}


class TwoWords(Exception):
    """Exception that cannot be unpickled, because Exception keeps only one of its arguments."""

    def __init__(self, one: str, other: str) -> None:
        super().__init__(f"{one} {other}")


def raises_what_cannot_be_loaded():
    raise TwoWords("one", "other")


def journal(folder):
    """Entries of a study's journal."""
    return [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]


def jobs(count, seconds=0.02, fates=None):
    """`count` cases, some with a fate of their own by index."""
    fates = fates or {}
    inputs = [{"name": f"c{i}", "value": i, "seconds": seconds, "fate": fates.get(i, "ok")} for i in range(count)]
    return [runner.Job(f"value={i}", payload, {"value": i}) for i, payload in enumerate(inputs)]


def main() -> int:
    """Run the study like `antinode run`."""
    from pipeline.questions import study as asked  # its measures load scipy, which no worker here needs

    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=0.1)
    parser.add_argument("--first", type=float, help="seconds of the first case, when they differ")
    args = parser.parse_args()
    try:
        todo = jobs(args.cases, args.seconds)
        if args.first is not None:
            todo[0].payload["seconds"] = args.first
        with terminable():
            outcome = runner.run_study(todo, compute, args.folder, runner.Options(jobs=2), Progress())
    except KeyboardInterrupt:
        return 130
    except StudyBusy as error:
        print(error, file=sys.stderr)
        return 2
    asked.write_table(args.folder)
    return outcome.exit_code


if __name__ == "__main__":
    from tests.helpers import fake_study  # workers import the module by its name

    sys.exit(fake_study.main())
