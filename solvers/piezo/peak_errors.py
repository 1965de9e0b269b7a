"""Errors of a patched plate's modes and peaks: frequencies by mesh, reduction and bonding, heights, loads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from geometry.elements import FloatArray
from solvers.accuracy.plate import MARGIN, by_degrees, by_mesh, by_modes, last_degree
from solvers.piezo.forced import ForcedPlate, GroupModes
from solvers.piezo.patched_plate import Group

# -- frequencies -------------------------------------------------------------------------------------------------------
# How far the frequencies of a patched plate's modes may be wrong: mesh, reduction and bonding together.


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
    return np.asarray(basis.bond.frequency + _growth(group, value) * group.yielding(vectors) / (2.0 * value))


# -- heights -----------------------------------------------------------------------------------------------------------
# How far a peak of a driven plate may be wrong: its frequency and its height.


def frequency_error(forced: ForcedPlate, frequency_hz: float) -> float | None:
    """Half-width of the bar of the frequency of the peak nearest to one, relative; None where it is not known.

    That of the mode nearest to it: mesh, reduction and bonding together.
    """
    basis, index = _nearest(forced, frequency_hz)
    return None if basis is None else _known(float(frequency_errors(basis).total[index]))


def height_error(forced: ForcedPlate, frequency_hz: float) -> float | None:
    """Half-width of the bar of the peak nearest to a frequency, relative; None where it is not known, or no mode is about.

    A resonance's height goes as phi'f / lambda: what the loads f and the mode's frequency may be wrong by adds up. Damping is
    given and not judged. What modes left out of the panels bring is told at rest: at the mode's eigenvalue l it may be
    larger by l / (L - l), L that below which none was left out.
    """
    basis, index = _nearest(forced, frequency_hz)
    if basis is None or basis.bond is None:
        return None
    group, phi, value = basis.group, basis.columns[:, index], float(basis.eigenvalue[index])
    if group.by_modes is None:
        return None
    volts = forced.volts(forced.plate.scale.eigenvalue(frequency_hz))
    lost = basis.bond.gain[index] @ np.abs(volts) + _growth(group, value) * abs(phi @ group.by_modes @ volts)
    given = abs(basis.gain[index] @ volts)
    return _known(float(lost / given) + 2.0 * float(frequency_errors(basis).total[index])) if given else None


def load_errors(basis: GroupModes) -> FloatArray:
    """Errors of the loads' gains by the mesh of the bond and by the modes left out of the panels, (modes, patches); NaN where
    they are not known.
    """
    if basis.bond is None or basis.group.by_modes is None:
        return np.full_like(basis.gain, np.nan)
    growth = np.asarray(_growth(basis.group, basis.eigenvalue))
    left = basis.columns[:, : len(basis.eigenvalue)].T @ basis.group.by_modes
    return np.asarray(basis.bond.gain + growth[:, None] * np.abs(left))


def _growth(group: Group, value: float | FloatArray) -> Any:
    """How much larger at eigenvalues than at rest the answers of modes left out of the panels are at most, less 1."""
    return np.max([cell.residual.growth(value) for plate in group.plates for cell in plate.cells], axis=0) - 1.0


def _known(error: float) -> float | None:
    return error if np.isfinite(error) else None


def _nearest(forced: ForcedPlate, frequency_hz: float) -> tuple[GroupModes | None, int]:
    """The mode nearest to a frequency: its group and its number there."""
    resonant = [
        (abs(hz - frequency_hz), basis, index) for basis in forced.modes for index, hz in enumerate(basis.frequency_hz)
    ]
    if not resonant:
        return None, 0
    _, basis, index = min(resonant, key=lambda each: each[0])
    return basis, index
