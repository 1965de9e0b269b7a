"""Integrals of |u_z|^2 over parts of a driven plate as quadratic forms of its drivers' voltages, and the largest contrast."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from geometry.elements import ComplexArray, FloatArray, IntArray
from solvers.piezo.forced import ForcedPlate, GroupModes
from solvers.superelement.lattice import times

# -- contrast ----------------------------------------------------------------------------------------------------------
# Active confinement by the patches themselves: the voltages of the largest contrast between zone and passive face.
# a' G_in a over a' G_out a is largest for the first eigenvector of G_in a = c^2 G_out a (choi2002), with G from each
# driver's field.

ROUNDING = 1e-12  # of the outside's mean: what voltages that move nothing there have


def contrast_volts(plate: ForcedPlate, frequency_hz: float) -> ComplexArray | None:
    """Find the voltages of the largest contrast between the active and the passive face.

    Parameters
    ----------
    plate : ForcedPlate
        The plate with its drivers.
    frequency_hz : float
        Frequency of the drive.

    Returns
    -------
    ndarray, shape (patches,), or None
        In V, 0 for sensors, the largest of size 1; None with one driver or no passive face.
    """
    drivers = plate.drivers
    design = plate.design
    length, width = design.plate_m
    passive = max(length / design.length_m, width / design.width_m) > 1.0 + 1e-9
    if len(drivers) < 2 or plate.circuit != "short" or not passive:
        return None
    volts = np.zeros(len(plate.plate.patches), dtype=complex)
    inside, outside = forms(plate, face_grams(plate), np.array([frequency_hz])).squares[:, 0]
    volts[drivers] = best_volts(inside, outside, 0.0)
    return volts


def best_volts(inside: ComplexArray, outside: ComplexArray, alpha: float) -> ComplexArray:
    """Find the drivers' voltages of the largest contrast between two forms.

    alpha^2 times the mean of the outside's diagonal is added to it, as in solvers.shaping.voltages: this penalises large
    voltages that move the plate little.

    Parameters
    ----------
    inside, outside : ndarray, shape (..., d, d)
        Hermitian forms of the voltages.
    alpha : float
        Penalty, dimensionless.

    Returns
    -------
    ndarray, shape (..., d)
        In V, the largest of size 1.
    """
    count = inside.shape[-1]
    mean = np.trace(outside, axis1=-2, axis2=-1).real[..., None, None]
    lower = np.linalg.cholesky(outside + max(ROUNDING, alpha**2 / count) * mean * np.eye(count))
    back = np.linalg.inv(lower)
    top = np.linalg.eigh(back @ inside @ back.conj().swapaxes(-1, -2))[1][..., -1]
    best = (back.conj().swapaxes(-1, -2) @ top[..., None])[..., 0]
    largest = np.abs(best).argmax(axis=-1)[..., None]
    return np.asarray(best / np.take_along_axis(best, largest, axis=-1))


def unit_volts(plate: ForcedPlate, eigenvalue: float | FloatArray) -> ComplexArray:
    """Compute the voltages of all patches with each driver alone at 1 V and the sensors open.

    Parameters
    ----------
    plate : ForcedPlate
        The plate with its patches.
    eigenvalue : float or ndarray, shape (...)
        Scaled eigenvalues of the frequencies.

    Returns
    -------
    ndarray, shape (..., patches, drivers)
        In V.
    """
    one = np.eye(len(plate.plate.patches), dtype=complex)[:, plate.drivers]
    volts = np.tile(one, (*np.shape(eigenvalue), 1, 1))
    if left := plate.sensors:
        moved, total = _sensor_charges(plate, eigenvalue)
        volts[..., left, :] = -np.linalg.solve(total, moved[..., plate.drivers])
    return volts


def _sensor_charges(plate: ForcedPlate, eigenvalue: float | FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Scaled charges of the sensors per volt: by the plate's motion on each patch (..., sensors, patches), and in all on the
    sensors (..., sensors, sensors).
    """
    left = plate.sensors
    moved = np.sum([basis.receptance(eigenvalue)[..., left, :] for basis in plate.modes], axis=0)
    return moved, moved[..., left] + np.diag(plate.plate.capacitance_f[left]) / plate.plate.stiffness_unit


