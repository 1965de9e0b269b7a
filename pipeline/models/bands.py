"""Bloch bands of a case's unit cell along a path and over a grid: waves, branches, labels, shapes, gaps, error bars."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Protocol

import numpy as np

from geometry.decimation import coarse, with_sides
from geometry.elements import FloatArray, IntArray
from geometry.lattice import Lattice, Path
from geometry.layout import Design
from geometry.tiling import row_panels
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models import own_frequency
from pipeline.models.cell_cache import CellCache
from pipeline.models.own_frequency import OwnFrequency
from pipeline.models.parts import mesh_record
from pipeline.models.prestress import warn_of_free_cell
from pipeline.models.unit_cell import Bar, LatticeModel, WholeCell, lattice_model
from pipeline.planning import refinement, resource_estimate, simplifications
from pipeline.planning.mesh_rules import refinement_of
from pipeline.planning.model_choice import SOLID, ModelChoice
from pipeline.planning.refinement import (
    MARGIN,
    ErrorEstimate,
    WidestBar,
    on_finer_meshes,
    refine_reduction,
    step_by_step,
)
from pipeline.planning.resources import ResourceEstimate
from pipeline.quantity import figure, frequency
from pipeline.records.record import MeshRecord
from solvers.accuracy.mesh import largest
from solvers.accuracy.reduction import MeshErrors, ModeErrors, mesh_error, truncation_bars, waves_of
from solvers.measures.loss import of_discarded, quality_and_bar
from solvers.plates.assembled import Reductions
from solvers.superelement.interface import ReductionSettings
from solvers.superelement.lattice import Periodic, ReducedLattice, Waves, times
from solvers.superelement.plate import loss_of
from solvers.threads import one_thread
from solvers.waves.branches import Branches, Label, Mirrors, Solved, follow
from solvers.waves.gaps import (
    BrillouinZoneGap,
    DirectionalGap,
    Gap,
    PolarisationGap,
    directional_gaps,
    labels_along,
    path_gaps,
    path_lines,
    polarisation_gaps,
    sampled_lines,
    searched_extreme,
    zone_extreme,
    zone_gaps,
)


def edge_error(frequency_hz: FloatArray, error: FloatArray, edge_hz: float, sign: int) -> float | None:
    """Bound the relative error of a gap's edge, an extreme of a band.

    With f (1 - e) <= f_exact <= f (1 + e) at every wavevector, max f_exact lies between f_m (1 - e_m), m the wavevector of
    the largest f, and max f (1 + e).

    Parameters
    ----------
    frequency_hz, error : ndarray, shape (n,)
        The band in Hz and its relative errors; NaN where unknown.
    edge_hz : float
        The extreme, which may lie between two of the wavevectors.
    sign : int
        1 for the maximum of the band below the gap, -1 for the minimum of the one above.

    Returns
    -------
    float or None
        Relative error of the edge; None if one of the errors is unknown.
    """
    if not len(error) or np.isnan(error).any() or edge_hz <= 0.0:
        return None
    own = float(error[np.argmax(sign * frequency_hz)])
    farthest = float((sign * frequency_hz + error * frequency_hz).max())
    return max(own, (farthest - sign * edge_hz) / edge_hz)


def gap_errors(gap: Gap, frequencies_hz: FloatArray, errors: FloatArray) -> dict[str, float | None]:
    """Return `lower_error` and `upper_error` of a gap from the bands and their relative errors, (wavevectors, bands)."""
    lower, upper = gap.lower_band - 1, gap.upper_band - 1
    return {
        "lower_error": edge_error(frequencies_hz[:, lower], errors[:, lower], gap.lower_hz, 1),
        "upper_error": edge_error(frequencies_hz[:, upper], errors[:, upper], gap.upper_hz, -1),
    }


def nearest_error(frequencies_hz: FloatArray, errors: FloatArray, edge_hz: float) -> float | None:
    """Relative error of the frequency nearest to an edge, over all bands (wavevectors, bands)."""
    error = float(errors.flat[np.argmin(np.abs(frequencies_hz - edge_hz))])
    return None if np.isnan(error) else error


def widest(path: Path, by_mesh: FloatArray, truncated: FloatArray, moduli: FloatArray | None = None) -> WidestBar:
    """Find the largest error bar of the bands (wavevectors, bands) along a path."""
    total = by_mesh + truncated + (0.0 if moduli is None else moduli)
    if not total.size or np.isnan(total).any():
        return WidestBar(None)
    point, band = (int(index) for index in np.unravel_index(np.argmax(total), total.shape))
    where = path.labels[point] or "k = ({}, {}) rad/m".format(*map(figure, path.wavevectors[point]))
    parts = {"mesh": float(by_mesh[point, band]), "truncation": float(truncated[point, band])}
    if moduli is not None and moduli.any():
        parts["moduli"] = float(moduli[point, band])
    return WidestBar(float(total[point, band]), f"band {band + 1} at {where}", parts)


def with_edges(gaps: Sequence[Any], path: Path, frequencies_hz: FloatArray, errors: FloatArray) -> list[dict[str, Any]]:
    """Fields of gaps with the errors of their edges: those of their bands, else of the frequency nearest to an edge."""
    return [vars(gap) | _edges(gap, path, frequencies_hz, errors) for gap in gaps]


def _edges(gap: Any, path: Path, frequencies_hz: FloatArray, errors: FloatArray) -> dict[str, float | None]:
    if isinstance(gap, DirectionalGap):
        own = next(each for each in path.segments if (each.start, each.end) == (gap.start, gap.end))
        here = slice(own.first, own.last + 1)
        return gap_errors(gap, frequencies_hz[here], errors[here])
    if isinstance(gap, Gap):
        return gap_errors(gap, frequencies_hz, errors)
    sides = ("lower", "upper")
    return {f"{side}_error": nearest_error(frequencies_hz, errors, getattr(gap, f"{side}_hz")) for side in sides}


Solve = Callable[[FloatArray, int], tuple[FloatArray, ModeErrors]]
MOVED = 1e-6  # relative change that shows that an edge of the zone's gap lies off the path
MAX_RAISES = 4  # most increases of a reduction's degrees
MAX_POINTS = 500
MAX_BANDS = 12
QUALITY = "quality_factor", "quality_error"
SLOWEST = 0.05  # of the highest frequency of bands: slower waves do not decide at which the moduli are taken


class SampledCell(Protocol):
    """A cell that gives frequencies and their errors, but no waves."""

    @property
    def dof(self) -> int:
        """Degrees of freedom per wavevector."""
        ...

    def solve(self, wavevector: FloatArray, count: int) -> tuple[FloatArray, ModeErrors]:
        """Solve the `count` lowest frequencies at a wavevector (2,) in rad/m; returns them in Hz, with their errors."""
        ...

    def frequencies(self, wavevector: FloatArray, count: int) -> FloatArray:
        """Solve the frequencies alone."""
        ...


@dataclass(frozen=True)
class Detail:
    """Results of the reduced cell other than frequencies: one row per wavevector, one column per band.

    labels and parity are lists of rows, branch (n, bands) counts from 1, velocity (n, bands, 2) is in m/s (NaN for still
    waves). quality: quality factors and their half-widths, (2, n, bands), NaN where there is none; None without loss.
    """

    labels: list[list[Label]]
    parity: list[list[str]]
    branch: IntArray
    velocity: FloatArray
    directional_gaps: list[DirectionalGap] | None
    polarisation_gaps: list[PolarisationGap] | None
    reduction_error: float
    quality: FloatArray | None = None

    def point(self, index: int) -> dict[str, Any]:
        """Return the fields of one wavevector."""
        return {
            "polarisation": [label.name for label in self.labels[index]],
            "plate_polarisation": [label.plate for label in self.labels[index]],
            "parity": self.parity[index],
            "branch": [int(number) for number in self.branch[index]],
            "group_velocity_m_s": [_pair(pair) for pair in self.velocity[index]],
        } | ({} if self.quality is None else dict(zip(QUALITY, map(_known, self.quality[:, index]), strict=True)))

    @property
    def gaps(self) -> dict[str, Any]:
        """Partial gaps by their kind, if they were searched."""
        found = {"directional_gaps": self.directional_gaps, "polarisation_gaps": self.polarisation_gaps}
        return {kind: gaps for kind, gaps in found.items() if gaps is not None}


@dataclass(frozen=True)
class SolvedBands:
    """Frequencies (wavevectors, bands) in Hz along a path, complete gaps, and the model that gives them.

    mesh_errors: discretisation error of each frequency, (wavevectors, bands); truncated: relative overestimate due to
    truncation, of the same shape; 0 for a cell that is not reduced.
    """

    model: str
    dof: int
    path: Path
    frequencies_hz: FloatArray
    gaps: list[Gap]
    meshes: list[MeshRecord] = field(default_factory=list)
    detail: Detail | None = None
    zone_gaps: list[BrillouinZoneGap] | None = None
    shapes: dict[str, Any] = field(default_factory=dict)
    expected_error: float | None = None
    lattice: LatticeModel | None = None  # of a reduced cell
    mesh_errors: MeshErrors | None = None
    truncated: FloatArray | float = 0.0
    moduli: FloatArray | float = 0.0  # relative, by moduli that depend on the frequency

    @property
    def by_mesh(self) -> FloatArray:
        """Relative discretisation error of each frequency, (wavevectors, bands); NaN without an estimate."""
        return self.mesh_errors.half_width if self.mesh_errors else np.full(self.frequencies_hz.shape, np.nan)

    @property
    def error(self) -> FloatArray:
        """Relative error of each frequency from discretisation, truncation and moduli; NaN without an estimate."""
        return self.by_mesh + self.truncated + self.moduli

    @property
    def computed_hz(self) -> FloatArray:
        """Frequencies on the finest mesh, Hz, before the correction."""
        return self.frequencies_hz * (1.0 + self.mesh_errors.taken) if self.mesh_errors else self.frequencies_hz

    def point(self, index: int) -> dict[str, Any]:
        """Return the fields of the waves at one wavevector by name."""
        own = {"label": self.path.labels[index], "kx_per_m": self.path.wavevectors[index, 0]}
        own |= {"ky_per_m": self.path.wavevectors[index, 1], "frequencies_hz": self.frequencies_hz[index]}
        own |= {"computed_hz": self.computed_hz[index], "error": self.error[index]}
        return own | (self.detail.point(index) if self.detail else {})

    @property
    def every_gap(self) -> dict[str, list[dict[str, Any]]]:
        """Return the fields of all gaps, with the errors of their edges, by the kind of gap."""
        found: dict[str, Sequence[Any]] = {"gaps": self.gaps} | (self.detail.gaps if self.detail else {})
        if self.zone_gaps is not None:
            found["zone_gaps"] = self.zone_gaps
        return {kind: with_edges(gaps, self.path, self.frequencies_hz, self.error) for kind, gaps in found.items()}

    def _widened(self, own: OwnFrequency, tones: FloatArray) -> FloatArray | None:
        """Quality factors with error bars that hold what loss and moduli change to their own frequencies, Hz."""
        known = self.detail.quality if self.detail else None
        if known is None:
            return None
        change = np.array([own.lossier(tone) + own.stiffer(tone) if tone else 0.0 for tone in tones.tolist()])
        half = known[1] + known[0] * change.reshape(known[0].shape)
        return np.array([known[0], np.where(half < known[0], half, np.nan)])

    @property
    def widest_bar(self) -> WidestBar:
        """Largest error bar of all bands along the path."""
        truncated, moduli = (np.broadcast_to(each, self.frequencies_hz.shape) for each in (self.truncated, self.moduli))
        return widest(self.path, self.by_mesh, truncated, moduli)

    def at_own_frequencies(self, own: OwnFrequency) -> SolvedBands:
        """Return the bands with the moduli at the frequency of each wave: gaps stay gaps, because waves keep their order."""
        middle, half = own.centred(self.frequencies_hz.ravel())

        def moved(gaps: Sequence[Any]) -> list[Any]:
            edges = [own.centred(np.array([gap.lower_hz, gap.upper_hz]))[0].tolist() for gap in gaps]
            return [replace(gap, lower_hz=low, upper_hz=high) for gap, (low, high) in zip(gaps, edges, strict=True)]

        detail = self.detail
        if detail:
            slope = own.slope(self.frequencies_hz.ravel()).reshape(*self.frequencies_hz.shape, 1)
            more: dict[str, Any] = {name: moved(gaps) for name, gaps in detail.gaps.items()}
            detail = replace(detail, velocity=detail.velocity * slope, quality=self._widened(own, middle), **more)
        return replace(
            self, frequencies_hz=middle.reshape(self.frequencies_hz.shape), gaps=moved(self.gaps), detail=detail,
            zone_gaps=None if self.zone_gaps is None else moved(self.zone_gaps),
            moduli=half.reshape(self.frequencies_hz.shape),
        )  # fmt: skip


def _known(values: FloatArray) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in values]


def _pair(pair: FloatArray) -> list[float] | None:
    return None if np.isnan(pair).any() else pair.tolist()


@one_thread()
def solve_bands(
    case: Case, choice: ModelChoice, log: Log, *, shapes: bool = False, every_gap: bool = True
) -> SolvedBands:
    """Compute all bands of the case at every wavevector of its path, and on request the waves' shapes for a page.

    Parameters
    ----------
    case
        The case.
    choice
        Model and mesh of the cell.
    log
        Receives the progress.
    shapes
        Whether to keep the waves' shapes at the corners of the path.
    every_gap
        Whether to search partial gaps, too: those of one direction or one polarisation.
    """
    design, settings = case.design, case.bands
    path = case.path(settings.points)

    def solved(case: Case) -> SolvedBands:
        if choice.model == SOLID or design.stagger:
            return _sampled(case, choice, path, log)
        return _reduced(case, choice, path, log, shapes, every_gap)

    bands = _at_own_frequencies(case, solved, log) if own_frequency.is_open(case, "cell") else solved(case)
    if bands.gaps and not (simplifications.off_path(design, settings.path, settings.grid) or settings.grid):
        log.warning(
            "PATH",
            f"{settings.path} does not bound this cell's irreducible Brillouin zone, so a gap may close off the path: "
            "set bands.grid = 20 to search there",
        )
    refinement.log_mesh_error(choice, case, log, largest(bands.by_mesh))
    log.info(bands.widest_bar.text())
    bands.widest_bar.warn(case, log)
    return replace(bands, expected_error=largest(bands.by_mesh))


def _at_own_frequencies(case: Case, solve: Callable[[Case], SolvedBands], log: Log) -> SolvedBands:
    """Solve bands with the moduli at their middle frequency, and enclose each wave with those at its own."""
    bands, own = solve(case), own_frequency.of_part(case, "cell")
    middle, half = own.centred(bands.frequencies_hz.ravel())
    if half.any():
        tone = float(np.sqrt(middle[middle > SLOWEST * middle.max()].min() * middle.max()))
        log.info(f"moduli depend on the frequency: solved again with those at {frequency(tone)}")
        tuned = own_frequency.taken_at(case, tone)
        bands, own = solve(tuned), own_frequency.of_part(tuned, "cell")
    bands = bands.at_own_frequencies(own)
    for line in own.beyond(bands.frequencies_hz):
        log.warning("MATERIAL", line)
    return bands


def row_cell(design: Design, reduction: ReductionSettings, lossy: bool = False, parted: bool = False) -> Periodic:
    """Reduce the primitive cell of staggered rows: a panel with the pillar and a bare one, each half a pitch wide."""
    reductions = Reductions(design.stack, design.pillar, reduction, CellCache(), lossy=lossy, parted=parted)
    return Periodic([reductions.cell(panel) for panel in row_panels(design)], shift=1)


def _solver(cell: SampledCell | Periodic) -> Solve:
    return partial(waves_of, cell) if isinstance(cell, Periodic) else cell.solve


def sampled_cell(
    case: Case, choice: ModelChoice, path: Path, log: Log, parted: bool = False
) -> tuple[ModelChoice, WholeCell | Periodic, Bar]:
    """Choose and build the meshed cell, or the reduced cell of staggered rows.

    It has the first reduction and the first mesh whose errors at the corners of the path meet the accuracy, or the finest
    that fits into memory. Returns it with its relative discretisation error (None if unknown) and truncation error. parted: the
    cell of staggered rows has the stiffness of each material.
    """
    design, count = case.design, case.bands.count
    if case.design.is_stressed:
        warn_of_free_cell(log)

    def solved(choice: ModelChoice) -> tuple[WholeCell | Periodic, list[ModeErrors]]:
        cell: WholeCell | Periodic
        if choice.reduction:
            with log.step("reduce the panels of a row"):
                cell = row_cell(design, choice.reduction, case.is_lossy, parted)
        else:
            assert choice.hexahedra
            with log.step("assemble the cell and two coarser ones"):
                cell = WholeCell.of(design, choice.hexahedra)
        with log.step("errors at the corners of the path"):
            return cell, _each_once(path.corners, count, _solver(cell))[1]

    def demand(choice: ModelChoice) -> ResourceEstimate:
        return resource_estimate.of_bands(case, choice, len(path.wavevectors))

    def deeper(choice: ModelChoice, built: tuple[WholeCell | Periodic, list[ModeErrors]], _: int) -> ModelChoice | None:
        finer = refine_reduction(choice, _worst(built[1]), case, log, "a band")
        return finer if finer and resource_estimate.fits(demand(finer), log) else None

    first = step_by_step((choice, solved(choice)), deeper, solved, MAX_RAISES, log)
    choice, (cell, errors) = on_finer_meshes(first, lambda built: _widest(built[1]), solved, demand, case, log)
    return choice, cell, _widest(errors)


def _worst(errors: list[ModeErrors]) -> ErrorEstimate:
    """Largest truncation errors of any wave, source by source."""
    parts = (max(float(getattr(each, name).max()) for each in errors) for name in ("modes", "degrees", "through"))
    return ErrorEstimate(max(float(each.total.max()) for each in errors), *parts)


def _widest(errors: list[ModeErrors]) -> Bar:
    """Largest discretisation and truncation errors of the waves."""
    truncated = MARGIN * max(float(each.total.max()) for each in errors)
    return largest(np.concatenate([each.mesh for each in errors])), truncated


def _sampled(case: Case, choice: ModelChoice, path: Path, log: Log) -> SolvedBands:
    """Solve the meshed cell or the reduced cell of staggered rows."""
    choice, cell, _ = sampled_cell(case, choice, path, log)
    return _by_samples(case, cell, choice.name, case.design.lattice, case.design.cell_mirrors, path, log)


@one_thread()
def bands_of_cell(case: Case, cell: SampledCell, name: str, lattice: Lattice, path: Path, log: Log) -> SolvedBands:
    """Compute the bands of another cell than the case's own, whose symmetry is not known.

    Parameters
    ----------
    case
        The case.
    cell
        The cell.
    name
        Name of its model.
    lattice
        Its lattice.
    path
        Path through the Brillouin zone of the lattice.
    log
        Receives the progress.
    """
    bands = _by_samples(case, cell, name, lattice, (), path, log)
    if bands.gaps and not case.bands.grid:
        walked = "".join(label for label in path.labels if label)
        what = f"the symmetry of this cell is not known, so a gap may close off {walked}: set bands.grid = 20 to search there"
        log.warning("PATH", what)
    if bands.widest_bar.error is not None:
        log.info(bands.widest_bar.text())
        bands.widest_bar.warn(case, log)
    return replace(bands, expected_error=largest(bands.by_mesh))


def _by_samples(
    case: Case,
    cell: SampledCell | Periodic,
    name: str,
    lattice: Lattice,
    mirrors: Collection[str],
    path: Path,
    log: Log,
) -> SolvedBands:
    """Solve a cell that gives frequencies only; gaps are searched between the samples, too."""
    mesh = getattr(cell, "mesh", None)
    meshes = [mesh_record("cell", mesh)] if mesh else []
    log.left_out(
        "polarisation, branches, group velocity and quality factors", "this model of the cell gives frequencies only"
    )
    with log.step(f"{len(path.wavevectors)} wavevectors"):
        rows, estimates = _each_once(path.wavevectors, case.bands.count, _solver(cell))
    frequencies = partial(cell.frequencies, count=case.bands.count)
    with log.step("gaps"):
        gaps, zone = path_gaps(sampled_lines(frequencies, path, rows)), None
    if case.bands.grid:
        grid = lattice.grid(case.bands.grid, mirrors)
        with log.step(f"grid of {len(grid)} wavevectors"):
            values = np.array([frequencies(k) for k in grid])
            every, found = np.vstack([path.wavevectors, grid]), np.vstack([rows, values])
            zone = zone_gaps(gaps, partial(searched_extreme, frequencies, every, found))
        _log_zone(gaps, zone, log)
    errors = MeshErrors(np.array([each.taken for each in estimates]), np.array([each.mesh for each in estimates]))
    truncated = MARGIN * truncation_bars(np.array([each.total for each in estimates]))
    return SolvedBands(name, cell.dof, path, rows, gaps, meshes, None, zone, mesh_errors=errors, truncated=truncated)


def _each_once(wavevectors: FloatArray, count: int, solve: Solve) -> tuple[FloatArray, list[ModeErrors]]:
    """Solve each distinct wavevector once."""
    known = {key: solve(np.array(key), count) for key in dict.fromkeys(map(_key, wavevectors))}
    solved = [known[_key(k)] for k in wavevectors]
    return np.array([frequencies for frequencies, _ in solved]), [errors for _, errors in solved]


def _key(wavevector: FloatArray) -> tuple[float, float]:
    return float(wavevector[0]), float(wavevector[1])


def _reduced(case: Case, choice: ModelChoice, path: Path, log: Log, shapes: bool, every_gap: bool) -> SolvedBands:
    """Solve the reduced cell: branches are followed on a refined path, gaps are searched between the samples, too."""
    meshes: list[MeshRecord] = []
    corners = path.corners
    model = lattice_model(case, choice, corners, log, meshes)
    count = min(case.bands.count, model.lattice.dof)
    solved, factor = Solved(model.lattice, count), refinement_of(case.bands.points)
    fine = path.finer(factor)
    with log.step(f"{len(fine.wavevectors)} wavevectors"):
        for k in fine.wavevectors:
            solved(k)
    with log.step("branches"):
        branches = follow(solved, fine.wavevectors)
    with log.step("gaps"):
        labels, lines = labels_along(solved, branches), path_lines(solved, fine)
        gaps = path_gaps(lines)
        along_segments = directional_gaps(fine, lines) if every_gap else None
        polarised = polarisation_gaps(solved, branches, labels) if every_gap else None
    rows = np.array([waves.frequency_hz[:count] for waves in branches.waves])[::factor]
    truncated = model.truncation(branches.waves[::factor], count)
    detail = _detail(model, branches, labels, factor, count, along_segments, polarised, float(truncated.max()))
    zone = _over_the_zone(case, model, solved, gaps, log) if case.bands.grid else None
    moved = wave_shapes(model.lattice, path, count) if shapes else {}
    estimates = [mesh_error(model.lattice.cell, each) for each in branches.waves[::factor]]
    errors = MeshErrors(*(np.array([getattr(e, name)[:count] for e in estimates]) for name in ("taken", "half_width")))
    bands = SolvedBands(
        model.name, model.lattice.dof, path, rows, gaps, meshes, detail, zone, moved, lattice=model, mesh_errors=errors,
        truncated=truncated,
    )  # fmt: skip
    if not case.is_lossy:
        return bands
    quality = _quality(case, model.lattice, branches.waves[::factor], bands.error)
    return replace(bands, detail=replace(detail, quality=quality))


def _quality(case: Case, lattice: ReducedLattice, waves: Sequence[Waves], error: FloatArray) -> FloatArray:
    """Quality factors of the waves by where their strain energy sits, and their half-widths, (2, n, bands)."""
    known = [material.lost for material in case.design.materials]
    most, least, loss, count = max(known), min(known), loss_of(lattice.cell), error.shape[1]
    out = np.full((2, *error.shape), np.nan)
    for place, each in enumerate(waves):
        dofs = each.dofs[:, :count]
        lost, held = (
            np.einsum("in,in->n", dofs.conj(), times(part, dofs)).real for part in (loss, lattice.cell.stiffness)
        )
        for band in np.flatnonzero(each.eigenvalue[:count] > 0.0):
            bar, factor = error[place, band], float(lost[band] / held[band])
            softened = np.abs(held[band] / each.eigenvalue[band] - 1.0)
            of_wave = None if np.isnan(bar) else float(bar)
            discarded = float(of_discarded(most, least, softened, np.array(factor)))
            out[:, place, band] = quality_and_bar(factor, most, of_wave, discarded)
    return np.where(np.isnan(out[1]), np.nan, out)  # without a bar no figure


def _detail(
    model: LatticeModel, branches: Branches, labels: list[list[Label]], factor: int, count: int,
    along_segments: list[DirectionalGap] | None, polarised: list[PolarisationGap] | None, reduction_error: float,
) -> Detail:  # fmt: skip
    """Labels, parity, branches and group velocities at the requested wavevectors."""
    mirrors, waves = Mirrors(model.lattice.cell), branches.waves[::factor]
    parity = []
    for each in waves:
        signs = {name: mirrors.parity(name, each.dofs[:, :count]) for name in mirrors.keeping(each.wavevector)}
        parity.append(["".join(f"{n}{'A?S'[v[i] + 1]}" for n, v in signs.items()) for i in range(count)])
    velocity = np.array([model.lattice.group_velocity(each)[:count] for each in waves])
    number = branches.number[::factor, :count]
    visible = [row[:count] for row in labels[::factor]]
    return Detail(visible, parity, number, velocity, along_segments, polarised, reduction_error)


def _over_the_zone(
    case: Case, model: LatticeModel, solved: Solved, gaps: list[Gap], log: Log
) -> list[BrillouinZoneGap]:
    """Search the path's gaps over the whole irreducible Brillouin zone, from a grid and the extreme points of the path."""
    own = case.design
    names = {*own.body_mirrors} if own.oblique_m else {*own.cell_mirrors} & {*Mirrors(model.lattice.cell).names}
    grid = case.design.lattice.grid(case.bands.grid, names)
    with log.step(f"grid of {len(grid)} wavevectors"):
        values = np.array([model.lattice.waves(k, solved.count).eigenvalue for k in grid])
        zone = zone_gaps(gaps, partial(zone_extreme, solved, grid, values))
    _log_zone(gaps, zone, log)
    return zone


