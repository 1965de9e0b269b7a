"""Files for other programs: print and CAD files with their check, meshes with modes, mode tables."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.case.features import GROUPS, LARGER, OF_A_PLATE, OUTLINE, ZONES
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.target import verdict_text
from pipeline.records import outputs

if TYPE_CHECKING:
    from pipeline.models.user_mesh import UserMesh

CAD = ("stl", "step", "3mf")
SOLVER_FILES = ("aster", "calculix")
WHOLE = (*SOLVER_FILES, "vtu", "paraview", "xdmf")  # of modes or meshes: of plates of any outline
ONE_FILE = ("phonopy", "paraview", "xdmf", "uff", "impedance")  # functions of `results`
OF_MESHES = {"vtu": "surface_vtu", "paraview": "paraview", "xdmf": "xdmf"}  # functions of `results` for a mesh file
ENDINGS = {  # allowed endings of a file, the first one by default; "": common stem of several files
    "stl": (".stl",),
    "step": (".step", ".stp"),
    "3mf": (".3mf",),
    "aster": ("", ".med", ".comm", ".export"),
    "calculix": ("", ".inp"),
    "vtu": (".vtu",),
    "paraview": (".vtkhdf", ".hdf"),
    "xdmf": (".xdmf", ".xmf"),
    "phonopy": (".yaml", ".yml"),
    "uff": (".uff", ".unv"),
    "impedance": (".s1p", ".csv"),
    "table": (".bin", ".h", ""),
}
WORDS = {".s1p": ".s1p (Touchstone)"}


def write(
    case: Case, form: str, output: str | None, log: Log, part: str = "plate", force: bool = False,
    own: UserMesh | None = None,
) -> list[Path]:  # fmt: skip
    """Write one format; returns the files written. Parts other than the plate go to finite-element programs only.

    `force`: write a mode table even without a target mode. own: a mesh file to solve instead of the plate.
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
    outputs.check_files("-o", places(form, output if output == "" else path))
    if output is not None:
        _check_ending(form, path)
    if own:
        return [getattr(import_module("pipeline.exchange.results"), OF_MESHES[form])(case, path, log, own)]
    if form in SOLVER_FILES:
        written: list[Path] = getattr(import_module("pipeline.exchange.finite_elements"), form)(case, part, path, log)
        return written
    if form in ONE_FILE:
        return [getattr(import_module("pipeline.exchange.results"), form)(case, path, log)]
    if form in CAD:
        return [_cad(case, form, path, log)]
    return _vtu(case, path, log) if form == "vtu" else _table(case, path, log, force)


def _require(case: Case, form: str, part: str) -> None:
    """Raise InputError for a case that lacks what is to be written, or that the format cannot honour."""
    command = f"export {form}"
    of_plate = form != "phonopy" and part == "plate"
    honours = OF_A_PLATE if form in CAD or not of_plate else (LARGER, OUTLINE) if form in WHOLE else (LARGER,)
    case.refuse(command, honours)
    if of_plate:
        case.require_plate(command)
        return
    case.require(*(("plate", "zone") if part == "zone" else ("pillar",)), command=command)


def _check_ending(form: str, path: Path) -> None:
    """Raise InputError for a file name whose ending does not match the format."""
    if outputs.is_standard_output(path) or (path.exists() and not path.is_file()):
        return
    allowed = ENDINGS[form]
    if path.suffix.lower() not in allowed:
        *others, last = (WORDS.get(each, each) for each in allowed if each)
        listed = f"{', '.join(others)} or {last}" if others else last
        raise InputError(f"-o {path}: must end in {listed}{', or have no ending' * ('' in allowed)}")


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
    return write_table(case, part_modes, index, path.parent, path.stem, log)
