"""The wanted mode tracked along a sweep, from stored records: where it went, and where it is lost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.records.study import StoredCase, StoredStudy
from pipeline.records.sweep_lines import lines_along, main_key
from solvers.measures.correlation import Shapes, follow

Line = list[tuple[StoredCase, Any, Any]]


@dataclass(frozen=True)
class Tracked:
    """One case of a line: the tracked mode's frequency (None when lost), its MAC with the case before, and a word.

    tracking: "start" (where the wanted mode is plainest), "kept", "crossed" (kept, but another mode looks more like the
    wanted one here), "lost".
    """

    frequency_hz: float | None
    mac: float | None
    tracking: str


def along_sweep(study: StoredStudy) -> dict[str, Tracked]:
    """Every case of a sweep by its id; {} where nothing numeric is swept or no shapes are stored."""
    cases = [case for case in study.cases if case.record.held("shapes")]
    key = main_key(study, cases) if len(cases) > 1 else None
    tracked: dict[str, Tracked] = {}
    for line in lines_along(study, cases, key).values() if key else ():
        known = ((case, case.record.wanted, case.record.held("shapes")) for case in line)
        tracked |= _line([(case, wanted, shapes) for case, wanted, shapes in known if wanted and shapes])
    return tracked


def _line(line: Line) -> dict[str, Tracked]:
    """From the case with the plainest wanted mode to both ends of the line."""
    start = max(range(len(line)), key=lambda i: line[i][1].share or 0.0)
    first, wanted, shapes = line[start]
    tracked = {first.case_id: Tracked(wanted.frequency_hz, None, "start")}
    for choice in (line[start:], line[start::-1]):
        plates = [Shapes(*map(np.array, (s.frequency_hz, s.share, s.coefficients))) for _, _, s in choice]
        steps = follow(plates, shapes.wanted)
        for number, (case, _, stored) in enumerate(choice[1:]):
            step = steps[number] if number < len(steps) else None
            if step is None or step.row is None or not step.kept:
                tracked[case.case_id] = Tracked(None, step.mac if step else None, "lost")
            else:
                tracking = "kept" if step.row == stored.wanted else "crossed"
                tracked[case.case_id] = Tracked(stored.frequency_hz[step.row], step.mac, tracking)
    return tracked
