"""A panel's mesh with its pillar grown, moved or raised: every node goes along, the elements stay joined as they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geometry.elements import FloatArray
from geometry.errors import MeshError
from geometry.hex.boxes import Boxes, hex_mesh, panel_boxes
from geometry.hex.panels import (
    PLANS,
    PatchedMesh,
    foot_from_middle,
    foot_patches,
    leaning,
    lines_along_z,
    panel_mesh,
    relaid,
    square_of,
)
from geometry.hex.scenes import HexSettings
from geometry.layout import Pillar
from geometry.mesh import Mesh
from geometry.tiling import Panel

FLUSH_M = 1e-9


@dataclass(frozen=True)
class PillarChange:
    """How much higher and wider a pillar is, and how far its foot stands from its place along x and y, m.

    Its section keeps its shape: all widths grow by the same ratio.
    """

    height_m: float = 0.0
    side_m: float = 0.0
    x_m: float = 0.0
    y_m: float = 0.0


@dataclass(frozen=True)
class VariedPanel:
    """A panel with a pillar, meshed together with its mirror image about each of the axes `opened` that it is halved along."""

    panel: Panel
    thickness_m: float
    pillar: Pillar
    settings: HexSettings
    opened: tuple[int, ...] = ()

    @cached_property
    def still(self) -> Mesh:
        """The mesh of the pillar as it is. MeshError as panel_mesh."""
        return self._patched.mesh if self.pillar.form.plan in PLANS else self._of_boxes

    def moved(self, change: PillarChange) -> Mesh:
        """The same mesh with the pillar changed; the panel's sides and its thickness stay. MeshError where the foot leaves the
        panel.
        """
        if change.height_m <= -self.pillar.height_m:
            raise MeshError("a pillar's height must stay above 0")
        shifts = _Shift.along(self.panel, self.pillar, change, 0), _Shift.along(self.panel, self.pillar, change, 1)
        if self.pillar.form.plan not in PLANS:
            return self._shifted(shifts, change)
        grown, shift_m = 1.0 + change.side_m / self.pillar.base_m, (change.x_m, change.y_m)
        patches = foot_patches(self._whole, self.pillar, self.settings, grown, shift_m)
        z = lines_along_z(self.thickness_m, self.pillar, self.settings)
        return relaid(self._patched, patches, self._raised(z, change), self.thickness_m)

    def _raised(self, z: FloatArray, change: PillarChange) -> FloatArray:
        """Places along z, those above the plate stretched to the changed height."""
        beyond = np.maximum(z - self.thickness_m, 0.0)
        return np.asarray(z + beyond * change.height_m / self.pillar.height_m)

    @property
    def _whole(self) -> Panel:
        kept = tuple(axis for axis in self.panel.halved if axis not in self.opened)
        return replace(self.panel, halved=kept)

    @cached_property
    def _patched(self) -> PatchedMesh:
        return panel_mesh(self._whole, self.thickness_m, self.pillar, self.settings)

    @cached_property
    def _of_boxes(self) -> Mesh:
        boxes = panel_boxes(replace(self.panel, pillar=square_of(self.pillar)), self.thickness_m, None, self.settings)
        for axis in self.opened:
            boxes = unfolded(boxes, axis)
        taper = 1.0 if self.pillar.is_made_of_boxes else self.pillar.form.taper
        mesh = hex_mesh(boxes, self.settings.order)
        return leaning(mesh, foot_from_middle(self.panel), self.thickness_m, self.pillar.height_m, taper)

    def _shifted(self, shifts: tuple[_Shift, _Shift], change: PillarChange) -> Mesh:
        """Lines along the axes go along with the foot: the plate's nodes piecewise linearly between the panel's sides and the
        foot's, those of the pillar as its foot does.
        """
        mesh = self.still
        x, y, z = mesh.nodes.T
        above = z > self.thickness_m + FLUSH_M
        plan = [np.where(above, own.foot(line), own.plate(line)) for own, line in zip(shifts, (x, y), strict=True)]
        nodes = np.column_stack([*plan, self._raised(z, change)])
        spans = None if mesh.spans is None else np.ptp(nodes[mesh.cells], axis=1)
        return replace(mesh, nodes=nodes, spans=spans)


def unfolded(boxes: Boxes, axis: int) -> Boxes:
    """Boxes on both sides of the mirror plane at 0 from those on its positive side. MeshError where they begin elsewhere."""
    lines = [boxes.x, boxes.y, boxes.z]
    half = lines[axis]
    if half[0] != 0.0:
        raise MeshError("only boxes that begin at 0 can be unfolded")
    lines[axis] = np.concatenate([-half[:0:-1], half])
    region = np.concatenate([np.flip(boxes.region, axis), boxes.region], axis)
    return Boxes(lines[0], lines[1], lines[2], region, boxes.names)


@dataclass(frozen=True)
class _Shift:
    """Where the panel's sides and the foot's lay along an axis, and where they lie then, (4,) m each."""

    old: FloatArray
    new: FloatArray

    @classmethod
    def along(cls, panel: Panel, pillar: Pillar, change: PillarChange, axis: int) -> _Shift:
        """A foot flush with a side stays so and grows to the other side."""
        edge = (panel.high[axis] - panel.low[axis]) / 2.0
        half, grown = pillar.form.extent_m()[axis] / 2.0, 1.0 + change.side_m / pillar.base_m
        ends, centre = np.array([-half, half]), foot_from_middle(panel)[axis]
        feet, moved = centre + ends, centre + (change.x_m, change.y_m)[axis] + grown * ends
        flush = np.abs(np.abs(feet) - edge) < FLUSH_M
        if flush.any():
            moved = np.where(flush, feet, feet + (0.0 if flush.all() else 2.0 * (grown - 1.0) * ends))
        inner = np.concatenate([moved[:1] + edge, np.diff(moved), edge - moved[1:]])
        if inner[1] <= 0.0 or (inner[[0, 2]] < np.where(flush, 0.0, FLUSH_M) - FLUSH_M / 2.0).any():
            raise MeshError("a pillar reaches out of its panel: its spread is too wide for the pitch")
        return cls(np.array([-edge, *feet, edge]), np.array([-edge, *moved, edge]))

    def plate(self, line: FloatArray) -> FloatArray:
        """Places along the axis in the plate."""
        once = np.concatenate([[True], np.diff(self.old) > FLUSH_M])
        return np.asarray(np.interp(line, self.old[once], self.new[once]))

    def foot(self, line: FloatArray) -> FloatArray:
        """Places along the axis in the pillar, whose sections may reach beyond the foot."""
        ratio = (self.new[2] - self.new[1]) / (self.old[2] - self.old[1])
        return np.asarray(self.new[1] + (line - self.old[1]) * ratio)
