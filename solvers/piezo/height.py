"""How far the height of a driven plate's peak may be wrong."""

from __future__ import annotations

import numpy as np

from solvers.piezo.forced import ForcedPlate, GroupModes


def height_error(forced: ForcedPlate, frequency_hz: float) -> float | None:
    """Half-width of the bar of the peak nearest to a frequency, relative; None where it is not known, or no mode is about.

    A resonance's height goes as phi'f / lambda: what the loads f and the mode's frequency may be wrong by adds up. Damping is
    given and not judged. What modes left out of the panels bring is told at rest: at the mode's eigenvalue l it may be
    larger by l / (L - l), L that below which none was left out. What inertia adds to the loads is told at one frequency.
    """
    basis, index = _nearest(forced, frequency_hz)
    if basis is None:
        return None
    group, phi, value = basis.group, basis.columns[:, index], float(basis.eigenvalue[index])
    if group.by_mesh is None or group.by_modes is None:
        return None
    volts = forced.volts(forced.plate.scale.eigenvalue(frequency_hz))
    growth = max(float(cell.residual.growth(value)) - 1.0 for plate in group.plates for cell in plate.cells)
    lost = abs(phi @ group.by_mesh @ volts) + growth * abs(phi @ group.by_modes @ volts)
    if group.inertia is not None:
        lost += abs(value / group.eigenvalue - 1.0) * abs(phi @ group.inertia @ volts)
    given = abs(basis.gain[index] @ volts)
    hz = float(basis.frequency_hz[index])
    mesh = forced.mesh_error(hz, hz)
    error = float(lost / given) + 2.0 * mesh if given and mesh is not None else float("nan")
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
