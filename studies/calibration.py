"""pipeline/calibration.csv from the stored accuracy study: `python -m studies.calibration` after `antinode run accuracy`."""

from __future__ import annotations

import csv
import io
import json
import sys
from typing import Any

from pipeline.calibration import FIELDS, TABLE
from pipeline.house import RESULTS
from pipeline.records import read_study
from pipeline.store import BadRecord, write_atomic
from studies.accuracy import QUANTITIES, cases, references

KINDS = {"hex": "hex", "solid": "hex", "superelement": "hex", "tet": "tet", "superelement tet": "tet"}
SMALLEST_MM = {"zone": 4.0, "pillar": 2.0, "cell": 2.0, "plate": 2.0}  # of the reference design


def rows(records: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    """One row a part and mesh: the worst of its quantities."""
    known, found = references(records), dict[tuple[Any, ...], float]()
    for record in records:
        given, values = record["parameters"], record.get("values") or {}
        rung = given["rung"]
        if given["role"] != "rung" or rung["model"] not in KINDS or not values:
            continue
        asked = [name for name in QUANTITIES[given["part"]] if name in values and name in known]
        error = max(abs(values[name] / known[name][0] - 1.0) for name in asked)
        kind = KINDS[rung["model"]]
        across = SMALLEST_MM[given["part"]] / rung["size_mm"] if kind == "tet" else 0.0
        share = rung.get("share", 0.0)
        factor = rung.get("factor", 0.0)
        key = (given["part"], kind, rung["order"], int(rung.get("layers") or 0), factor, share, round(across, 2))
        if kind == "hex" and not share:
            continue  # no mesh of the planner's
        found[key] = error
    return [(*key, float(f"{error:.2g}")) for key, error in sorted(found.items())]


def text(records: list[dict[str, Any]]) -> str:
    """The table as CSV."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(FIELDS)
    writer.writerows(rows(records))
    return buffer.getvalue()


def _asked(name: str) -> Any:
    """The parameters that a stored case was computed with."""
    return json.loads((RESULTS / "accuracy" / name / "input.json").read_text(encoding="utf-8"))["parameters"]


def main() -> int:
    """Write the table, or say that the study was not run, or not as it stands."""
    try:
        stored = {case.case_id: case.record for case in read_study(RESULTS / "accuracy").cases}
    except BadRecord as fault:
        print(f"calibration: {fault}", file=sys.stderr)
        return 2
    records = [{"parameters": given, **stored.get(name, {})} for name, given in cases()]
    other = [name for name, given in cases() if name in stored and _asked(name) != json.loads(json.dumps(given))]
    if other:
        print(f"calibration: {other[0]} was computed with another mesh: run `antinode run accuracy`", file=sys.stderr)
        return 2
    write_atomic(TABLE, text(records).encode())
    print(f"calibration {TABLE}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
