"""Resource estimate of a driven plate: memory held by its symmetry classes, patches and tolerance samples together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import prod

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.scenes import HexSettings, bonded_scene, grid_lines
from geometry.layout import mirrored_axes
from pipeline.case.model import Case
from pipeline.planning import resource_estimate, simplifications
from pipeline.planning.model_choice import ModelChoice, Request
from pipeline.planning.resource_estimate import AssembledClass
from pipeline.planning.resources import ResourceEstimate
from solvers.fem.cost import (
    Cost,
    Fill,
    MeshCounts,
    Stage,
    assembly,
    eliminated,
    factorisation,
    modal_solve,
)

PENCIL = 24.0  # bytes per entry of K and M
BOND = 3  # matrices of a patch's bonded face: stiffness, mass, flexibility
FORCES = 240.0  # right-hand sides solved together beneath a patch
COARSER = 1.3  # times the work on the finest mesh beneath a patch: includes the coarser one
SAME_M = 1e-9


def as_driven(case: Case, choice: ModelChoice) -> ModelChoice:
    """Adapt the choice to a driven plate, which is solved whole if its patches couple all symmetry classes."""
    if case.patches is None or len(simplifications.patch_groups(case.patches)) > 1:
        return choice
    left_out = tuple(each for each in choice.left_out if each.rule != "mirror_images")
    return replace(choice, quarter=False, left_out=left_out)


def of_response(case: Case, choice: ModelChoice, band_hz: tuple[float, float], frequencies: int) -> ResourceEstimate:
    """Estimate a response: every driven group of classes joined with the patches on two meshes, and its modes."""
    choice = as_driven(case, choice)
    undriven = simplifications.undriven(case.patches) if case.patches and choice.quarter else []
    return _driven(case, choice, band_hz, frequencies, set(undriven))


def of_tolerance(case: Case, choice: ModelChoice, band_hz: tuple[float, float], frequencies: int) -> ResourceEstimate:
    """Estimate plates whose pillars differ: all groups of classes, and every pillar in the space of their modes."""
    choice = as_driven(case, choice)
    demand = _driven(case, choice, band_hz, frequencies, set())
    if choice.reduction is None:
        return demand
    own = resource_estimate.assembled_class(case.design, choice, choice.reduction)
    pillars = resource_estimate.pillar_count(case.design)
    size = (demand.modes or 0.0) + 2.0 * len(choice.classes) * _loads(case) + pillars / 2.0
    varied = Stage("varying the pillars", own.kept_bytes + 2.0 * 8.0 * pillars * own.functions * size)
    held = len(choice.classes) * _Joined(own, _Patches(case, own)).bytes
    moved = max((_moved(own, *kind) for kind in own.kinds), key=lambda stage: stage.bytes)
    return replace(demand, cost=demand.cost.then(Cost((varied,)), held).then(Cost((moved,))))


def _moved(own: AssembledClass, mesh: MeshCounts, functions: float, copies: int) -> Stage:
    """Reduction of a panel with its pillar moved, while matrices and shapes of the original stay in memory."""
    shapes = 8.0 * mesh.dofs * (own.reduction.ample.count + functions)
    still = mesh.mesh_bytes + 2.0 * 9.0 * 12.0 * mesh.pairs + shapes
    peak = resource_estimate.panel_reduction(mesh, own.reduction.ample, functions, copies).peak.bytes
    return Stage("moving the pillar of a panel", still + peak)


def _loads(case: Case) -> int:
    """Number of loads: one per patch, or a single pressure."""
    return case.patches.count if case.patches else 1


def _driven(
    case: Case, choice: ModelChoice, band_hz: tuple[float, float], frequencies: int, undriven: set[str]
) -> ResourceEstimate:
    from solvers.piezo.forced import MARGIN

    demand = resource_estimate.of_modes(
        case, choice, Request("plate", (MARGIN[0] * band_hz[0], MARGIN[1] * band_hz[1]))
    )
    modes = demand.modes or 0.0
    cost = demand.cost.then(Cost((), 100.0 * modes**2 * frequencies))
    if choice.reduction is None:
        return replace(demand, cost=cost)
    own = resource_estimate.assembled_class(case.design, choice, choice.reduction)
    patches, held = _Patches(case, own), own.kept_bytes
    cost, held = cost.then(patches.compliance, held), held + patches.bytes
    for group in _groups(case, choice):
        if {*group} <= undriven:
            continue
        joined = _Joined(own, patches, len(group))
        each = modes * len(group) / len(choice.classes)
        cost = cost.then(joined.solve(each), held + joined.bytes)
        held += joined.bytes + 8.0 * joined.dofs * (each + 2.0 * _loads(case))
    return replace(demand, cost=cost)


def group_bytes(case: Case, choice: ModelChoice, modes: float) -> float:
    """Memory of the largest group of classes while its share of the plate's `modes` is solved, B."""
    choice = as_driven(case, choice)
    if choice.reduction is None:
        return 0.0
    own, groups = resource_estimate.assembled_class(case.design, choice, choice.reduction), _groups(case, choice)
    most = max(len(group) for group in groups)
    joined = _Joined(own, _Patches(case, own), most)
    return joined.bytes + joined.solve(modes * most / len(choice.classes)).peak.bytes


