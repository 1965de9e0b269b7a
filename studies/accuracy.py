"""Error against run time and memory, every model and mesh of the ladder against a finer reference; calibration.csv."""

from __future__ import annotations

import json
import statistics
import sys
import time
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import cache, partial
from itertools import product
from math import floor
from pathlib import Path
from typing import Any

import numpy as np

from geometry.errors import GeometryError, MeshError
from pipeline.logs import RunLog
from pipeline.paths import RESULTS
from pipeline.planning import mesh_rules
from pipeline.plots import style
from pipeline.records import store
from pipeline.records.outputs import csv_bytes
from pipeline.records.store import BadRecord, write_atomic
from pipeline.records.study import read_study
from pipeline.report.html import Page, Section, Table
from solvers import machine
from solvers.accuracy.calibration import FIELDS, MIXING, TABLE
from solvers.errors import SolverError
from studies import ladder

TITLE = "Error against run time"

LEAD = (
    "Parts of the reference design (zone between clamped sides, isolated pillar, cell, plate of one row with a margin of "
    "5 mm), computed with every model, element and order: relative error against a finer computation, wall time (median "
    "of repeats, one process, two threads, including meshing) and peak memory."
)

REPEAT_BELOW_S = 3.0

ENVELOPE = (
    "Time of each mesh that `solve.accuracy` may choose, divided by that of the fastest model that is at least as accurate. "
    "A ratio of 1 lies on the lower envelope of the pictures. Errors below the reference's uncertainty mean little. The "
    "meshes of the zone are chosen for the mode (0, N); its higher modes show how the error grows with frequency."
)

CONFINEMENT = "confinement (dB)"
LINES = {"superelement": "--", ladder.EXTRAPOLATED: ":"}
CHOSEN = "what solve.accuracy may choose"
TARGETS = (0.03, 0.01, 0.003, 0.001)

QUANTITIES = {
    "zone": tuple(ladder.ZONE),
    "pillar": ("pillar", "second bending", "third bending"),
    "cell": ("bending at M", "bending at G", "first at X", "gap lower edge", "gap upper edge"),
    "plate": ("plate",),
}

NAMES = {
    "zone": "Zone, (0, N)",
    "zone two lines up": "Zone, (0, N + 2)",
    "zone four lines up": "Zone, (0, N + 4)",
    "pillar": "Pillar, first bending",
    "second bending": "Pillar, second bending",
    "third bending": "Pillar, third bending",
    "plate": "Plate, target mode",
    "bending at M": "Cell, bending at M",
    "bending at G": "Cell, bands 4 and 5 at Γ",
    "first at X": "Cell, first band at X",
    "gap lower edge": "Cell, lower gap edge (M)",
    "gap upper edge": "Cell, upper gap edge (Γ)",
}

MESHES = Path(__file__).parent / "data" / "accuracy-meshes.toml"

KINDS = {"hex": "hex", "solid": "hex", "superelement": "hex", "tet": "tet", "superelement tet": "tet"}
ANALYTIC = "analytic"
FIRST = 1.0  # growth of what a part's error counts from
NO_MESH = (0, 0, 0.0, 0.0, 0, 0.0, FIRST)
SMALLEST_MM = {"zone": 4.0, "pillar": 2.0, "cell": 2.0, "plate": 2.0}  # of the reference design


def mesh_levels() -> dict[str, list[dict[str, Any]]]:
    """What is measured, part by part, the cheap ones first."""
    return _meshes()["measured"]


def cases() -> list[tuple[str, dict[str, Any]]]:
    """References first, then every mesh level."""
    listed = [
        (f"reference,{part},{level}", {"part": part, "mesh_level": mesh_level, "role": "reference", "level": level})
        for part, given in _meshes()["references"].items()
        for level, mesh_level in enumerate(given)
    ]
    for part, given in mesh_levels().items():
        listed += [
            (f"{part},{name(mesh_level)}", {"part": part, "mesh_level": mesh_level, "role": "mesh_level"})
            for mesh_level in given
        ]
    return listed


def name(mesh_level: dict[str, Any]) -> str:
    """A mesh level in a word, such as superelement-hex3,2x1.6mm,layers=2: elements 2 mm in the plate, 1.6 mm along a pillar."""
    if mesh_level["model"] == "analytic":
        return f"analytic-{mesh_level['theory']}"
    element = "tet" if "tet" in mesh_level["model"] else "hex"
    model = "" if mesh_level["model"] in ("hex", "tet", "solid") else mesh_level["model"].split()[0] + "-"
    degrees = "" if "degrees" not in mesh_level else f",degrees={mesh_level['degrees'][0]}"
    layers = f",layers={mesh_level['layers']}" if mesh_level.get("layers") else ""
    along = f"x{mesh_level['along_mm']:.3g}" if "along_mm" in mesh_level else ""
    through = f",through={mesh_level['through']}" if mesh_level.get("through", 1) > 1 else ""
    return f"{model}{element}{mesh_level['order']},{mesh_level['size_mm']:g}{along}mm{layers}{through}{degrees}"


