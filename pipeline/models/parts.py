"""Plate, zone and lone pillar as models to solve, of boxes or of tetrahedra, with what is said of their meshes.

A coarse mesh shows first how high the modes about a frequency lie and how many of each symmetry class there are: it chooses the
mesh and the number of modes that each class is asked for. What is reported is counted on the finer mesh all the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import Boxes, hex_mesh, interpolation, part_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, region_materials
from geometry.mesh import AnyMesh, Mesh, check_mesh
from geometry.tiling import Panel
from pipeline.case.model import Case
from pipeline.logs import Log, TerminalLog
from pipeline.models.cell_cache import CellCache
from pipeline.planning import foresight, simplifications
from pipeline.planning.model_choice import SOLID, ModelChoice, Request, model_choice_of
from pipeline.records import store
from pipeline.records.record import MeshRecord
from solvers.accuracy.mesh import (
    CoarserMeshes,
    ErrorFractions,
    LowerOrders,
    Nested,
    StressRecovery,
    clamped_shares,
    rim_shares,
)
from solvers.errors import CountMismatch, SolverError
from solvers.fem.eigen import PlainPencil, modes_near
from solvers.fem.solid import SolidModel
from solvers.fem.surface import Skin
from solvers.measures.confinement import TouchField
from solvers.plates.assembled import PlateModel, Reductions

MeshErrorSource = CoarserMeshes | LowerOrders | StressRecovery
LOCKING = 0.45  # Poisson's ratio


class PartModel(Protocol):
    """A body whose modes are solved symmetry class by symmetry class."""

    name: str
    symmetries: tuple[str | None, ...]

    def pencil(self, symmetry: str | None) -> PlainPencil:
        """K and M of a class."""
        ...

    def touch(self, symmetry: str | None, vectors: FloatArray) -> TouchField:
        """u_z on the touch face."""
        ...

    def pillar_share(self, symmetry: str | None, vectors: FloatArray) -> FloatArray:
        """Share of the pillars in the kinetic energy."""
        ...

    def skin(self, symmetry: str | None, vectors: FloatArray) -> Skin:
        """Outer surface."""
        ...


def mesh_record(what: str, mesh: AnyMesh) -> MeshRecord:
    """Check a mesh and describe it for the record. Raises MeshError when it is not sound."""
    own = {"kind": mesh.kind, "order": mesh.order, "dof": mesh.dof, "sha256": mesh.sha256}
    return MeshRecord.of(check_mesh(mesh), what=what, volume_error=None, **own)


def build(case: Case, part: str, high_hz: float, log: Log, meshes: list[MeshRecord]) -> PartModel:
    """Build the model that the case asks for and append its meshes to `meshes`. Raises InputError for a model that
    cannot serve.
    """
    choice = model_choice_of(case, part, high_hz)
    simplifications.log_all(choice.left_out, log)
    return built(case, choice, log, meshes)


def built(case: Case, choice: ModelChoice, log: Log, meshes: list[MeshRecord]) -> PartModel:
    """Build the model of a given choice."""
    design, part = case.design, choice.part
    if choice.reduction:
        return _assembled(design, choice, log)
    if choice.edge_m:
        from geometry.tet import scenes

        with log.step(f"mesh the {part} by tetrahedra"):
            mesh = scenes.tet_part(design, part, choice.edge_m, choice.quarter)
    else:
        assert choice.hexahedra
        mesh = hex_mesh(part_boxes(design, part, choice.hexahedra), choice.hexahedra.order)
    meshes.append(mesh_record(part, mesh))
    warn_of_locking(design, mesh, log)
    clamped = ("foot",) if choice.edge_m and part == "pillar" else CLAMPED[part]
    materials = region_materials(design.stack, design.pillar)
    return SolidModel(mesh, materials, clamped, choice.quarter, design.touch_lines_m)


def warn_of_locking(design: Design, mesh: AnyMesh, log: Log) -> None:
    """Warn where displacement elements are known to be too stiff; `antinode report extremes` has the measurement."""
    stiffest = max(material.average.poisson for material in region_materials(design.stack, design.pillar).values())
    if "tet" in mesh.kind and mesh.order == 2 and stiffest > LOCKING:
        log.warning(
            "LOCKING", f"nu = {stiffest:g}: quadratic tetrahedra lock above {LOCKING:g}; hexahedra of order 4 do not"
        )
    if mesh.order == 1:
        log.warning("ORDER_1", "elements of order 1 are far too stiff in bending: kept for comparison only")


CLAMPED = {"zone": ("y+",), "pillar": ("touch",), "plate": ()}  # faces of boxes


def mesh_error_source(case: Case, choice: ModelChoice, model: PartModel) -> MeshErrorSource | None:
    """What tells the error of a part meshed whole: two coarser meshes, two lower orders where nothing is singular, or the
    stresses of its tetrahedra; None for what was reduced, whose cells tell it.
    """
    fine, design = choice.hexahedra, case.design
    materials = region_materials(design.stack, design.pillar)
    if not isinstance(model, SolidModel):
        return None
    if choice.edge_m or fine is None:
        return StressRecovery(model.mesh, materials, model.scale, bool(CLAMPED[choice.part]))
    boxes, layers = part_boxes(design, choice.part, fine), fine.layers

    def nested(settings: HexSettings) -> Nested[SolidModel]:
        own = part_boxes(design, choice.part, settings)
        model = SolidModel(hex_mesh(own, settings.order), materials, CLAMPED[choice.part], choice.quarter)
        return Nested(model, interpolation(own, boxes, fine.order, settings.order))

    order = nested(replace(fine, order=fine.order - 1))
    if choice.part == "plate" and design.pillar is None:
        return _lower_orders(design, boxes, order, nested(replace(fine, order=fine.order - 2)), fine.order)
    return CoarserMeshes(nested(fine.coarser) if layers else None, order, _shares(design, choice.part, fine))


def _lower_orders(
    design: Design, boxes: Boxes, order: Nested[SolidModel], lower: Nested[SolidModel], degree: int
) -> LowerOrders:
    """What lower orders tell of a plate without pillars, which has nothing singular."""
    smallest = min(design.length_m, 2.0 * design.half_span_m, design.thickness_m)
    x, y, z = (float(np.diff(line).max()) / smallest for line in (boxes.x, boxes.y, boxes.z))
    return LowerOrders(order, lower, degree, max(x, y), z)


def _shares(design: Design, part: str, mesh: HexSettings) -> ErrorFractions:
    """What coarser meshes tell at the singular edges of a part."""
    pillar = design.pillar
    if part == "plate":
        return foot_shares(design, mesh)
    if part == "pillar" and pillar:
        return clamped_shares(pillar.material, mesh, *pillar.joints)
    return clamped_shares(design.stack.mean, mesh, thickness_m=design.thickness_m)


def foot_shares(design: Design, mesh: HexSettings) -> ErrorFractions:
    """What coarser meshes tell at the rims of a plate's feet; one without pillars has nothing singular."""
    pillar = design.pillar
    return (
        rim_shares(design.stack.back, pillar.material, mesh, *pillar.joints)
        if pillar
        else ErrorFractions(order=mesh.order)
    )