# -- forms -------------------------------------------------------------------------------------------------------------
# Integrals of |u_z|^2 over parts of a driven plate as quadratic forms of its drivers' voltages, and those of plates
# like it.
# With columns [modes, R, R1] of all groups, X (columns, drivers) their answers per volt with the sensors open and G a
# part's integrals per pair of columns, the part has v^H S v, S = X^H G X. A change d of the stiffness of mode r and a
# force on it both add y_r rho to X, y_r the answer to a unit force on the mode and rho a row of the drivers: of the
# stiffness
#
#     rho = -d c x_r / (1 + d c f_rr),  c = 1 + i/Q, x_r the mode's row of X, f_rr its row of y_r,
#
# and two such rows where two modes are coupled (Sherman, Morrison, Woodbury). So S is exact on every plate that
# differs in one mode or in one pair of them, at the cost of a few products and without another solve.


@dataclass(frozen=True, eq=False)
class Forms:
    """A plate's forms at t frequencies.

    grams (k, columns, columns): of the parts. places (n,): the modes' columns. answers (t, columns, d): X. flexible (t, n): of
    the modes alone. charged (t, columns, o), gains (n, o): answers to unit charges on the open patches, and their gains.
    drivers, volts (t, drivers): the forms of each driver, and the drivers' voltages if d = 1 stands for all together.
    """

    grams: FloatArray
    places: IntArray
    lossy: ComplexArray
    answers: ComplexArray
    flexible: ComplexArray
    charged: ComplexArray
    gains: FloatArray
    drivers: Forms | None = None
    volts: ComplexArray | None = None

    @cached_property
    def squares(self) -> ComplexArray:
        """S, (k, t, d, d)."""
        return np.asarray(_adjoint(self.answers) @ self._heavy)

    @cached_property
    def modal(self) -> ComplexArray:
        """The modes' rows of X, (t, n, d)."""
        return np.asarray(self.answers[:, self.places])

    @cached_property
    def own(self) -> ComplexArray:
        """f_rr, (t, n)."""
        return np.asarray(self.flexible * (1.0 - (self.charged[:, self.places] * self.gains).sum(axis=-1)))

    @cached_property
    def beside(self) -> ComplexArray:
        """y_r^H G X, (k, t, n, d)."""
        charged = _adjoint(self.charged) @ self._heavy
        return np.asarray(self.flexible.conj()[..., None] * (self._heavy[:, :, self.places] - self.gains @ charged))

    @cached_property
    def norms(self) -> ComplexArray:
        """y_r^H G y_r, (k, t, n)."""
        moved = self._moved[:, :, self.places]
        single = np.diagonal(self.grams, axis1=1, axis2=2)[:, None, self.places]
        crossed = 2.0 * (moved * self.gains).sum(axis=-1).real
        both = (self.gains @ self._charges * self.gains).sum(axis=-1)
        return np.asarray(np.abs(self.flexible) ** 2 * (single - crossed + both))

    def at(self, tones: slice) -> Forms:
        """Forms at some of the frequencies."""
        return replace(self, answers=self.answers[tones], flexible=self.flexible[tones], charged=self.charged[tones])

    def fed(self, volts: ComplexArray) -> Forms:
        """Forms of a single voltage, which feeds the drivers by (t, d)."""
        return replace(self, answers=self.answers @ volts[..., None], drivers=self, volts=volts)

    def softened(self, change: FloatArray) -> ComplexArray:
        """S with the stiffness of each mode changed by (t, n, s): (k, t, n, s, d, d)."""
        return self._forced(softened_rows(np.asarray(self.lossy[:, None] * change), self.own, self.modal))

    def forced(self, rows: ComplexArray) -> ComplexArray:
        """S with a further force on each mode, (t, n, s, drivers) per volt: (k, t, n, s, d, d)."""
        return self._forced(rows if self.volts is None else rows @ self.volts[:, None, :, None])

    def _forced(self, rows: ComplexArray) -> ComplexArray:
        return self._with(self.beside[..., None, :], rows[..., None, :], self.norms[..., None, None])

    def rest(self, share: FloatArray) -> ComplexArray:
        """S with all columns but the modes' larger by shares (s,): (k, t, 1, s, d, d)."""
        rest = self.answers.copy()
        rest[:, self.places] = 0.0
        crossed, own = _adjoint(rest) @ self._heavy, _adjoint(rest) @ _times(self.grams, rest)
        parts = self.squares, crossed + _adjoint(crossed), own
        none, one, two = (part[:, :, None, None] for part in parts)
        share = share[:, None, None]
        return np.asarray(none + share * one + share**2 * two)

    def louder(self, factor: FloatArray) -> ComplexArray:
        """S with the drivers' answers times factors (m, s, drivers): (k, t, m, s, d, d)."""
        if self.drivers is None or self.volts is None:
            return np.asarray(factor[..., None] * self.squares[:, :, None, None] * factor[..., None, :])
        fed = factor * self.volts[:, None, None]
        return np.asarray(np.einsum("tmsa,ktab,tmsb->ktms", fed.conj(), self.drivers.squares, fed)[..., None, None])

    def coupled(self, mode: IntArray, change: FloatArray) -> ComplexArray:
        """S with one mode per tone (t,) coupled to each other by a stiffness (t, n, s), 0 to itself: (k, t, n, s, d, d)."""
        at = np.arange(len(mode))
        rows = coupled_rows(np.asarray(self.lossy[:, None] * change), self.own, self.modal, mode, self._between(mode))
        beside = [np.broadcast_to(self.beside[:, at, mode][:, :, None], self.beside.shape), self.beside]
        return self._with(np.stack(beside, -2), rows, self._pairs(mode))

    def _with(self, beside: ComplexArray, rows: ComplexArray, pairs: ComplexArray) -> ComplexArray:
        """S with X + sum y_u rho_u: y_u^H G X (k, t, n, u, d), rho_u (t, n, s, u, d), y_u^H G y_v (k, t, n, u, u)."""
        crossed = np.einsum("ktmua,tmsub->ktmsab", beside.conj(), rows)
        within = np.einsum("tmsua,ktmuv,tmsvb->ktmsab", rows.conj(), pairs, rows, optimize=True)
        return np.asarray(self.squares[:, :, None, None] + crossed + _adjoint(crossed) + within)

    def _between(self, mode: IntArray) -> ComplexArray:
        """f_ij of one mode per frequency and each, (t, n)."""
        at = np.arange(len(mode))
        crossed = np.einsum("to,jo->tj", self.charged[at, self.places[mode]], self.gains)
        return np.asarray(self.flexible * ((mode[:, None] == np.arange(len(self.places))) - crossed))

    def _pairs(self, mode: IntArray) -> ComplexArray:
        """y_i^H G y_j of one mode per frequency and each, (k, t, n, 2, 2)."""
        at, columns, gains = np.arange(len(mode)), self.places[mode], self.gains[mode]
        flat = self.grams[:, columns[:, None], self.places]
        flat = flat - np.einsum("kto,jo->ktj", self._moved[:, at, columns], self.gains)
        flat = flat - np.einsum("to,ktjo->ktj", gains, self._moved[:, :, self.places].conj())
        flat = flat + np.einsum("to,ktop,jp->ktj", gains, self._charges, self.gains)
        cross = self.flexible[at, mode].conj()[:, None] * self.flexible * flat
        out = np.empty((*cross.shape, 2, 2), dtype=complex)
        out[..., 0, 0], out[..., 1, 1] = self.norms[:, at, mode][..., None], self.norms
        out[..., 0, 1], out[..., 1, 0] = cross, cross.conj()
        return out

    @cached_property
    def _heavy(self) -> ComplexArray:
        """G X, (k, t, columns, d)."""
        return _times(self.grams, self.answers)

    @cached_property
    def _moved(self) -> ComplexArray:
        """G times the answers to charges, (k, t, columns, o)."""
        return _times(self.grams, self.charged)

    @cached_property
    def _charges(self) -> ComplexArray:
        """G between charges, (k, t, o, o)."""
        return np.asarray(_adjoint(self.charged) @ self._moved)


