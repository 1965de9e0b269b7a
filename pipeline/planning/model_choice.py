"""How each part of a scene is modelled: what a plan lists and what `parts`, `bands` and `attenuation` then build."""

from __future__ import annotations

from dataclasses import dataclass, replace

from geometry.hex.boxes import HexSettings
from pipeline.case.model import Case
from pipeline.errors import InputFault
from pipeline.planning import mesh_rules, simplifications
from pipeline.planning.calibration import HEX, TET, TET_ORDER
from pipeline.planning.mesh_rules import Rung
from pipeline.planning.simplifications import CLASSES, Omission
from solvers.superelement.build import Recipe

SUPERELEMENT, SOLID = "superelement", "solid"


@dataclass(frozen=True)
class Way:
    """Model and mesh of one part: superelement or solid, hexahedra (settings) or tetrahedra (edge, m), the reduction's recipe.

    `classes` are the mirror classes that are solved apart, (None,) for a body without mirrors; `why` gives the reasons;
    up to `good_to_hz` the mesh makes no larger error than its calibration tells.
    """

    part: str
    model: str
    kind: str
    hexahedra: HexSettings | None
    edge_m: float | None
    recipe: Recipe | None
    classes: tuple[str | None, ...]
    left_out: tuple[Omission, ...]
    why: tuple[str, ...]
    good_to_hz: float
    rung: Rung | None = None  # of hexahedra

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


def way_of(case: Case, part: str, high_hz: float) -> Way:
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
        raise InputFault(f"{case.source or case.name}: {fault}" for fault in faults)


def _zone(case: Case, high_hz: float) -> Way:
    design, accuracy = case.design, case.solve.accuracy
    no_cad, quarter = simplifications.boxes(case, "zone"), simplifications.mirror_images(case.design, "zone")
    rung, top_hz = mesh_rules.reaching("zone", design, accuracy, high_hz)
    hexahedra = mesh_rules.zone_mesh(design, rung, top_hz) if no_cad else None
    edge = None if no_cad else mesh_rules.tet_edge_m(2.0 * design.thickness_m, accuracy)
    return _lone(case, "zone", rung, hexahedra, edge, bool(quarter), (no_cad, quarter), top_hz)


def _pillar(case: Case, high_hz: float) -> Way:
    design, accuracy = case.design, case.solve.accuracy
    assert design.pillar
    no_cad = simplifications.boxes(case, "pillar")
    quarter = simplifications.mirror_images(design, "pillar") if no_cad else None  # tetrahedra mesh the whole pillar
    rung, top_hz = mesh_rules.reaching("pillar", design, accuracy, high_hz)
    hexahedra = mesh_rules.pillar_mesh(design, rung, top_hz) if no_cad else None
    edge = None if no_cad else mesh_rules.tet_edge_m(design.pillar.tip_m, accuracy)
    return _lone(case, "pillar", rung, hexahedra, edge, bool(quarter), (no_cad, quarter), top_hz)


def _lone(
    case: Case, part: str, rung: Rung, hexahedra: HexSettings | None, edge_m: float | None, quarter: bool,
    taken: tuple[Omission | None, ...], top_hz: float,
) -> Way:  # fmt: skip
    """A part by itself, as a solid: its mesh depends on how high its modes lie."""
    way = _way(case, part, SOLID, hexahedra, edge_m, None, quarter, taken, _because(case, part, hexahedra, rung), rung)
    return replace(way, good_to_hz=top_hz) if way.kind == HEX else way


def _plate(case: Case, high_hz: float) -> Way:
    design, solve = case.design, case.solve
    bare, no_cad = simplifications.no_pillars(design, "plate"), simplifications.boxes(case, "plate")
    quarter = simplifications.mirror_images(design, "plate")
    taken: tuple[Omission | None, ...] = (bare, no_cad, quarter)
    if solve.model == SOLID:
        rung = mesh_rules.rung("whole", solve.accuracy)
        hexahedra = mesh_rules.cell_mesh(design, rung) if no_cad else None
        edge = None if no_cad else mesh_rules.tet_plate_edge_m(design, solve.accuracy)
        reason = "the case asks for it"
        why = (reason, *_because(case, "whole", hexahedra, rung))
        return _way(case, "plate", SOLID, hexahedra, edge, None, bool(quarter), taken, why, rung)
    recipe, rung = mesh_rules.plate_recipe(design, solve.accuracy, high_hz), mesh_rules.rung("plate", solve.accuracy)
    edge = None if no_cad or bare else mesh_rules.tet_cell_edge_m(design, solve.accuracy)
    taken = (*taken, simplifications.alike_cells(design))
    why = (
        "cells joined cost one reduction a kind; one rung up where their own estimate asks for it",
        *_because(case, "plate", None if edge else recipe.hexahedra, rung),
    )
    return _way(case, "plate", SUPERELEMENT, recipe.hexahedra, edge, recipe, bool(quarter), taken, why, rung)


def cell_way(case: Case) -> Way:
    """How the unit cell is modelled: reduced, or as meshed when the case asks for the solid and boxes allow it. InputFault."""
    check_model(case, box=not (case.design.pillar and not case.design.pillar.is_box))
    design, solve = case.design, case.solve
    no_cad = simplifications.boxes(case, "cell")
    taken, rung = (simplifications.no_pillars(design, "cell"), no_cad), mesh_rules.rung("cell", solve.accuracy)
    if solve.model == SOLID and no_cad:
        settings = mesh_rules.cell_settings(design, solve.accuracy)
        why = ("the case asks for it", *_because(case, "cell", settings, rung))
        return _way(case, "cell", SOLID, settings, None, None, False, taken, why, rung)
    recipe = mesh_rules.lattice_recipe(design, solve.accuracy)
    edge = None if no_cad else mesh_rules.tet_cell_edge_m(design, solve.accuracy)
    why = (
        "one reduced pair serves every wavevector",
        *_because(case, "cell", recipe.hexahedra if no_cad else None, rung),
    )
    return _way(case, "cell", SUPERELEMENT, recipe.hexahedra, edge, recipe, False, taken, why, rung)


def _way(
    case: Case, part: str, model: str, hexahedra: HexSettings | None, edge_m: float | None, recipe: Recipe | None,
    quarter: bool, taken: tuple[Omission | None, ...], why: tuple[str, ...], rung: Rung,
) -> Way:  # fmt: skip
    classes: tuple[str | None, ...] = CLASSES if quarter else (None,)
    kind = HEX if edge_m is None else TET
    good = mesh_rules.good_to_hz(part, case.design)
    left_out = tuple(omission for omission in taken if omission)
    return Way(
        part, model, kind, hexahedra, edge_m, recipe, classes, left_out, why, good, rung if kind == HEX else None
    )


def _because(case: Case, part: str, hexahedra: HexSettings | None, rung: Rung) -> tuple[str, ...]:
    accuracy = f"accuracy {case.solve.accuracy:g}"
    if hexahedra:
        error = mesh_rules.expected_error(part, rung)
        told = "not calibrated" if error is None else f"expected error {error:.2%} by the calibration"
        return (f"{accuracy} asks for order {hexahedra.order} with {hexahedra.layers} graded layers: {told}",)
    shape = "the case asks for tetrahedra" if case.solve.mesh == TET else "the pillar is no box"
    return (shape, f"{accuracy} sets their edges")


def _mm(length_m: float) -> str:
    return f"{1e3 * length_m:.3g} mm"
