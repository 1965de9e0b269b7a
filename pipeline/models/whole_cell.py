"""The unit cell as meshed, under Bloch's conditions, with two coarser meshes that tell the error of its own.

The independent path beside the reduced cell: no symmetry, no reduction, every wave counted by inertia.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import cell_boxes, hex_mesh, interpolation
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, region_materials
from geometry.mesh import Mesh
from pipeline.models.parts import foot_shares
from solvers.fem.assembly import assemble
from solvers.fem.eigen import PlainPencil, lowest_pairs
from solvers.fem.mesh_error import Nested, Shares, prolonged_eigenvalues
from solvers.superelement.lattice_error import STILL
from solvers.superelement.plate_error import ModeErrors
from solvers.waves.bloch import BlochCell

MORE = 4  # waves beside those asked for


@dataclass(frozen=True)
class WholeCell:
    """A meshed cell, the same without the innermost layer (None where it has none) and of one order less."""

    mesh: Mesh
    own: BlochCell
    layer: Nested[BlochCell] | None
    order: Nested[BlochCell]
    shares: Shares

    @classmethod
    def of(cls, design: Design, settings: HexSettings) -> WholeCell:
        """The meshes of a design's cell."""
        boxes, mesh = cell_boxes(design, settings), _mesh(design, settings)

        def nested(other: HexSettings) -> Nested[BlochCell]:
            transfer = interpolation(cell_boxes(design, other), boxes, settings.order, other.order)
            return Nested(_bloch(design, _mesh(design, other)), transfer)

        layer = nested(settings.coarser) if design.pillar and settings.layers else None
        order = nested(replace(settings, order=settings.order - 1))
        return cls(mesh, _bloch(design, mesh), layer, order, foot_shares(design, settings))

    @property
    def dof(self) -> int:
        """Degrees of freedom at a wavevector."""
        return self.own.dof

    def solve(self, wavevector: FloatArray, count: int) -> tuple[FloatArray, ModeErrors]:
        """The `count` lowest frequencies at a wavevector (2,) in rad/m, Hz, less what coarser meshes tell; and their errors.

        Waves that the mesh misses by more than those about them change places: some more are solved, and sorted.
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
        layer = change(self.layer) if self.layer else order  # all of it the edge's; a bare cell's shares count none
        none, taken = np.zeros(count), self.shares.taken * layer
        best, half = tones[::copies] / (1.0 + taken), self.shares.half_width(layer, order)
        lowest = np.argsort(best, kind="stable")[:count]
        return best[lowest], ModeErrors(none, none, none, taken[lowest], half[lowest])

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


def _mesh(design: Design, settings: HexSettings) -> Mesh:
    return hex_mesh(cell_boxes(design, settings), settings.order)


def _bloch(design: Design, mesh: Mesh) -> BlochCell:
    return BlochCell(assemble(mesh, region_materials(design.material, design.pillar)), *design.cell_m)
