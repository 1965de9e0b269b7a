"""Export of parts to Code_Aster and CalculiX: whole quadratic meshes with named groups."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from geometry.cad.solids import part_solid
from geometry.elements import IntArray
from geometry.formats.med import write_med
from geometry.formats.neutral import FACET, VOLUME, Facets, RawMesh, local_nodes, outer_facets
from geometry.hex.boxes import Boxes, boxes_of, hex_mesh
from geometry.hex.scenes import HexSettings, box_counts, part_scene
from geometry.layout import Design, region_materials
from geometry.materials import Material
from geometry.mesh import Mesh, check_mesh, split_hexahedra
from geometry.tet import scenes
from pipeline import quantity
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models import parts
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import Request, check_model, with_defaults
from pipeline.records.outputs import delivered, is_standard_output, write_file
from solvers.accuracy.mesh import StressRecovery
from solvers.accuracy.reduction import MARGIN
from solvers.fem.eigen import factor_near, modes_near
from solvers.fem.factor import Factoriser
from solvers.fem.solid import SolidModel

ESTIMATED_DOFS = 60_000  # largest mesh that is solved to estimate its error
ESTIMATED_MODES = 4
HALVED = 1.0 / 7.0  # factor on the degrees of freedom that leaves room to halve the elements
MAX_DOFS = 300_000  # fits into the memory of a desktop computer in other programs
FINENESS = (0.25, 0.5, 1.0, 2.0, 4.0)  # element sizes tried, over the part's smallest dimension
FINEST = {0.03: 2.0, 0.01: 1.0, 0.003: 0.5}  # accuracy: first element size tried in FINENESS
DOFS_PER_TET = 4.5  # a quadratic tetrahedron adds about 1.5 nodes
TETS_PER_CUBE = 8.5  # tetrahedra of edge h in a cube of side h
COARSER = 1.25
COUNT_ACCURACY = 0.03
GROUPS = {"touch": "TOUCH", "back": "BACK", "foot": "FOOT", "top": "TOP"}
GROUPS |= {"x-": "XMIN", "x+": "XMAX", "y-": "YMIN", "y+": "YMAX"}
CLAMP = "CLAMP"

ENDINGS = (".med", ".comm", ".export", "_README.txt")
MODES_A_BAND = 40  # one Lanczos subspace per band: keeps its vectors and its orthogonalisation small
ABOVE_RIGID_HZ = 1.0  # a free body's band must exclude its rigid-body modes
NODES = "N_"  # prefix of a face group for the group of its nodes
MESH_NAME_LENGTH = 24

PER_LINE = 12  # numbers on a line of a set; CalculiX allows 16
SPARE = 1.05  # more modes than were counted: the counting model differs a little from the mesh written
SPARE_MODES = 6


@dataclass(frozen=True)
class Exchange:
    """A part to export: order-2 mesh, outer facets, face groups as indices of facets, volumes with their materials.

    search: request of the case, a band or `count` modes near a frequency; error: relative overestimate of modes there, None
    without an estimate; estimated_hz: lowest and highest of these modes.
    """

    name: str
    part: str
    mesh: Mesh
    facets: Facets
    faces: dict[str, IntArray]
    volumes: dict[str, IntArray]
    materials: dict[str, Material]
    search: Request
    error: float | None = None
    estimated_hz: tuple[float, float] = (0.0, 0.0)

    @property
    def error_text(self) -> str:
        """Describe the error of the mesh for the file and the terminal."""
        if self.error is None:
            return "no error estimate for its frequencies: refine the mesh and compare"
        modes = quantity.interval(*self.estimated_hz)
        return (
            f"its modes at {modes} are up to {quantity.percent(self.error)} too high (estimated from stress recovery)"
        )

    @property
    def clamped(self) -> bool:
        """Whether any face is clamped."""
        return CLAMP in self.faces

    def nodes_of(self, group: str) -> IntArray:
        """Sorted nodes of a face group."""
        return np.unique(self.facets.nodes[self.faces[group]])


def exchange(case: Case, part: str, log: Log, tetrahedra: bool = False) -> Exchange:
    """Mesh a part whole and name its groups; boxes give hexahedra of 27 nodes, which `tetrahedra` splits."""
    if part == "pillar":
        case.require_one_kind("the isolated pillar is")
    part_mesh, share = _exchange(case, part, log, tetrahedra), 1.0
    while _is_coarse(part_mesh, case) and part_mesh.mesh.dof <= HALVED * ESTIMATED_DOFS:
        share /= 2.0
        log.info(f"{part_mesh.error_text}; solve.accuracy = {case.solve.accuracy:g}: halving the element size")
        part_mesh = _exchange(case, part, log, tetrahedra, share)
    _log_summary(part_mesh, log)
    if _is_coarse(part_mesh, case):
        log.warning("MESH", f"solve.accuracy = {case.solve.accuracy:g}: not met by this mesh; {part_mesh.error_text}")
    return part_mesh


def rendered(template: str, **values: Any) -> str:
    """Render the text for another program from a template of this folder."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    look: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True, "keep_trailing_newline": True}
    loader = FileSystemLoader(Path(__file__).with_name("templates"))
    return Environment(loader=loader, undefined=StrictUndefined, **look).get_template(template).render(values)


