"""Unit cell of a user's mesh: sides tied by Bloch's conditions, reduced or solved whole, extrapolated from two meshes.

The error of the finer mesh goes as h^q. With q at least 1, that of the strongest singularity of elasticity, a crack's, the
frequencies f of two meshes whose elements differ by a factor r put the exact one between f and f - |df| / (r - 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.errors import MeshError
from geometry.materials import Material
from geometry.mesh import AnyMesh, cell_volumes
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.bands import SolvedBands, bands_of_cell
from pipeline.models.unit_cell import largest_of_alike
from pipeline.models.user_mesh import UserMesh, read_bodies
from pipeline.quantity import MM, figure, percent
from solvers.accuracy.reduction import STILL, ModeErrors
from solvers.errors import SolverError
from solvers.fem.assembly import assemble
from solvers.plates.own_cell import body_of
from solvers.plates.sampled import SampledLattice, sampled_lattice
from solvers.superelement.interface import Interface
from solvers.waves.bloch import BlochCell, periodic_nodes, sides

FINER = 1.2  # times smaller at least must the elements of the finer mesh be, along every axis, everywhere
SAME_BODY = 0.01  # of the size along an axis, and of the volume: two meshes of one cell agree that well
FACE = Interface(12, 4)  # boundary functions of a reduced cell
TRUNCATED = 1e-6  # relative change of a frequency by the reduction above which the mesh is solved whole
MIN_DOF, MIN_WAVEVECTORS = 4000, 9  # the reduction takes longer than fewer solves of a smaller mesh
SAMPLES = 3  # wavevectors sampled per segment of the path
GRID = 4  # intervals of the grid that is checked over the zone
UPPER = (np.sqrt(2.0), np.pi)  # wavevectors on one side of this direction: those on the other have the same waves
BLOCKS = 3  # parts along each axis in which the sizes of elements are compared


@dataclass(frozen=True)
class Solvable:
    """A meshed cell, reduced or whole, and the relative truncation error of its frequencies."""

    mesh: AnyMesh
    cell: BlochCell | SampledLattice
    truncated: float = 0.0


@dataclass(frozen=True)
class OwnCell:
    """A cell, and a coarser mesh of it whose elements are `ratio` times as long; None without one to compare."""

    finer: Solvable
    coarser: Solvable | None
    ratio: float

    @property
    def mesh(self) -> AnyMesh:
        """The finer mesh."""
        return self.finer.mesh

    @property
    def dof(self) -> int:
        """Degrees of freedom per wavevector."""
        return self.finer.cell.dof

    @property
    def name(self) -> str:
        """Elements and their order."""
        reduced = ", reduced" if isinstance(self.finer.cell, SampledLattice) else ""
        return f"own cell {self.mesh.kind}{self.mesh.order}{reduced}"

    def solve(self, wavevector: FloatArray, count: int) -> tuple[FloatArray, ModeErrors]:
        """Solve the `count` lowest frequencies at a wavevector (2,) in rad/m; returns them in Hz, with their errors."""
        tones, none = self.finer.cell.frequencies(wavevector, count), np.zeros(count)
        moving = tones > STILL * tones[-1]
        lost = self.finer.truncated + (self.coarser.truncated / (self.ratio - 1.0) if self.coarser else 0.0)
        truncated = np.where(moving, lost, 0.0)
        if self.coarser is None:
            return tones, ModeErrors(truncated, none, none, none, np.full(count, np.nan))
        coarse = self.coarser.cell.frequencies(wavevector, count)
        rise = np.where(moving, coarse / np.where(moving, tones, 1.0) - 1.0, 0.0) / (self.ratio - 1.0)
        half = largest_of_alike(tones, np.abs(rise)) / 2.0
        best = tones * (1.0 - rise / 2.0)
        order = np.argsort(best, kind="stable")
        taken = rise / 2.0 / (1.0 - rise / 2.0)
        return best[order], ModeErrors(truncated, none, none, taken[order], half[order])

    def frequencies(self, wavevector: FloatArray, count: int) -> FloatArray:
        """Solve the frequencies alone."""
        return self.solve(wavevector, count)[0]


def solve_own_bands(case: Case, files: Sequence[UserMesh], log: Log) -> SolvedBands:
    """Compute the bands of a user's mesh of the cell along the case's path, with error bars from two meshes.

    Parameters
    ----------
    case : Case
        The case, with its lattice.
    files : sequence of UserMesh
        One or two meshes of the cell.
    log : Log
        Receives the progress.

    Returns
    -------
    SolvedBands
        Along the path.
    """
    cell = own_cell(case, files, log)
    return bands_of_cell(case, cell, cell.name, case.design.lattice, case.path(case.bands.points), log)


def own_cell(case: Case, files: Sequence[UserMesh], log: Log) -> OwnCell:
    """Read one or two meshes of a cell and tie their sides along the case's lattice; InputError for unsuitable ones."""
    cells = []
    for each in files:
        read, materials = read_bodies(case, each, log)
        try:
            periodic_nodes(read.mesh, case.design.lattice)
        except MeshError as fault:
            raise InputError(f"{each.file}: {fault}") from fault
        cells.append(_reduced(case, read.mesh, materials, log) or _whole(case, read.mesh, materials, log))
    if len(cells) == 1:
        return OwnCell(cells[0], None, compared([cells[0].mesh], [files[0].file], log))
    order = np.argsort([cell.mesh.dof for cell in cells], kind="stable").tolist()
    coarse, fine = (cells[place] for place in order)
    ratio = compared([coarse.mesh, fine.mesh], [files[place].file for place in order], log)
    return OwnCell(fine, coarse if np.isfinite(ratio) else None, ratio)


