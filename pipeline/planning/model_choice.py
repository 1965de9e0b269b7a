"""How each part of a scene is modelled: what a plan lists and what `parts`, `bands` and `attenuation` then build."""

from __future__ import annotations

from dataclasses import dataclass, replace

from geometry.hex.boxes import HexSettings
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.planning import mesh_rules, simplifications
from pipeline.planning.calibration import HEX, TET, TET_ORDER
from pipeline.planning.mesh_rules import MeshLevel
from pipeline.planning.simplifications import CLASSES, Simplification
from solvers.superelement.build import ReductionSettings

SUPERELEMENT, SOLID = "superelement", "solid"


@dataclass(frozen=True)
class ModelChoice:
    """Model and mesh of one part: superelement or solid, hexahedra (settings) or tetrahedra (edge, m), the
    reduction's reduction settings.

    `classes` are the symmetry classes that are solved apart, (None,) for a body without mirrors; `why` gives the reasons;
    up to `good_to_hz` the mesh makes no larger error than its calibration tells.
    """

    part: str
    model: str
    kind: str
    hexahedra: HexSettings | None
    edge_m: float | None
    reduction: ReductionSettings | None
    classes: tuple[str | None, ...]
    left_out: tuple[Simplification, ...]
    why: tuple[str, ...]
    good_to_hz: float
    mesh_level: MeshLevel | None = None  # of hexahedra

    @property
    def name(self) -> str:
        """As results name it: superelement hex3, solid tet2."""
        order = self.hexahedra.order if self.hexahedra and self.kind == HEX else TET_ORDER
        return f"{self.model} {self.kind}{order}"

    @property
    def mirrored(self) -> bool:
        """Whether a quarter stands for the whole."""
        return self.classes != (None,)

    @property
    def mesh(self) -> str:
        """The mesh in words."""
        if self.kind == TET:
            return f"tetrahedra of order {TET_ORDER}, {_mm(self.edge_m or 0.0)} edges"
        assert self.hexahedra
        graded = f", {self.hexahedra.layers} graded layers at singular edges" if self.hexahedra.layers else ""
        through = f", {self.hexahedra.through} through the plate" if self.hexahedra.through > 1 else ""
        return f"hexahedra of order {self.hexahedra.order}, {_mm(self.hexahedra.size_m)}{through}{graded}"


def model_choice_of(case: Case, part: str, high_hz: float) -> ModelChoice:
    """How a part of a case is modelled for modes up to a frequency. InputFault for a model that cannot serve."""
    check_model(case, box=part == "zone" or not (case.design.pillar and not case.design.pillar.is_box))
    return {"plate": _plate, "zone": _zone, "pillar": _pillar}[part](case, high_hz)


def check_model(case: Case, box: bool) -> None:
    """Refuse what no solver here does: an analytic answer to a computed question, hexahedra for what is no box."""
    faults = []
    if case.solve.model == "analytic":
        faults.append(
            "solve.model = 'analytic': must be auto, superelement or solid here; `antinode predesign` is analytic"
        )
    if case.solve.mesh == HEX and not box:
        faults.append("solve.mesh = 'hex': must be auto or tet, only square pillars without fillet are boxes")
    if faults:
        raise InputError(f"{case.source or case.name}: {fault}" for fault in faults)


def _zone(case: Case, high_hz: float) -> ModelChoice:
    design, accuracy = case.design, case.solve.accuracy
    no_cad, quarter = simplifications.boxes(case, "zone"), simplifications.mirror_images(case.design, "zone")
    mesh_level, top_hz = mesh_rules.reaching("zone", design, accuracy, high_hz)
    hexahedra = mesh_rules.zone_mesh(design, mesh_level, top_hz) if no_cad else None
    edge = None if no_cad else mesh_rules.tet_edge_m(2.0 * design.thickness_m, accuracy)
    return _lone(case, "zone", mesh_level, hexahedra, edge, bool(quarter), (no_cad, quarter), top_hz)


def _pillar(case: Case, high_hz: float) -> ModelChoice:
    design, accuracy = case.design, case.solve.accuracy
    assert design.pillar
    no_cad = simplifications.boxes(case, "pillar")
    quarter = simplifications.mirror_images(design, "pillar") if no_cad else None  # tetrahedra mesh the whole pillar
    mesh_level, top_hz = mesh_rules.reaching("pillar", design, accuracy, high_hz)
    hexahedra = mesh_rules.pillar_mesh(design, mesh_level, top_hz) if no_cad else None
    edge = None if no_cad else mesh_rules.tet_edge_m(design.pillar.tip_m, accuracy)
    return _lone(case, "pillar", mesh_level, hexahedra, edge, bool(quarter), (no_cad, quarter), top_hz)