def clamped_faces(part: str, mesh: Mesh) -> tuple[str, ...]:
    """Clamped faces: both long sides of the zone, the foot of the pillar, none of the plate."""
    if part == "zone":
        return ("y-", "y+")
    return ("foot" if "foot" in mesh.faces else "touch",) if part == "pillar" else ()


def modes_below(case: Case, part: str, frequencies_hz: Sequence[float], log: Log) -> list[int]:
    """Number of modes of a coarse model below each frequency, rigid ones included, from the negative pivots of K - sM."""
    coarse = replace(case, solve=case.solve.but(accuracy=max(case.solve.accuracy, COUNT_ACCURACY), model="auto"))
    counts = [0] * len(frequencies_hz)
    with log.step("count modes"):
        model = parts.build(coarse, part, max(frequencies_hz), log, [])
        for symmetry in model.symmetries:
            pencil = model.pencil(symmetry)
            factorise = Factoriser()
            for i, frequency in enumerate(frequencies_hz):
                counts[i] += factor_near(pencil, pencil.scale.eigenvalue(frequency), factorise)[0].negative
    return counts


def aster(case: Case, part: str, output: Path, log: Log) -> list[Path]:
    """Write NAME.med, NAME.comm, NAME.export and NAME_README.txt; `output` gives folder and name."""
    _check_axes(case)
    part_mesh = exchange(case, part, log)
    med, comm, export, note = aster_files(output)
    stem = med.with_suffix("")
    with log.step("write MED"), delivered(med) as temporary:
        write_med(raw_mesh(part_mesh), temporary, mesh_name(part_mesh))
    bounds = _bounds(case, part_mesh, log)
    write_file(comm, commands(part_mesh, bounds).encode())
    write_file(export, rendered("aster.export.j2", name=stem.name).encode())
    write_file(note, _note(part_mesh, stem.name).encode())
    log.info(f"run it with: run_aster {export.name}")
    return [med, comm, export, note]


def _check_axes(case: Case) -> None:
    """Raise InputError for a law that ELAS_ORTH cannot hold: it has nine constants, along x, y and z."""
    for region, material in region_materials(case.design.stack, case.design.pillar).items():
        if not {"x", "y"} <= {*material.mirrors}:
            what = "Code_Aster's ELAS_ORTH takes axes along x, y and z: leave out axes_deg, or export calculix"
            raise InputError(f"{case.source or case.name}: material of {region}: {what}")


def aster_files(output: Path) -> list[Path]:
    """Files of the study: NAME.med, NAME.comm, NAME.export, NAME_README.txt."""
    name = output.stem if output.suffix.lower() in ENDINGS else output.name
    return [output.with_name(name + ending) for ending in ENDINGS]


def mesh_name(part_mesh: Exchange) -> str:
    """Name of the mesh in the MED file."""
    return part_mesh.part.upper()[:MESH_NAME_LENGTH]


def raw_mesh(part_mesh: Exchange) -> RawMesh:
    """Collect volume cells, facets of named faces, volume and face groups, and groups N_... of their nodes."""
    mesh = part_mesh.mesh
    kind = (mesh.kind, mesh.order)
    named = np.unique(np.concatenate(list(part_mesh.faces.values())))
    place = np.full(len(part_mesh.facets.nodes), -1)
    place[named] = np.arange(len(named))
    blocks = [(VOLUME[kind], mesh.cells[:, local_nodes(*kind)]), (FACET[kind], part_mesh.facets.nodes[named])]
    groups = {name: {0: cells} for name, cells in part_mesh.volumes.items()}
    groups |= {name: {1: place[facets]} for name, facets in part_mesh.faces.items()}
    return RawMesh(mesh.nodes, blocks, groups, {NODES + name: part_mesh.nodes_of(name) for name in part_mesh.faces})


