"""The parametric cell of a case's materials, computed once and kept in the results, and the error of its single mesh.

The overestimate of the bands on that mesh is measured in the corners of the cell's box. It is nearly a product of powers of the
sizes, so its logarithm is interpolated multilinearly in their logarithms, and the result is subtracted. The error bar covers
the rest and the error of the plain reductions themselves; designs between the corners give the factor by which it is widened.
"""

from __future__ import annotations

import contextlib
import hashlib
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.lattice import Lattice
from geometry.layout import Design
from geometry.materials import Material
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log, WarningLog
from pipeline.models.bands import row_cell
from pipeline.models.cell_cache import ArrayCache, packed, symmetric, triangles, unpacked
from pipeline.models.unit_cell import lattice_model
from pipeline.paths import RESULTS
from pipeline.planning.model_choice import cell_model_choice
from pipeline.planning.refinement import MARGIN
from pipeline.quantity import percent
from pipeline.workers import LocalWorkers
from solvers.accuracy.reduction import mesh_error, waves_of
from solvers.errors import SolverError
from solvers.parametric.affine import PITCH, AffineCell, DesignBox, FixedMesh, Sizes, as_sizes, between, foot_of
from solvers.parametric.bands import FLAT, BandBases, Bands, band_bases, bands, compressed, own_error, rich_sectors
from solvers.parametric.cell import ParametricCell, parametric_cell
from solvers.superelement.interface import Interface
from solvers.threads import one_thread

ACCURACY = 0.002  # of the plain reductions; their own error is added
MIN_ERROR = 1e-5
Map = Callable[[Callable[[Any], FloatArray], Iterable[Any]], Iterable[FloatArray]]


@dataclass(frozen=True)
class MeshTable:
    """Discretisation error bars of the bands in the box's corners, (16, bands), and `margin`, their factor in between.

    `high` (16, bands) is the relative overestimate of the bands in the corners.
    """

    box: DesignBox
    corners: FloatArray
    margin: float
    high: FloatArray

    def at(self, sizes: Sizes) -> FloatArray:
        """The half-widths of a design, relative, (bands,)."""
        return self.margin * self._between(self.corners, sizes)

    def overestimate(self, sizes: Sizes) -> FloatArray:
        """How far a design's bands lie too high, relative, (bands,)."""
        return self._between(self.high, sizes)

    def _between(self, corners: FloatArray, sizes: Sizes) -> FloatArray:
        return np.asarray(np.exp(corner_weights(self.box, sizes) @ np.log(corners)))


def corner_weights(box: DesignBox, sizes: Sizes) -> FloatArray:
    """Weights (16,) of the box's corners at a design, in the order of DesignBox.spread."""
    unit = box.unit(sizes)
    return np.array([np.prod(np.where(corner, unit, 1.0 - unit)) for corner in product((0, 1), repeat=4)])


def with_sizes(case: Case, sizes: Sizes, accuracy: float, count: int) -> Case:
    """The case with another cell, so many of its bands to be had within an accuracy."""
    solve = case.solve.but(accuracy=accuracy, model="auto", mesh="auto")
    return replace(case, design=resized(case.design, sizes), solve=solve, bands=case.bands.but(count=count))


def resized(design: Design, sizes: Sizes) -> Design:
    """The design with another cell; the pillar's further widths keep their ratio to the first."""
    assert design.pillar is not None
    t, h, a, p = sizes
    grown = a / design.pillar.base_m
    more = tuple((name, grown * size) for name, size in design.pillar.more_m)
    pillar = replace(design.pillar, base_m=a, tip_m=grown * design.pillar.tip_m, height_m=h, more_m=more)
    pitch_y_m = p * lattice_of(design).a2_m[1]
    return replace(design, thickness_m=t, pillar=pillar, pitch_x_m=p, pitch_y_m=pitch_y_m)


def lattice_of(design: Design) -> Lattice:
    """The lattice of its rows, in pitches along x."""
    return Lattice.of_rows(1.0, round(design.pitch_y_m / design.pitch_x_m, 12), design.stagger)