def _whole(case: Case, mesh: AnyMesh, materials: dict[str, Material], log: Log) -> Solvable:
    with log.step("assemble the cell"):
        return Solvable(mesh, BlochCell(assemble(mesh, materials), case.design.lattice))


def _reduced(case: Case, mesh: AnyMesh, materials: dict[str, Material], log: Log) -> Solvable | None:
    """Reduce a cell whose sides are faces of bare plate; None if it is faster or more accurate to solve it whole."""
    design, bands = case.design, case.bands
    if mesh.dof < MIN_DOF or (len(case.path(bands.points).wavevectors) < MIN_WAVEVECTORS and not bands.grid):
        return None
    try:
        thickness = float(np.ptp(mesh.nodes[sides(mesh, design.pitch_x_m)[0].nodes, 2]))
        body = body_of(mesh, materials, replace(design, thickness_m=thickness))
        with log.step("reduce the cell"):
            system, places = assemble(body.mesh, body.materials), _sampled_and_checked(case)
            reduced, error = sampled_lattice(system, body.limited(FACE), *places, bands.count, TRUNCATED, body.edges_m)
    except (MeshError, SolverError):  # other sides, or more boundary functions than the mesh can distinguish
        return None
    is_close = error <= TRUNCATED
    log.info(
        f"own cell: {mesh.dof} degrees of freedom on its mesh, {reduced.dof} per wavevector; truncation error of the bands "
        f"{percent(error)}{'' if is_close else ': the mesh is solved whole'}"
    )
    return Solvable(mesh, reduced, error) if is_close else None


def _sampled_and_checked(case: Case) -> tuple[FloatArray, FloatArray]:
    """Wavevectors (n, 2) in rad/m on the path to sample, and those between them and over half the zone to check."""
    path, finer = (case.path(points).wavevectors for points in (SAMPLES, 2 * SAMPLES))
    grid = case.design.lattice.grid(GRID, ()) if case.bands.grid else np.empty((0, 2))
    return np.unique(path, axis=0), np.vstack([finer[1::2], grid[grid @ UPPER >= 0.0]])