def _lone(
    case: Case, part: str, mesh_level: MeshLevel, hexahedra: HexSettings | None, edge_m: float | None, quarter: bool,
    taken: tuple[Simplification | None, ...], top_hz: float,
) -> ModelChoice:  # fmt: skip
    """A part by itself, as a solid: its mesh depends on how high its modes lie."""
    choice = _model_choice(
        case,
        part,
        SOLID,
        hexahedra,
        edge_m,
        None,
        quarter,
        taken,
        _because(case, part, hexahedra, mesh_level),
        mesh_level,
    )
    return replace(choice, good_to_hz=top_hz) if choice.kind == HEX else choice


def _plate(case: Case, high_hz: float) -> ModelChoice:
    design, solve = case.design, case.solve
    bare, no_cad = simplifications.no_pillars(design, "plate"), simplifications.boxes(case, "plate")
    quarter = simplifications.mirror_images(design, "plate")
    taken: tuple[Simplification | None, ...] = (bare, no_cad, quarter)
    if solve.model == SOLID:
        mesh_level = mesh_rules.mesh_level("whole", solve.accuracy)
        hexahedra = mesh_rules.cell_mesh(design, mesh_level) if no_cad else None
        edge = None if no_cad else mesh_rules.tet_plate_edge_m(design, solve.accuracy)
        reason = "the case asks for it"
        why = (reason, *_because(case, "whole", hexahedra, mesh_level))
        return _model_choice(case, "plate", SOLID, hexahedra, edge, None, bool(quarter), taken, why, mesh_level)
    reduction, mesh_level = (
        mesh_rules.plate_reduction(design, solve.accuracy, high_hz),
        mesh_rules.mesh_level("plate", solve.accuracy),
    )
    edge = None if no_cad or bare else mesh_rules.tet_cell_edge_m(design, solve.accuracy)
    taken = (*taken, simplifications.alike_cells(design))
    why = (
        "cells assembled cost one reduction a kind; one mesh level finer where their own estimate asks for it",
        *_because(case, "plate", None if edge else reduction.hexahedra, mesh_level),
    )
    return _model_choice(
        case, "plate", SUPERELEMENT, reduction.hexahedra, edge, reduction, bool(quarter), taken, why, mesh_level
    )


def cell_model_choice(case: Case) -> ModelChoice:
    """How the unit cell is modelled: reduced, or as meshed when the case asks for the solid and boxes allow it. InputFault."""
    check_model(case, box=not (case.design.pillar and not case.design.pillar.is_box))
    design, solve = case.design, case.solve
    no_cad = simplifications.boxes(case, "cell")
    taken, mesh_level = (
        (simplifications.no_pillars(design, "cell"), no_cad),
        mesh_rules.mesh_level("cell", solve.accuracy),
    )
    if solve.model == SOLID and no_cad:
        settings = mesh_rules.cell_settings(design, solve.accuracy)
        why = ("the case asks for it", *_because(case, "cell", settings, mesh_level))
        return _model_choice(case, "cell", SOLID, settings, None, None, False, taken, why, mesh_level)
    reduction = mesh_rules.lattice_reduction(design, solve.accuracy)
    edge = None if no_cad else mesh_rules.tet_cell_edge_m(design, solve.accuracy)
    why = (
        "one reduced pair serves every wavevector",
        *_because(case, "cell", reduction.hexahedra if no_cad else None, mesh_level),
    )
    return _model_choice(
        case, "cell", SUPERELEMENT, reduction.hexahedra, edge, reduction, False, taken, why, mesh_level
    )


def _model_choice(
    case: Case, part: str, model: str, hexahedra: HexSettings | None, edge_m: float | None, reduction: ReductionSettings | None,
    quarter: bool, taken: tuple[Simplification | None, ...], why: tuple[str, ...], mesh_level: MeshLevel,
) -> ModelChoice:  # fmt: skip
    classes: tuple[str | None, ...] = CLASSES if quarter else (None,)
    kind = HEX if edge_m is None else TET
    good = mesh_rules.good_to_hz(part, case.design)
    left_out = tuple(simplification for simplification in taken if simplification)
    return ModelChoice(
        part,
        model,
        kind,
        hexahedra,
        edge_m,
        reduction,
        classes,
        left_out,
        why,
        good,
        mesh_level if kind == HEX else None,
    )


def _because(case: Case, part: str, hexahedra: HexSettings | None, mesh_level: MeshLevel) -> tuple[str, ...]:
    accuracy = f"accuracy {case.solve.accuracy:g}"
    if hexahedra:
        error = mesh_rules.expected_error(part, mesh_level)
        reason = "not calibrated" if error is None else f"expected error {error:.2%} by the calibration"
        return (f"{accuracy} asks for order {hexahedra.order} with {hexahedra.layers} graded layers: {reason}",)
    shape = "the case asks for tetrahedra" if case.solve.mesh == TET else "the pillar is no box"
    return (shape, f"{accuracy} sets their edges")


def _mm(length_m: float) -> str:
    return f"{1e3 * length_m:.3g} mm"