def mesh_table(
    case: Case, cell: ParametricCell, bases: BandBases, between: list[Sizes], apply: Map
) -> MeshTable | None:
    """Compare the bands of corner designs, and of some between them, with plain reductions on meshes of their own.

    None if one of those cannot be computed or has no error estimate.
    """
    at = [number for number, label in enumerate(bases.labels) if label][:3]
    tasks = [
        (with_sizes(case, sizes, ACCURACY, bases.count), bases.fractions[at] * np.pi / sizes[3], band_hz)
        for sizes in (*cell.box.spread(0), *between)
        for band_hz in [bands(cell, bases, sizes).frequency_hz[at]]
    ]
    high, bar = np.moveaxis(np.array(list(apply(off_by, tasks))), 1, 0)
    if np.isnan(high).all(axis=1).any():
        return None
    table = MeshTable(
        cell.box, np.ones_like(high[: 2**4, 0]), 1.0, np.maximum(np.nanmean(high[: 2**4], axis=1), MIN_ERROR)
    )
    designs = [*cell.box.spread(0), *between]
    expected = np.array([table.overestimate(sizes) for sizes in designs])[:, None]
    left = np.nanmax(np.maximum(np.abs(high - expected) + bar, MIN_ERROR), axis=1)
    table = replace(table, corners=left[: 2**4])
    more = [float((own / table.at(sizes)).max()) for own, sizes in zip(left, designs, strict=True)]
    return replace(table, margin=max([1.0, *more]))


def off_by(task: tuple[Case, FloatArray, FloatArray]) -> FloatArray:
    """How far bands at wavevectors (k, 2) lie above plain reductions, relative, and the bars of these, (2, k, bands).

    NaN at rest, and throughout where there is no such reduction.
    """
    case, wavevectors, band_hz = task
    out = np.full((2, *band_hz.shape), np.nan)
    try:
        solved = (_staggered if case.design.stagger else _in_line)(case, wavevectors, band_hz.shape[1])
    except SolverError:
        return out
    for row, (frequency_hz, bar) in enumerate(solved):
        moving = frequency_hz > FLAT * frequency_hz[-1]
        out[0, row, moving] = (band_hz[row] / np.where(moving, frequency_hz, 1.0) - 1.0)[moving]
        out[1, row, moving] = bar[moving]
    return out


def _in_line(case: Case, wavevectors: FloatArray, count: int) -> list[tuple[FloatArray, FloatArray]]:
    """Frequencies of a plain reduction and their error bars at each wavevector."""
    model = lattice_model(case, cell_model_choice(case), wavevectors, WarningLog(), [], finer=False)
    solved = [model.lattice.waves(k, count) for k in wavevectors]
    bars = [mesh_error(model.lattice.cell, waves).half_width for waves in solved]
    parts = zip(solved, bars, model.truncation(solved, count), strict=True)
    return [(waves.frequency_hz, bar + truncated) for waves, bar, truncated in parts]


def _staggered(case: Case, wavevectors: FloatArray, count: int) -> list[tuple[FloatArray, FloatArray]]:
    """The same of staggered rows."""
    reduction = cell_model_choice(case).reduction
    assert reduction is not None
    cell = row_cell(case.design, reduction)
    solved = [waves_of(cell, k, count) for k in wavevectors]
    return [(frequency_hz, errors.mesh + MARGIN * errors.total) for frequency_hz, errors in solved]


def sizes_of(design: Design) -> Sizes:
    """Thickness, height, width of the foot and pitch of a design with a pillar, m."""
    assert design.pillar is not None
    return design.thickness_m, design.pillar.height_m, design.pillar.base_m, design.pitch_x_m


# -- the model of a cell -----------------------------------------------------------------------------------------------


INTERVALS, BANDS = 25, 10
ASPECTS = 0.5, 2.0  # of the pitch along y to that along x
MAX_BYTES = 400_000_000  # of all models: some pairs of materials
UNSEEN = 4  # designs for estimating the error of the bases
# discretisation error of a frequency that a search's columns may have in addition to their own error
FINE_ENOUGH = 0.015


@dataclass(frozen=True)
class Offline:
    """What the bases are made from: mesh, boundary degrees, the coarser mesh on which designs are chosen (None: all are taken),
    and how many there are besides the corners, for the cell and for the bands.
    """

    box: DesignBox = field(default_factory=DesignBox)
    mesh: FixedMesh = field(default_factory=FixedMesh)
    interface: Interface = field(default_factory=lambda: Interface(5, 3))
    coarse: FixedMesh | None = field(default_factory=lambda: FixedMesh(2, beside=1, along=3, layers=1))
    designs: int = 48
    waves: int = 32
    intervals: int = INTERVALS
    workers: int = 2
    measures_mesh: bool = True  # whether the mesh's error is measured


