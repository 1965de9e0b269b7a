"""Stiff and extreme cases of the finite-element core: each is right within its error bar, or rejected with a reason."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, onenormest

from geometry.errors import GeometryError
from geometry.hex.boxes import Boxes, hex_mesh, panel_boxes, pillar_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Pillar
from geometry.materials import MATERIALS, Material, Stack
from geometry.mesh import Mesh, check_mesh, split_hexahedra
from geometry.tiling import Panel
from pipeline.errors import CommandError
from pipeline.logs import RunLog
from pipeline.paths import ROOT
from pipeline.report.html import Page, Section, Table
from solvers.analytic.plates import supported_plate_hz
from solvers.errors import SolverError
from solvers.fem.assembly import assemble
from solvers.fem.eigen import Modes, modes_in_band, modes_near
from solvers.fem.factor import Factoriser
from solvers.fem.solid import Pencil, constrain, free_mask

TITLE = "Stiff and extreme cases"
LEAD = (
    "Every case has a reference and a specified error for its mesh. The verdict is 'right' if the error is within this limit "
    "plus the rounding error that the solver reports, and 'refused' if the solver returned an error instead of a number."
)
ALUMINIUM = MATERIALS["aluminium"]
PLATE_M = 0.1
SIDES = ("x-", "x+", "y-", "y+")
POISSON = (-0.5, 0.0, 0.3, 0.45, 0.49, 0.499, 0.4999, 0.5)
ELEMENTS = ("hex1", "hex2", "hex3", "hex4", "tet1", "tet2")
PROMISED = 0.01  # of a frequency: what every mesh of this study but those that lock should meet
ROUNDING_ONLY = 1e-9

Result = dict[str, Any]


def cases() -> list[tuple[str, dict[str, Any]]]:
    """One case a scene and parameter; the large ones last."""
    listed: list[tuple[str, dict[str, Any]]] = [
        (f"{scene},{key}={value:g}", {"scene": scene, key: value})
        for scene, (_, _, key, values) in SCENES.items()
        for value in values
    ]
    listed += [
        (f"poisson,{element},nu={nu:g}", {"scene": "poisson", "element": element, "poisson": nu})
        for element in ELEMENTS
        for nu in POISSON
    ]
    return [*listed, *((f"million,{shape}", {"scene": "million", "shape": shape}) for shape in ("slab", "block"))]


def compute(parameters: dict[str, Any], folder: Path, log: RunLog) -> Result:
    """One scene: value, reference, error, residual, rounding, condition, count, and the verdict."""
    given = dict(parameters)
    functions: dict[str, Callable[..., Result]] = {name: function for name, (function, *_) in SCENES.items()}
    scene = (functions | {"poisson": poisson, "million": million})[given.pop("scene")]
    start = time.perf_counter()
    try:
        outcome = scene(**given)
    except (SolverError, GeometryError, CommandError, MemoryError) as refusal:
        outcome = {"verdict": "refused", "reason": " ".join(str(refusal).split()).replace(f"{ROOT}/", "")}
    outcome["seconds"] = time.perf_counter() - start
    if "verdict" not in outcome:
        outcome["verdict"] = verdict(outcome)
    log.info(f"{outcome['verdict']}: {outcome.get('reason') or outcome.get('error')}")
    failed = {"status": "FAILED", "diagnosis": "a wrong number in silence"} if outcome["verdict"] == "WRONG" else {}
    return {"found": outcome, **failed}


def verdict(outcome: Result) -> str:
    """Right within the promise and the reported rounding; 'locks' for a known stiff element; else wrong in silence."""
    if outcome["count_found"] != outcome["count_expected"]:
        return "WRONG"
    if abs(outcome["error"]) <= outcome["promised"] + outcome["rounding"]:
        return "right"
    return "locks" if outcome.get("may_lock") else "WRONG"


def result(pencil: Pencil, modes: Modes, reference_hz: float, promised: float = PROMISED, **more: Any) -> Result:
    """Figures of the mode nearest to the reference."""
    index = int(np.argmin(np.abs(modes.frequency_hz - reference_hz)))
    return {
        "value_hz": float(modes.frequency_hz[index]),
        "reference_hz": reference_hz,
        "error": float(modes.frequency_hz[index] / reference_hz - 1.0),
        "promised": promised,
        "residual": float(modes.residual[index]),
        "rounding": float(modes.rounding[index]),
        "condition": condition(pencil, 0.5 * reference_hz),
        "count_expected": modes.count.expected,
        "count_found": modes.count.found,
        "dof": pencil.dof,
        **more,
    }


def condition(pencil: Pencil, shift_hz: float) -> float:
    """Estimate of ||A||_1 ||A^-1||_1 for A = K - s M (higham2000), s below the mode."""
    matrix = pencil.stiffness - pencil.scale.eigenvalue(shift_hz) * pencil.mass
    factor = Factoriser()(matrix.tocsc())
    size = (pencil.dof, pencil.dof)
    inverse = LinearOperator(size, matvec=factor.solve, rmatvec=factor.solve, matmat=factor.solve, dtype=float)
    return float(abs(matrix).sum(axis=0).max() * onenormest(inverse, t=1))


def box(edges_m: Sequence[float], cuts: Sequence[int], order: int) -> Mesh:
    """A box from the origin, cut evenly into hexahedra."""
    x, y, z = (np.linspace(0.0, edge, n + 1) for edge, n in zip(edges_m, cuts, strict=True))
    return hex_mesh(Boxes(x, y, z, np.zeros(tuple(cuts), dtype=np.int64), ("body",)), order)


def supported(mesh: Mesh, material: Material) -> Pencil:
    """A rectangular plate on hard supports: no u_z and no tangential displacement on its four sides."""
    return constrain(assemble(mesh, {"body": material}), free_mask(mesh, (), dict.fromkeys(SIDES, "A")))


def thin(length_over_thickness: float) -> Result:
    """A plate on hard supports, exact in three dimensions; order 4, one element through."""
    thickness = PLATE_M / length_over_thickness
    pencil = supported(box((PLATE_M, PLATE_M, thickness), (3, 3, 1), 4), ALUMINIUM)
    exact = supported_plate_hz(1, 1, (PLATE_M, PLATE_M), thickness, ALUMINIUM)
    return result(pencil, modes_near(pencil, exact, 1), exact)


def poisson(element: str, poisson: float) -> Result:
    """A 1:10 plate by every element at about equal degrees of freedom; low orders lock towards 1/2."""
    material = Material.isotropic("given", ALUMINIUM.as_isotropic.young_pa, ALUMINIUM.density_kg_m3, poisson)
    order = int(element[-1])
    cuts = {1: 12, 2: 6, 3: 4, 4: 3}[order]
    through = {1: 4, 2: 2, 3: 1, 4: 1}[order]
    edges = (PLATE_M, PLATE_M, PLATE_M / 10.0)
    if element.startswith("tet"):
        mesh = split_hexahedra(box(edges, (cuts, cuts, through), order))
    else:
        mesh = box(edges, (cuts, cuts, through), order)
    pencil = supported(mesh, material)
    exact = supported_plate_hz(1, 1, edges[:2], edges[2], material)
    modes = modes_in_band(pencil, 0.0, 4.0 * exact)
    return result(pencil, modes, exact, may_lock=True)


def slender(height_over_side: float) -> Result:
    """First bending of a clamped pillar, graded towards its foot, against a finer mesh of its own."""
    pillar = Pillar("square", 2e-3, 2e-3, 2e-3 * height_over_side, ALUMINIUM)

    def solved(order: int, layers: int, size: float) -> tuple[Pencil, Modes]:
        mesh = hex_mesh(pillar_boxes(pillar, HexSettings(order, 2e-3, layers, 0.15, size)), order)
        pencil = constrain(assemble(mesh, {"pillar": ALUMINIUM}), free_mask(mesh, ("touch",), {"x-": "A", "y-": "S"}))
        return pencil, modes_near(pencil, 0.0, 1)

    along = max(2e-3, pillar.height_m / 4.0)
    fine = solved(4, 2, along)[1].frequency_hz[0]
    pencil, modes = solved(3, 1, along)
    return result(pencil, modes, float(fine))


def contrast(young_ratio: float) -> Result:
    """A pillar stiffer than its plate (a 4 mm cell between sliding walls), against a finer mesh."""
    pillar_material = replace(ALUMINIUM.scaled(young_ratio), name="stiff")
    pillar = Pillar("square", 2e-3, 2e-3, 6.3e-3, pillar_material)
    panel = Panel((-2e-3, -2e-3), (2e-3, 2e-3), (0.0, 0.0), (0, 1))
    walls = {"x-": "A", "y-": "S", "x+": "A", "y+": "S"}

    def solved(order: int, layers: int) -> tuple[Pencil, Modes]:
        mesh = hex_mesh(
            panel_boxes(panel, Stack.of(2e-3, ALUMINIUM), pillar, HexSettings(order, 2e-3, layers, 0.15, 3e-3)), order
        )
        pencil = constrain(assemble(mesh, {"plate": ALUMINIUM, "pillar": pillar_material}), free_mask(mesh, (), walls))
        return pencil, modes_near(pencil, 0.0, 1)

    fine = solved(4, 3)[1].frequency_hz[0]
    pencil, modes = solved(3, 2)
    return result(pencil, modes, float(fine))


def sliver(dihedral_deg: float) -> Result:
    """The supported plate with a layer of flat tetrahedra in its middle; exact in three dimensions."""
    thickness, cuts = PLATE_M / 10.0, 8
    flat = PLATE_M / cuts * np.tan(np.radians(dihedral_deg))
    line = np.linspace(0.0, PLATE_M, cuts + 1)
    levels = np.array([0.0, (thickness - flat) / 2.0, (thickness + flat) / 2.0, thickness])
    boxes = Boxes(line, line, levels, np.zeros((cuts, cuts, 3), dtype=np.int64), ("body",))
    mesh = split_hexahedra(hex_mesh(boxes, 2))
    check_mesh(mesh, PLATE_M**2 * thickness, 1e-9)
    pencil = supported(mesh, ALUMINIUM)
    exact = supported_plate_hz(1, 1, (PLATE_M, PLATE_M), thickness, ALUMINIUM)
    return result(pencil, modes_near(pencil, exact, 1), exact, smallest_dihedral_deg=smallest_dihedral(mesh))


def smallest_dihedral(mesh: Mesh) -> float:
    """Smallest angle between two faces of a tetrahedron, degrees."""
    corners = mesh.nodes[mesh.cells[:, :4]]
    normals = []
    for a, b, c, d in ((1, 2, 3, 0), (0, 2, 3, 1), (0, 1, 3, 2), (0, 1, 2, 3)):
        normal = np.cross(corners[:, b] - corners[:, a], corners[:, c] - corners[:, a])
        outward = np.einsum("ij,ij->i", normal, corners[:, a] - corners[:, d])
        normals.append(normal * np.sign(outward)[:, None] / np.linalg.norm(normal, axis=1)[:, None])
    cosines = [-np.einsum("ij,ij->i", normals[i], normals[j]) for i in range(4) for j in range(i)]
    return float(np.degrees(np.arccos(np.clip(np.max(cosines), -1.0, 1.0))))


def size(edge_m: float) -> Result:
    """The 1:50 plate from a micrometre to 100 m: f times length is one number (reference: the 1 m plate)."""

    def solved(edge: float) -> tuple[Pencil, Modes]:
        pencil = supported(box((edge, edge, edge / 50.0), (3, 3, 1), 3), ALUMINIUM)
        guess = supported_plate_hz(1, 1, (edge, edge), edge / 50.0, ALUMINIUM)
        return pencil, modes_near(pencil, guess, 1)

    reference = solved(1.0)[1].frequency_hz[0] / edge_m
    pencil, modes = solved(edge_m)
    return result(pencil, modes, float(reference), ROUNDING_ONLY)


def side_by_side(mesh: Mesh, count: int, step_m: float) -> Mesh:
    """Copies of a body next to each other, not touching."""
    shift = np.arange(count)[:, None, None] * np.array([step_m, 0.0, 0.0])
    nodes = (mesh.nodes[None] + shift).reshape(-1, 3)
    number = np.arange(count)[:, None, None] * len(mesh.nodes)
    faces = {name: (face[None] + number).reshape(-1, face.shape[1]) for name, face in mesh.faces.items()}
    cells = (mesh.cells[None] + number).reshape(-1, mesh.cells.shape[1])
    spans = None if mesh.spans is None else np.tile(mesh.spans, (count, 1))
    return Mesh(nodes, cells, mesh.kind, mesh.order, {"body": np.arange(len(cells))}, faces, spans)


def cluster(copies: int) -> Result:
    """Equal bodies that do not touch: every mode `copies` times, all of them found and counted."""
    one = box((2e-3, 2.5e-3, 3e-3), (1, 1, 1), 2)
    alone = constrain(assemble(one, {"body": ALUMINIUM}), free_mask(one, ("touch",)))
    lowest = modes_near(alone, 0.0, 2).frequency_hz
    many = side_by_side(one, copies, 4e-3)
    pencil = constrain(assemble(many, {"body": ALUMINIUM}), free_mask(many, ("touch",)))
    middle = float(lowest[:2].mean())
    modes = modes_in_band(pencil, 0.9 * float(lowest[0]), middle)
    text = result(pencil, modes, float(lowest[0]), ROUNDING_ONLY)
    return {**text, "count_expected": copies, "spread": float(np.ptp(modes.frequency_hz) / lowest[0])}


def free(order: int) -> Result:
    """A free box: K is singular six times over; its lowest elastic mode against order 4 on a finer mesh."""

    def solved(order: int, cuts: int) -> tuple[Pencil, Modes]:
        mesh = box((0.03, 0.02, 0.01), (3 * cuts, 2 * cuts, cuts), order)
        pencil = constrain(assemble(mesh, {"body": ALUMINIUM}), free_mask(mesh))
        return pencil, modes_near(pencil, 0.0, 1)

    fine = solved(4, 1)[1].frequency_hz[0]
    pencil, modes = solved(order, 2)
    if modes.rigid_count != 6:
        raise SolverError(f"{modes.rigid_count} rigid-body modes found, a free body has 6")
    return result(pencil, modes, float(fine), rigid_count=modes.rigid_count)


def on_eigenvalue(order: int) -> Result:
    """The frequency sought falls exactly on a computed eigenvalue: the shift is moved, the mode found all the same."""
    pencil = supported(box((PLATE_M, PLATE_M, 0.01), (3, 3, 1), order), ALUMINIUM)
    exact = supported_plate_hz(1, 1, (PLATE_M, PLATE_M), 0.01, ALUMINIUM)
    first = float(modes_near(pencil, exact, 1).frequency_hz[0])
    return result(pencil, modes_near(pencil, first, 1), first, ROUNDING_ONLY)


def one_element(order: int) -> Result:
    """A single element, clamped below: the whole spectrum against dense algebra."""
    from scipy.linalg import eigh

    mesh = box((2e-3, 2e-3, 2e-3), (1, 1, 1), order)
    pencil = constrain(assemble(mesh, {"body": ALUMINIUM}), free_mask(mesh, ("touch",)))
    dense = eigh(pencil.stiffness.toarray(), pencil.mass.toarray(), eigvals_only=True)
    reference = float(pencil.scale.frequency(dense)[0])
    return result(pencil, modes_near(pencil, 0.0, 3), reference, ROUNDING_ONLY)


def mixed_units(thickness_mm: float) -> Result:
    """A case file whose thickness was typed in another unit than millimetres."""
    from pipeline.case.model import load_case
    from pipeline.paths import STUDIES

    load_case(STUDIES / "three-rows.toml", [f"plate.thickness_mm={thickness_mm!r}"])
    return {"verdict": "WRONG", "reason": "the case was taken as it stands"}


def million(shape: str) -> Result:
    """A million degrees of freedom: a slab that fits into memory, a block that does not."""
    if shape == "slab":
        edges, cuts, order = (PLATE_M, PLATE_M, PLATE_M / 50.0), (165, 165, 1), 2
    else:
        edges, cuts, order = (PLATE_M, PLATE_M, PLATE_M), (68, 68, 68), 1
    pencil = supported(box(edges, cuts, order), ALUMINIUM)
    exact = supported_plate_hz(1, 1, edges[:2], edges[2], ALUMINIUM)
    modes = modes_near(pencil, exact, 1)
    return {**result(pencil, modes, exact), "dof": pencil.dof}


# the function of a scene, its subject, its parameter and the values that are solved
SCENES: dict[str, tuple[Callable[..., Result], str, str, tuple[float, ...]]] = {
    "thin": (
        *(thin, "Thickness to length, supported plate (exact in three dimensions)"),
        *("length_over_thickness", (10, 30, 100, 300, 1000, 2000, 10_000)),
    ),
    "slender": (slender, "Pillar slenderness (against a finer mesh)", "height_over_side", (1, 2, 5, 10, 20, 50)),
    "contrast": (
        *(contrast, "Young's modulus of the pillar over the plate's (against a finer mesh)"),
        *("young_ratio", (1.0, 1e2, 1e4, 1e6, 1e8)),
    ),
    "sliver": (sliver, "Flat tetrahedra of order 2 (exact in three dimensions)", "dihedral_deg", (10.0, 1.0, 0.1)),
    "size": (
        size,
        "Sizes from a micrometre to 100 m (frequency times length is constant)",
        "edge_m",
        (1e-6, 1e-3, 1.0, 100.0),
    ),
    "cluster": (cluster, "Equal modes: all found, all counted", "copies", (2, 4, 100)),
    "free": (free, "Free body: K is singular", "order", (2,)),
    "on_eigenvalue": (on_eigenvalue, "Frequency exactly on an eigenvalue", "order", (3,)),
    "one_element": (one_element, "One element (against dense algebra)", "order", (1, 4)),
    "mixed_units": (mixed_units, "A thickness in the wrong unit", "thickness_mm", (0.002, 2000.0)),
}
HEADINGS = (
    *("case", "dofs", "value (Hz)", "reference (Hz)", "error", "rounding", "residual", "condition"),
    *("count", "time (s)", "verdict", "reason"),
)


def conclude(records: list[Result]) -> Page:
    """One table a scene; Poisson's ratio as a grid of errors."""
    by_scene: dict[str, list[Result]] = {}
    for record in records:
        by_scene.setdefault(record["parameters"]["scene"], []).append(record)
    wrong = [r["case_id"] for r in records if _outcome(r)["verdict"] not in ("right", "refused", "locks")]
    total = len(records)
    text = (
        f"{total - len(wrong)} of {total} cases are right within the specified error, lock as expected, or are refused."
    )
    titles = {scene: title for scene, (_, title, *_) in SCENES.items()} | {"million": "A million degrees of freedom"}
    rows = [[title, *_summary(by_scene.get(scene, []))] for scene, title in titles.items()]
    summary = Table("summary", ("cases", "number", "largest error", "largest rounding error", "refused"), rows)
    sections = [Section("Summary", [text, *(f"Exception: {case}" for case in wrong)], [summary])]
    for scene, title in titles.items():
        sections.append(
            Section(title, tables=[Table(scene, HEADINGS, [_row(each) for each in by_scene.get(scene, [])])])
        )
    sections.append(_locking(by_scene.get("poisson", [])))
    return Page(sections)