def commands(part_mesh: Exchange, bounds: tuple[float, ...]) -> str:
    """Render the command file: mesh, model, materials, clamps, matrices, count of modes, modes, results."""
    about = {
        "element": VOLUME[part_mesh.mesh.kind, part_mesh.mesh.order],
        "mesh_name": mesh_name(part_mesh),
        "clamp": CLAMP,
    }
    axes = [name for name, material in part_mesh.materials.items() if not material.constants]
    return rendered("aster.comm.j2", part=part_mesh, bounds=bounds, axes=axes, orthotropic=_orthotropic, **about)


def _orthotropic(material: Material) -> dict[str, float]:
    """Return the nine constants of ELAS_ORTH: L, T, N along x, y, z, NU_LT = -e_T / e_L under a stress along L alone."""
    s = material.compliance_pa
    names, pairs = ("L", "T", "N"), (("LT", 0, 1, 5), ("LN", 0, 2, 4), ("TN", 1, 2, 3))
    return (
        {f"E_{name}": float(1.0 / s[axis, axis]) for axis, name in enumerate(names)}
        | {f"NU_{pair}": float(-s[i, j] / s[i, i]) + 0.0 for pair, i, j, _ in pairs}
        | {f"G_{pair}": float(1.0 / s[place, place]) for pair, _, _, place in pairs}
    )


def calculix(case: Case, part: str, output: Path, log: Log) -> list[Path]:
    """Write NAME.inp with everything a run needs (ccx NAME)."""
    part_mesh = exchange(case, part, log, tetrahedra=True)
    count = _count(case, part_mesh, log)
    path = calculix_file(output)
    with log.step("write the input file"), delivered(path) as temporary:
        temporary.write_text(input_deck(part_mesh, count))
    log.info(f"run it with: ccx {path.stem}")
    return [path]


def calculix_file(output: Path) -> Path:
    """Path of the input file: NAME.inp, or `output` itself if it is not a regular file, such as standard output."""
    if is_standard_output(output) or output.suffix.lower() == ".inp" or (output.exists() and not output.is_file()):
        return output
    return output.with_name(output.name + ".inp")


def input_deck(part_mesh: Exchange, count: int) -> str:
    """Write the whole input file, which requests the `count` lowest modes."""
    out = io.StringIO()
    out.write(f"*HEADING\n{part_mesh.name}: the whole {part_mesh.part}, SI units (m, kg, s, N), written by antinode\n")
    out.write(f"** mesh sha256 {part_mesh.mesh.sha256}\n** mesh: {part_mesh.error_text}\n")
    _nodes(out, part_mesh)
    _elements(out, part_mesh)
    for name, places in part_mesh.faces.items():
        _set(out, f"*NSET, NSET={name}", part_mesh.nodes_of(name) + 1)
        _surface(out, part_mesh, name, places)
    words = {"clamp": CLAMP, "count": count, "constants_of": _constants}
    out.write(rendered("calculix_materials.inp.j2", part=part_mesh, **words))
    return out.getvalue()


def _constants(material: Material) -> list[str]:
    """Return the 21 constants of *ELASTIC, TYPE=ANISO, eight a line: the upper triangle over 11, 22, 33, 12, 13, 23."""
    c, order = material.stiffness_pa, (0, 1, 2, 5, 4, 3)
    values = [f"{c[order[row]][place]:.12g}" for column, place in enumerate(order) for row in range(column + 1)]
    return [", ".join(values[start : start + 8]) for start in range(0, len(values), 8)]


def _is_coarse(part_mesh: Exchange, case: Case) -> bool:
    """Whether the estimated error of the mesh exceeds the accuracy."""
    return part_mesh.error is not None and part_mesh.error > case.solve.accuracy


def _exchange(case: Case, part: str, log: Log, tetrahedra: bool, share: float = 1.0) -> Exchange:
    """Mesh the part with elements `share` times as long as those that the accuracy selects first."""
    with log.step(f"mesh the whole {part}"):
        mesh = _mesh(case, part, log, share)
        if tetrahedra and mesh.kind == "hex":
            mesh = split_hexahedra(mesh)
        check_mesh(mesh)
    design, facets, regions = case.design, outer_facets(mesh), mesh.region_of_cells()
    own = region_materials(design.stack, design.pillar)
    volumes = {name.upper(): cells for name, cells in regions.items()}
    materials = {name.upper(): own[name] for name in regions}
    faces, search = _faces(mesh, facets, design, part), with_defaults(case, Request(part))
    written = Exchange(case.name, part, mesh, facets, faces, volumes, materials, search)
    return _estimated(written, own, log, thin=part == "plate" and design.outline is not None)