def forms(forced: ForcedPlate, grams: FloatArray, frequency_hz: FloatArray) -> Forms:
    """Compute the quadratic forms of a plate whose drivers hold voltages.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    grams : ndarray, shape (k, columns, columns)
        Integrals over k parts for each pair of all groups' columns, group after group.
    frequency_hz : ndarray, shape (t,)
        Frequencies of the drive.

    Returns
    -------
    Forms
        S (k, t, d, d) and what changes of the modes need.
    """
    at = forced.plate.scale.eigenvalue(frequency_hz)
    opened, total = forced.sensors, _sensor_charges(forced, at)[1]
    starts = np.cumsum([0, *(basis.columns.shape[1] for basis in forced.modes)])
    places = [start + np.arange(len(b.eigenvalue)) for start, b in zip(starts, forced.modes, strict=False)]
    charges = np.zeros((len(at), len(forced.plate.patches), len(opened)), dtype=complex)
    charges[:, opened] = np.linalg.inv(total)
    return Forms(
        grams,
        np.concatenate(places),
        np.asarray(1.0 + 1j * forced.losses),
        _answers(forced.modes, at, unit_volts(forced, at)),
        np.concatenate([basis.flexibility(at) for basis in forced.modes], axis=-1),
        _answers(forced.modes, at, charges),
        np.concatenate([basis.gain[:, opened] for basis in forced.modes]),
    )


