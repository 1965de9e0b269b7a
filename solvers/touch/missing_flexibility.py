"""Static flexibility under a finger that the plate's reduced panels lack: their bar, as no mode beyond the band shows it.

F = N K^-1 N' - E K_r^-1 E': moments of u_z over the contact per moment of its pressure, on a mesh of the panels under it, less
the same of their reduced matrices, both with the border around these panels clamped (macneal1971).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.linalg import cho_factor, cho_solve, eigh

from geometry.elements import FloatArray
from geometry.errors import MeshError
from geometry.hex.boxes import HexSettings, bonded_boxes, hex_mesh
from geometry.mesh import Mesh
from solvers.errors import TooLarge
from solvers.fem.constraints import constrain, free_mask
from solvers.fem.factor.factoriser import Factoriser
from solvers.piezo.beneath import Beneath
from solvers.piezo.bond import SAME_M, Contact, grid_weights
from solvers.piezo.panels import JoinedPanels, Panels
from solvers.superelement.build import Reductions
from solvers.superelement.plate import AssembledPlate
from solvers.touch import disk
from solvers.touch.touched_plate import Finger

MESH = HexSettings(order=3, layers=0, through=2)


def missing_flexibility(plate: AssembledPlate, beneath: Beneath, finger: Finger) -> FloatArray | None:
    """F of a finger's moments on a plate, (moments, moments) in m/N, its positive part; None where no mesh of hexahedra has
    the panels' pillars or the factorisation is too large.
    """
    points, means = disk.means(finger.degree)
    contact = Contact(np.array(finger.at_m) + finger.radius_m * points, means, back=False)
    box = np.repeat(finger.at_m, 2) + finger.radius_m * np.array([-1.0, 1.0, -1.0, 1.0])
    panels = Panels.beneath(plate.grid, box, beneath.reductions.thickness_m)
    own_box = box - np.repeat(panels.middle_m, 2)

    def more() -> FloatArray:
        lacking = _fine(panels, beneath.reductions, contact, own_box) - _reduced(JoinedPanels(panels, plate), contact)
        values, vectors = eigh((lacking + lacking.T) / 2.0)
        kept = values > 0.0
        return np.asarray((vectors[:, kept] * values[kept]) @ vectors[:, kept].T)

    place = repr(
        ([np.round(each, 9).tolist() for each in (panels.span_m, own_box)], panels.clamped, finger.degree, MESH)
    )
    try:
        scaled = beneath.kept(("finger", *beneath.made_of(panels)), place, more)
    except (MeshError, TooLarge):
        return None
    unit = plate.placed_cells[0].cell.scale
    return scaled / (unit.young_pa * unit.length_m)


def _fine(panels: Panels, reductions: Reductions, contact: Contact, box_m: FloatArray) -> FloatArray:
    """N K^-1 N' in the plate's scale."""
    thickness = reductions.thickness_m
    settings = HexSettings(MESH.order, thickness / MESH.through, MESH.layers)
    stands = panels.stands(reductions.pillar)
    mesh = hex_mesh(bonded_boxes(panels.span_m, thickness, stands, box_m, False, settings), MESH.order)
    pencil = constrain(reductions.system(mesh), free_mask(mesh, set(panels.clamped), {}))
    loads = _loads(mesh, contact, panels.middle_m)[np.flatnonzero(pencil.free)]
    return np.asarray(loads.T @ Factoriser()(sp.csc_array(pencil.stiffness)).solve(loads))


def _loads(mesh: Mesh, contact: Contact, middle_m: FloatArray) -> FloatArray:
    """Unit moments of pressure at the nodes of the touch face, (dof, moments)."""
    on = np.flatnonzero(np.abs(mesh.nodes[:, 2]) < SAME_M)
    loads = np.zeros((3 * len(mesh.nodes), len(contact.means)))
    loads[3 * on + 2] = (contact.means @ grid_weights(mesh.nodes[on, :2], mesh.order, contact.points - middle_m)).T
    return loads


def _reduced(joined: JoinedPanels, contact: Contact) -> FloatArray:
    """E K_r^-1 E' in the plate's scale."""
    free = joined.free & (np.diag(joined.stiffness) > 0.0)  # functions of free sides carry nothing
    moved = joined.motion(contact)[2::3][:, free]
    return np.asarray(moved @ cho_solve(cho_factor(joined.stiffness[np.ix_(free, free)]), moved.T))
