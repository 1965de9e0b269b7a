"""The unit cell of a case's STEP file: meshed, with the material of each body, and reduced."""

from __future__ import annotations

from pathlib import Path

from geometry.errors import GeometryError, MeshError
from geometry.tiling import Panel
from pipeline.case.model import Case
from pipeline.case.reading import nearest
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.parts import warn_of_locking
from solvers.plates.own_cell import Body, OwnReductions, body_of, oblique_rows
from solvers.superelement.cell import Cell
from solvers.superelement.interface import ReductionSettings
from solvers.superelement.lattice import ReducedLattice


def step_body(case: Case, edge_m: float, log: Log) -> Body:
    """Mesh the cell of the case's STEP file.

    Parameters
    ----------
    case : Case
        The case, with its cell.
    edge_m : float
        Largest edge length of the tetrahedra in m.
    log : Log
        Receives the progress.

    Returns
    -------
    Body
        Stress recovery corrects its discretisation error.

    Raises
    ------
    InputError
        For a file that cannot be read, sides that are not faces of bare plate, and names that no body has.
    """
    from geometry.cad.step_cell import step_cell
    from geometry.tet.scenes import tet_step_cell

    design, file = case.design, case.design.cell_file
    pitches = design.pitch_x_m, design.pitch_y_m
    assert file
    where = f"{case.source or case.name}: cell.file = {Path(file).name!r}"
    try:
        rows = oblique_rows(design)
        with log.step("read the cell"):
            solid = step_cell(file, (None, rows[1][1]) if rows else pitches, design.thickness_m)
        given = {name.casefold(): material for name, material in case.group_materials}
        _check_names(case, solid.regions)
        with log.step("mesh the cell with tetrahedra"):
            mesh = tet_step_cell(solid, edge_m)
        materials = {name: given.get(name.casefold(), design.stack.back) for name in solid.regions}
        body = body_of(mesh, materials, design, estimated=True)
    except (GeometryError, MeshError) as fault:
        raise InputError(f"{where}: {str(fault).removeprefix(f'{file}: ')}") from fault
    log.info("bodies of the cell: " + ", ".join(f"{name}: {material.name}" for name, material in materials.items()))
    warn_of_locking(design, mesh, log)
    return body


def _check_names(case: Case, regions: tuple[str, ...]) -> None:
    """Raise InputError for a material of a body that the file does not have."""
    known = {name.casefold() for name in regions}
    unknown = [name for name, _ in case.group_materials if name.casefold() not in known]
    if unknown:
        there = f"it has {', '.join(regions)}"
        raise InputError(
            f"{case.source or case.name}: [materials] {name}: no such body of cell.file{nearest(name, regions)}; {there}"
            for name in unknown
        )


def reduced_body(case: Case, body: Body, log: Log, reduction: ReductionSettings) -> Cell:
    """Reduce a cell whose sides are faces of bare plate.

    Parameters
    ----------
    case : Case
        The case.
    body : Body
        The meshed cell.
    log : Log
        Receives the progress.
    reduction : ReductionSettings
        Boundary functions and cut-off.

    Returns
    -------
    Cell
        The reduced cell.
    """
    design = case.design
    with log.step("reduce the own cell"):
        reductions = OwnReductions(design.stack, None, reduction, lossy=case.is_lossy, body=body)
        half_x, half_y = design.pitch_x_m / 2.0, design.pitch_y_m / 2.0
        cell = reductions.cell(Panel((-half_x, -half_y), (half_x, half_y), (0.0, 0.0)))
    log.info(f"own cell: {body.mesh.dof} degrees of freedom on its mesh, {ReducedLattice(cell).dof} per wavevector")
    return cell
