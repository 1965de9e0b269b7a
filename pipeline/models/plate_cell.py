"""Own cells whose sides are faces of bare plate: reduced like the case's cell, so that waves decay across them and bare plate
goes on next to them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from geometry.elements import FloatArray
from geometry.errors import MeshError
from geometry.layout import Design, Pillar
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.cell_cache import CellCache
from pipeline.models.own_cell import compared
from pipeline.models.step_cell import reduced_body, step_body
from pipeline.models.unit_cell import CLEAR, LatticeModel, good_enough, largest_of_alike, own_pilot
from pipeline.models.user_mesh import UserMesh, read_bodies
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import SUPERELEMENT, ModelChoice, in_rows
from solvers.accuracy.reduction import STILL
from solvers.plates.own_cell import Body, OwnReductions, body_of
from solvers.superelement.interface import ReductionSettings
from solvers.superelement.lattice import ReducedLattice


def read_cells(case: Case, files: Sequence[UserMesh], log: Log) -> tuple[list[Body], float]:
    """Read one or two meshes of a cell, the finer first, and how many times longer the other's elements are.

    Parameters
    ----------
    case : Case
        The case, with its lattice and its plate.
    files : sequence of UserMesh
        One or two meshes of one cell.
    log : Log
        Receives the progress.

    Returns
    -------
    bodies : list of Body
        One where two cannot be compared.
    ratio : float
        Infinite for one.

    Raises
    ------
    InputError
        For a cell whose sides are not faces of bare plate.
    """
    found = []
    for each in files:
        read, materials = read_bodies(case, each, log)
        try:
            found.append(body_of(read.mesh, materials, case.design))
        except MeshError as fault:
            what = "bands --mesh-file takes any sides that pair"
            raise InputError(f"{each.file}: {fault} ({what})") from fault
    order = sorted(range(len(found)), key=lambda place: found[place].mesh.dof)
    ratio = compared([found[place].mesh for place in order], [files[place].file for place in order], log)
    bodies = [found[place] for place in reversed(order)]
    return (bodies, ratio) if np.isfinite(ratio) else (bodies[:1], ratio)


@dataclass(frozen=True)
class OwnRows:
    """Rows of an own cell next to the zone: the plate that has them, the cell, and the discretisation error of its bands.

    design: its pillars stand for the cells, as wide as a pitch, so that the zone's border is the side of the first cell.
    """

    design: Design
    body: Body
    mesh_error: float | None

    def reductions(self, reduction: ReductionSettings) -> OwnReductions:
        """Reductions of the cell and of bare panels, with as many boundary functions as the cell's mesh can hold."""
        face = self.body.limited(reduction.interface)
        most = max(min(reduction.further, self.body.held[1] - face.through), 0)
        held = replace(reduction, interface=face, further=most)
        return OwnReductions(
            self.design.stack, None, held, CellCache(), body=self.body, is_known=self.mesh_error is not None
        )


def in_own_vectors(case: Case, body: Body) -> Case:
    """Return the case with the vectors along the sides of an oblique cell as those of its lattice, and pitches of its rows.

    Parameters
    ----------
    case : Case
        The case.
    body : Body
        The cell.

    Returns
    -------
    Case
        The case itself for a rectangular cell.
    """
    if body.edges_m is None:
        return case
    (x1, y1), (x2, y2) = body.edges_m.tolist()
    return in_rows(case, ((x1, y1), (x2, y2)))


def plate_cell(case: Case, bodies: Sequence[Body], ratio: float, log: Log, high_hz: float) -> LatticeModel:
    """Reduce an own cell so that its bands, and its waves up to a frequency, meet the accuracy.

    Parameters
    ----------
    case : Case
        The case.
    bodies : sequence of Body
        The cell, and a coarser mesh of it if there is one.
    ratio : float
        How many times longer the elements of the coarser mesh are.
    log : Log
        Receives the progress.
    high_hz : float
        Highest frequency in Hz.

    Returns
    -------
    LatticeModel
        Its discretisation error from both meshes: the change of a frequency over the ratio less one, as for an error that
        falls with the first power of the element size.
    """
    corners, count, design = case.path(1).corners, case.bands.count, replace(case.design, pillar=None)
    reduce = partial(reduced_body, case, bodies[0], log)
    pilot, first = own_pilot(case, bodies[-1], mesh_rules.lattice_reduction(design, case.solve.accuracy), log)
    settled = good_enough(reduce, pilot, first, corners, case, log, CLEAR * high_hz)
    reduction, lattice, bar, truncated, beyond = settled
    by_mesh = bar[0]
    if len(bodies) > 1:
        other = ReducedLattice(pilot.reduce(reduction))
        by_mesh = max(_change(lattice, other, k, count) for k in corners) / (ratio - 1.0)
    mesh = bodies[0].mesh
    choice = ModelChoice("cell", SUPERELEMENT, None, None, reduction, False, (), (), np.inf)
    name = f"{SUPERELEMENT} {mesh.kind}{mesh.order} of an own cell"
    return LatticeModel(name, lattice, truncated, beyond, by_mesh, choice)


def own_rows(case: Case, files: Sequence[UserMesh], log: Log, high_hz: float) -> OwnRows:
    """Read the meshes of a cell and lay its rows out next to the zone.

    Parameters
    ----------
    case : Case
        The case.
    files : sequence of UserMesh
        One or two meshes of one cell.
    log : Log
        Receives the progress.
    high_hz : float
        Highest frequency in Hz.

    Returns
    -------
    OwnRows
        With the discretisation error of the cell's bands, if there are two meshes.
    """
    bodies, ratio = read_cells(case, files, log)
    known = plate_cell(case, bodies, ratio, log, high_hz).mesh_error if len(bodies) > 1 else None
    return _laid_out(case, bodies[0], known)


def step_rows(case: Case, edge_m: float, log: Log) -> OwnRows:
    """Mesh the cell of a STEP file and lay its rows out next to the zone.

    Parameters
    ----------
    case : Case
        The case.
    edge_m : float
        Edge length of the tetrahedra in m.
    log : Log
        Receives the progress.

    Returns
    -------
    OwnRows
        Stress recovery gives the discretisation error of its cells.
    """
    return _laid_out(case, step_body(case, edge_m, log), 0.0)


def _laid_out(case: Case, body: Body, known: float | None) -> OwnRows:
    design = in_own_vectors(case, body).design
    place = Pillar("square", design.pitch_y_m, design.pitch_y_m, design.thickness_m, design.material)
    return OwnRows(replace(design, pillar=place, graded=(), graded_pitches_m=(), cell_file=None), body, known)


def _change(fine: ReducedLattice, coarse: ReducedLattice, wavevector: FloatArray, count: int) -> float:
    """Largest relative change of the lowest frequencies between two meshes."""
    tones, others = (lattice.frequencies(wavevector, count) for lattice in (fine, coarse))
    moving = tones > STILL * tones[-1]
    rise = np.where(moving, np.abs(others / np.where(moving, tones, 1.0) - 1.0), 0.0)
    return float(largest_of_alike(tones, rise).max())
