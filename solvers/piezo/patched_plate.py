"""An assembled plate with bonded patches: classes that these couple are solved together, modes extrapolated.

u = sum over classes E_c q_c at the bonded faces; K = diag(K_c) + sum over patches E' K_E E, M alike, loads E' theta. Beneath
each patch the plate has the additional flexibility F (solvers/piezo/patch.py). Patch and F are meshed twice: both
plates are solved, and the difference of their modes shows the error of the finer mesh.

At a patch's edges stresses are singular, so the finer mesh leaves a known share t of the coarser one's deficit relative
to it (decision 7). That holds for eigenvalues and gains, in which the plate has yielded to either mesh, and not for stiffness
matrices: motions as short as an element meet many times the stiffness on the coarser mesh, the more so the stiffer the
ceramic is compared with its plate, and a share of that taken from K softens the plate by more than there is. Modes of
the coarser mesh, aligned with those of the finer one (schoenemann1966), have K there. With A and g its matrices in modal
coordinates

    Lambda = A - t (A_c - A)+,    gains = g + t (g - g_c).

A mesh nested in another one is no softer: of A_c - A only the positive part + is of the edges. Where the coarser mesh is the
softer one, something else differs, and a share of that change enters the error bar.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh, svd

from geometry.elements import FloatArray
from geometry.layout import Design, mirrored_axes
from solvers.accuracy.mesh import ErrorFractions, amid
from solvers.errors import SolverError
from solvers.fem.assembly import Scale
from solvers.fem.eigen import PlainPencil, factor_near
from solvers.fem.factor import Factoriser
from solvers.measures.confinement import TouchField, target_shape, target_symmetry
from solvers.piezo.patch import BondedPatch, StaticCorrection, bonded_patch
from solvers.superelement.bond import Contact, PanelContact, displacement_on, mirror_signs, panel_contacts
from solvers.superelement.plate import WHOLE, AssembledPlate

CLASSES = ("SS", "SA", "AS", "AA")
NEAR_M = 1e-9  # a patch whose middle lies so near to a mirror line lies on it
UNDRIVEN = 1e-9  # of the largest load: a class below it is not driven
_Bonded = tuple[float, FloatArray, sp.csr_array]  # a factor, a patch's own matrix (3 b, 3 b), its motion (3 b, dof)

ALIKE = 0.5  # of a direction among the modes: less of it on the coarser mesh is none of its modes about the band


@dataclass(frozen=True)
class CoarserBond:
    """Classes with the patches on a coarser mesh: K and M on demand, loads (dof, patches) and their part by
    inertia, and the shares of the change from that mesh to the finer one that is left, and that is uncertain.
    """

    join: Callable[[], PlainPencil]
    loads: FloatArray
    inertia: FloatArray
    shares: ErrorFractions


@dataclass(frozen=True)
class Group:
    """Symmetry classes solved together: the load of one volt on each patch, (dof, patches), scaled, and K and M as `join` makes
    them, on demand.

    damping: loss (k, k) between motions (dof, k), by the stiffness of each material times its loss factor; None where it is
    not known. parted: stiffness of each material between motions, and what K of the plate has more, (materials + 1, k, k).
    Parts of the load: by_modes, due to the panels' discarded modes at rest; inertia, proportional to the eigenvalue, at that
    one. yielding: energies (k,) of F under the forces of the patches in motions (dof, k); None without patches.
    coarser: the same classes on a coarser mesh of the patches; None where there is none.
    """

    plates: tuple[AssembledPlate, ...]
    join: Callable[[], PlainPencil]
    loads: FloatArray
    by_modes: FloatArray | None = None
    inertia: FloatArray | None = None
    eigenvalue: float = 0.0
    yielding: Callable[[FloatArray], FloatArray] | None = None
    coarser: CoarserBond | None = None
    damping: Callable[[FloatArray], FloatArray] | None = None
    parted: Callable[[FloatArray], FloatArray] | None = None

    @cached_property
    def pencil(self) -> PlainPencil:
        """K and M."""
        return self.join()

    @cached_property
    def factorise(self) -> Factoriser:
        """Factoriser of shifted K of the classes; one symbolic analysis serves all of them."""
        return Factoriser()

    def let_go(self) -> None:
        """Free K and M, which are joined again on demand."""
        for name in ("pencil", "factorise"):
            vars(self).pop(name, None)

    def lost(self, vectors: FloatArray) -> FloatArray:
        """Loss between motions (dof, k), (k, k). SolverError where that of the materials is not known."""
        if self.damping is None:
            raise SolverError("the loss of the materials is not known: give a quality factor")
        return self.damping(vectors)

    def gain(self, vectors: FloatArray, values: FloatArray) -> FloatArray:
        """Gains (k, patches) of the loads on modes (dof, k), each at its own eigenvalue (k,)."""
        return _gains_at(vectors, values / self.eigenvalue if self.eigenvalue else None, self.loads, self.inertia)

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
    """Patches on the bare face of a plate; lengths in m, K and loads scaled: `stiffness_unit` times them is SI.

    `plates`: the plate by symmetry class, or the whole one alone under WHOLE. at_hz: frequency of the loads, whose part due
    to the patches' inertia goes with the square of the frequency; at rest without it.
    """

    def __init__(
        self,
        plates: Mapping[str, AssembledPlate],
        patches: Sequence[BondedPatch],
        back: bool,
        name: str = "superelement",
        beneath: StaticCorrection | None = None,
        at_hz: float = 0.0,
    ) -> None:
        if not patches:
            raise SolverError("no patches: nothing drives the plate")
        self.patches, self.back, self.name, self.beneath = tuple(patches), back, name, beneath
        some = next(iter(plates.values()))
        self.scale: Scale = some.placed_cells[0].cell.scale
        self.eigenvalue = self.scale.eigenvalue(at_hz)
        own = [self._folded(patch, some) for patch in self.patches]
        distinct = {key: patch for key, patch, _ in own}
        known = _bonds(distinct, some, back, self.eigenvalue, beneath)
        self._images = _images([(key, flip) for key, _, flip in own])
        self.bonds = [known[key].mirrored(flip) for key, _, flip in own]
        self._join(plates)

    def _join(self, plates: Mapping[str, AssembledPlate]) -> None:
        """The groups of classes that the patches couple, and which of them they drive."""
        some = next(iter(plates.values()))
        classes = [[WHOLE]] if WHOLE in plates else coupled_classes(self.patches)
        self._panel_contacts: dict[int, list[tuple[PanelContact, ...]]] = {}
        self._pencils: dict[str, PlainPencil] = {}
        self._matrices = _PatchMatrices(len(classes) > 1)
        self.whole = some
        # of bonded faces, mesh by mesh, on demand
        self.motions: dict[str, dict[int, list[sp.csr_array]]] = {}
        self.everything = [self._group([plates[p] for p in symmetries]) for symmetries in classes]
        loudest = max(float(np.abs(group.loads).max()) for group in self.everything)
        self.groups = [group for group in self.everything if np.abs(group.loads).max() > UNDRIVEN * loudest]
        self.undriven = [p for group in self.everything if group not in self.groups for p in group.symmetries]
        self._panel_contacts.clear()

    def _folded(self, patch: BondedPatch, plate: AssembledPlate) -> tuple[str, BondedPatch, FloatArray]:
        """A patch, or its image where x, y > 0 on a plate that is its own mirror image: its key, itself, and
        the axes (2,) along which it was turned round, -1.
        """
        ends = patch.box_m.reshape(2, 2)
        flip = np.where(plate.tiling.mirrored & (ends.sum(axis=1) < -NEAR_M), -1.0, 1.0)
        box = np.sort(ends * flip[:, None], axis=1).ravel()
        if (flip < 0.0).any():
            patch = bonded_patch(patch.material, box, patch.thickness_m, self.back, patch.mesh, glue=patch.glue)
        return (
            repr((patch.material.name, patch.thickness_m, patch.glue, patch.mesh, np.round(box, 9).tolist())),
            patch,
            flip,
        )

    @cached_property
    def stiffness_unit(self) -> float:
        """N/m of one scaled unit of stiffness, E L."""
        return self.scale.young_pa * self.scale.length_m

    @property
    def capacitance_f(self) -> FloatArray:
        """Capacitance of each patch with its bonded face clamped, F."""
        return np.array([bond.finest.capacitance_f for bond in self.bonds])

    def _group(self, plates: list[AssembledPlate]) -> Group:
        dofs = sum(plate.dof for plate in plates)
        fine, coarse, by_modes, inertia, coarse_inertia = (np.zeros((dofs, len(self.bonds))) for _ in range(5))
        for number, bond in enumerate(self.bonds):
            if self._cannot_drive(plates, number):
                continue  # the rounded rest of its load would be a direction of its own in `variation.samples`
            part, motion = bond.finest, self.motion(plates, number)
            fine[:, number] = motion.T @ part.load
            inertia[:, number] = motion.T @ part.inertia
            by_modes[:, number] = motion.T @ part.softened
            part, motion = bond.parts[-1], self.motion(plates, number, -1)
            coarse[:, number] = motion.T @ part.load
            coarse_inertia[:, number] = motion.T @ part.inertia
        shares = _joint_shares([bond.shares for bond in self.bonds])
        return Group(
            tuple(plates),
            partial(self._pencil, plates, 0),
            fine,
            by_modes,
            inertia if self.eigenvalue else None,
            self.eigenvalue,
            partial(self._yielding, plates),
            CoarserBond(partial(self._pencil, plates, -1), coarse, coarse_inertia, shares) if shares else None,
            partial(self._lost, plates),
            partial(self._parted, plates),
        )

    def _cannot_drive(self, plates: list[AssembledPlate], number: int) -> bool:
        """Whether a patch is its own mirror image about a line about which the one class is antisymmetric."""
        on_line = np.abs(self.patches[number].box_m.reshape(2, 2).sum(axis=1)) < NEAR_M
        classes = [plate.symmetry for plate in plates]
        return len(classes) == 1 and any(mark == "A" and on for mark, on in zip(classes[0], on_line, strict=False))

    def motion(self, plates: Sequence[AssembledPlate], number: int, mesh: int = 0) -> sp.csr_array:
        """Motion of a patch's bonded face in the classes, (3 b, dof); in one class that of a patch gives its mirror image's."""
        first, flip = self._own_or_image(number, plates)
        own = self._moved(plates)[first][mesh]
        if first == number:
            return own
        signs = np.tile(mirror_signs(plates[0].symmetry, flip), own.shape[0] // 3)
        return sp.csr_array(sp.diags_array(signs) @ own)

    def _moved(self, plates: Sequence[AssembledPlate]) -> dict[int, list[sp.csr_array]]:
        """Motions of the bonded faces that are no other's image, kept."""
        name = plates[0].symmetry
        if name not in self.motions:
            numbers = dict.fromkeys(self._own_or_image(number, plates)[0] for number in range(len(self.bonds)))
            self.motions[name] = {number: self._motions(plates, number) for number in numbers}
        return self.motions[name]

    def _motions(self, plates: Sequence[AssembledPlate], number: int) -> list[sp.csr_array]:
        """Motion of a patch's bonded face, mesh by mesh."""
        bond = self.bonds[number]
        if number not in self._panel_contacts:
            self._panel_contacts[number] = [tuple(panel_contacts(self.whole, part.contact)) for part in bond.parts]
        pairs = zip(self._panel_contacts[number], bond.parts, strict=True)
        return [_motion(plates, panels, part.contact) for panels, part in pairs]

    def _own_or_image(self, number: int, plates: Sequence[AssembledPlate]) -> tuple[int, FloatArray]:
        """The first patch whose mirror image in one class a patch is, and the axes (2,) turned round; itself elsewhere."""
        alone = len(plates) == 1 and plates[0].symmetry != WHOLE
        return self._images[number] if alone else (number, np.ones(2))

    def _pencil(self, plates: list[AssembledPlate], mesh: int) -> PlainPencil:
        """K and M of the classes with the patches of a mesh, which move with their bonded faces, (3 b, dof) each."""
        pencils = [self._bare(plate, mesh) for plate in plates]
        stiffness, mass = ([getattr(p, name) for p in pencils] for name in ("stiffness", "mass"))
        whole, heavy = (each[0] if len(each) == 1 else sp.block_diag(each, format="csc") for each in (stiffness, mass))
        stiff: list[_Bonded] = []
        weights: list[_Bonded] = []
        for count, bond, moved in self._distinct(plates):
            part, motion = bond.parts[mesh], moved[mesh]
            stiff.append((count, part.stiffness, motion))
            weights.append((count / self.scale.mass_kg, part.mass, motion))
        rigid = sum(plate.rigid_count for plate in plates)
        matrices = self._matrices
        return PlainPencil(matrices.added(whole, stiff), matrices.added(heavy, weights), self.scale, rigid)

    def _bare(self, plate: AssembledPlate, mesh: int) -> PlainPencil:
        """K and M of a class without patches, kept from the finest mesh of the patches to the next, which begins with them."""
        pencil = self._pencils.pop(plate.symmetry, None) or plate.pencil()
        if mesh == 0 and _joint_shares([bond.shares for bond in self.bonds]):
            self._pencils[plate.symmetry] = pencil
        return pencil

    def _yielding(self, plates: list[AssembledPlate], vectors: FloatArray) -> FloatArray:
        """f'F f of the forces f of all patches in motions (dof, k) of the classes, (k,)."""
        total = np.zeros(vectors.shape[1])
        for count, bond, moved in self._distinct(plates):
            forces = bond.finest.stiffness @ (moved[0] @ vectors)
            total += count * np.einsum("ik,ik->k", forces, bond.finest.yields @ forces)
        return total

    def _lost(self, plates: list[AssembledPlate], vectors: FloatArray) -> FloatArray:
        """Loss between motions (dof, k) in the plate, in the patches and in what yields beneath them, (k, k)."""
        parts = np.split(vectors, np.cumsum([plate.dof for plate in plates])[:-1])
        total = np.sum([plate.lost(part) for plate, part in zip(plates, parts, strict=True)], axis=0)
        for count, bond, moved in self._distinct(plates):
            if bond.finest.loss is None:
                raise SolverError("the loss of a patch is not known: give a quality factor")
            own = moved[0] @ vectors
            total += count * own.T @ bond.finest.loss @ own
        return np.asarray(total)

    def _parted(self, plates: list[AssembledPlate], vectors: FloatArray) -> FloatArray:
        """Stiffness of each material of the plate between motions (dof, k), and what K has more, (materials + 1, k, k)."""
        parts = np.split(vectors, np.cumsum([plate.dof for plate in plates])[:-1])
        return np.sum([plate.parted(part) for plate, part in zip(plates, parts, strict=True)], axis=0)

    def _distinct(self, plates: list[AssembledPlate]) -> list[tuple[int, _Bond, list[sp.csr_array]]]:
        """The patches that are no other's image in the classes: how many of each, itself and its motions."""
        motions = self._moved(plates)
        alike = Counter(self._own_or_image(number, plates)[0] for number in range(len(self.bonds)))
        return [(count, self.bonds[number], motions[number]) for number, count in alike.items()]