@dataclass(frozen=True)
class CellModel:
    """The cell as a function of its sizes, its bands along the path, and the error of its mesh where it was measured."""

    cell: ParametricCell
    bases: BandBases
    mesh: MeshTable | None = None

    def bands(self, sizes: Sizes) -> Bands:
        """The bands of a design, less what its mesh puts them too high by where that was measured. SolverError for a design
        outside the box.
        """
        dispersion = bands(self.cell, self.bases, sizes)
        return dispersion.corrected(self.mesh.overestimate(sizes)) if self.mesh else dispersion

    def as_meshed(self, sizes: Sizes) -> FloatArray | None:
        """Relative error bars of the bands without correction for the mesh, (bands,); None as in `by_mesh`."""
        return self.mesh.at(sizes) + self.mesh.overestimate(sizes) if self.mesh else None

    def by_mesh(self, sizes: Sizes) -> FloatArray | None:
        """Relative discretisation error bars of the bands, (bands,); None without an estimate."""
        return self.mesh.at(sizes) if self.mesh else None


def require_box(case: Case, box: DesignBox | None = None) -> DesignBox:
    """The box of designs with the pillar's section and the rows' lattice, as wide as pillars fit it.

    InputError, a line each, for a case whose cell the model cannot follow.
    """
    design, said = case.design, []
    foot = foot_of(design.pillar) if design.pillar else None
    if foot is None:
        known = "square, round, hexagonal, tapered or cross, without fillet and heavy tip and on the back alone"
        said.append(f"{case.name}: pillar.shape must be {known}, for explore: the others do not grow with their width")
    least, most = ASPECTS
    if design.pillar is not None and not least <= design.pitch_y_m / design.pitch_x_m <= most:
        said.append(
            f"{case.name}: array.pitch_y_mm must lie between {least:g} and {most:g} times pitch_x_mm for explore"
        )
    if not design.stack.is_uniform or (design.pillar and design.pillar.material.constants is None):
        said.append(f"{case.name}: explore holds for a plate of one isotropic layer with isotropic pillars")
    if foot is None or said:
        raise InputError(said)
    case.require_one_kind("explore is")
    case.one_quality_factor("explore")
    box = replace(box or DesignBox(), foot=foot, lattice=lattice_of(design))
    widest = (box.narrow * box.high[PITCH] - 2.0 * box.clearance_m) / foot.widest
    thickness, height, side, pitch = box.high
    return replace(box, high=(thickness, height, min(side, widest), pitch))


def _for_case(offline: Offline, case: Case) -> Offline:
    """The same for the case's section and lattice: a cross has edges enough for one layer each."""
    box = require_box(case, offline.box)
    mesh = replace(offline.mesh, layers=min(offline.mesh.layers, 1)) if box.foot.arm < 1.0 else offline.mesh
    return replace(offline, box=box, mesh=mesh)


def laid_about(case: Case, offline: Offline | None = None) -> Offline:
    """What bases of a box laid about a case's own design are made from; a study's cases share the usual box instead."""
    offline = offline or Offline()
    return replace(offline, box=offline.box.about(sizes_of(case.design))) if case.design.pillar else offline


def cell_model(case: Case, log: Log, offline: Offline | None = None) -> CellModel:
    """The model of a case's materials: taken from the cache, or made now. InputError for a cell that it cannot follow."""
    offline = _for_case(offline or Offline(), case)
    cache = CellModelCache()
    with cache.alone(log):  # cases of a study that need the same model wait for the one that makes it
        kept = kept_model(case, offline)
        if kept is not None:
            log.info("parametric cell taken from the cache")
            return kept
        model = _made(case, offline, log)
        cache.put_model(_key(_materials(case), offline), model)
    return model


def kept_model(case: Case, offline: Offline | None = None) -> CellModel | None:
    """The model of a case's materials where the cache has it. InputError for a cell that it cannot follow."""
    return CellModelCache().get_model(_key(_materials(case), _for_case(offline or Offline(), case)))


def kept_cell(case: Case) -> ParametricCell | None:
    """The parametric cell of a case where the cache has it, the design lies in its box and its mesh is fine enough there; None
    where it must be meshed.
    """
    try:
        offline = _for_case(Offline(), case)
    except InputError:
        return None
    model, sizes = _loaded(_materials(case), offline), sizes_of(case.design)
    if model is None or model.cell.box.faults(sizes):
        return None
    by_mesh = model.as_meshed(sizes)
    return model.cell if by_mesh is not None and by_mesh.max() <= FINE_ENOUGH else None


@lru_cache(maxsize=2)
def _loaded(materials: tuple[Material, Material], offline: Offline) -> CellModel | None:
    return CellModelCache().get_model(_key(materials, offline))


def _materials(case: Case) -> tuple[Material, Material]:
    assert case.design.pillar is not None
    return case.design.stack.material, case.design.pillar.material


