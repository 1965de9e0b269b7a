"""The wanted mode followed along a sweep, from stored records: where it went, and where its identity is lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.records.study import StoredCase, StoredStudy
from pipeline.records.sweep_lines import lines_along, main_key
from solvers.measures.mode_tracking import Shapes, Step, follow


@dataclass(frozen=True)
class Followed:
    """One case of a line: the followed mode's frequency (None when lost), its MAC with the case before, and a word.

    identity: "start" (where the wanted mode is plainest), "kept", "crossed" (kept, but another mode looks more like the
    wanted one here), "lost".
    """

    frequency_hz: float | None
    mac: float | None
    identity: str


def along_sweep(study: StoredStudy) -> dict[str, Followed]:
    """Every case of a sweep by its id; {} where nothing numeric is swept or no shapes are stored."""
    cases = [case for case in study.cases if case.record.get("shapes")]
    key = main_key(study, cases) if len(cases) > 1 else None
    tracked: dict[str, Followed] = {}
    for line in lines_along(study, cases, key).values() if key else ():
        tracked |= _line(line)
    return tracked


def _line(line: list[StoredCase]) -> dict[str, Followed]:
    """From the case with the plainest wanted mode to both ends of the line."""
    start = max(range(len(line)), key=lambda i: line[i].wanted.get("share") or 0.0)
    first = line[start]
    tracked = {first.case_id: Followed(first.wanted["frequency_hz"], None, "start")}
    for choice in (line[start:], line[start::-1]):
        plates = [_shapes(case) for case in choice]
        steps = follow(plates, int(first.record["shapes"]["wanted"]))
        for number, case in enumerate(choice[1:]):
            tracked[case.case_id] = (
                _summary(steps[number], case) if number < len(steps) else Followed(None, None, "lost")
            )
    return tracked


def _summary(step: Step, case: StoredCase) -> Followed:
    if step.row is None or not step.kept:
        return Followed(None, step.mac, "lost")
    stored = case.record["shapes"]
    same = step.row == stored["wanted"]
    return Followed(stored["frequency_hz"][step.row], step.mac, "kept" if same else "crossed")


def _shapes(case: StoredCase) -> Shapes:
    stored = case.record["shapes"]
    return Shapes(*(np.array(stored[key], dtype=float) for key in ("frequency_hz", "share", "coefficients")))