class _PatchMatrices:
    """Patches' matrices in a plate's degrees of freedom.

    In classes that differ about a mirror line far from a patch its motions are equal up to their sign, and made once.
    """

    def __init__(self, are_several: bool) -> None:
        self.are_several = are_several
        self._known: dict[tuple[int, bytes], tuple[FloatArray, FloatArray]] = {}

    def added(self, matrix: sp.csc_array, bonds: Sequence[_Bonded]) -> sp.csc_array:
        """A matrix and factor motion' own motion of each of the bonds, dense where their motions have entries."""
        total, kind = sp.csc_array(matrix.shape), matrix.indices.dtype  # mixed kinds would double every later index
        for factor, own, motion in bonds:
            used = np.flatnonzero(np.bincount(motion.indices, minlength=matrix.shape[0]))
            ends = np.zeros(matrix.shape[0] + 1, dtype=kind)
            ends[used + 1] = len(used)
            dense = (factor * self._projected(own, motion[:, used].toarray())).T.ravel()
            places = np.tile(used.astype(kind), len(used))
            total += sp.csc_array((dense, places, ends.cumsum(dtype=kind)), shape=matrix.shape)
        return sp.csc_array(matrix + total)

    def _projected(self, own: FloatArray, motion: FloatArray) -> FloatArray:
        if not self.are_several:
            return np.asarray(motion.T @ own @ motion)
        first = motion.flat[np.flatnonzero(motion)[:1]]
        key = id(own), hashlib.sha256((np.sign(first) * motion + 0.0).tobytes()).digest()  # no zero below zero
        if key not in self._known:
            self._known[key] = own, motion.T @ own @ motion  # the matrix is held, so that its id stays its own
        return self._known[key][1]


