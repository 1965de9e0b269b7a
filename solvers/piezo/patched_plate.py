"""An assembled plate with bonded patches: symmetry classes that the patches couple are solved together.

u = sum over classes E_c q_c at the bonded faces; K = diag(K_c) + sum over patches E' K_E E, M alike, loads E' theta.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray
from geometry.patches import mirrored_axes
from solvers.errors import SolverError
from solvers.fem.assembly import Scale
from solvers.fem.eigen import PlainPencil
from solvers.measures.confinement import TouchField
from solvers.piezo.patch import BondedPatch
from solvers.superelement.bond import Contact, displacement_at, flexibility_at
from solvers.superelement.cell import Cell
from solvers.superelement.plate import RIGID_OF_CLASS, WHOLE, AssembledPlate

CLASSES = ("SS", "SA", "AS", "AA")
UNDRIVEN = 1e-9  # of the largest load: a class below it is not driven


@dataclass(frozen=True)
class Group:
    """Symmetry classes solved together: the load of one volt on each patch, (dof, patches), scaled, and K and M as `join` makes
    them, once they are asked for.
    """

    plates: tuple[AssembledPlate, ...]
    join: Callable[[], PlainPencil]
    loads: FloatArray

    @cached_property
    def pencil(self) -> PlainPencil:
        """K and M."""
        return self.join()

    @property
    def symmetries(self) -> tuple[str, ...]:
        """The classes."""
        return tuple(plate.symmetry for plate in self.plates)

    def split(self, vectors: FloatArray) -> list[FloatArray]:
        """Degrees of freedom of each class."""
        return np.split(vectors, np.cumsum([plate.dof for plate in self.plates])[:-1])

    def touch(self, vectors: FloatArray) -> list[TouchField]:
        """u_z on the touch face class by class; integrals over the whole plate add up, cross terms vanish."""
        return [plate.touch(part) for plate, part in zip(self.plates, self.split(vectors), strict=True)]


class PatchedPlate:
    """Patches on the bare face of a plate; lengths in m, forces and charges in SI after `unscaled`.

    `plates`: the plate by symmetry class, or the whole one alone under WHOLE.
    """

    def __init__(
        self,
        plates: Mapping[str, AssembledPlate],
        patches: Sequence[BondedPatch],
        back: bool,
        name: str = "superelement",
        flexibility: Callable[[Cell], FloatArray] | None = None,
    ) -> None:
        if not patches:
            raise SolverError("no patches: nothing drives the plate")
        self.patches, self.back, self.name = tuple(patches), back, name
        some = next(iter(plates.values()))
        self.scale: Scale = some.placed_cells[0].cell.scale
        self.bonds = [_bond(patch, some, back, self.stiffness_unit, flexibility) for patch in self.patches]
        classes = [[WHOLE]] if WHOLE in plates else coupled_classes(self.patches)
        self.motions: dict[str, list[sp.csr_array]] = {}  # of the bonded faces, by a group's first class
        self.everything = [self._group([plates[p] for p in symmetries]) for symmetries in classes]
        loudest = max(float(np.abs(group.loads).max()) for group in self.everything)
        self.groups = [group for group in self.everything if np.abs(group.loads).max() > UNDRIVEN * loudest]
        self.undriven = [p for group in self.everything if group not in self.groups for p in group.symmetries]

    @cached_property
    def stiffness_unit(self) -> float:
        """N/m of one scaled unit of stiffness, E L."""
        return self.scale.young_pa * self.scale.length_m

    @property
    def capacitance_f(self) -> FloatArray:
        """Capacitance of each patch with its bonded face clamped, F."""
        return np.array([bond.capacitance_f for bond in self.bonds])

    def _group(self, plates: list[AssembledPlate]) -> Group:
        motions = [
            sp.csr_array(sp.hstack([displacement_at(plate, bond.contact) for plate in plates], format="csr"))
            for bond in self.bonds
        ]
        self.motions[plates[0].symmetry] = motions
        loads = np.column_stack([motion.T @ bond.load for motion, bond in zip(motions, self.bonds, strict=True)])
        return Group(tuple(plates), partial(self._pencil, plates, motions), loads)

    def _pencil(self, plates: list[AssembledPlate], motions: list[sp.csr_array]) -> PlainPencil:
        """K and M of the classes with the patches, which move with their bonded faces, (3 b, dof) each."""
        pencils = [plate.pencil() for plate in plates]

        def joined(bare: list[sp.csc_array], bonded: list[FloatArray]) -> sp.csc_array:
            whole = bare[0] if len(bare) == 1 else sp.block_diag(bare, format="csc")
            return sp.csc_array(sum((_felt(b, m) for b, m in zip(bonded, motions, strict=True)), start=whole))

        stiff = [bond.stiffness for bond in self.bonds]
        heavy = [bond.mass / self.scale.mass_kg for bond in self.bonds]
        rigid = sum(RIGID_OF_CLASS[plate.symmetry] for plate in plates)
        bare = [p.stiffness for p in pencils], [p.mass for p in pencils]
        return PlainPencil(joined(bare[0], stiff), joined(bare[1], heavy), self.scale, rigid)


def _felt(matrix: FloatArray, motion: sp.csr_array) -> sp.csc_array:
    """motion' matrix motion, dense where the motion (3 b, dof) has entries: its columns are written as they are stored."""
    used = np.unique(motion.indices)
    dense = motion[:, used].toarray()
    starts = np.zeros(motion.shape[1] + 1, dtype=used.dtype)
    starts[used + 1] = len(used)
    block = dense.T @ matrix @ dense
    where = (block.ravel(order="F"), np.tile(used, len(used)), np.cumsum(starts, dtype=used.dtype))
    return sp.csc_array(where, shape=(motion.shape[1],) * 2)


