"""Unit cell of an array: reduced, with an estimate of its own error, or whole with Bloch's conditions.

The whole cell is an independent check: no symmetry, no reduction, inertia counts, and two coarser meshes for its error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import cell_boxes, hex_mesh, interpolation
from geometry.hex.panels import square_of
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, region_materials
from geometry.mesh import Mesh
from geometry.tiling import lattice_panel
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models.cell_cache import CellCache
from pipeline.models.parts import foot_shares, mesh_record, tet_cell
from pipeline.models.prestress import warn_of_free_cell
from pipeline.planning import mesh_rules, resource_estimate
from pipeline.planning.model_choice import ORDER, SUPERELEMENT, ModelChoice, cell_model_choice, coarse_settings
from pipeline.planning.refinement import describe_change, higher_degree, more_modes, on_finer_meshes
from pipeline.planning.resources import ResourceEstimate
from pipeline.quantity import percent
from pipeline.records.record import MeshRecord
from solvers.accuracy.mesh import ErrorFractions, Nested, prolonged_eigenvalues
from solvers.accuracy.reduction import (
    STILL,
    ModeErrors,
    ReductionError,
    cutoff_hz,
    error_of_waves,
    further_degrees,
    in_order,
    last_degree_through,
    mesh_error,
    reduction_error,
    truncation,
    truncation_bars,
)
from solvers.errors import SolverError
from solvers.fem.assembly import assemble
from solvers.fem.eigen import PlainPencil, lowest_pairs
from solvers.fem.prestress import with_free_stress
from solvers.plates.assembled import Reductions
from solvers.superelement.cell import Cell
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import ReducedLattice, Waves
from solvers.waves.bloch import BlochCell

if TYPE_CHECKING:
    from solvers.plates.own_cell import Body

ROUNDS = 8
MARGIN = 0.3  # of the accuracy: the rest is for discretisation, and for the difference between coarse and fine mesh
THICK = 0.3  # of the pitch: no thinner plate needed a fourth degree through its thickness
MAX_THROUGH = 6
CLEAR = 3.0  # times the highest frequency: residual flexibility represents modes discarded above it to one sixteenth
THROUGH = 0.35  # of the accuracy: the next degree through the thickness costs another element through the plate
BY_MODES = 0.5  # of the truncation error: modes are cheaper than degrees
MAX_BY_MESH = 0.8  # of the accuracy: above it, a finer mesh is cheaper than the small rest for truncation
AIM = 0.7  # of the error allowed to truncation
COARSER = 1.5  # times longer edges of the tetrahedra on which the reduction of a STEP file's cell is chosen
MAX_DOF = 400  # per wavevector: beyond it, a dense solve costs more than the accuracy is worth
Reduce = Callable[[ReductionSettings], Cell]
Bar = tuple[float | None, float]  # relative discretisation error (None if unknown) and truncation error


@dataclass(frozen=True)
class LatticeModel:
    """A lattice of reduced cells with its largest relative truncation error, the part of it beyond the degree through the
    thickness, and its discretisation error at the corners of the path (None without a coarser mesh).
    """

    name: str
    lattice: ReducedLattice
    reduction_error: float
    beyond: float
    mesh_error: float | None
    choice: ModelChoice  # with the final reduction

    def truncation(self, waves: Sequence[Waves], count: int) -> FloatArray:
        """Relative truncation errors of the lowest bands, (wavevectors, bands)."""
        return truncated_bars(self.lattice, waves, count, self.beyond)


def lattice_model(
    case: Case,
    choice: ModelChoice,
    corners: FloatArray,
    log: Log,
    meshes: list[MeshRecord],
    finer: bool = True,
    high_hz: float = 0.0,
    parted: bool = False,
) -> LatticeModel:
    """Reduce the cell so that its bands at the corners (n, 2) of the path meet the accuracy; warn if they do not.

    finer: refine the mesh if its error exceeds the accuracy; high_hz: highest frequency needed in addition to the bands;
    parted: with the stiffness of each material.
    """
    if case.design.is_stressed:
        warn_of_free_cell(log)
    reduction = choice.reduction or mesh_rules.lattice_reduction(case.design, case.solve.accuracy)
    reduce = _reducer(choice, case, log, meshes, parted)
    if case.design.cell_file:
        pilot, reduction = _coarser_pilot(case, choice, reduction, log)
    else:
        pilot = _coarse_pilot(case.design, case.bands.count)
    reduction, lattice, bar, error, beyond = good_enough(reduce, pilot, reduction, corners, case, log, CLEAR * high_hz)
    choice = replace(choice, reduction=reduction, hexahedra=reduction.hexahedra)

    def on_mesh(choice: ModelChoice) -> tuple[ReducedLattice, Bar]:
        assert choice.reduction
        own: list[MeshRecord] = []
        lattice = ReducedLattice(_reducer(choice, case, log, own, parted)(choice.reduction))
        meshes[:] = own  # replaces the first mesh once this one is solved
        return lattice, widest_bar(lattice, _solved(lattice, corners, case), case.bands.count, beyond)

    def demand(choice: ModelChoice) -> ResourceEstimate:
        return resource_estimate.of_finer_mesh(case, choice, len(corners))

    first = choice, (lattice, bar)
    choice, (lattice, bar) = (
        on_finer_meshes(first, lambda built: built[1], on_mesh, demand, case, log) if finer else first
    )
    return LatticeModel(replace(choice, model=SUPERELEMENT).name, lattice, error, beyond, bar[0], choice)


def _solved(lattice: ReducedLattice, wavevectors: FloatArray, case: Case) -> list[Waves]:
    """Lowest waves at wavevectors (n, 2)."""
    return [lattice.waves(k, case.bands.count) for k in wavevectors]


def widest_bar(lattice: ReducedLattice, waves: Sequence[Waves], count: int, beyond: float) -> Bar:
    """Largest error bar of the lowest bands: discretisation error (None without a coarser mesh) and truncation error."""
    truncated = truncated_bars(lattice, waves, count, beyond)
    if lattice.cell.mesh_error is None:
        return None, float(truncated.max())
    by_mesh = np.array([mesh_error(lattice.cell, each).half_width[:count] for each in waves])
    worst = np.unravel_index(np.argmax(by_mesh + truncated), by_mesh.shape)
    return float(by_mesh[worst]), float(truncated[worst])


def truncated_bars(lattice: ReducedLattice, waves: Sequence[Waves], count: int, beyond: float) -> FloatArray:
    """Relative truncation errors of the lowest bands, (wavevectors, bands)."""
    estimates = [truncation(lattice, each) for each in waves]
    modes = np.array([each[:count] for each, _ in estimates])
    last = np.array([in_order(own, parts[-1])[:count] for own, (_, parts) in zip(waves, estimates, strict=True)])
    return modes + truncation_bars(last, further_degrees([parts[:, :count] for _, parts in estimates])) + beyond


def _reducer(choice: ModelChoice, case: Case, log: Log, meshes: list[MeshRecord], parted: bool = False) -> Reduce:
    """Return the function that reduces the cell on the mesh of a choice; the record of tetrahedra is added to `meshes`."""
    design = case.design
    if design.cell_file:
        return _own_reducer(choice, case, log, meshes)
    mesh, halved = tet_cell(design, choice.edge_m, log) if choice.edge_m else (None, ())
    panel = replace(lattice_panel(design), halved=halved) if mesh else lattice_panel(design)
    if mesh:
        meshes.append(mesh_record("cell", mesh))

    def reduce(reduction: ReductionSettings) -> Cell:
        cache, mesher = (None, lambda _: mesh) if mesh else (CellCache(), None)
        reductions = Reductions(design.stack, design.pillar, reduction, cache, mesher, "", case.is_lossy, parted)
        with log.step("reduce the cell"):
            cell = reductions.cell(panel)
        source = "reduced" if reductions.fresh else "loaded from the cache"
        more = "opposite faces need not match" if mesh else source
        size, dof = mesh.dof if mesh else cell.mesh_dof, ReducedLattice(cell).dof
        log.info(f"unit cell: {size} degrees of freedom on its mesh, {dof} per wavevector; {more}")
        return cell

    return reduce


def _own_reducer(choice: ModelChoice, case: Case, log: Log, meshes: list[MeshRecord]) -> Reduce:
    """Return the function that reduces the cell of the case's STEP file."""
    from pipeline.models.step_cell import reduced_body, step_body

    assert choice.edge_m
    body = step_body(case, choice.edge_m, log)
    meshes.append(mesh_record("cell", body.mesh))
    return partial(reduced_body, case, body, log)


