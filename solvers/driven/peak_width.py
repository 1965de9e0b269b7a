"""First-order changes of the quality factor read from a peak, by small changes of the modes behind it.

The zone's square z^2 = sum a^H G a has modal amplitudes a = D g'v with voltages v. A symmetric change E of the modes' stiffness
changes it by -2 Re (1 + i/Q) s'D E a, s' = a^H G - q^H C^-1 g': q = dz^2/dv, C the charge per volt of the patches that no
voltage holds. One adjoint a tone so serves every E; the changes of ln z^2 on the peak and at its half-power points make that
of the quality factor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.driven.error_bars import Variation
from solvers.piezo.circuit import open_patches
from solvers.piezo.forced import ForcedPlate, GroupModes

STEP = 0.01  # of the half-power width: tones on both sides of one, for derivatives


@dataclass(frozen=True, eq=False)
class WidthRates:
    """Rates of ln Q per change of the modes' stiffness, (modes, modes) a group, and the largest flexibility of each mode about
    the peak, (modes,).
    """

    modes: list[GroupModes]
    rates: list[FloatArray]
    flexibility: list[FloatArray]

    def change(self, variation: Variation) -> float:
        """Relative change of the quality factor to first order."""
        number, places, stiffness = self._stiffness(variation)
        return float((stiffness * self.rates[number][np.ix_(places, places)]).sum())

    def ratio(self, variation: Variation) -> float:
        """|D E|, about by how much of the first-order change that of second order differs."""
        number, places, stiffness = self._stiffness(variation)
        root = np.sqrt(self.flexibility[number][places])
        return float(np.linalg.norm(root[:, None] * stiffness * root, 2))

    def _stiffness(self, variation: Variation) -> tuple[int, list[int], FloatArray]:
        """Group, places and change of the modal stiffness of a varied plate."""
        plates = variation.basis.group.plates
        number = next(i for i, basis in enumerate(self.modes) if basis.group.plates is plates)
        places, turn = (
            list(variation.places),
            np.eye(len(variation.places)) if variation.turn is None else variation.turn,
        )
        changed = (turn * np.array(variation.values)) @ turn.T - np.diag(variation.basis.eigenvalue[places])
        return number, places, changed


def width_rates(forced: ForcedPlate, peak_hz: float, half_hz: tuple[float, float]) -> WidthRates:
    """Rates of a peak's quality factor.

    Parameters
    ----------
    forced : ForcedPlate
    peak_hz : float
        The peak's frequency, Hz.
    half_hz : (float, float)
        Its half-power points, Hz.
    """
    width = half_hz[1] - half_hz[0]
    step = STEP * width
    tones = np.concatenate([tone + step * np.arange(-1, 2) for tone in (peak_hz, *half_hz)])
    at = np.array([forced.plate.scale.eigenvalue(tone) for tone in tones])
    square, adjoint, amplitude = _adjoint(forced, at)
    weights = _weights(np.log(square), peak_hz, width, step) / square
    flexible = [basis.flexibility(at, forced.loss) for basis in forced.modes]
    pairs = zip(adjoint, flexible, amplitude, strict=True)
    turned = -2.0 * (1.0 + 1j * forced.loss)
    rates = [((turned * weights[:, None] * left * mobile).T @ right).real for left, mobile, right in pairs]
    return WidthRates(forced.modes, rates, [np.abs(each).max(axis=0) for each in flexible])


def _weights(level: FloatArray, peak_hz: float, width: float, step: float) -> FloatArray:
    """Change of ln Q = ln f0 - ln (f2 - f1) per change of ln z^2 at the tones, three about each of f0, f1 and f2, (9,)."""
    top, low, high = level.reshape(3, 3)
    below, above = (side[2] - side[0] for side in (low, high))
    curving = top[0] - 2.0 * top[1] + top[2]
    out = np.zeros((3, 3))
    out[0] = np.array([0.5, 0.0, -0.5]) * step / (curving * peak_hz)
    out[:, 1] += np.array([1.0 / below - 1.0 / above, -1.0 / below, 1.0 / above]) * 2.0 * step / width
    return out.ravel()


def _adjoint(forced: ForcedPlate, at: FloatArray) -> tuple[FloatArray, list[ComplexArray], list[ComplexArray]]:
    """The zone's square (n,) at eigenvalues (n,), and group by group s and the modes' amplitudes, (n, modes) each."""
    volts, opened = forced.volts_over(at), open_patches(forced)
    columns = [basis.amplitudes(at, forced.loss, volts) for basis in forced.modes]
    heavy: list[ComplexArray] = [
        np.asarray(np.conj(each) @ gram[0]) for each, gram in zip(columns, forced.grams, strict=True)
    ]
    square = np.sum([(left * right).sum(axis=1).real for left, right in zip(heavy, columns, strict=True)], axis=0)
    counts = [len(basis.eigenvalue) for basis in forced.modes]
    back = _per_charge(forced, at, heavy, opened)
    own = [
        left[:, :count] - back @ basis.gain[:, opened].T
        for left, count, basis in zip(heavy, counts, forced.modes, strict=True)
    ]
    return square, own, [each[:, :count] for each, count in zip(columns, counts, strict=True)]


def _per_charge(forced: ForcedPlate, at: FloatArray, heavy: list[ComplexArray], opened: list[int]) -> ComplexArray:
    """q^H C^-1 of the patches that no voltage holds, (n, open), scaled."""
    count = len(forced.plate.patches)
    units = np.broadcast_to(np.eye(count, dtype=complex)[:, None], (count, len(at), count))
    unit = forced.plate.stiffness_unit
    per_volt = np.zeros((len(at), count), dtype=complex)
    moved = np.zeros((len(at), len(opened), len(opened)), dtype=complex)
    for basis, left in zip(forced.modes, heavy, strict=True):
        answers = basis.amplitudes(at, forced.loss, units)
        per_volt += np.einsum("nc,pnc->np", left, answers)
        moved += basis.receptance(at, forced.loss)[:, opened][:, :, opened]
    clamped = unit * moved + np.diag(forced.plate.capacitance_f[opened])
    return np.asarray(unit * np.linalg.solve(clamped.swapaxes(1, 2), per_volt[:, opened, None])[..., 0])