def softened_rows(step: ComplexArray, own: ComplexArray, modal: ComplexArray) -> ComplexArray:
    """Compute the forces on modes whose stiffness changes.

    Parameters
    ----------
    step : ndarray, shape (t, n, s)
        Lossy changes of the scaled stiffness.
    own : ndarray, shape (t, n)
        Flexibility f_rr of each mode.
    modal : ndarray, shape (t, n, d)
        Modal amplitudes x_r per volt.

    Returns
    -------
    ndarray, shape (t, n, s, d)
        Scaled forces rho per volt.
    """
    return np.asarray(-(step / (1.0 + step * own[..., None]))[..., None] * modal[:, :, None])


def coupled_rows(
    step: ComplexArray, own: ComplexArray, modal: ComplexArray, mode: IntArray, between: ComplexArray
) -> ComplexArray:
    """Compute the forces on one mode per frequency and on each other mode, coupled by steps of stiffness.

    Parameters
    ----------
    step : ndarray, shape (t, n, s)
        Lossy scaled coupling stiffness.
    own : ndarray, shape (t, n)
        Flexibility of each mode.
    modal : ndarray, shape (t, n, d)
        Modal amplitudes per volt.
    mode : ndarray, shape (t,)
        Number of the mode at each frequency.
    between : ndarray, shape (t, n)
        Flexibility f_ij between it and each other mode.

    Returns
    -------
    ndarray, shape (t, n, s, 2, d)
        Scaled forces on both, per volt.
    """
    at, step = np.arange(len(mode)), step[..., None]
    here, there = own[at, mode][:, None, None, None], own[..., None, None]
    first, second = modal[at, mode][:, None, None], modal[:, :, None]
    turned = 1.0 + step * between[..., None, None]
    size = step**2 * here * there - turned**2
    rows = [
        -step * (step * there * first - turned * second) / size,
        -step * (step * here * second - turned * first) / size,
    ]
    return np.stack(rows, -2)


def face_grams(forced: ForcedPlate) -> FloatArray:
    """Average u_z^2 over the active and over the passive touch face for each pair of all groups' columns.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.

    Returns
    -------
    ndarray, shape (2, columns, columns)
        The means, scaled as the columns; one only where there is no passive face.
    """
    grams = [block_diag(*each) for each in zip(*forced.grams, strict=True)]
    return np.array([gram / area for gram, area in zip(grams, forced.areas_m2, strict=True) if area])


def _answers(modes: list[GroupModes], at: FloatArray, volts: ComplexArray) -> ComplexArray:
    """Coefficients (t, columns, n) per voltages (t, patches, n)."""
    one = volts.transpose(2, 0, 1)
    return np.concatenate([basis.amplitudes(at, one) for basis in modes], axis=-1).transpose(1, 2, 0)


def _adjoint(values: ComplexArray) -> ComplexArray:
    return np.asarray(values.conj().swapaxes(-1, -2))


def _times(real: FloatArray, values: ComplexArray) -> ComplexArray:
    """Products (k, t, rows, n) of real matrices (k, rows, rows) and complex ones (t, rows, n)."""
    t, rows, n = values.shape
    flat = np.ascontiguousarray(values.transpose(1, 0, 2)).reshape(rows, t * n)
    return np.asarray(times(real, flat).reshape(len(real), rows, t, n).transpose(0, 2, 1, 3))