def _coarser_pilot(
    case: Case, choice: ModelChoice, reduction: ReductionSettings, log: Log
) -> tuple[Pilot, ReductionSettings]:
    """Lattices of a coarser mesh of the case's STEP file, and the first settings that it can hold."""
    from pipeline.models.step_cell import step_body

    assert choice.edge_m
    body = replace(step_body(case, COARSER * choice.edge_m, log), estimated=False)
    return own_pilot(case, body, reduction, log)


def own_pilot(case: Case, body: Body, reduction: ReductionSettings, log: Log) -> tuple[Pilot, ReductionSettings]:
    """Prepare to choose the reduction of an own cell on one mesh of it.

    Parameters
    ----------
    case : Case
        The case.
    body : Body
        A mesh of the cell.
    reduction : ReductionSettings
        First settings.
    log : Log
        Receives the progress.

    Returns
    -------
    pilot : Pilot
        Lattices of the mesh.
    reduction : ReductionSettings
        The first settings, with no higher degrees than the mesh can hold.
    """
    from pipeline.models.step_cell import reduced_body

    face, (along, through) = body.limited(reduction.interface), body.held
    pilot = Pilot(partial(reduced_body, case, body, log), through > face.through, along, through)
    return pilot, replace(reduction, interface=face)


def reduced_cell(case: Case, choice: ModelChoice, log: Log) -> Cell:
    """Reduce the cell of a case with the settings of another one of the same lattice.

    Parameters
    ----------
    case : Case
        The case.
    choice : ModelChoice
        Mesh and reduction of the other one.
    log : Log
        Receives the progress.

    Returns
    -------
    Cell
        With the same boundary functions.
    """
    assert choice.reduction
    own = cell_model_choice(case)
    needs_cad = own.edge_m if choice.edge_m is None or case.design.pillar is None else choice.edge_m
    return _reducer(replace(choice, edge_m=needs_cad), case, log, [])(choice.reduction)


