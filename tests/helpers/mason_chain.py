"""Mason's line by chain matrices multiplied from end to end: an independent solution for forces and velocities."""

from __future__ import annotations

import numpy as np

from geometry.elements import FloatArray
from solvers.thesis.circuit import Line, LineResponse


def chain_response(line: Line, omega: FloatArray) -> LineResponse:
    """Velocities and forces of a driven line from right to left, as in the thesis but with corrected signs.

    A filter multiplies by [[1, 1/Y], [0, 1]] and must not be lossless at its own frequency.
    """
    w = np.atleast_1d(omega)
    start = np.zeros((w.size, 2, 1), dtype=complex)
    start[:, 1 if line.right == "free" else 0] = 1.0  # the unknown at the right end: I when free, V when clamped
    state = np.concatenate([start, np.zeros_like(start)], axis=2)  # per unknown, and with it at zero
    voltages, currents = [], [state[:, 1]]
    for k in range(len(line.cells) - 1, -1, -1):
        push, chain = np.array([[line.sources[k]], [0.0]]) * np.array([[0.0, 1.0]]), line.cells[k].chain(w)
        left = chain @ (state - push) + push
        voltages.append(np.stack([left[:, 0], state[:, 0]], axis=1))
        state = left
        if k in line.filters:
            state = left.copy()
            state[:, 0] += left[:, 1] / line.filters[k].admittance(w)[:, None]
        currents.append(state[:, 1])
    known = state[:, 0] if line.left == "free" else state[:, 1]
    weight = np.stack([-known[:, 1] / known[:, 0], np.ones(w.size)], axis=1)
    current = np.stack(currents[::-1], axis=1) @ weight[:, :, None]
    voltage = np.stack(voltages[::-1], axis=1) @ weight[:, None, :, None]
    return LineResponse(current[..., 0], voltage[..., 0])


def absorbed_power_w(line: Line, response: LineResponse, omega: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean power of the sources and of the filters' resistors, each shape (n,), W; amplitudes are peaks."""
    w = np.atleast_1d(omega)
    into = response.currents[:, :-1] - response.currents[:, 1:]
    given = -0.5 * np.real(np.sum(np.array(line.sources) * into.conj(), axis=1))
    taken = np.zeros(w.size)
    for joint, one in line.filters.items():
        drop = response.voltages[:, joint - 1, 1] - response.voltages[:, joint, 0]
        taken += 0.5 * np.abs(drop) ** 2 * np.real(one.admittance(w))
    return given, taken