def compared(meshes: Sequence[AnyMesh], names: Sequence[str], log: Log) -> float:
    """Compare the elements of two meshes of a cell, the coarser first, and warn where they give no error bar.

    Parameters
    ----------
    meshes : sequence of AnyMesh
        One or two meshes.
    names : sequence of str
        Their files.
    log : Log
        Receives the warning.

    Returns
    -------
    float
        How many times smaller the elements of the finer one are at least; infinite where they give no error bar.

    Raises
    ------
    InputError
        For meshes of two bodies, or of two orders.
    """
    if len(meshes) == 1:
        log.warning("NO_ERROR_BAR", f"{names[0]}: no error bar: give a finer mesh, too, with a second --mesh-file")
        return np.inf
    coarse, fine = meshes
    _check_alike(coarse, fine, list(names))
    ratio, axis = _ratio(coarse, fine)
    if ratio < FINER:
        what = f"its elements along {axis} are {figure(ratio)} times smaller than those of {names[0]} somewhere"
        log.warning(
            "NO_ERROR_BAR", f"{names[1]}: no error bar: {what}, which must be at least {FINER:g} times everywhere"
        )
        return np.inf
    log.info(f"elements of {names[1]} are at least {figure(ratio)} times smaller than those of {names[0]}")
    return ratio


def _check_alike(coarse: AnyMesh, fine: AnyMesh, names: list[str]) -> None:
    """Raise InputError for meshes of two bodies, and for elements of two orders."""
    if coarse.order != fine.order:
        what = f"its elements are of order {fine.order}, those of {names[0]} of order {coarse.order}: must be one order"
        raise InputError(f"{names[1]}: {what}")
    sizes = [np.append(np.ptp(mesh.nodes, axis=0), _volume(mesh)) for mesh in (coarse, fine)]
    apart = np.abs(sizes[1] / sizes[0] - 1.0)
    if apart.max() > SAME_BODY:
        one, two = (" x ".join(figure(edge / MM) for edge in size[:3]) for size in sizes)
        what = f"is {two} mm, {names[0]} is {one} mm, their volumes differ by {percent(apart[3])}: must be one cell"
        raise InputError(f"{names[1]}: {what}")


def _volume(mesh: AnyMesh) -> float:
    return float(sum(cell_volumes(block).sum() for block in mesh.blocks))


def _ratio(coarse: AnyMesh, fine: AnyMesh) -> tuple[float, str]:
    """How many times smaller a mesh's elements are than a coarser one's, where least, and along which axis."""
    from scipy.spatial import cKDTree

    low, high = coarse.nodes.min(axis=0), coarse.nodes.max(axis=0)
    (middle, edges), (finer, finer_edges) = map(_elements, (coarse, fine))
    place = np.clip((BLOCKS * (middle - low) / (high - low)).astype(int), 0, BLOCKS - 1)
    block = np.unique(place, axis=0, return_inverse=True)[1].ravel()
    within = block[cKDTree(middle).query(finer)[1]]
    kept = np.unique(within)
    ratio = _means(edges, block)[kept] / _means(finer_edges, within)[kept]
    axis = int(np.argmin(ratio.min(axis=0)))
    return float(ratio.min()), "xyz"[axis]


def _elements(mesh: AnyMesh) -> tuple[FloatArray, FloatArray]:
    """Middles (e, 3) of elements, and their extents along the axes (e, 3), m."""
    ends = [mesh.nodes[block.cells] for block in mesh.blocks]
    return np.vstack([each.mean(axis=1) for each in ends]), np.vstack([np.ptp(each, axis=1) for each in ends])


def _means(values: FloatArray, group: IntArray) -> FloatArray:
    """Mean of values (e, 3) in each group (e,), (groups, 3); 0 where there are none."""
    size = np.maximum(np.bincount(group), 1)
    return np.column_stack([np.bincount(group, column) / size for column in values.T])