def compute(parameters: dict[str, Any], folder: Path, log: RunLog) -> dict[str, Any]:
    """Values of one mesh level, the median of its wall times, and the memory it took above what was there before."""
    part, mesh_level = parameters["part"], parameters["mesh_level"]
    mesh_level = {**mesh_level, "degrees": tuple(mesh_level["degrees"])} if "degrees" in mesh_level else mesh_level
    ladder.design()
    solve = ladder.PARTS[part]
    machine.restart_peak()
    before = machine.resident_bytes()
    start = time.perf_counter()
    try:
        values, dof = solve(mesh_level)
    except (SolverError, GeometryError, MeshError, MemoryError) as refusal:
        return {"refused": " ".join(str(refusal).split()), "values": {}, "dof": None}
    seconds = [time.perf_counter() - start]
    peak = max(machine.peak_bytes() - before, 0)
    while parameters["role"] == "mesh_level" and len(seconds) < 3 and sum(seconds) < REPEAT_BELOW_S:
        start = time.perf_counter()
        solve(mesh_level)
        seconds.append(time.perf_counter() - start)
    log.info(f"{values}, {dof} degrees of freedom, {statistics.median(seconds):.3f} s, {peak / 1e6:.0f} MB")
    measured = {"seconds": statistics.median(seconds), "repeats": len(seconds), "peak_bytes": peak}
    return {"values": values, "dof": dof, "measured": measured}


def extrapolated(levels: list[float]) -> tuple[float, float]:
    """Limit of three refinements and its uncertainty: Aitken's step, and the step itself (aitken1926).

    Where the differences do not shrink, the last value and the last difference.
    """
    first, second, third = levels
    d1, d2 = second - first, third - second
    if d1 == d2 or not abs(d2) < abs(d1):
        return third, abs(d2)
    limit = third - d2 * d2 / (d2 - d1)
    return limit, abs(limit - third)


def references(records: list[dict[str, Any]]) -> dict[str, tuple[float, float]]:
    """Reference and uncertainty of every quantity whose three levels were computed."""
    levels: dict[str, list[float]] = {}
    for record in records:
        if record["parameters"]["role"] == "reference":
            for quantity, value in (record.get("values") or {}).items():
                if quantity in (*NAMES, CONFINEMENT):
                    levels.setdefault(quantity, []).append(value)
    return {quantity: extrapolated(values) for quantity, values in levels.items() if len(values) == 3}


def conclude(records: list[dict[str, Any]]) -> Page:
    """The references, the cheapest way to each accuracy, and a table and picture per quantity."""
    known = references(records)
    rows = [[NAMES.get(q, q), value, spread, spread / abs(value)] for q, (value, spread) in known.items()]
    headings = ("quantity", "reference (Hz or dB)", "uncertainty", "relative")
    words = (
        "Elements of order 4, extrapolated from three meshes; the uncertainty is the extrapolated step. From mesh to mesh the "
        "elements of the zone shrink by a third, with three layers graded towards the singular edges, and those of the pillar "
        "by half, with two, three and four layers. The cell has one, two and three layers. The plate, computed with the "
        "superelement, has zero, one and two; its uncertainty covers the singular edges only.",
    )
    sections = [
        Section("Fastest model for each accuracy", (), [_cheapest(records, known)]),
        Section("The planner's meshes and the lower envelope", (ENVELOPE,), [_envelope(records, known)]),
        Section("References", words, [Table("references", headings, rows)]),
    ]
    sections += [_section(part, quantity, records, known[quantity]) for part, quantity in _followed(known)]
    if CONFINEMENT in known:
        sections.append(_confinement_section(records, known[CONFINEMENT]))
    return Page(sections)