def _outcome(record: Result) -> Result:
    return dict(record.get("found") or {"verdict": record["status"], "reason": record["diagnosis"]})


def _summary(records: list[Result]) -> list[Any]:
    """Number of cases, largest error and rounding error, and the cases refused with their reasons."""
    outcomes = [_outcome(record) for record in records]
    largest = (max((abs(one[key]) for one in outcomes if key in one), default=None) for key in ("error", "rounding"))
    refused = (
        f"{_case(record)}: {one['reason']}"
        for record, one in zip(records, outcomes, strict=True)
        if one["verdict"] == "refused"
    )
    return [len(records), *largest, "; ".join(refused) or None]


def _case(record: Result) -> str:
    return record["case_id"].partition(",")[2] or record["case_id"]


def _row(record: Result) -> list[Any]:
    outcome = _outcome(record)
    keys = ("dof", "value_hz", "reference_hz", "error", "rounding", "residual", "condition")
    count = f"{outcome['count_found']} of {outcome['count_expected']}" if "count_found" in outcome else None
    tail = [count, outcome.get("seconds"), outcome["verdict"], outcome.get("reason")]
    return [_case(record), *(outcome.get(key) for key in keys), *tail]


def _locking(records: list[Result]) -> Section:
    words = (
        "Relative error of the first flexural frequency of a 1:10 plate on hard supports. Displacement elements lock as "
        "nu approaches 1/2, low orders first; nu = 1/2 is refused. Order 1 is too stiff in bending at every nu and serves "
        "only for comparison."
    )
    outcome = {(r["parameters"]["element"], r["parameters"]["poisson"]): _outcome(r) for r in records}
    rows = []
    for element in ELEMENTS:
        row: list[Any] = [
            element,
            next((f["dof"] for (e, _), f in outcome.items() if e == element and "dof" in f), None),
        ]
        for nu in POISSON:
            entry = outcome.get((element, nu), {})
            row.append(entry["error"] if "error" in entry else entry.get("verdict"))
        rows.append(row)
    headings = ["element", "dofs", *(f"nu = {nu:g}" for nu in POISSON)]
    return Section("Poisson's ratio: where elements lock", [words], [Table("poisson", headings, rows)])