class Pilot:
    """Lattices of a coarse cell, fast and with nearly the truncation error of the fine cell, for many settings.

    The cell is reduced with finer settings than needed, and its matrices contain those of the coarser settings.
    along, through: highest degrees that its mesh can hold.
    """

    def __init__(self, reduce: Reduce, is_thick: bool, along: int = MAX_DOF, through: int = MAX_DOF) -> None:
        self.reduce, self.is_thick, self.along, self.through = reduce, is_thick, along, through
        self._whole: ReducedLattice | None = None
        self._top_hz = 0.0

    def lattice(self, reduction: ReductionSettings) -> ReducedLattice:
        """Return the coarse cell reduced with these settings."""
        if self._whole is None or not self._holds(self._whole.cell.interface, reduction):
            face = reduction.interface
            along, through = min(face.along + 1, self.along), min(face.through + self.is_thick, self.through)
            ample = replace(face, along=max(along, face.along), through=max(through, face.through))
            self._top_hz = reduction.top_hz
            self._whole = ReducedLattice(self.reduce(replace(reduction, interface=ample)))
        return self._whole.up_to(reduction.interface, reduction.top_hz)

    def _holds(self, face: Interface, reduction: ReductionSettings) -> bool:
        interface = reduction.interface
        return interface.along <= face.along and interface.through <= face.through and reduction.top_hz <= self._top_hz


def _coarse_pilot(design: Design, count: int) -> Pilot:
    """Coarse cell whose pillar is a box."""
    thick = design.thickness_m >= THICK * max(design.pitch_x_m, design.pitch_y_m)
    box = square_of(design.pillar) if design.pillar and not design.oblique_m else design.pillar

    def reduce(reduction: ReductionSettings) -> Cell:
        through = ceil(reduction.interface.through / ORDER)  # gives one node more through the plate than the degree
        coarse = coarse_settings(design, count, through)
        reductions = Reductions(design.stack, box, replace(reduction, hexahedra=coarse), CellCache())
        return reductions.cell(lattice_panel(replace(design, pillar=box)))

    return Pilot(reduce, thick or mesh_rules.is_tight(design) or not design.stack.is_uniform)


def _piloted(
    pilot: Pilot,
    reduction: ReductionSettings,
    corners: FloatArray,
    count: int,
    allowed: float,
    log: Log,
    least_hz: float,
) -> ReductionSettings:
    """Choose degrees and number of modes on a coarse mesh of the cell; the cut-off is at least least_hz."""
    level = reduction
    with (
        log.step("choose degrees and modes on a coarse cell"),
        suppress(SolverError),
    ):  # raised if the coarse mesh has too few degrees of freedom
        for _ in range(ROUNDS):
            fewer = cutoff_hz(pilot.lattice(reduction), corners, count, BY_MODES * allowed)
            level = replace(reduction, top_hz=max(min(reduction.top_hz, fewer), least_hz))
            lattice = pilot.lattice(level)
            error = reduction_error(lattice, corners, count)
            reduction = level if error.total <= allowed else _raised(level, lattice, error, allowed)
            if reduction == level:
                break
    return level


