"""Where the patches' power goes along a driven plate: what flows through a section x, and what is lost on the way.

Power in = Re(V* I)/2 patch by patch with I = j omega (theta' u + C V). Only the modes are damped, in proportion to their
strain: a panel loses omega/(2 Q) u' K u of their motion u, a patch on it likewise. Modes extrapolated from two meshes of the
patches store L = diag(eigenvalues), not the U' K U of the finer mesh: u = U S q with S' (U' K U) S = L, so that what is lost
everywhere is what the modes lose, omega/(2 Q) q' L q. The flow through a section is what comes in left of it less what is lost
there: it ends at 0 beyond the last patch.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import pi
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.errors import SolverError
from solvers.piezo.forced import ForcedPlate, GroupModes
from solvers.piezo.patched_plate import PatchedPlate
from solvers.superelement.cell import Cell
from solvers.superelement.plate import WHOLE


@dataclass(frozen=True)
class PowerFlow:
    """Means over a period, W: what each patch gives (patches,), negative where it takes; the flow towards +x (n,) through the
    sections x_m (n,) that no patch straddles; what the plate and its patches lose.
    """

    patches_w: FloatArray
    x_m: FloatArray
    flow_w: FloatArray
    lost_w: float


def power_flow(forced: ForcedPlate, frequency_hz: float) -> PowerFlow:
    """The flow of a patched plate as it is fed (`ForcedPlate.driven_by`), sections at the edges of its panels."""
    plate = forced.plate
    if not isinstance(plate, PatchedPlate):
        raise SolverError("a power flow along the plate needs patches that drive it")
    eigenvalue, omega = plate.scale.eigenvalue(frequency_hz), 2.0 * pi * frequency_hz
    volts = forced.volts(eigenvalue)
    charge = np.sum([basis.receptance(eigenvalue, forced.loss) for basis in forced.modes], axis=0) @ volts
    current = 1j * omega * (charge * plate.stiffness_unit + plate.capacitance_f * volts)
    given = 0.5 * (volts.conj() * current).real
    motions = [_modal(basis, eigenvalue, forced.loss, volts) for basis in forced.modes]
    x, energy = _panels(forced, motions)
    lost = 0.5 * omega * forced.loss * plate.stiffness_unit * np.concatenate([energy, _on_patches(forced, motions)])
    spans = np.array([(patch.points[:, 0].min(), patch.points[:, 0].max()) for patch in plate.patches])
    places = np.concatenate([x, spans.mean(axis=1)])
    edges = np.unique(np.round(forced.modes[0].group.plates[0].tiling.x, 12))
    clear = np.array([not ((spans[:, 0] < edge) & (edge < spans[:, 1])).any() for edge in edges])
    sections = edges[clear]
    flow = [float(given[spans[:, 1] <= edge + 1e-9].sum() - lost[places < edge].sum()) for edge in sections]
    return PowerFlow(given, sections, np.array(flow), float(lost.sum()))


def _modal(basis: GroupModes, eigenvalue: float, loss: float, volts: ComplexArray) -> list[Any]:
    """The damped part of the motion, with the strain energy of the modes that are solved, class by class of the group."""
    count = len(basis.frequency_hz)
    amplitudes = basis.amplitudes(eigenvalue, loss, volts)[:count]
    modes = basis.columns[:, :count]
    motion: Any = modes @ (_as_stiff(basis, modes) @ amplitudes)
    return list(basis.group.split(motion))


_KNOWN: WeakKeyDictionary[GroupModes, FloatArray] = WeakKeyDictionary()  # one plate is driven in several ways


def _as_stiff(basis: GroupModes, modes: FloatArray) -> FloatArray:
    """S = A^(-1/2) L^(1/2), so that S' A S = L: stiffness A (k, k) in modes, eigenvalues L (k,), none of them rigid."""
    if basis not in _KNOWN:
        meshed = modes.T @ np.asarray(basis.group.pencil.stiffness @ modes)
        values, vectors = np.linalg.eigh((meshed + meshed.T) / 2.0)
        _KNOWN[basis] = np.asarray((vectors / np.sqrt(values)) @ vectors.T * np.sqrt(basis.eigenvalue))
    return _KNOWN[basis]


def _panels(forced: ForcedPlate, motions: list[list[Any]]) -> tuple[FloatArray, FloatArray]:
    """Middles x (n,) in m of the whole plate's panels and u' K u of each, scaled.

    In mirrored coordinates a panel's image moves as the sum of the classes, each with the sign of its mirrors; a panel on a
    mirror line is its own image, and its share is counted at both.
    """
    places: list[float] = []
    energies: list[FloatArray] = []
    for cell, x, copies, classes in _placed(forced, motions):
        flips = [(1.0, 1.0)] if classes[0][0] == WHOLE else list(product((1.0, -1.0), repeat=2))
        moved = np.array([np.sum([_sign(name, flip) * field for name, field in classes], axis=0) for flip in flips])
        energies.append(np.einsum("fi,ij,fj->f", moved.conj(), cell.stiffness, moved).real * copies / len(flips))
        places += [flip[0] * x for flip in flips]
    return np.array(places), np.concatenate(energies)


def _placed(forced: ForcedPlate, motions: list[list[Any]]) -> Iterator[tuple[Cell, float, int, list[tuple[str, Any]]]]:
    """Each assembled panel: its cell, middle x, copies, and its motion in every class that is driven."""
    plates = [
        (plate, motion)
        for basis, parts in zip(forced.modes, motions, strict=True)
        for plate, motion in zip(basis.group.plates, parts, strict=True)
    ]
    for cells in zip(*(plate.placed_cells for plate, _ in plates), strict=True):
        pairs = zip(cells, plates, strict=True)
        moved = [(plate.symmetry, plate.cell_vectors(cell, motion[:, None])[:, 0]) for cell, (plate, motion) in pairs]
        yield cells[0].cell, float(cells[0].middle[0]), cells[0].copies, moved


def _sign(symmetry: str, flip: tuple[float, ...]) -> float:
    marks = zip(symmetry, flip, strict=False)
    return float(np.prod([-1.0 if mark == "A" and side < 0.0 else 1.0 for mark, side in marks]))


def _on_patches(forced: ForcedPlate, motions: list[list[Any]]) -> FloatArray:
    """u' K u of the patches themselves, scaled, (patches,)."""
    plate = forced.plate
    assert isinstance(plate, PatchedPlate)
    energies = np.zeros(len(plate.bonds))
    for number, bond in enumerate(plate.bonds):
        pairs = zip(forced.modes, motions, strict=True)
        moved = np.sum([plate.motion(b.group.plates, number) @ np.concatenate(m) for b, m in pairs], axis=0)
        energies[number] = (np.conj(moved) @ bond.finest.stiffness @ moved).real
    return energies
