"""The unit cell as meshed, under Bloch's conditions, with two coarser meshes that tell the error of its own.

An independent path beside the reduced cell: three solves a wavevector, each counted, paired in ascending order, which is how
the frequencies of nested meshes follow each other (boffi2010).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import HexSettings, cell_boxes, hex_mesh
from geometry.layout import Design, region_materials
from geometry.mesh import Mesh
from solvers.fem.assembly import assemble
from solvers.fem.coarser import Shares, rim_shares
from solvers.superelement.lattice_error import STILL
from solvers.superelement.plate_error import ModeErrors
from solvers.waves.bloch import BlochCell


@dataclass(frozen=True)
class WholeCell:
    """A meshed cell, the same without the innermost layer (the same again where it has none) and of one order less."""

    mesh: Mesh
    own: BlochCell
    layer: BlochCell
    order: BlochCell
    shares: Shares

    @classmethod
    def of(cls, design: Design, settings: HexSettings) -> WholeCell:
        """The meshes of a design's cell."""
        pillar = design.pillar
        shares = rim_shares(design.material, pillar.material, settings, *pillar.joints) if pillar else Shares()
        mesh, less = _mesh(design, settings), replace(settings, order=settings.order - 1)
        own, order = _bloch(design, mesh), _bloch(design, _mesh(design, less))
        layer = _bloch(design, _mesh(design, settings.coarser)) if pillar and settings.layers else None
        return cls(mesh, own, layer or (order if pillar else own), order, shares)

    @property
    def dof(self) -> int:
        """Degrees of freedom at a wavevector."""
        return self.own.dof

    def solve(self, wavevector: FloatArray, count: int) -> tuple[FloatArray, ModeErrors]:
        """The `count` lowest frequencies at a wavevector (2,) in rad/m, Hz, less what coarser meshes tell; and their errors."""
        own, layer, order = (cell.frequencies(wavevector, count) for cell in (self.own, self.layer, self.order))
        moving = own > STILL * own[-1]
        layer, order = (np.where(moving, each / np.where(moving, own, 1.0) - 1.0, 0.0) for each in (layer, order))
        taken, none = self.shares.taken * layer, np.zeros_like(own)
        errors = ModeErrors(none, none, taken, self.shares.half_width(layer, order))
        return np.asarray(own / (1.0 + taken)), errors


def _mesh(design: Design, settings: HexSettings) -> Mesh:
    return hex_mesh(cell_boxes(design, settings), settings.order)


def _bloch(design: Design, mesh: Mesh) -> BlochCell:
    return BlochCell(assemble(mesh, region_materials(design.material, design.pillar)), *design.cell_m)