def _groups(case: Case, choice: ModelChoice) -> list[tuple[str, ...]]:
    """Classes that are solved together."""
    if case.patches and choice.quarter:
        return simplifications.patch_groups(case.patches)
    return [(each or "",) for each in choice.classes]


@dataclass(frozen=True)
class _Joined:
    """Classes that the patches couple, joined with them: each patch adds a dense block over its panels."""

    own: AssembledClass
    patches: _Patches
    classes: int = 1

    @property
    def dofs(self) -> float:
        return self.classes * self.own.dofs

    @property
    def entries(self) -> float:
        return self.classes * self.own.entries + self.patches.distinct * (self.classes * self.patches.felt) ** 2

    @property
    def fill(self) -> Fill:
        dense = eliminated(self.classes * self.patches.felt, 0.0)
        return self.own.fill.times(self.classes) + dense.times(self.patches.distinct)

    @property
    def bytes(self) -> float:
        """K and M of the group, and the motions of the bonded faces."""
        return PENCIL * self.entries + self.classes * self.patches.motion_bytes

    def solve(self, modes: float) -> Cost:
        """Cost of the group's modes, while K and M of the bare plate and of a coarser patch mesh stay in memory."""
        coarser = PENCIL * (self.classes * self.own.entries + self.entries) if self.patches.distinct else 0.0
        return Cost().then(modal_solve(self.dofs, self.entries, self.fill, modes), coarser)