def _thick_enough(
    pilot: Pilot, reduction: ReductionSettings, corners: FloatArray, count: int, allowed: float, log: Log
) -> tuple[ReductionSettings, float]:
    """Raise the degree through the thickness until the next one changes a coarse cell by at most `allowed`; returns the change.

    The contribution of a degree falls exponentially; a plate much thinner than its pitch moves almost linearly through it.
    """
    if not pilot.is_thick:
        return reduction, 0.0
    error, face = 0.0, reduction.interface
    with log.step("choose the degree through the thickness on a coarse cell"):
        for through in range(face.through, min(MAX_THROUGH, pilot.through - 1) + 1):
            trial = replace(reduction, interface=replace(face, through=through + 1))
            error = last_degree_through(pilot.lattice(trial), corners, count)
            if error <= allowed or through == min(MAX_THROUGH, pilot.through - 1):
                break
    if through == face.through:
        return reduction, error
    log.info(
        f"degree through the thickness: {through} instead of {face.through}; higher ones would change {percent(error)}"
    )
    finer = replace(reduction, interface=replace(face, through=through))
    return replace(finer, hexahedra=mesh_rules.with_nodes_for(finer.interface, finer.hexahedra)), error


def good_enough(
    reduce: Reduce, pilot: Pilot, reduction: ReductionSettings, corners: FloatArray, case: Case, log: Log,
    least_hz: float,
) -> tuple[ReductionSettings, ReducedLattice, Bar, float, float]:  # fmt: skip
    """Reduce with the settings of the coarse cell, and again if truncation exceeds its share of the accuracy.

    Returns settings and lattice, the largest error bar, the truncation error, and its part beyond the degree through the
    thickness.
    """
    count, accuracy = case.bands.count, case.solve.accuracy
    advised = _piloted(pilot, reduction, corners, count, MARGIN * accuracy, log, least_hz)
    if advised != reduction:
        log.info(f"reduction for {count} bands within {percent(accuracy)}: {describe_change(reduction, advised)}")
    advised, beyond = _thick_enough(pilot, advised, corners, count, THROUGH * accuracy, log)
    lattice = ReducedLattice(reduce(advised))
    waves = _solved(lattice, corners, case)
    error, bar = error_of_waves(lattice, waves), widest_bar(lattice, waves, count, beyond)
    left = _left_by_the_mesh(bar, accuracy)
    finer = advised if error.total <= left else _raised(advised, lattice, error, AIM * left)
    if finer != advised:
        log.info(
            f"truncation error of the bands: {percent(error.total)}, {percent(left)} allowed; refining: "
            f"{describe_change(advised, finer)}"
        )
        with suppress(SolverError):  # raised if the mesh has too few degrees of freedom
            trial = ReducedLattice(reduce(finer))
            waves = _solved(trial, corners, case)
            error, bar = error_of_waves(trial, waves), widest_bar(trial, waves, count, beyond)
            advised, lattice = finer, trial
    total = error.total + beyond
    log.info(f"truncation error of the bands: at most {percent(total)} (from residual flexibility and last degree)")
    if total > accuracy:
        log.warning(
            "REDUCTION",
            f"truncation may change a band by {percent(total)}, more than solve.accuracy = {accuracy:g}: "
            f"lower bands.count ({count}), raise solve.accuracy, or set solve.model = 'solid'",
        )
    return advised, lattice, bar, total, beyond


def _left_by_the_mesh(bar: Bar, accuracy: float) -> float:
    """Share of the accuracy that discretisation leaves to truncation: all of it if the mesh has to be refined anyway."""
    by_mesh, truncated = bar
    if by_mesh is None or by_mesh + truncated <= accuracy or by_mesh > MAX_BY_MESH * accuracy:
        return accuracy
    return accuracy - by_mesh


def _raised(
    reduction: ReductionSettings, lattice: ReducedLattice, error: ReductionError, allowed: float
) -> ReductionSettings:
    """Add fixed-interface modes or a degree along the sides, whichever causes more error; unchanged at the limit."""
    face, modes = reduction.interface, len(lattice.cell.fixed_hz)
    if error.degrees > error.modes:
        finer = higher_degree(reduction)
        return finer if _boundary(finer.interface) + modes <= MAX_DOF else reduction
    limit = (max(MAX_DOF - _boundary(face), modes) / max(modes, 1)) ** (1.0 / 3.0)  # modes go as top_hz^3
    return more_modes(reduction, error.modes, max(allowed - error.degrees, allowed / 4.0), limit)


def _boundary(face: Interface) -> int:
    """Number of boundary degrees of freedom of the lattice."""
    return face.vertex_block + 2 * face.side_block