def _key(materials: tuple[Material, Material], offline: Offline) -> str:
    return hashlib.sha256(repr(("parametric", offline, materials)).encode()).hexdigest()


def _made(case: Case, offline: Offline, log: Log) -> CellModel:
    box = offline.box
    log.info("the bases of this plate, pillar and box of sizes are computed once and kept: this takes some minutes")
    unseen = as_sizes(box.sample(between(UNSEEN, seed=3)))
    with log.step("mesh the reference cell"):
        affine, coarse = (
            AffineCell(box, mesh, *_materials(case)) if mesh else None for mesh in (offline.mesh, offline.coarse)
        )
        assert affine is not None
    with log.step("reduce the cell over the box of designs"):
        cell, *alone = _reduced(affine, coarse, offline, unseen, log)
    path = box.path(offline.intervals // box.panels)  # the zone of staggered rows has more lines
    fractions, labels = path.wavevectors / np.pi, tuple(label or "" for label in path.labels)
    designs = box.spread(offline.waves, seed=2)
    with log.step("gather waves at every wavevector"), one_thread():
        cell = compressed(cell, rich_sectors(cell, fractions, labels), BANDS, designs)
        floor = own_error(cell, alone, unseen, BANDS)
        bases = band_bases(cell, fractions, labels, BANDS, designs, floor)
    log.info(
        f"bases miss at most {percent(floor)} of a frequency on {len(unseen)} designs that they were not made from"
    )
    if not offline.measures_mesh:
        return CellModel(cell, bases)
    with log.step("compare the box's corners with meshes of their own"), _mapped(offline, log, "design") as apply:
        mesh = mesh_table(case, cell, bases, unseen, apply)
    if mesh:
        worst, middle = mesh.margin * mesh.corners.max(), mesh.at(box.middle).max()
        high = mesh.high.max(), mesh.overestimate(box.middle).max()
        log.info(
            f"the mesh overestimates a band by {percent(high[0])} in the worst corner and {percent(high[1])} in the "
            f"middle, at most; this is corrected, leaving error bars of {percent(worst)} and {percent(middle)}"
        )
    return CellModel(cell, bases, mesh)


def _reduced(
    affine: AffineCell, coarse: AffineCell | None, offline: Offline, unseen: list[Sizes], log: Log
) -> tuple[ParametricCell, ...]:
    """Symmetry classes side by side, in processes of their own."""
    with _mapped(offline, log, "symmetry class") as apply:
        designs = offline.box.spread(offline.designs)
        return parametric_cell(affine, offline.interface, designs, unseen, apply, coarse)


@contextlib.contextmanager
def _mapped(offline: Offline, log: Log, part: str) -> Iterator[Callable[..., Iterable[Any]]]:
    """A map over so many processes as were asked for, which logs every part that is done."""
    with LocalWorkers(offline.workers, 1) if offline.workers > 1 else contextlib.nullcontext() as workers:

        def apply(work: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Any]:
            for number, done in enumerate((workers.map if workers else map)(work, tasks), start=1):
                log.info(f"{part} {number} of {len(tasks)} done")
                yield done

        yield apply


HALVED = re.compile(r"cell\.blocks\.\d+\.(stiffness|mass)").fullmatch  # symmetric: single precision holds them


class CellModelCache(ArrayCache):
    """Models, a file each, in a folder of their own, so that the cells of a sweep never displace them."""

    def __init__(self, folder: Path = RESULTS / ".explore", max_bytes: int = MAX_BYTES) -> None:
        super().__init__(folder, max_bytes)

    @contextlib.contextmanager
    def alone(self, log: Log) -> Iterator[None]:
        """One process at a time makes a model, the others say that they wait; none does where the folder cannot be written."""
        import fcntl

        with contextlib.ExitStack() as resources:
            with contextlib.suppress(OSError):
                self.folder.mkdir(parents=True, exist_ok=True)
                file = resources.enter_context((self.folder / ".making").open("w"))
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # the kernel frees it when the process ends
                except BlockingIOError:
                    log.info("another process computes the bases of an explorer: waiting for it")
                    fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def get_model(self, key: str) -> CellModel | None:
        """The model kept under this key by the same code, or None."""
        flat = self.load(key)
        if flat is None:
            return None
        return unpacked(CellModel, {name: symmetric(own) if HALVED(name) else own for name, own in flat.items()})

    def put_model(self, key: str, model: CellModel) -> None:
        """Keep a model; where the disk is full it is made again in the next run."""
        flat = packed(model)
        self.keep(key, {name: triangles(own).astype(np.float32) if HALVED(name) else own for name, own in flat.items()})