def _estimated(part_mesh: Exchange, materials: dict[str, Material], log: Log, thin: bool) -> Exchange:
    """Add the largest error of some modes near the request, times MARGIN; hexahedra and large meshes have no estimate."""
    mesh, search = part_mesh.mesh, part_mesh.search
    if mesh.kind != "tet" or mesh.dof > ESTIMATED_DOFS:
        return part_mesh
    clamped = clamped_faces(part_mesh.part, mesh)
    about_hz = sum(search.band_hz) / 2.0 if search.band_hz else search.near_hz or 0.0
    with log.step("discretisation error"):
        model = SolidModel(mesh, materials, clamped, False)
        pencil = model.pencil(None)
        modes = modes_near(pencil, about_hz, ESTIMATED_MODES)
        values = np.array([pencil.scale.eigenvalue(tone) for tone in modes.frequency_hz])
        recovery = StressRecovery(mesh, materials, model.scale, bool(clamped), thin)
        error = float(np.sum(recovery.errors(None, pencil, modes.vectors, values), axis=0).max(initial=0.0))
    ends = float(modes.frequency_hz.min()), float(modes.frequency_hz.max())
    return replace(part_mesh, error=MARGIN * error, estimated_hz=ends)


def _faces(mesh: Mesh, facets: Facets, design: Design, part: str) -> dict[str, IntArray]:
    """Indices of the facets of every named group; the back of a plate of boxes is recognised by its height."""
    inside = {name: np.isin(facets.nodes, mesh.nodes_of(name)).all(axis=1) for name in mesh.faces if name in GROUPS}
    if part != "pillar":
        height = mesh.nodes[facets.nodes, 2]
        inside["back"] = (np.abs(height - design.thickness_m) < 1e-9 * design.thickness_m).all(axis=1)
    groups = {GROUPS[name]: np.flatnonzero(on) for name, on in inside.items() if on.any()}
    clamped = [groups[GROUPS[name]] for name in clamped_faces(part, mesh)]
    return groups | ({CLAMP: np.unique(np.concatenate(clamped))} if clamped else {})


def _log_summary(part_mesh: Exchange, log: Log) -> None:
    mesh = part_mesh.mesh
    what = {"hex": "hexahedra of 27 nodes", "tet": "tetrahedra of 10 nodes"}[mesh.kind]
    log.info(
        f"mesh written: the whole {part_mesh.part}, {len(mesh.cells)} {what}, {len(mesh.nodes)} nodes, "
        f"{mesh.dof} degrees of freedom, "
        f"{part_mesh.error_text}; sha256 {mesh.sha256[:12]}; groups {', '.join([*part_mesh.volumes, *part_mesh.faces])}"
    )


def _mesh(case: Case, part: str, log: Log, share: float) -> Mesh:
    pillar = case.design.pillar
    boxes = part == "zone" or pillar is None or pillar.is_made_of_boxes or (part == "plate" and not case.design.rows)
    boxes &= part != "plate" or case.design.outline is None
    check_model(replace(case, solve=case.solve.but(model="solid")), boxes)
    if boxes and case.solve.mesh != "tet":
        return hex_mesh(_boxes(case, part, log, share), 2)
    return _tetrahedra(case, part, log, share)


def _settings(case: Case, part: str, share: float) -> Iterator[HexSettings]:
    """Element sizes from the finest that the accuracy requires to the coarsest."""
    design = case.design
    smallest = design.thickness_m if part != "pillar" or design.pillar is None else design.pillar.smallest_m
    finest = next((size for accuracy, size in FINEST.items() if case.solve.accuracy >= accuracy), FINENESS[0])
    for size in FINENESS:
        if size >= finest:
            yield HexSettings(2, share * size * smallest, layers=0 if part == "plate" else 1)


def _boxes(case: Case, part: str, log: Log, share: float) -> Boxes:
    """Mesh boxes as finely as the limit of degrees of freedom allows, or else with the coarsest elements."""
    for settings in _settings(case, part, share):
        scene = part_scene(case.design, part, settings, quarter=False)
        dofs = 3 * box_counts(scene, 2).nodes
        if dofs <= MAX_DOFS:
            return boxes_of(scene)
    log.warning("LARGE", f"{part}: its coarsest mesh has {dofs} degrees of freedom, more than {MAX_DOFS}")
    return boxes_of(scene)