@dataclass(frozen=True)
class _Part:
    """A patch of one mesh as the plate's own degrees of freedom feel it.

    Where; stiffness (3b, 3b), load of a volt (3b,) and its part by inertia, scaled; mass (3b, 3b) in kg; capacitance in F with
    that face held. softened (3b,): what F brings to the load; yields (3b, 3b): F, scaled. loss (3b, 3b): stiffness of patch and
    of F times their loss factors; None where one is not known.
    """

    contact: Contact
    stiffness: FloatArray
    mass: FloatArray
    load: FloatArray
    inertia: FloatArray
    softened: FloatArray
    yields: FloatArray
    capacitance_f: float
    loss: FloatArray | None = None

    def mirrored(self, flip: FloatArray) -> _Part:
        """Return the part at its mirror image: -1 along the axes (2,) that are turned round."""
        turn = np.tile([*flip, 1.0], len(self.load) // 3)
        return replace(
            self,
            contact=replace(self.contact, points=self.contact.points * flip),
            stiffness=turn[:, None] * self.stiffness * turn,
            mass=turn[:, None] * self.mass * turn,
            load=turn * self.load,
            inertia=turn * self.inertia,
            softened=turn * self.softened,
            yields=turn[:, None] * self.yields * turn,
            loss=None if self.loss is None else turn[:, None] * self.loss * turn,
        )


@dataclass(frozen=True)
class _Bond:
    """A patch by its meshes, the finest first, and the error fractions of the coarser one's change."""

    parts: tuple[_Part, ...]
    shares: ErrorFractions | None = None

    def mirrored(self, flip: FloatArray) -> _Bond:
        """Return the bond at its mirror image."""
        if (flip > 0.0).all():
            return self
        return replace(self, parts=tuple(part.mirrored(flip) for part in self.parts))

    @property
    def finest(self) -> _Part:
        """The patch on its finest mesh."""
        return self.parts[0]


class PressedPlate:
    """Symmetry classes of an assembled plate, or the whole one, with one load of 1 N where patches would be; only the target
    class feels it.
    """

    def __init__(self, plates: Mapping[str, AssembledPlate], design: Design, name: str) -> None:
        self.name = name
        self.patches: tuple[object, ...] = ("pressure",)
        self.scale = next(iter(plates.values())).placed_cells[0].cell.scale
        self.stiffness_unit = self.scale.young_pa * self.scale.length_m
        self.capacitance_f: FloatArray = np.ones(1)  # no circuit: never open
        pressed = WHOLE if WHOLE in plates else target_symmetry(design.nodal_lines)
        self.everything = [self._group(plate, design, symmetry == pressed) for symmetry, plate in plates.items()]
        self.groups = [group for group in self.everything if group.symmetries == (pressed,)]
        self.undriven = [symmetry for symmetry in plates if symmetry != pressed]

    def _group(self, plate: AssembledPlate, design: Design, pressed: bool) -> Group:
        load = _pressure(plate, design) / self.stiffness_unit if pressed else np.zeros(plate.dof)
        return Group((plate,), plate.pencil, load[:, None], damping=plate.lost, parted=plate.parted)


@dataclass(frozen=True)
class BondErrors:
    """Error bars (half-widths) due to the bond's mesh: of frequencies, relative, (k,); of gains, (k, patches).

    NaN for a mode without a counterpart on the coarser mesh.
    """

    frequency: FloatArray
    gain: FloatArray


@dataclass(frozen=True)
class ExtrapolatedModes:
    """Scaled eigenvalues (k,), ascending, M-orthonormal modes (dof, k) and gains (k, patches); errors None without a mesh that
    shows them.

    images: K and M of the finer mesh times the modes, (dof, k) each.
    """

    eigenvalue: FloatArray
    vectors: FloatArray
    gain: FloatArray
    errors: BondErrors | None
    images: tuple[FloatArray, FloatArray]


def _gains_at(
    vectors: FloatArray, growth: FloatArray | None, loads: FloatArray, inertia: FloatArray | None
) -> FloatArray:
    """Gains (k, patches) of loads on modes (dof, k); growth (k,): of their part by inertia."""
    gain = vectors.T @ loads
    if growth is None or inertia is None:
        return np.asarray(gain)
    return np.asarray(gain + (growth - 1.0)[:, None] * (vectors.T @ inertia))


def _joint_shares(shares: Sequence[ErrorFractions | None]) -> ErrorFractions | None:
    """Mean error fractions of several patches, whose differences add to the uncertainty; None if one has none."""
    known = [each for each in shares if each is not None]
    if not known or len(known) < len(shares):
        return None
    correction, spread = (np.array([getattr(each, name) for each in known]) for name in ("correction", "uncertainty"))
    return replace(known[0], correction=float(correction.mean()), uncertainty=float(spread.max() + np.ptp(correction)))


def coupled_classes(patches: Sequence[BondedPatch]) -> list[list[str]]:
    """Group the symmetry classes that patches couple: classes stay apart along an axis about which the patches are mirrored.

    Parameters
    ----------
    patches : sequence of BondedPatch
        All patches.

    Returns
    -------
    list of list of str
        One list per group.
    """
    low = np.array([patch.points.min(axis=0) for patch in patches])
    high = np.array([patch.points.max(axis=0) for patch in patches])
    even = mirrored_axes(np.column_stack([low[:, 0], high[:, 0], low[:, 1], high[:, 1]]))
    groups: dict[tuple[str, ...], list[str]] = {}
    for symmetry in CLASSES:
        key = tuple(mark if even[axis] else "" for axis, mark in enumerate(symmetry))
        groups.setdefault(key, []).append(symmetry)
    return list(groups.values())


def extrapolated_modes(group: Group, values: FloatArray, vectors: FloatArray) -> ExtrapolatedModes:
    """Extrapolate a group's modes about the band from its two meshes of the patches.

    Parameters
    ----------
    group : Group
        The classes with their patches.
    values, vectors : ndarray, shapes (k,), (dof, k)
        Scaled eigenvalues and M-orthonormal modes of the finer mesh.

    Returns
    -------
    ExtrapolatedModes
        Within the span of `vectors`.
    """
    coarser, gain, heavy = group.coarser, group.gain(vectors, values), group.pencil.apply_mass(vectors)
    if coarser is None or not len(values):
        return ExtrapolatedModes(values, vectors, gain, None, (heavy * values, heavy))
    stiffness, coarse_gain, known = _aligned(group, coarser, (values, heavy), gain)
    share, spread = coarser.shares.correction, coarser.shares.uncertainty
    stiffer, softer = _signed(stiffness - np.diag(values))
    better, turn = eigh(np.diag(values) - share * stiffer)
    change, against = (np.einsum("ij,ik,kj->j", turn, each, turn) for each in (stiffer + softer, softer))
    gains, coarse_gains = turn.T @ gain, turn.T @ coarse_gain
    unknown = np.where((turn**2).T @ known > ALIKE, 1.0, np.nan)
    errors = BondErrors(
        unknown * (spread * np.abs(change) + share * np.abs(against)) / (2.0 * better),
        unknown[:, None] * spread * np.abs(gains - coarse_gains),
    )
    images = heavy @ (values[:, None] * turn), heavy @ turn
    return ExtrapolatedModes(better, vectors @ turn, gains + share * (gains - coarse_gains), errors, images)


def _images(folded: Sequence[tuple[str, FloatArray]]) -> list[tuple[int, FloatArray]]:
    """For each patch, identified by its folded self and the axes (2,) it was turned about: the first with the same folded self,
    and the axes that turn the one into the other.
    """
    first: dict[str, int] = {}
    numbers = [first.setdefault(key, number) for number, (key, _) in enumerate(folded)]
    return [(number, folded[number][1] * flip) for number, (_, flip) in zip(numbers, folded, strict=True)]


def _bonds(
    patches: Mapping[str, BondedPatch],
    plate: AssembledPlate,
    back: bool,
    eigenvalue: float,
    beneath: StaticCorrection | None,
) -> dict[str, _Bond]:
    """Patches with the static correction of the plate beneath, on two meshes if they have two; on one without `beneath`."""
    meshed = {key: _meshes(patch, back, beneath) for key, patch in patches.items()}
    if beneath:
        beneath.prepare(plate, [patch for parts in meshed.values() for patch in parts], back)
    return {
        key: _Bond(
            tuple(_part(patch, plate, back, eigenvalue, beneath) for patch in parts),
            beneath.shares(parts[0], back) if beneath and len(parts) > 1 else None,
        )
        for key, parts in meshed.items()
    }


def _meshes(patch: BondedPatch, back: bool, beneath: StaticCorrection | None) -> tuple[BondedPatch, ...]:
    """A patch by its meshes, the finest first."""
    if beneath is None or not patch.mesh.layers:
        return (patch,)
    coarser = bonded_patch(patch.material, patch.box_m, patch.thickness_m, back, patch.mesh.coarser, glue=patch.glue)
    return patch, coarser


def _part(
    patch: BondedPatch, plate: AssembledPlate, back: bool, eigenvalue: float, beneath: StaticCorrection | None
) -> _Part:
    """The patch of one mesh on a plate with the additional flexibility F that its degrees of freedom q lack.

    w = E q - F (K_E w - theta V): with T = (I + F K_E)^-1 the plate feels K_E T, T'M_E T, the load T'theta, and the patch holds
    theta'T F theta V more charge. What moves in and beneath it has inertia: l T'(m + M_E F T'theta) more load at an
    eigenvalue l. The interaction of two patches on one panel through F is neglected.
    """
    scale: Scale = plate.placed_cells[0].cell.scale
    unit = scale.young_pa * scale.length_m
    stiffness, load = patch.stiffness / unit, patch.theta / unit
    gives = beneath.flexibility(plate, patch, back) if beneath else np.zeros_like(stiffness)
    turn = np.linalg.inv(np.eye(len(load)) + gives @ stiffness)
    effective, effective_load = stiffness @ turn, turn.T @ load
    held = turn.T @ stiffness @ turn  # the patch's own part of the stiffness, the rest is F's
    below = beneath.loss_factor(back) if beneath else 0.0
    loss = None
    if patch.lost is not None and below is not None:
        loss = turn.T @ (patch.lost / unit) @ turn + below * ((effective + effective.T) / 2.0 - held)
    inertia = eigenvalue * turn.T @ (patch.swell + patch.mass @ (gives @ effective_load)) / scale.mass_kg
    return _Part(
        Contact(patch.points, patch.projection, back),
        (effective + effective.T) / 2.0,
        turn.T @ patch.mass @ turn,
        effective_load + inertia,
        inertia,
        effective_load - load,
        gives,
        patch.capacitance_f + float(patch.theta @ turn @ gives @ load),
        loss,
    )


def _motion(plates: Sequence[AssembledPlate], panels: Sequence[PanelContact], contact: Contact) -> sp.csr_array:
    """The means of u that a contact feels per degree of freedom of the classes one after another, (3 b, dof)."""
    return sp.csr_array(
        sp.hstack([displacement_on(plate, panels, len(contact.means)) for plate in plates], format="csr")
    )


def _pressure(plate: AssembledPlate, design: Design) -> FloatArray:
    """Work of the pressure on each degree of freedom, (dof,), N."""
    load, size = np.zeros(plate.dof), 0.0
    for placed_cell in plate.placed_cells:
        rule = plate.touch_rule(placed_cell)
        points = rule.points[:, :2] + np.array(placed_cell.middle)
        active = design.in_zone(points)
        force = placed_cell.copies * np.where(active, rule.weights * target_shape(design, points), 0.0)
        size += float(np.abs(force).sum())
        live = placed_cell.coefficient != 0.0
        work = placed_cell.coefficient * rule.work(force)
        np.add.at(load, placed_cell.dofs[live], work[live])
    return load / size


def _signed(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The positive and the negative part of a symmetric matrix, whose sum it is."""
    values, vectors = eigh(matrix)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T, (vectors * np.minimum(values, 0.0)) @ vectors.T


def _aligned(
    group: Group, coarser: CoarserBond, modes: tuple[FloatArray, FloatArray], gain: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """K (k, k) and gains (k, patches) of the coarser mesh in its modes, turned onto the finer one's, and how much of each of
    those is there, (k,).

    modes: eigenvalues (k,) of the finer mesh, and its M times its modes, (dof, k). Both meshes move the same degrees of
    freedom, so that one symbolic analysis serves them. Directions without a counterpart stay as the finer mesh has them.
    """
    pencil, (values, heavy) = coarser.join(), modes
    factor, shift = factor_near(pencil, amid(values), group.factorise)
    # one inverse iteration from the finer mesh's modes, then Rayleigh-Ritz in its span: the coarser mesh's own modes
    force = heavy * (values - shift)  # of answers as long as the modes
    moved = factor.solve(force)
    factor.free()
    mass = moved.T @ pencil.apply_mass(moved)
    stiffness = moved.T @ force + shift * mass  # (K - shift M) moved = force
    eigenvalues, own = eigh((stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0)
    moved = moved @ own
    fine, overlap, coarse = svd(heavy.T @ moved)
    alike = overlap > ALIKE
    fine, turn = fine[:, alike], coarse[alike].T
    own = np.diag(values)
    change = (turn.T * eigenvalues) @ turn - fine.T @ own @ fine
    growth = eigenvalues / group.eigenvalue if group.eigenvalue else None
    other = turn.T @ _gains_at(moved, growth, coarser.loads, coarser.inertia) - fine.T @ gain
    known = (fine**2).sum(axis=1)
    return own + fine @ change @ fine.T, gain + fine @ other, known
