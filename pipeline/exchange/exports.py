"""Files for other programs: print and CAD files with their check, meshes and shapes of modes, bands, responses, tables."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.lattice import Lattice
from pipeline.case.features import GROUPS, LARGER, OF_A_PLATE, OUTLINE, PLACES, ZONES
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.target import verdict_text
from pipeline.quantity import frequency
from pipeline.records import outputs

if TYPE_CHECKING:
    from pipeline.models.user_mesh import UserMesh

CAD = ("stl", "step", "3mf")
SOLVER_FILES = ("aster", "calculix")
WHOLE = (*SOLVER_FILES, "vtu", "paraview", "xdmf")  # of modes or meshes: of plates of any outline
ENDINGS = {  # allowed endings of a file, the first one by default; "": common stem of several files
    "stl": (".stl",),
    "step": (".step", ".stp"),
    "3mf": (".3mf",),
    "aster": ("", ".med", ".comm", ".export"),
    "calculix": ("", ".inp"),
    "vtu": (".vtu",),
    "paraview": (".vtkhdf", ".hdf"),
    "xdmf": (".xdmf", ".xmf"),
    "driven": (".vtkhdf", ".hdf"),
    "phonopy": (".yaml", ".yml"),
    "uff": (".uff", ".unv"),
    "impedance": (".s1p", ".csv"),
    "table": (".bin", ".h", ""),
}
WORDS = {".s1p": ".s1p (Touchstone)"}


def write(
    case: Case, form: str, output: str | None, log: Log, part: str = "plate", force: bool = False,
    own: UserMesh | None = None, option: str = "-o", folder: str | None = None,
) -> list[Path]:  # fmt: skip
    """Write one format; returns the files written. Parts other than the plate go to finite-element programs only.

    `force`: write a mode table even without a target mode. own: a mesh file to solve instead of the plate. option: what
    messages call `output`. folder: where files without an `output` go, created if missing.
    """
    if form not in SOLVER_FILES and part != "plate":
        raise InputError(f"export {form} --part {part}: must be plate; {' and '.join(SOLVER_FILES)} take any part")
    if own:
        if form not in OF_MESHES or part != "plate":
            takes = ", ".join(OF_MESHES)
            raise InputError(f"--mesh-file {own.file}: must be left out of export {form}: {takes} of the plate take it")
        case.refuse(f"export {form} --mesh-file", (ZONES, LARGER, GROUPS))
    else:
        _require(case, form, part)
    path = Path(f"{case.name}{ENDINGS[form][0]}" if output is None else output)
    if folder and output is None:
        path = outputs.folder(folder) / path
    outputs.check_files(option, places(form, output if output == "" else path))
    if output is not None:
        _check_ending(form, path, option)
    if own:
        return [OF_MESHES[form](case, path, log, own)]
    if form in SOLVER_FILES:
        from pipeline.exchange import finite_elements

        return (finite_elements.aster if form == "aster" else finite_elements.calculix)(case, part, path, log)
    if form in ONE_FILE:
        return [ONE_FILE[form](case, path, log)]
    if form in CAD:
        return [_cad(case, form, path, log)]
    return _vtu(case, path, log) if form == "vtu" else _table(case, path, log, force)


def _require(case: Case, form: str, part: str) -> None:
    """Raise InputError for a case that lacks what is to be written, or that the format cannot honour."""
    if form == "phonopy":
        from pipeline.questions.bands import Bands

        Bands().suited(case)
        return
    command = f"export {form}"
    of_plate = part == "plate"
    honours = OF_A_PLATE if form in CAD or not of_plate else (LARGER, PLACES, OUTLINE) if form in WHOLE else (LARGER,)
    case.refuse(command, honours)
    if of_plate:
        case.require_plate(command)
        return
    case.require(*(("plate", "zone") if part == "zone" else ("pillar",)), command=command)


def _check_ending(form: str, path: Path, option: str) -> None:
    """Raise InputError for a file name whose ending does not match the format."""
    if outputs.is_standard_output(path) or (path.exists() and not path.is_file()):
        return
    allowed = ENDINGS[form]
    if path.suffix.lower() not in allowed:
        *others, last = (WORDS.get(each, each) for each in allowed if each)
        listed = f"{', '.join(others)} or {last}" if others else last
        raise InputError(f"{option} = {path}: must end in {listed}{', or have no ending' * ('' in allowed)}")


def places(form: str, output: str | Path) -> list[str | Path]:
    """Return the files of one format; InputError for several files if `output` cannot name a regular file."""
    path = Path(output)
    if not path.name or form in CAD or form in ONE_FILE or form == "vtu":
        return [output]
    from pipeline.board import export
    from pipeline.exchange import finite_elements

    if form == "calculix":
        return [finite_elements.calculix_file(path)]
    several = finite_elements.aster_files(path) if form == "aster" else export.places(path.parent, path.stem)
    if outputs.is_standard_output(output) or (path.exists() and not (path.is_file() or path.is_dir())):
        names = ", ".join(each.name for each in several)
        raise InputError(f"-o {output}: export {form} writes several files ({names}); must be a file's name")
    return [*several]


def _cad(case: Case, form: str, path: Path, log: Log) -> Path:
    from geometry.cad import printing, solids
    from pipeline.questions.geometry import about, checked, material_names

    with log.step("build the solid"):
        body = solids.plate_solid(case.design)
    names = material_names(case.design)
    with log.step(f"write {form}"), outputs.delivered(path) as temporary:
        if form == "step":
            printing.write_step(body, temporary, case.name, names)
        elif form == "3mf":
            printing.write_3mf(body, temporary, about(case), names)
        else:
            printing.write_stl(body, temporary, case.name)
            checked(case, body, temporary, log, (path.name,))
    return path


def _vtu(case: Case, path: Path, log: Log) -> list[Path]:
    """Write the solid quarter of the plate with its target mode."""
    from dataclasses import replace

    from geometry.formats.vtk import write_vtu
    from geometry.mesh import Mesh
    from pipeline.models.modes import Request, solve_modes
    from pipeline.models.target import warn_of_target
    from solvers.fem.solid import SolidModel

    solid = replace(case, solve=case.solve.but(model="solid", accuracy=max(case.solve.accuracy, 0.02)))
    part_modes = solve_modes(solid, Request("plate", symmetry=case.target_symmetry), log)
    assert isinstance(part_modes.model, SolidModel) and part_modes.target
    warn_of_target(part_modes.target, case, log)
    data, row = {}, part_modes.target.row
    if row is not None:
        vectors = part_modes.vectors[row.symmetry][:, [row.column]]
        data["displacement"] = part_modes.model.field(row.symmetry, vectors)[:, :, 0]
    assert isinstance(part_modes.model.mesh, Mesh)
    with outputs.delivered(path) as temporary:
        write_vtu(part_modes.model.mesh, temporary, data)
    return [path]


def _table(case: Case, path: Path, log: Log, force: bool) -> list[Path]:
    """Write the mode table of the target mode and its neighbours; without one, `force` uses the most similar mode."""
    from pipeline.board.export import write_table
    from pipeline.models.modes import solve_modes
    from pipeline.models.target import warn_of_target
    from pipeline.planning.model_choice import of_case

    part_modes = solve_modes(case, of_case(case), log).whole_window
    assert part_modes.target
    index = part_modes.index(part_modes.target.row)
    if index is not None or force:
        warn_of_target(part_modes.target, case, log)
    if index is None and force and part_modes.rows:
        index = max(range(len(part_modes.rows)), key=lambda i: part_modes.rows[i].mac or 0.0)
    if index is None:
        (said,) = verdict_text(part_modes.target, case.design)
        raise InputError(
            f"{case.name}: {said} A table would drive another mode: change the design or solve.band_kHz, or use the most "
            "similar mode with --force"
        )
    return write_table(case, part_modes, index, path.parent, path.stem, log, force)


# -- bands -------------------------------------------------------------------------------------------------------------
# phonopy's band.yaml: frequencies in THz, lengths in Angstrom, wavevectors in units of the reciprocal lattice.

ANGSTROM_M = 1e-10


def phonopy(case: Case, path: Path, log: Log) -> Path:
    """Compute the bands of a case's unit cell and write them."""
    from pipeline.questions.bands import Bands
    from pipeline.questions.question import ask

    outputs.write_file(path, band_yaml(ask(case, Bands(), log).to_dict()).encode())
    return path