def _tetrahedra(case: Case, part: str, log: Log, share: float) -> Mesh:
    """Mesh the part through CAD and pytetwild, with longer edges until it is below the limit."""
    fewest = (DOFS_PER_TET * TETS_PER_CUBE * part_solid(case.design, part).volume_m3 / MAX_DOFS) ** (1.0 / 3.0)
    edge = max(share * mesh_rules.tet_edge_m(_smallest_m(case.design, part), max(case.solve.accuracy, 0.01)), fewest)
    while (mesh := scenes.tet_part(case.design, part, edge)).dof > MAX_DOFS:
        log.info(f"mesh: {mesh.dof} degrees of freedom, limit {MAX_DOFS}; meshing again with longer edges")
        edge *= COARSER
    return mesh


def _smallest_m(design: Design, part: str) -> float:
    """Smallest dimension that a part's tetrahedra must resolve, m."""
    sizes = [design.thickness_m] if part != "pillar" else []
    if design.pillar and (part == "pillar" or (part == "plate" and design.rows)):
        sizes += [pillar.smallest_m for pillar in design.kinds]
    return min(sizes)


def _bounds(case: Case, part_mesh: Exchange, log: Log) -> tuple[float, ...]:
    """Ends of the sub-bands, Hz, whose number depends on that of the modes; none without a band."""
    if part_mesh.search.band_hz is None:
        return ()
    low, high = part_mesh.search.band_hz
    low = max(low, ABOVE_RIGID_HZ)
    below_low, below_high = modes_below(case, part_mesh.part, (low, high), log)
    count = below_high - below_low
    parts = max(1, ceil(count / MODES_A_BAND))
    log.info(f"modes from {low:g} to {high:g} Hz: about {count} (coarse inertia count), in {parts} sub-band(s)")
    return tuple(float(f) for f in np.linspace(low, high, parts + 1))


def _note(part_mesh: Exchange, name: str) -> str:
    search = part_mesh.search
    window = f"--band {search.band_hz[0]:g}Hz:{search.band_hz[1]:g}Hz" if search.band_hz else f"--count {search.count}"
    window = f"--near {search.near_hz:g}Hz {window}" if search.near_hz and not search.band_hz else window
    about = {"element": VOLUME[part_mesh.mesh.kind, part_mesh.mesh.order], "clamp": CLAMP, "nodes": NODES}
    return rendered("aster_README.txt.j2", part=part_mesh, name=name, window=window, **about)


def _count(case: Case, part_mesh: Exchange, log: Log) -> int:
    """Number of modes to request: CalculiX always begins with the lowest one, so that modes below the band count, too."""
    rigid = 0 if part_mesh.clamped else 6
    if part_mesh.search.band_hz is None:
        top = part_mesh.search.near_hz or 0.0
        below = modes_below(case, part_mesh.part, (top,), log)[0] if top else rigid
        return below + (part_mesh.search.count or 1)
    high = part_mesh.search.band_hz[1]
    below = modes_below(case, part_mesh.part, (high,), log)[0]
    log.info(f"modes below {high:g} Hz: about {below} (coarse inertia count); CalculiX drops those below the band")
    return int(SPARE * below) + SPARE_MODES


def _nodes(out: io.StringIO, part_mesh: Exchange) -> None:
    """Write the nodes; CalculiX reads at most 20 characters per number."""
    out.write("*NODE, NSET=NALL\n")
    numbers = np.arange(1, len(part_mesh.mesh.nodes) + 1)
    np.savetxt(out, np.column_stack([numbers, part_mesh.mesh.nodes]), fmt="%d, %.12e, %.12e, %.12e")


def _elements(out: io.StringIO, part_mesh: Exchange) -> None:
    """Write the elements, whose local nodes have our order: corners, then middles of 12, 23, 13, 14, 24, 34."""
    for name, cells in part_mesh.volumes.items():
        out.write(f"*ELEMENT, TYPE=C3D10, ELSET={name}\n")
        np.savetxt(out, np.column_stack([cells + 1, part_mesh.mesh.cells[cells] + 1]), fmt="%d", delimiter=", ")


def _set(out: io.StringIO, head: str, members: IntArray) -> None:
    out.write(head + "\n")
    for start in range(0, len(members), PER_LINE):
        out.write(", ".join(str(n) for n in members[start : start + PER_LINE]) + ",\n")


def _surface(out: io.StringIO, part_mesh: Exchange, name: str, places: IntArray) -> None:
    """Write the faces of elements, which already have CalculiX's order S1 to S4."""
    out.write(f"*SURFACE, NAME=S_{name}, TYPE=ELEMENT\n")
    facets = part_mesh.facets
    for cell, local in zip(facets.cells[places], facets.local[places], strict=True):
        out.write(f"{cell + 1}, S{local + 1}\n")