def _assembled(design: Design, choice: ModelChoice, log: Log) -> PlateModel:
    assert choice.reduction
    reductions = Reductions(
        design.stack,
        design.pillar,
        choice.reduction,
        CellCache(),
        *panel_mesher(design, choice, log),
    )
    with log.step("reduce cells"):
        model = PlateModel(design, reductions, foresight.of_panels(design, choice, choice.reduction))
    log.info(
        f"{len(model.tiling.x) - 1} x {len(model.tiling.y) - 1} panels of {len(model.cells)} kinds: "
        f"{reductions.fresh} reduced now, {reductions.reused} taken from the cache"
    )
    return model


def panel_mesher(design: Design, choice: ModelChoice, log: Log) -> tuple[Callable[[Panel], Mesh] | None, str]:
    """What meshes the panels that carry a pillar by tetrahedra, and its name in the cache; (None, "") for boxes."""
    if choice.edge_m is None:
        return None, ""
    from geometry.tet import scenes

    edge = choice.edge_m

    def mesh(panel: Panel) -> Mesh:
        with log.step("mesh a panel by tetrahedra"):
            return scenes.tet_panel(design, panel, edge)

    file = design.pillar.file if design.pillar else None
    return mesh, f"tet {edge!r} {store.file_hash(Path(file)) if file else ''}"


def tet_cell(design: Design, edge_m: float, log: Log) -> tuple[Mesh, tuple[int, ...]]:
    """The unit cell, finer towards the pillar's foot, and the axes along which it is halved."""
    from geometry.tet import scenes

    is_mirrored = {"x", "y"} <= {*design.cell_mirrors}
    with log.step("mesh the cell by tetrahedra"):
        return scenes.tet_cell(design, edge_m, "xy" if is_mirrored else ""), (0, 1) if is_mirrored else ()


ORDER, OFF = 2, 0.125  # without layers at the singular edges: frequencies up to so much too high
QUIET = TerminalLog(True)


@dataclass(frozen=True)
class CoarseModes:
    """The highest of the modes nearest to a frequency, Hz, and how many to ask each symmetry class for."""

    highest_hz: float
    counts: dict[str | None, int]


def coarse_modes(case: Case, query: Request, choice: ModelChoice) -> CoarseModes | None:
    """The modes of a request on a coarse mesh; None for a band, for what is reduced or meshed by tetrahedra, and where the
    coarse mesh cannot tell.

    All classes by quadratic elements; the class of the highest mode once more by elements for its frequency, without layers,
    which puts it two per cent or so too high, and further where classes change places.
    """
    near, count, fine = query.near_hz, query.count, choice.hexahedra
    if query.band_hz or near is None or count is None or choice.model != SOLID or choice.part == "plate":
        return None
    if fine is None or choice.edge_m is not None or fine.order <= ORDER:
        return None
    rough = _built(case, choice, ORDER)
    try:
        tones = {
            one: modes_near(rough.pencil(one), near, count).frequency_hz
            for one in ((query.symmetry,) if query.symmetry else rough.symmetries)
        }
        away = sorted(abs(tone - near) for each in tones.values() for tone in each)
        reach = away[min(count, len(away)) - 1]
        inside = {one: int((abs(each - near) <= reach).sum()) for one, each in tones.items()}
        last = max(inside, key=lambda one: float(tones[one][abs(tones[one] - near) <= reach].max(initial=0.0)))
        there = model_choice_of(case, query.part, near + reach)
        better = modes_near(_built(case, there, fine.order).pencil(last), near, inside[last]).frequency_hz
    except (CountMismatch, SolverError):
        return None
    return CoarseModes(
        float(better.max()), {one: _needed_count(each, near, reach, count) for one, each in tones.items()}
    )


def _needed_count(tones: FloatArray, near_hz: float, reach_hz: float, count: int) -> int:
    """How many modes to ask a class for: of the lowest one more than may lie within reach; about a frequency the coarse
    mesh does not tell on which side of it a mode lies.
    """
    return count if near_hz else min(count, int((tones <= (1.0 + OFF) * reach_hz).sum()) + 1)


def _built(case: Case, choice: ModelChoice, order: int) -> PartModel:
    assert choice.hexahedra
    coarse = replace(choice.hexahedra, order=order, layers=0, skipped=0)
    return built(case, replace(choice, hexahedra=coarse, mesh_level=None), QUIET, [])