def _log_zone(along: list[Gap], zone: list[BrillouinZoneGap], log: Log) -> None:
    """Log whether the path's gaps hold over the whole irreducible Brillouin zone."""
    left = {gap.lower_band: gap for gap in zone}
    for gap in along:
        name = f"the gap between bands {gap.lower_band} and {gap.upper_band}"
        whole = left.get(gap.lower_band)
        if whole is None:
            log.warning("ZONE", f"{name} is open along the path only: waves off the path close it")
            continue
        for edge, path_hz, hz, at in (
            ("lower", gap.lower_hz, whole.lower_hz, whole.lower_at),
            ("upper", gap.upper_hz, whole.upper_hz, whole.upper_at),
        ):
            if abs(hz / path_hz - 1.0) > MOVED:
                where = f"k = ({figure(at[0])}, {figure(at[1])}) rad/m, off the path"
                log.warning(
                    "ZONE",
                    f"{name} has its {edge} edge at {frequency(hz, MOVED)}, {where}; "
                    f"along the path {frequency(path_hz, MOVED)}",
                )
    if along and not _moved(along, zone):
        log.info("every gap along the path holds in the whole Brillouin zone, with the same edges")


def _moved(along: list[Gap], zone: list[BrillouinZoneGap]) -> bool:
    """Whether an edge of the gap over the Brillouin zone differs from the path's."""
    edges = {gap.lower_band: (gap.lower_hz, gap.upper_hz) for gap in zone}
    return any(
        gap.lower_band not in edges
        or np.abs(np.array(edges[gap.lower_band]) / (gap.lower_hz, gap.upper_hz) - 1.0).max() > MOVED
        for gap in along
    )


