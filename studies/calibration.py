"""The calibration.csv from the stored accuracy study: `python -m studies.calibration` after `antinode run accuracy`."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from math import floor
from typing import Any

from pipeline.paths import RESULTS
from pipeline.planning import mesh_rules
from pipeline.records import store
from pipeline.records.outputs import csv_bytes
from pipeline.records.store import BadRecord, write_atomic
from pipeline.records.study import read_study
from solvers.accuracy.calibration import FIELDS, MIXING, TABLE
from studies import ladder
from studies.accuracy import CONFINEMENT, QUANTITIES, cases, references

KINDS = {"hex": "hex", "solid": "hex", "superelement": "hex", "tet": "tet", "superelement tet": "tet"}
ANALYTIC = "analytic"
FIRST = 1.0  # growth of what a part's error counts from
NO_MESH = (0, 0, 0.0, 0.0, 0, 0.0, FIRST)
SMALLEST_MM = {"zone": 4.0, "pillar": 2.0, "cell": 2.0, "plate": 2.0}  # of the reference design


def rows(records: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    """One row a part, mesh and growth: the worst of its quantities; of a theory the first one."""
    known, worst = references(records), dict[tuple[Any, ...], float]()
    for record in records:
        given, values = record["parameters"], record.get("values") or {}
        if given["role"] == "mesh_level" and given["mesh_level"]["model"] != ladder.EXTRAPOLATED and values:
            for key, error in _errors(given["part"], given["mesh_level"], values, known):
                worst[key] = max(error, worst.get(key, 0.0))
    share = _mixing(records, known)
    if share:
        worst[("plate", MIXING, *NO_MESH)] = share
    return [(*key, float(f"{error:.2g}")) for key, error in sorted(worst.items())]


def _errors(
    part: str, mesh: dict[str, Any], values: dict[str, float], known: dict[str, tuple[float, float]]
) -> Iterator[tuple[tuple[Any, ...], float]]:
    """Keys and errors of one mesh; none of hexahedra that the planner does not choose."""
    names = [name for name in QUANTITIES[part] if name in values and name in known]
    errors = {name: abs(values[name] / known[name][0] - 1.0) for name in names}
    if mesh["model"] == ANALYTIC:
        yield (part, mesh["theory"], *NO_MESH), errors[names[0]]
        return
    whole = (part, mesh["model"]) == ("plate", "solid")
    kind, share, layers = KINDS[mesh["model"]], mesh.get("share", 0.0), int(mesh.get("layers") or 0)
    across = SMALLEST_MM[part] / mesh["size_mm"] if kind == "tet" else 0.0
    element = ("whole" if whole else part, kind, mesh["order"], layers, mesh.get("factor", 0.0))
    key = (*element, share, mesh.get("through", 0), round(across, 2))
    for quantity, error in errors.items():
        if kind == "hex" and share:
            yield (*key, growth(quantity, known[quantity][0])), error
        elif kind == "tet" and not ladder.ZONE.get(quantity):
            yield (*key, FIRST), error


def growth(quantity: str, reference_hz: float) -> float:
    """A zone's mode over the frequency up to which the planner calls its mesh good, rounded down; 1 for other parts."""
    if quantity not in ladder.ZONE:
        return FIRST
    return floor(100.0 * reference_hz / mesh_rules.good_to_hz("zone", ladder.design())) / 100.0


def _mixing(records: list[dict[str, Any]], known: dict[str, tuple[float, float]]) -> float:
    """The largest change of a confinement by whole meshes over what their error of the frequency may bring at most."""
    shares = [0.0]
    for record in records:
        given, values = record["parameters"], record.get("values") or {}
        whole = given["role"] == "mesh_level" and given["mesh_level"]["model"] == "solid" and "mixing (dB)" in values
        if whole and {CONFINEMENT, "plate"} <= known.keys():
            error = abs(values["plate"] / known["plate"][0] - 1.0)
            shares.append(abs(values[CONFINEMENT] - known[CONFINEMENT][0]) / (values["mixing (dB)"] * error))
    return max(shares)


def _query(name: str) -> Any:
    """The parameters that a stored case was computed with."""
    return store.read_listed(RESULTS / "accuracy" / name, store.INPUT)["parameters"]


def main() -> int:
    """Write the table, or say that the study was not run, or not as it stands."""
    try:
        stored = {case.case_id: case.record.other for case in read_study(RESULTS / "accuracy").cases}
        other = [name for name, given in cases() if name in stored and _query(name) != json.loads(json.dumps(given))]
    except BadRecord as fault:
        print(f"calibration: {fault}", file=sys.stderr)
        return 2
    records = [{"parameters": given, **stored.get(name, {})} for name, given in cases()]
    if other:
        print(f"calibration: {other[0]} was computed with another mesh: run `antinode run accuracy`", file=sys.stderr)
        return 2
    write_atomic(TABLE, csv_bytes(FIELDS, rows(records)))
    print(f"calibration {TABLE}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
