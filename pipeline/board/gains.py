"""Gains of a plate's modes from its drive patches to its sensor patches, by modal residues.

Sensors are open: with E = C + R_ss (clamped capacitance and quasi-static residual), modes r of the plate with closed circuits,
gains g_rp = phi_r' theta_p and lambda_r' = lambda_r (1 + i/Q),

    (diag(lambda') + g_s E^-1 g_s' - lambda) q = g_d - g_s E^-1 R_sd,    V_s = -E^-1 (R_sd + g_s' q) per volt.

Its eigenvalues mu are the modes with open sensors; near one, V_s/V = G/(1 + i tau (w - w0)), G = residue/(i Im mu).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from pipeline.board.table_file import GAIN
from pipeline.case.model import Case
from solvers.errors import SolverError
from solvers.piezo.forced import ForcedPlate, in_phase_signs


@dataclass(frozen=True)
class ModalGains:
    """m modes with open sensors, ascending: frequency_hz (m,), tau_s (m,); wanted, the index of the wanted one.

    parts (m, drivers, sensors): G of each driver alone, driven by +1 V, at the mode's resonance, V/V, exp(i w t);
    signs (drivers,): with these all drivers push the wanted mode the same way.
    """

    frequency_hz: FloatArray
    tau_s: FloatArray
    parts: ComplexArray
    signs: FloatArray
    wanted: int

    @property
    def gain(self) -> ComplexArray:
        """G of all drivers together with their signs, (m, sensors), V/V."""
        return np.einsum("mds,d->ms", self.parts, self.signs)


def can_be_computed(case: Case) -> bool:
    """Whether there is a driving patch and a sensing one."""
    patches = case.patches
    return patches is not None and bool(patches.sensors) and bool(patches.drivers)


def modal_gains(forced: ForcedPlate, near_hz: float | None = None) -> ModalGains:
    """Modes and gains of a plate with open sensors, the quasi-static residual taken at the wanted mode.

    Without a wanted mode, the one nearest to `near_hz` stands for it; SolverError where that is not given either. Modes that
    no driver moves or no sensor hears (|G| of every pair below 1e-6 V/V) are left out.
    """
    values = np.concatenate([basis.eigenvalue for basis in forced.modes])
    gain = np.concatenate([basis.gain for basis in forced.modes])
    scale = forced.plate.scale.eigenvalue(1.0)
    tone = near_hz if forced.wanted_place() is None else forced.wanted_hz()
    if tone is None:
        raise SolverError("no mode of the plate with its patches has the wanted shape: there is none to drive")
    start = int(np.argmin(np.abs(values - scale * tone**2)))
    residual = sum(one.residual_gain[0] + (values[start] - one.middle) * one.residual_gain[1] for one in forced.modes)
    d, s = forced.drivers, forced.sensors
    clamped = np.diag(forced.plate.capacitance_f[s]) / forced.plate.stiffness_unit + residual[np.ix_(s, s)]
    listened = np.linalg.solve(clamped, gain[:, s].T)  # E^-1 g_s', (sensors, modes)
    system = np.diag(values * (1.0 + 1j * forced.loss)) + gain[:, s] @ listened
    mu, vectors = np.linalg.eig(system)
    vectors = vectors / np.sqrt(np.sum(vectors**2, axis=0))  # x'x = 1: the system is complex symmetric
    pushed = gain[:, d] - listened.T @ residual[np.ix_(s, d)]
    residues = np.einsum("dm,sm->mds", pushed.T @ vectors, -listened @ vectors)
    root = np.sqrt(mu / scale)
    parts = residues / (1j * mu.imag)[:, None, None]
    heard = np.abs(parts).max(axis=(1, 2)) >= GAIN[0]
    order = [k for k in np.argsort(mu.real) if heard[k]]
    wanted = int(np.argmax(np.abs(vectors[start])))
    return ModalGains(
        frequency_hz=np.sqrt(mu.real[order] / scale),
        tau_s=1.0 / (2.0 * pi * root.imag[order]),
        parts=parts[order],
        signs=in_phase_signs(gain[start], d)[d],
        wanted=order.index(wanted),
    )


def hold(frequency_hz: float, sample_rate_hz: float) -> complex:
    """What holding each sample until the next does to a tone, (1 - exp(-i w T))/(i w T): half a sample late, drooped."""
    turn = 2j * pi * frequency_hz / sample_rate_hz
    return complex((1.0 - np.exp(-turn)) / turn)
