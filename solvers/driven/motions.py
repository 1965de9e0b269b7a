"""Motions of a driven plate at places where something presses on it, and those of plates like it, as `forms` has their squares.

Loads L are voltages of patches and forces at the points of a contact. R = G' f G + R0 gives charges and motions, with gains G
and flexibilities f of the modes, and R0 of what lies beyond them. Open patches carry no charge, and a contact of stiffness D
bears the force -D u: S L_u = -R L_fed with S = R + diag(C, 1/D) of these loads. What a force on a mode moves, and how it moves
the modes, then is

    y_r = f_r (G' - R S^-1 G'_u) e_r,  f_ij = f_i (delta_ij - G_i S^-1 G'_j f_j).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray, IntArray
from solvers.driven.curve_bars import Doubts, changes
from solvers.driven.forms import coupled_rows, softened_rows


@dataclass(frozen=True, eq=False)
class Motions:
    """Outputs (t, m, d) of a plate at t places per drive, what of them no mode carries, and what a force on a mode gives.

    answers, rest (t, m, d); moved (t, m, n); modal (t, n, d): motion of the modes; within (t, n, n): f_ij; flexible (1, n).
    drivers, volts (t, d): the same of each driver, and what they are fed with where d = 1 stands for all together.
    """

    lossy: complex
    answers: ComplexArray
    rest_only: ComplexArray
    moved: ComplexArray
    modal: ComplexArray
    within: ComplexArray
    flexible: ComplexArray
    drivers: Motions | None = None
    volts: ComplexArray | None = None

    @cached_property
    def own(self) -> ComplexArray:
        """f_rr, (t, n)."""
        return np.diagonal(self.within, axis1=1, axis2=2)

    def fed(self, volts: ComplexArray) -> Motions:
        """The same of one voltage alone: the drivers', (t, d)."""
        parts = {name: getattr(self, name) @ volts[..., None] for name in ("answers", "rest_only", "modal")}
        return replace(self, **parts, drivers=self, volts=volts)

    def softened(self, change: FloatArray) -> ComplexArray:
        """Outputs with the stiffness of each mode changed by (t, n, s): (t, n, s, m), as fed."""
        return self._forced(softened_rows(np.asarray(self.lossy * change), self.own, self.modal)[..., 0])

    def coupled(self, mode: IntArray, change: FloatArray) -> ComplexArray:
        """The same with one mode a place (t,) and each other coupled by a stiffness (t, n, s), 0 to itself."""
        at = np.arange(len(mode))
        rows = coupled_rows(np.asarray(self.lossy * change), self.own, self.modal, mode, self.within[at, mode])[..., 0]
        first = rows[..., 0][..., None] * self.moved[at, :, mode][:, None, None]
        return self._forced(rows[..., 1]) + first

    def forced(self, rows: ComplexArray) -> ComplexArray:
        """The same with a further force on each mode, (t, n, s, drivers) per volt."""
        assert self.volts is not None
        return self._forced((rows @ self.volts[:, None, :, None])[..., 0])

    def rest(self, share: FloatArray) -> ComplexArray:
        """The same with what lies beyond the modes larger by shares (s,), to first order: (t, 1, s, m)."""
        return np.asarray(self._plain + share[:, None] * self.rest_only[:, None, None, :, 0])

    def louder(self, factor: FloatArray) -> ComplexArray:
        """The same with the drivers' answers times factors (k, s, d): (t, k, s, m)."""
        assert self.drivers is not None and self.volts is not None
        fed = factor * self.volts[:, None, None]
        return np.asarray(np.einsum("tmd,tksd->tksm", self.drivers.answers, fed))

    @property
    def _plain(self) -> ComplexArray:
        return np.asarray(self.answers[:, None, None, :, 0])

    def _forced(self, rows: ComplexArray) -> ComplexArray:
        return np.asarray(self._plain + rows[..., None] * self.moved.swapaxes(1, 2)[:, :, None])