def wave_shapes(lattice: ReducedLattice, path: Path, count: int) -> dict[str, Any]:
    """bands_* arrays: points (p, 3) in m, quads or triangles, labels (l,), u (l, bands, 2, p, 3): real and imaginary part.

    Each wave is scaled to a largest component of 1 and rotated in phase so that it is real; half precision, for display only.
    """
    skin = lattice.cell.skin
    assert skin.facets is not None
    facets = with_sides(skin.points, skin.facets, lattice.cell.size_m[2])
    kept, small = coarse(skin.points, facets, MAX_POINTS)
    labels = list(dict.fromkeys(label for label in path.labels if label))
    corners = [path.wavevectors[path.labels.index(label)] for label in labels]
    waves = [_waves(lattice, k, min(count, MAX_BANDS), skin.matrix[kept]) for k in corners]
    return {
        "bands_points": skin.points[kept].astype(np.float32),
        f"bands_{'quads' if small.shape[1] == 4 else 'triangles'}": small.astype(np.int32),
        "bands_labels": np.array(labels),
        "bands_u": np.stack(waves).astype(np.float16),
    }


def _waves(lattice: ReducedLattice, k: FloatArray, count: int, matrix: FloatArray) -> FloatArray:
    """Displacements (count, 2, p, 3) of the lowest waves at one wavevector."""
    dofs = lattice.waves(k, count).dofs
    field = np.tensordot(matrix, dofs, axes=(2, 0)).transpose(2, 0, 1)
    flat = field.reshape(len(field), -1)
    peak = flat[np.arange(len(flat)), np.argmax(np.abs(flat), axis=1)]
    field = field / peak[:, None, None]
    return np.stack([field.real, field.imag], axis=1)