def bare_cell(case: Case, interface: Interface, log: Log, parted: bool = False) -> Cell:
    """Reduce the unit cell without its pillar, with the boundary functions of the neighbouring cell.

    parted: with the stiffness of each material.
    """
    design = replace(case.design, pillar=None, cell_file=None, attached=())
    reduction = replace(mesh_rules.lattice_reduction(design, case.solve.accuracy), interface=interface)
    with log.step("reduce the bare cell"):
        return Reductions(design.stack, None, reduction, CellCache(), parted=parted).cell(lattice_panel(design))


MORE = 4  # waves in addition to those requested


@dataclass(frozen=True)
class WholeCell:
    """A meshed cell, its copy without the innermost layer (None if it has no layers), and that of one order less."""

    mesh: Mesh
    own: BlochCell
    layer: Nested[BlochCell] | None
    order: Nested[BlochCell]
    shares: ErrorFractions

    @classmethod
    def of(cls, design: Design, settings: HexSettings) -> WholeCell:
        """Mesh the cell of a design."""
        boxes, mesh = cell_boxes(design, settings), _mesh(design, settings)

        def nested(other: HexSettings) -> Nested[BlochCell]:
            transfer = interpolation(cell_boxes(design, other), boxes, settings.order, other.order)
            return Nested(_bloch(design, _mesh(design, other)), transfer)

        layer = nested(settings.coarser) if design.pillar and settings.layers else None
        order = nested(replace(settings, order=settings.order - 1))
        return cls(mesh, _bloch(design, mesh), layer, order, foot_shares(design, settings))

    @property
    def dof(self) -> int:
        """Degrees of freedom per wavevector."""
        return self.own.dof

    def solve(self, wavevector: FloatArray, count: int) -> tuple[FloatArray, ModeErrors]:
        """Solve the `count` lowest frequencies at a wavevector (2,) in rad/m; returns them corrected, in Hz, with their errors.

        The correction may change the order of the waves, so a few more are solved and sorted.
        """
        pencil, copies = self.own.pencil(wavevector)
        values, vectors = lowest_pairs(pencil, count + MORE, copies)
        tones = self.own.scale.frequency(values)
        moving = tones > STILL * tones[-1]

        def change(nested: Nested[BlochCell]) -> FloatArray:
            risen = np.zeros(len(tones))
            risen[moving] = self._risen(nested, wavevector, pencil, vectors[:, moving], values[moving])
            return risen[::copies]

        order = change(self.order)
        layer = (
            change(self.layer) if self.layer else order
        )  # the error at singular edges; a bare cell's shares ignore it
        none, taken = np.zeros(count), self.shares.correction * layer
        best = tones[::copies] / (1.0 + taken)
        half = self.shares.half_width(*(largest_of_alike(tones[::copies], each) for each in (layer, order)))
        lowest = np.argsort(best, kind="stable")[:count]
        return best[lowest], ModeErrors(none, none, none, taken[lowest], half[lowest])

    def frequencies(self, wavevector: FloatArray, count: int) -> FloatArray:
        """Solve the frequencies alone."""
        return self.solve(wavevector, count)[0]

    def _risen(
        self,
        nested: Nested[BlochCell],
        wavevector: FloatArray,
        pencil: PlainPencil,
        vectors: FloatArray,
        values: FloatArray,
    ) -> FloatArray:
        """Relative rise of the waves' frequencies on a coarser mesh, (k,)."""
        coarse, _ = nested.body.pencil(wavevector)
        prolonged = self.own.prolonged(nested.body, nested.transfer, wavevector)
        return (prolonged_eigenvalues(pencil, coarse, prolonged, vectors, values) / values - 1.0) / 2.0


def largest_of_alike(tones: FloatArray, risen: FloatArray) -> FloatArray:
    """Give waves that a coarser mesh may exchange the largest rise among them, (k,): tones ascend.

    Two waves at one frequency are any two of their span: which of them a coarser mesh's belongs to is a matter of rounding.
    """
    out, first = risen.copy(), 0
    for last in range(1, len(tones) + 1):
        group = slice(first, last)
        if last < len(tones):
            apart = tones[last] - tones[last - 1]
            if apart <= max(risen[group].max(), risen[last]) * tones[last]:
                continue
        out[group] = risen[group].max()
        first = last
    return out


def _mesh(design: Design, settings: HexSettings) -> Mesh:
    return hex_mesh(cell_boxes(design, settings), settings.order)


def _bloch(design: Design, mesh: Mesh) -> BlochCell:
    system = assemble(mesh, region_materials(design.stack, design.pillar))
    if design.stack.is_stressed:
        system = with_free_stress(system, design.stack)
    return BlochCell(system, design.lattice)
