"""How far the frequencies of a patched plate's modes may be wrong: mesh, reduction and bonding together."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from geometry.elements import FloatArray
from solvers.piezo.forced import GroupModes
from solvers.superelement.plate_error import MARGIN, by_degrees, by_mesh, by_modes, last_degree


@dataclass(frozen=True)
class FrequencyErrors:
    """Relative half-widths, (k,) each: by the plate's mesh, by its reduction, by the mesh and yielding of the bond.

    NaN where nothing shows one.
    """

    mesh: FloatArray
    reduction: FloatArray
    bonding: FloatArray

    @property
    def total(self) -> FloatArray:
        """All of them."""
        return self.mesh + self.reduction + self.bonding


_KNOWN: WeakKeyDictionary[GroupModes, FrequencyErrors] = WeakKeyDictionary()  # every peak of a response asks for them


def frequency_errors(basis: GroupModes) -> FrequencyErrors:
    """Estimate the frequency errors of a group's modes.

    By the plate's mesh and its truncation as for a plate without patches, the patches' stiffness in K; by the mesh of the bond;
    and by F, which is that at rest: at the mode's eigenvalue l it is larger by l / (L - l) at most, L the lowest eigenvalue
    left out of the panels, and each f of the patches' forces lowers l by f'F f.

    Parameters
    ----------
    basis : GroupModes
        Modes of some classes, solved together.

    Returns
    -------
    FrequencyErrors
        Half-widths (k,) each.
    """
    if basis not in _KNOWN:
        _KNOWN[basis] = _estimated(basis)
    return _KNOWN[basis]


def _estimated(basis: GroupModes) -> FrequencyErrors:
    group, value, count = basis.group, basis.eigenvalue, len(basis.eigenvalue)
    vectors = basis.columns[:, :count]
    pairs = list(zip(group.plates, group.split(vectors), strict=True))
    mesh, modes = np.zeros(count), np.zeros(count)
    for plate, part in pairs:
        mesh += by_mesh(plate, value, part)[1]
        modes += by_modes(plate, value, part)
    last = np.concatenate([last_degree(plate) for plate in group.plates])
    reduction = MARGIN * (modes + by_degrees(group.pencil, vectors, last, basis.images))
    return FrequencyErrors(mesh, reduction, _bonding(basis, vectors))


def _bonding(basis: GroupModes, vectors: FloatArray) -> FloatArray:
    group, value = basis.group, basis.eigenvalue
    if group.yielding is None:
        return np.zeros(len(value))
    if basis.bond is None:
        return np.full(len(value), np.nan)
    growth = np.max([cell.residual.growth(value) for plate in group.plates for cell in plate.cells], axis=0) - 1.0
    return np.asarray(basis.bond.frequency + growth * group.yielding(vectors) / (2.0 * value))