def calibration_rows(records: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
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


def growth(quantity: str, reference_hz: float) -> float:
    """A zone's mode over the frequency up to which the planner calls its mesh good, rounded down; 1 for other parts."""
    if quantity not in ladder.ZONE:
        return FIRST
    return floor(100.0 * reference_hz / mesh_rules.good_to_hz("zone", ladder.design())) / 100.0


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
    write_atomic(TABLE, csv_bytes(FIELDS, calibration_rows(records)))
    print(f"calibration {TABLE}")
    return 0


@cache
def _meshes() -> dict[str, dict[str, list[dict[str, Any]]]]:
    with MESHES.open("rb") as file:
        listed = tomllib.load(file)
    return {
        role: {part: [one for entry in given for one in _expanded(entry)] for part, given in parts.items()}
        for role, parts in listed.items()
    }


def _expanded(entry: dict[str, Any]) -> list[dict[str, Any]]:
    """One mesh for each combination of an entry's lists, or what the planner may choose of a part."""
    if "degrees" in entry:
        entry = entry | {"degrees": (entry["degrees"]["sides"], entry["degrees"]["thickness"])}
    if "planner" in entry:
        return _planners(**entry)
    choices = [value if isinstance(value, list) else [value] for value in entry.values()]
    return [dict(zip(entry, values, strict=True)) for values in product(*choices)]


def _planners(planner: str, model: str, **more: Any) -> list[dict[str, Any]]:
    """Meshes that an accuracy may select for a part or for reduced cells; of lone parts also of order 2."""
    if planner == "reduced":
        rows = tuple(mesh_rules.CELL_LEVELS.values())
    elif planner == "whole":
        rows = mesh_rules.mesh_levels(planner)[:-1]
    else:
        rows = (*(mesh_rules.MeshLevel(2, layers, 0.15) for layers in (1, 2)), *mesh_rules.mesh_levels(planner))
    return [{"model": model, **ladder.of_the_planner(planner, row), **more} for row in rows]


def _confinement_section(records: list[dict[str, Any]], reference: tuple[float, float]) -> Section:
    """The plate's confinement by every mesh level, and how far each is from the reference."""
    rows: list[list[Any]] = []
    for record, error in _measured("plate", CONFINEMENT, records, reference):
        if error is not None:
            mesh_level = record["parameters"]["mesh_level"]
            value = record["values"][CONFINEMENT]
            rows.append([name(mesh_level), value, value - reference[0], record["values"]["plate"]])
    words = f"Reference {reference[0]:.3f} dB, uncertainty {reference[1]:.3f} dB."
    headings = ("model", "confinement (dB)", "error (dB)", "target mode (Hz)")
    return Section("Plate, confinement", (words,), [Table("confinement", headings, rows)])


def _measured(part: str, quantity: str, records: list[dict[str, Any]], reference: tuple[float, float]) -> list[Any]:
    """(record, error) of every mesh level of a part; None where it gave no value."""
    out = []
    for record in records:
        if record["parameters"]["part"] == part and record["parameters"]["role"] == "mesh_level":
            value = (record.get("values") or {}).get(quantity)
            out.append((record, None if value is None else value / reference[0] - 1.0))
    return out


def _section(part: str, quantity: str, records: list[dict[str, Any]], reference: tuple[float, float]) -> Section:
    points = _measured(part, quantity, records, reference)
    rows = []
    for record, error in points:
        measured = record.get("measured")
        spent = (measured["seconds"], measured["peak_bytes"] / 1e6) if measured else (None, None)
        value = (record.get("values") or {}).get(quantity)
        reason = record.get("refused") or ("" if record["status"] == "OK" else record["diagnosis"])
        rows.append([name(record["parameters"]["mesh_level"]), record.get("dof"), value, error, *spent, reason])
    headings = ("model", "dofs", "value (Hz)", "relative error", "time (s)", "memory (MB)", "note")
    table = Table(quantity.replace(" ", "_"), headings, rows)
    uncertainty = reference[1] / abs(reference[0])
    report_figures: list[Callable[[], style.ReportFigure]] = [partial(_picture, quantity, points, uncertainty)]
    return Section(NAMES[quantity], (), [table], report_figures)


def _followed(known: dict[str, tuple[float, float]]) -> list[tuple[str, str]]:
    """Part and name of every quantity that has a reference."""
    return [(part, quantity) for part, own in QUANTITIES.items() for quantity in own if quantity in known]


def _cheapest(records: list[dict[str, Any]], known: dict[str, tuple[float, float]]) -> Table:
    rows: list[list[Any]] = []
    for part, quantity in _followed(known):
        measured, (value, spread) = _measured(part, quantity, records, known[quantity]), known[quantity]
        rows.append([NAMES[quantity], *(_best(measured, target, spread / abs(value)) for target in TARGETS)])
    return Table("cheapest", ("quantity", *(f"within {100 * t:g} %" for t in TARGETS)), rows)


def _envelope(records: list[dict[str, Any]], known: dict[str, tuple[float, float]]) -> Table:
    rows: list[list[Any]] = []
    for part, quantity in _followed(known):
        if ladder.ZONE.get(quantity):
            continue
        measured = [(r, abs(e)) for r, e in _measured(part, quantity, records, known[quantity]) if e is not None]
        for record, error in measured:
            mesh_level, own = record["parameters"]["mesh_level"], record["measured"]["seconds"]
            if _planned(part, mesh_level):
                least = min(other["measured"]["seconds"] for other, theirs in measured if theirs <= error)
                rows.append([NAMES[quantity], name(mesh_level), error, own, own / least])
    return Table("envelope", ("quantity", "mesh", "relative error", "time (s)", "over the envelope"), rows)


def _planned(part: str, mesh_level: dict[str, Any]) -> bool:
    """Whether there is an accuracy for which the planner takes a mesh level's mesh for the part; of cells, reduced."""
    if part in ("cell", "plate"):
        return bool(mesh_level["model"] == ladder.EXTRAPOLATED)
    if "share" not in mesh_level:
        return False
    expected = [mesh_rules.expected_error(part, row) for row in mesh_rules.mesh_levels(part)]
    taken = {mesh_rules.mesh_level(part, each) for each in expected if each is not None}
    return mesh_rules.MeshLevel(*(mesh_level[field.name] for field in fields(mesh_rules.MeshLevel))) in taken


def _best(measured: list[Any], target: float, uncertainty: float) -> str:
    """The fastest mesh level within the target, the reference's own uncertainty counted against it."""
    good = [(r["measured"]["seconds"], r) for r, e in measured if e is not None and abs(e) + uncertainty <= target]
    if not good:
        return "none of these"
    seconds, record = min(good, key=lambda pair: pair[0])
    return f"{name(record['parameters']['mesh_level'])} ({seconds:.2g} s)"


def _family(mesh_level: dict[str, Any]) -> str:
    element = name(mesh_level).split(",")[0]
    if mesh_level["model"] == "analytic":
        return "analytic"
    graded = " graded" if mesh_level.get("layers") or "tet" in element else ""
    return element + graded


def _point(record: dict[str, Any], error: float) -> tuple[float, float, float]:
    """Seconds, megabytes, relative error."""
    measured = record["measured"]
    return measured["seconds"], max(measured["peak_bytes"] / 1e6, 0.1), max(abs(error), 1e-7)


def _picture(quantity: str, compared: list[Any], uncertainty: float) -> style.ReportFigure:
    figure = style.new_figure(style.WIDTH_IN, 3.6)
    left, right = figure.subplots(1, 2, sharey=True)
    families: dict[str, list[tuple[float, float, float]]] = {}
    chosen = []
    for record, error in compared:
        if error is not None and record.get("measured"):
            part, mesh_level = record["parameters"]["part"], record["parameters"]["mesh_level"]
            families.setdefault(_family(mesh_level), []).append(_point(record, error))
            chosen += [_point(record, error)] if _planned(part, mesh_level) else []
    for index, (family, points) in enumerate(families.items()):
        seconds, memory, errors = np.array(sorted(points)).T
        look = {
            "marker": style.MARKERS[index % len(style.MARKERS)], "color": style.CYCLE[index % len(style.CYCLE)],
            "linestyle": LINES.get(family.split("-")[0], "-"), "markersize": 4.0,
        }  # fmt: skip
        left.plot(seconds, errors, label=family, **look)
        right.plot(memory, errors, **look)
    for axes, label in ((left, "wall time (s)"), (right, "memory (MB)")):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel(label)
        axes.grid(True)
        axes.axhspan(1e-7, max(uncertainty, 1e-7), color=style.GREY, alpha=0.25, lw=0)
    for axes, column, legend in ((left, 0, CHOSEN), (right, 1, None)) if chosen else ():
        places, errors = [point[column] for point in chosen], [point[2] for point in chosen]
        axes.plot(places, errors, "o", label=legend, color="black", markersize=9.0, markerfacecolor="none")
    left.set_ylabel("relative error")
    left.set_ylim(bottom=max(uncertainty / 10.0, 1e-7))
    figure.legend(loc="outside lower center", ncols=4, fontsize=7)
    left.set_title(NAMES[quantity])
    alt = (
        f"{NAMES[quantity]}: relative error against wall time and memory for {', '.join(families)}; "
        "shaded: the reference's own uncertainty"
    )
    return style.ReportFigure(f"accuracy_{quantity.replace(' ', '_')}", NAMES[quantity], alt, figure, vector=True)


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


if __name__ == "__main__":
    raise SystemExit(main())
