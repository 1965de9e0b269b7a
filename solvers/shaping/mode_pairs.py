"""Several modes held at once, and two of them a quarter period apart: a travelling wave inside a zone.

Two shapes that look like cos kx and sin kx inside the zone, held with amplitudes in the ratio of their sizes and 90 degrees
apart, give w = cos kx - i sin kx = e^{-ikx}. Driven at one frequency between their own; the other modes are kept small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import BoolArray, ComplexArray
from solvers.errors import SolverError
from solvers.shaping.inversion import Drive, drive_voltages
from solvers.shaping.modal_table import ModalTable, field_matrix, modal_drive
from solvers.shaping.travelling_wave import travelling_wave_ratio


def hold_modes(table: ModalTable, frequency_hz: float, wanted: dict[int, complex], others: float = 1.0) -> Drive:
    """Voltages that give modal coordinates {mode: amplitude} and keep the rest small: least squares over all modes.

    others: weight of the modes not named, against 1 for those that are; 0 leaves them free. Raises SolverError for a mode that
    is not in the table, a mode no actuator reaches, others < 0; as drive_voltages and receptance.
    """
    count = table.frequencies_hz.size
    for mode in wanted:
        if not 0 <= mode < count:
            raise SolverError(f"mode {mode}: the table has modes 0 to {count - 1}")
        if not np.abs(table.actuators[mode]).max() > 1e-9 * np.abs(table.actuators).max():
            raise SolverError(f"mode {mode}: every actuator sits on a node of it, it cannot be held")
    if not (np.isfinite(others) and others >= 0.0):
        raise SolverError(f"others = {others:g}: must be 0 or more")
    named = np.array(list(wanted), dtype=int)
    kept = np.arange(count) if others else named
    target = np.zeros(count, dtype=complex)
    target[named] = list(wanted.values())
    weight = np.full(count, others)
    weight[named] = 1.0
    matrix = weight[:, None] * modal_drive(table, frequency_hz)
    return drive_voltages(matrix[kept], target[kept])


@dataclass(frozen=True)
class ModePair:
    """Two modes held a quarter period apart: drive, field (p,) in m, twr inside the zone, wavenumber along x in rad/m.

    alone: TWR of the pure sum of the two shapes, what perfect holding would give. A field that moves in step with even
    amplitude has a TWR of 1 too, so read it with the wavenumber: 0 where nothing travels, as for shapes of one symmetry.
    """

    modes: tuple[int, int]
    frequency_hz: float
    drive: Drive
    field: ComplexArray
    twr: float
    alone: float
    wavenumber: float


def travelling_pair(table: ModalTable, modes: tuple[int, int], inside: BoolArray, others: float = 1.0) -> ModePair:
    """Hold two modes 90 degrees apart with equal rms over `inside`, points (p,) along a line of the zone.

    The frequency is half-way between the two (geometric mean); the pure sum of the two runs towards +x.

    SolverError for the same mode twice, fewer than 8 points inside, a mode with no motion there; as hold_modes.
    """
    first, second = modes
    if first == second:
        raise SolverError("a travelling wave takes two different modes")
    if inside.sum() < 8:
        raise SolverError(f"{int(inside.sum())} points lie inside: 8 or more are needed")
    frequency_hz = float(np.sqrt(np.prod(table.frequencies_hz[list(modes)])))
    sizes = np.sqrt(np.mean(table.field[list(modes)][:, inside] ** 2, axis=1))
    if not sizes.min() > 1e-9 * np.abs(table.field).max():
        raise SolverError("one of the two modes does not move inside the zone")
    amplitudes = {first: complex(1.0 / sizes[0]), second: -1j / complex(sizes[1])}
    if _turning(table, _sum(table, amplitudes), inside) < 0.0:
        amplitudes[second] *= -1.0
    drive = hold_modes(table, frequency_hz, amplitudes, others)
    field = field_matrix(table, frequency_hz) @ drive.voltages
    return ModePair(
        modes=modes,
        frequency_hz=frequency_hz,
        drive=drive,
        field=field,
        twr=travelling_wave_ratio(field[inside]),
        alone=travelling_wave_ratio(_sum(table, amplitudes)[inside]),
        wavenumber=_turning(table, field, inside),
    )


def _sum(table: ModalTable, amplitudes: dict[int, complex]) -> ComplexArray:
    return np.asarray(np.array(list(amplitudes.values())) @ table.field[list(amplitudes)])


def _turning(table: ModalTable, field: ComplexArray, inside: BoolArray) -> float:
    """Mean -d(phase)/dx along the first coordinate, rad/m: above 0 for a wave towards +x."""
    x = table.points_m[inside, 0]
    order = np.argsort(x)
    phase = np.unwrap(np.angle(field[inside][order]))
    return float(-np.polyfit(x[order], phase, 1)[0])