def band_yaml(document: dict[str, Any]) -> str:
    """Render the file from a document of bands; every segment has both its ends, like those of phonopy."""
    from pipeline.exchange.finite_elements import rendered

    design, points = document["with_defaults"]["design"], document["points"]
    vectors = np.diag([0.0, 0.0, design["thickness_m"]])
    rows = Lattice.of_rows(design["pitch_x_m"], design["pitch_y_m"], design.get("stagger", False))
    vectors[:2, :2] = design.get("oblique_m") or rows.vectors_m
    wave = np.array([(point["kx_per_m"], point["ky_per_m"], 0.0) for point in points]) / (2.0 * np.pi)
    arc = np.cumsum([0.0, *np.linalg.norm(np.diff(wave, axis=0), axis=1) * ANGSTROM_M])
    own = [
        point | {"reduced": vectors @ k, "distance": distance}
        for point, k, distance in zip(points, wave, arc, strict=True)
    ]
    corners = [index for index, point in enumerate(points) if point["label"]]
    segments = [own[start : end + 1] for start, end in pairwise(corners)]
    lattice, atoms = vectors / ANGSTROM_M, max(1, len(points[0]["frequencies_hz"]) // 3)
    cell = {"lattice": lattice, "reciprocal": np.linalg.inv(lattice).T + 0.0, "atoms": atoms}
    return rendered("phonopy.yaml.j2", segments=segments, **cell)


# -- shapes ------------------------------------------------------------------------------------------------------------
# Every mode of a plate on the surface of the whole body, one step each: VTKHDF for ParaView, or XDMF as one text file.
# The driven plate over one period, as VTKHDF.

PHASES = 24


def paraview(case: Case, path: Path, log: Log, own: UserMesh | None = None) -> Path:
    """Compute the modes that `antinode modes` lists and write their shapes of unit modal mass; time is frequency, Hz."""
    from geometry.formats.vtk import write_steps

    points, facets, tones, shapes = shapes_of(case, log, own)
    with log.step(f"write {len(tones)} shapes"), outputs.delivered(path) as temporary:
        write_steps(temporary, points, facets, tones, "displacement", shapes)
    return path


def surface_vtu(case: Case, path: Path, log: Log, own: UserMesh) -> Path:
    """Compute the modes of a mesh file and write its surface, each shape a field named after its place and frequency."""
    import meshio

    points, facets, tones, shapes = shapes_of(case, log, own)
    fields = {
        f"{number}: {frequency(tone)}": shape for number, (tone, shape) in enumerate(zip(tones, shapes, strict=True), 1)
    }
    with log.step(f"write {len(tones)} shapes"), outputs.delivered(path) as temporary:
        meshio.Mesh(points, [("triangle", facets)], fields).write(temporary, file_format="vtu")
    return path


def xdmf(case: Case, path: Path, log: Log, own: UserMesh | None = None) -> Path:
    """Compute the modes that `antinode modes` lists and write their shapes as XDMF."""
    from meshio.xdmf import TimeSeriesWriter

    points, facets, tones, shapes = shapes_of(case, log, own)
    with (
        log.step(f"write {len(tones)} shapes"),
        outputs.delivered(path) as temporary,
        TimeSeriesWriter(
            temporary, data_format="XML"
        ) as writer,  # with HDF5, meshio leaves a file in the working folder
    ):
        writer.write_points_cells(points, [("triangle", facets)])
        for tone, shape in zip(tones.tolist(), shapes.astype(np.float32), strict=True):
            writer.write_data(tone, point_data={"displacement": shape})
    return path


def driven(case: Case, path: Path, log: Log) -> Path:
    """Compute the response and write one period of the plate at its peak, in m at drive_V; time is the phase, degrees."""
    from geometry.decimation import closed_surface
    from geometry.formats.vtk import write_steps
    from pipeline.models.mode_fields import over_period
    from pipeline.questions.question import Run, ask
    from pipeline.questions.response import Response

    run = Run(log)
    peak = ask(case, Response(), run).peak
    assert case.patches
    with log.step(f"write one period at {peak.tone}"), outputs.delivered(path) as temporary:
        skin = run.solved["forced"].skin(peak.frequency_hz)
        kept, triangles = closed_surface(skin.points, skin.facets, case.design.thickness_m)
        turns = np.arange(PHASES) / PHASES
        moved = case.patches.drive_v * skin.displacement[0, kept]
        shapes = np.stack([over_period(moved, turn) for turn in turns])
        write_steps(temporary, skin.points[kept], triangles, 360.0 * turns, "displacement", shapes)
    return path


def shapes_of(case: Case, log: Log, own: UserMesh | None = None) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Solve the modes of the plate, or of a mesh file, on its closed surface; InputError if the band has none. Returns points
    (p, 3) in m, triangles (m, 3), frequencies (k,) in Hz and displacements (k, p, 3).
    """
    from geometry.decimation import closed_surface
    from pipeline.models import user_mesh
    from pipeline.models.modes import solve_modes
    from pipeline.planning.model_choice import Request

    query = Request("plate")
    solved = user_mesh.solve(case, own, query, log) if own else solve_modes(case, query, log)
    if not solved.rows:
        raise InputError(f"{case.name}: no mode in the requested band: widen solve.band_kHz")
    symmetries = {row.symmetry for row in solved.rows}
    skins = {each: solved.model.skin(each, solved.vectors[each]).unfolded(each) for each in symmetries}
    first = next(iter(skins.values()))
    shapes = np.stack([skins[row.symmetry].displacement[row.column] for row in solved.rows])
    kept, triangles = closed_surface(first.points, first.facets, None if own else case.design.thickness_m)
    return first.points[kept], triangles, np.array([row.frequency_hz for row in solved.rows]), shapes[:, kept]


# -- frequency responses -----------------------------------------------------------------------------------------------
# The forced response as a universal file: nodes of the touch face (dataset 15), each with a frequency response (dataset 58).

FREQUENCY_RESPONSE, DISPLACEMENT, UNKNOWN, FREQUENCY, UP = 4, 8, 0, 18, 3  # codes of dataset 58
REAL_LENGTH = 80


def uff(case: Case, path: Path, log: Log) -> Path:
    """Compute the response around the target peak on a grid of the touch face and write it, u_z in m per volt."""
    import pyuff

    from pipeline.measured.synthetic import grid, tones
    from pipeline.questions.question import Run, ask
    from pipeline.questions.response import Response
    from solvers.piezo.responses import point_responses

    quality_factor, run = case.one_quality_factor("export uff"), Run(log)
    peak = ask(case, Response(), run).peak
    points, frequency = grid(case.design), tones(peak.frequency_hz, quality_factor)
    with log.step(f"response at {len(points)} points"):
        values = point_responses(run.solved["forced"], points, frequency)
    sets = [_units(), _nodes(points), *(_response(case, node, frequency, row) for node, row in enumerate(values, 1))]
    with outputs.delivered(path) as temporary:
        pyuff.UFF(str(temporary)).write_sets(sets, "overwrite")
    return path


def _units() -> dict[str, Any]:
    """Dataset 164: SI units."""
    factors = {"length": 1.0, "force": 1.0, "temp": 1.0, "temp_offset": 273.15}
    return {"type": 164, "units_code": 1, "units_description": "SI units", "temp_mode": 1} | factors


def _nodes(points: Any) -> dict[str, Any]:
    zero = [0] * len(points)
    numbers = list(range(1, len(points) + 1))
    place = {"x": points[:, 0].tolist(), "y": points[:, 1].tolist(), "z": [0.0] * len(points)}
    return {"type": 15, "node_nums": numbers, "def_cs": zero, "disp_cs": zero, "color": zero} | place


def _response(case: Case, node: int, frequency: Any, values: Any) -> dict[str, Any]:
    return {
        "type": 58,
        "binary": 0,
        "func_type": FREQUENCY_RESPONSE,
        "id1": f"{case.name}: u_z per volt on the patches"[:REAL_LENGTH],
        "rsp_node": node,
        "rsp_dir": UP,
        "ref_node": 0,
        "ref_dir": 0,
        "rsp_ent_name": "touch face",
        "ref_ent_name": "patches",
        "data": values,
        "x": np.asarray(frequency, dtype=float),
        "abscissa_spec_data_type": FREQUENCY,
        "ordinate_spec_data_type": DISPLACEMENT,
        "ordinate_axis_units_lab": "m",
        "orddenom_spec_data_type": UNKNOWN,
        "orddenom_axis_units_lab": "V",
    }


# -- impedance ---------------------------------------------------------------------------------------------------------
# The load of an amplifier: the patches' impedance over frequency, as a Touchstone file (.s1p) or CSV.

REFERENCE_OHM = 50.0
POINTS = 801


def impedance(case: Case, path: Path, log: Log) -> Path:
    """Compute the impedance of the driven patches in parallel, sensors open, and write it in the format of the ending."""
    from pipeline.models.forced import forced_plate
    from solvers.piezo.responses import admittance

    case.require("patches", command="export impedance")
    forced = forced_plate(case, log, None, [])
    frequency = np.linspace(*forced.band_hz, POINTS)
    ohm = 1.0 / admittance(forced, frequency)
    outputs.write_file(
        path, (touchstone if path.suffix.lower() == ".s1p" else impedance_table)(frequency, ohm).encode()
    )
    return path


def touchstone(frequency_hz: Any, impedance_ohm: Any) -> str:
    """Write the reflection S11 of one port with a reference of 50 ohm, as real and imaginary parts."""
    reflection = (impedance_ohm - REFERENCE_OHM) / (impedance_ohm + REFERENCE_OHM)
    lines = ["! driven patches of a plate in parallel, without dielectric losses", f"# Hz S RI R {REFERENCE_OHM:g}"]
    lines += [f"{f:.6f} {s.real:.12e} {s.imag:.12e}" for f, s in zip(frequency_hz, reflection, strict=True)]
    return "\n".join(lines) + "\n"


def impedance_table(frequency_hz: Any, impedance_ohm: Any) -> str:
    """Write the impedance as resistance and reactance."""
    head = ("frequency_Hz", "resistance_ohm", "reactance_ohm")
    rows = ((f"{f:.6f}", f"{z.real:.9e}", f"{z.imag:.9e}") for f, z in zip(frequency_hz, impedance_ohm, strict=True))
    return outputs.csv_bytes(head, rows).decode()


ONE_FILE: dict[str, Callable[[Case, Path, Log], Path]] = {
    "phonopy": phonopy,
    "paraview": paraview,
    "xdmf": xdmf,
    "driven": driven,
    "uff": uff,
    "impedance": impedance,
}
OF_MESHES: dict[str, Callable[[Case, Path, Log, UserMesh], Path]] = {
    "vtu": surface_vtu,
    "paraview": paraview,
    "xdmf": xdmf,
}  # of a mesh file