@dataclass(frozen=True)
class _Bond:
    """A patch as the plate's own degrees of freedom feel it: where, stiffness (3b, 3b) and load of a volt (3b,), scaled, mass
    (3b, 3b) in kg, and the capacitance in F with that face held.
    """

    contact: Contact
    stiffness: FloatArray
    mass: FloatArray
    load: FloatArray
    capacitance_f: float


def _bond(
    patch: BondedPatch, plate: AssembledPlate, back: bool, unit: float, flexibility: Callable[[Cell], FloatArray] | None
) -> _Bond:
    """The patch on a plate that also gives way by F, the flexibility that its own degrees of freedom q lack.

    w = E q - F (K_E w - theta V): with T = (I + F K_E)^-1 the plate feels K_E T, T'M_E T, the load T'theta, and the patch holds
    theta'T F theta V more charge. What two patches on one panel do to each other by F is left out.
    """
    contact = Contact(patch.points, patch.projection, back)
    stiffness, load = patch.stiffness / unit, patch.theta / unit
    gives = flexibility_at(plate, contact, flexibility) if flexibility else np.zeros_like(stiffness)
    turn = np.linalg.inv(np.eye(len(load)) + gives @ stiffness)
    felt = stiffness @ turn
    more = float(patch.theta @ turn @ gives @ load)
    return _Bond(contact, (felt + felt.T) / 2.0, turn.T @ patch.mass @ turn, turn.T @ load, patch.capacitance_f + more)


def coupled_classes(patches: Sequence[BondedPatch]) -> list[list[str]]:
    """Symmetry classes that stay apart: along an axis about which the set of patches is its own mirror image."""
    low = np.array([patch.points.min(axis=0) for patch in patches])
    high = np.array([patch.points.max(axis=0) for patch in patches])
    even = mirrored_axes(np.column_stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]]))
    groups: dict[tuple[str, ...], list[str]] = {}
    for symmetry in CLASSES:
        key = tuple(mark if even[axis] else "" for axis, mark in enumerate(symmetry))
        groups.setdefault(key, []).append(symmetry)
    return list(groups.values())