@dataclass(frozen=True, eq=False)
class Contacts:
    """A plate seen from its patches and the points of a contact at t places, in SI.

    beyond (t, l, l): what of the receptance no mode carries; gains (t, n, l) and scaled eigenvalues value (n,) of the modes;
    unit: N/m of one of stiffness. capacitance_f (patches,); drivers, sensors: by number among the patches, the first loads.
    """

    beyond: ComplexArray
    gains: FloatArray
    value: FloatArray
    loss: float
    unit: float
    capacitance_f: FloatArray
    drivers: list[int]
    sensors: list[int]

    @classmethod
    def of(cls, receptance: ComplexArray, eigenvalue: float, **plate: Any) -> Contacts:
        """From receptances (t, l, l) at an eigenvalue."""
        modal = cls(np.zeros_like(receptance), **plate).receptance(eigenvalue)
        return cls(np.asarray(receptance - modal), **plate)

    def receptance(self, eigenvalue: float) -> ComplexArray:
        """Charges and motions per volt and newton, (t, l, l)."""
        modal = (self.gains.swapaxes(1, 2) * self.flexible(eigenvalue)) @ self.gains
        return np.asarray(self.beyond + self.unit * modal)

    def flexible(self, eigenvalue: float) -> ComplexArray:
        """Flexibilities of the modes, (n,)."""
        return np.asarray(1.0 / (self.value * (1.0 + 1j * self.loss) - eigenvalue))

    def motions(self, eigenvalue: float, stiffness_n_m: complex | None = None, missing_m_n: float = 0.0) -> Motions:
        """Motions of the contact's points, then voltages of the sensors, (t, m, d); without a stiffness nothing presses.

        missing_m_n: flexibility of every point in addition to the plate's.
        """
        count = len(self.capacitance_f)
        points = np.arange(count, self.gains.shape[-1])
        loose = np.array([*self.sensors, *(points if stiffness_n_m is not None else [])], dtype=int)
        own = np.concatenate([self.capacitance_f[self.sensors], np.zeros(len(loose) - len(self.sensors))]).astype(
            complex
        )
        if stiffness_n_m is not None:
            own[len(self.sensors) :] = 1.0 / stiffness_n_m + missing_m_n
        flexible = self.flexible(eigenvalue)
        whole = self.receptance(eigenvalue)
        by_mode = self.unit * (flexible[:, None] * self.gains).swapaxes(1, 2)

        def answer(charge: ComplexArray) -> ComplexArray:
            """Loads (t, u, k) that charges and motions (t, l, k) of the loads which are given bring about."""
            return np.asarray(-np.linalg.solve(whole[:, loose[:, None], loose] + np.diag(own), charge[:, loose]))

        def outputs(charge: ComplexArray, loads: ComplexArray) -> ComplexArray:
            moved = charge[:, points] + whole[:, points[:, None], loose] @ loads
            if stiffness_n_m is not None:
                moved = moved + missing_m_n * loads[:, len(self.sensors) :]
            return np.concatenate([moved, loads[:, : len(self.sensors)]], axis=1)

        given, forced = whole[:, :, self.drivers], answer(by_mode)
        loads = answer(given)
        every = np.zeros((*given.shape[:2], len(self.drivers)), dtype=complex)
        every[:, self.drivers, np.arange(len(self.drivers))] = 1.0
        every[:, loose] = loads
        more = self.beyond @ every
        within = flexible[:, None] * (np.eye(len(flexible)) + self.gains[:, :, loose] @ forced)
        return Motions(
            1.0 + 1j * self.loss,
            outputs(given, loads),
            outputs(more, answer(more)),
            outputs(by_mode, forced),
            flexible[:, None] * (self.gains @ every),
            within,
            flexible[None],
        )


Figures = Callable[..., FloatArray]


def peak_half_widths(
    known: Doubts, motions: Callable[[float], list[Motions]], eigenvalue: float, volts: ComplexArray, figures: Figures
) -> FloatArray:
    """Half-widths (f, t) of the bars of figures at a peak that follows its mode, the nearest one.

    Parameters
    ----------
    known : Doubts
    motions : callable
        Of the plate at scaled eigenvalues, free and touched, say; the last one is what changes are made for.
    eigenvalue : float
        Of the peak.
    volts : ndarray, shape (d,)
        Of the drivers.
    figures : callable
        Gives them, (f, t, k, s), from the outputs (t, k, s, m) of each of the motions.
    """
    mode, ends = known.ends(eigenvalue)
    own = motions(eigenvalue)
    every = np.broadcast_to(volts, (len(own[-1].answers), len(volts)))
    alone = [each.fed(every) for each in own]
    nominal = figures(*(each.answers[:, None, None, :, 0] for each in alone))
    squares = np.zeros_like(nominal[..., 0, 0])
    at = np.full(len(every), eigenvalue)
    for change in changes(known, own[-1], at, every, mode):
        squares += (np.abs(figures(*map(change, alone)) - nominal).max(axis=-1) ** 2).sum(axis=-1)
    moved = np.zeros((2, len(every), len(known.value), 1))
    moved[:, :, mode, 0] = known.change[mode][:, None]
    ended = [
        figures(*(each.fed(every).softened(step)[:, mode, None] for each in motions(eigenvalue * end**2)))
        for end, step in zip(ends, moved, strict=True)
    ]
    squares += np.max([np.abs(each - nominal)[..., 0, 0] for each in ended], axis=0) ** 2
    return np.asarray(np.sqrt(squares))