class _Patches:
    """Sizes of a case's patches on their panels; empty if a pressure drives the plate."""

    def __init__(self, case: Case, own: AssembledClass) -> None:
        self.case, self.own = case, own
        self.boxes = np.array(case.patches.boxes_m()) if case.patches else np.empty((0, 4))

    @property
    def distinct(self) -> int:
        """Number of patches that are distinct under mirror images."""
        axes = (0, 1) if self.own.quarter else ()
        folded = self.boxes.reshape(-1, 2, 2).copy()
        for axis in axes:
            turned = folded[:, axis].sum(axis=1) < -SAME_M
            folded[turned, axis] = -folded[turned, axis, ::-1]
        return len(np.unique(np.round(folded / SAME_M), axis=0))

    @cached_property
    def _meshes(self) -> list[HexSettings]:
        from solvers.piezo.patch import patch_mesh

        mesh = patch_mesh(self.case.design, self.own.tiling, self.boxes[0])
        return [mesh, mesh.coarser]

    @cached_property
    def _faces(self) -> FloatArray:
        """Degrees of freedom of each patch's bonded face, mesh by mesh, (patches, meshes)."""
        return np.array([[_face(box, mesh) for mesh in self._meshes] for box in self.boxes]).reshape(-1, 2)

    @cached_property
    def felt(self) -> float:
        """Degrees of freedom of the panels beneath the patch that lies on most of them, images apart."""
        face, tiling = self.own.reduction.interface, self.own.tiling
        most = 0.0
        for box in self.boxes:
            pairs = zip(self._panels(box, 0.0), (len(tiling.x) - 1, len(tiling.y) - 1), strict=True)
            nx, ny = (self._unlike(*span, count) for span, count in pairs)
            sides = nx * (ny + 1) + ny * (nx + 1)
            own = (nx + 1) * (ny + 1) * face.vertex_block + sides * face.side_block + nx * ny * self.own.bare_modes
            most = max(most, own)
        return most

    def _unlike(self, first: int, last: int, count: int) -> int:
        """Number of panels from `first` to `last`, in a line of `count`, that are distinct under mirror images."""
        numbers = range(first, last + 1)
        return len({max(each, count - 1 - each) for each in numbers}) if self.own.quarter else len(numbers)

    def _panels(self, box: FloatArray, reach_m: float) -> list[tuple[int, int]]:
        from solvers.superelement.bond import between

        tiling = self.own.tiling
        return [between(*pair, reach_m) for pair in zip((tiling.x, tiling.y), box.reshape(2, 2), strict=True)]

    @property
    def motion_bytes(self) -> float:
        """Motions of the bonded faces in one class."""
        return 12.0 * self._share * self.felt * float(self._faces.sum())

    @property
    def bytes(self) -> float:
        """Matrices of the bonded faces with their mirror images, and their blocks in the plate's matrices."""
        bonds = (1.0 + self._share) * BOND * 8.0 * float((self._faces**2).sum())
        return bonds + 4.0 * self.distinct * 8.0 * self.felt**2

    @property
    def _share(self) -> float:
        """Fraction of the patches that are distinct under mirror images."""
        return self.distinct / max(len(self.boxes), 1)

    @property
    def compliance(self) -> Cost:
        """Largest static solve on the finest mesh of the panels beneath a patch."""
        return max((self._beneath(box) for box in self.boxes), key=lambda cost: cost.peak.bytes, default=Cost())

    def _beneath(self, box: FloatArray) -> Cost:
        tiling, stack = self.own.tiling, self.case.design.stack
        spans = zip((tiling.x, tiling.y), self._panels(box, stack.thickness_m), strict=True)
        span = np.array([lines[at] for lines, (first, last) in spans for at in (first, last + 1)])
        middle = np.repeat(span.reshape(2, 2).mean(axis=1), 2)
        span, box = span - middle, box - middle
        mirrors = [axis for axis in (0, 1) if mirrored_axes(box[None])[axis]]
        span.reshape(2, 2)[mirrors, 0] = 0.0
        assert self.case.patches
        settings, face = self._meshes[0], _face(box, self._meshes[0])
        back = self.case.patches.face == "back"
        mesh = resource_estimate.of_boxes(bonded_scene(span, stack, (), box, back, settings), settings.order)
        answers = Stage("solving beneath a patch", 8.0 * (2.0 * FORCES * mesh.dofs + 4.0 * face**2))
        solve = factorisation(mesh.dofs, 9.0 * mesh.pairs, mesh.fill, 1.0)
        solve = solve.then(
            Cost((answers,), 8.0 * mesh.fill.entries * face / 2.0 ** len(mirrors)), 15.0 * mesh.fill.entries
        )
        kept = mesh.mesh_bytes + 2.0 * 9.0 * 12.0 * mesh.pairs
        times = COARSER * self.distinct * 2 ** len(mirrors)
        whole = assembly(mesh).then(solve, kept)
        return replace(whole, operations=times * whole.operations)


def _face(box: FloatArray, mesh: HexSettings) -> float:
    """Degrees of freedom of a bonded face."""
    lines = (grid_lines({float(low): True, float(high): True}, mesh.grading) for low, high in box.reshape(2, 2))
    return 3.0 * prod(mesh.order * (len(each) - 1) + 1 for each in lines)
