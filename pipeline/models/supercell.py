"""Supercells: the case's own cell repeated, with some pillars changed or left out, joined from reduced cells."""

from __future__ import annotations

from dataclasses import dataclass, replace

from geometry.elements import FloatArray
from geometry.lattice import Lattice
from pipeline.case.defects import Defect
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.bands import SolvedBands, bands_of_cell
from pipeline.models.unit_cell import lattice_model, reduced_cell
from pipeline.planning.model_choice import ModelChoice, in_vectors
from solvers.accuracy.reduction import ModeErrors, waves_of
from solvers.superelement.lattice import Periodic

MAX_DOF = 5000  # degrees of freedom per wavevector: dense complex matrices of 400 MB each


@dataclass(frozen=True)
class Supercell:
    """Reduced cells joined to a larger one, and the name of their model."""

    cells: Periodic
    name: str

    @property
    def dof(self) -> int:
        """Degrees of freedom per wavevector."""
        return self.cells.dof

    def solve(self, wavevector: FloatArray, count: int) -> tuple[FloatArray, ModeErrors]:
        """Solve the `count` lowest frequencies at a wavevector (2,) in rad/m; returns them in Hz, with their errors.

        The bars are those of the waves before the discarded modes couple them, which lie above the exact ones.
        """
        errors = waves_of(self.cells, wavevector, count)[1]
        return self.frequencies(wavevector, count), errors

    def frequencies(self, wavevector: FloatArray, count: int) -> FloatArray:
        """Solve the frequencies alone."""
        return self.cells.at(wavevector).softened(count)


def repeated(lattice: Lattice, size: tuple[int, int]) -> Lattice:
    """Return the lattice of supercells of some cells along a1 and a2."""
    (ax, ay), (bx, by), (n, m) = lattice.a1_m, lattice.a2_m, size
    return Lattice((n * ax, n * ay), (m * bx, m * by))


def in_one_cell(case: Case) -> Case:
    """Return the case with its cell along the vectors of its lattice: panels of shifted rows cannot be repeated alone.

    Parameters
    ----------
    case : Case
        Any case.

    Returns
    -------
    Case
        The case itself without shifted rows.
    """
    lattice = case.design.lattice
    return in_vectors(case, (lattice.a1_m, lattice.a2_m)) if case.design.stagger else case


def check_places(case: Case, size: tuple[int, int]) -> None:
    """Raise InputError for a defect outside the supercell."""
    for number, each in enumerate(case.defects):
        if not all(place < count for place, count in zip(each.at, size, strict=True)):
            last = f"[{size[0] - 1}, {size[1] - 1}]"
            what = f"must be a cell of the supercell {size[0]}x{size[1]}, from [0, 0] to {last}"
            raise InputError(f"{case.source or case.name}: defect.{number}.at = {list(each.at)}: {what}")


def solve_supercell_bands(case: Case, choice: ModelChoice, size: tuple[int, int], log: Log) -> SolvedBands:
    """Compute the bands of a supercell along the path of its own lattice, folded where no pillar differs.

    Parameters
    ----------
    case : Case
        The case, with its defects.
    choice : ModelChoice
        Model and mesh of its own cell.
    size : tuple of int
        Cells along a1 and a2.
    log : Log
        Receives the progress.

    Returns
    -------
    SolvedBands
        Along the path of `[bands]`, or else along the border of the supercell's zone.
    """
    case = in_one_cell(case)
    cell, lattice = supercell(case, choice, size, log), repeated(case.design.lattice, size)
    path = case.path(case.bands.points, lattice, None if "bands.path" in case.given else lattice.default_path)
    return bands_of_cell(case, cell, cell.name, lattice, path, log)


def supercell(case: Case, choice: ModelChoice, size: tuple[int, int], log: Log) -> Supercell:
    """Reduce the case's own cell as `bands` does, the changed ones alike, and join them.

    Raises InputError if there are too many.
    """
    corners = case.path(case.bands.points).corners
    model = lattice_model(case, choice, corners, log, [])
    total = size[0] * size[1] * model.lattice.dof
    if total > MAX_DOF:
        what = f"{total} degrees of freedom per wavevector, at most {MAX_DOF}: fewer cells, or a higher solve.accuracy"
        raise InputError(f"{case.source or case.name}: --supercell {size[0]}x{size[1]}: {what}")
    cells = [model.lattice.cell] * (size[0] * size[1])
    for each in case.defects:
        cells[each.at[0] + size[0] * each.at[1]] = reduced_cell(_changed(case, each), model.choice, log)
    log.info(f"supercell: {size[0]} x {size[1]} cells, {len(case.defects)} of them changed")
    name = f"supercell {size[0]}x{size[1]} of {model.name}"
    return Supercell(Periodic(cells, rows=size[1]), name)


def _changed(case: Case, defect: Defect) -> Case:
    return replace(
        case, design=replace(case.design, pillar=defect.pillar, rows=case.design.rows if defect.pillar else 0)
    )
