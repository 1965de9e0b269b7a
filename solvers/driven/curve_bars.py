"""Error bars of a driven plate's response at many frequencies, from one solve: on its faces and under contacts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray, IntArray
from solvers.driven.forms import Forms, coupled_rows, forms, softened_rows
from solvers.piezo.forced import ForcedPlate, GroupModes
from solvers.piezo.responses import frequency_errors, load_errors

# -- quadratic forms ---------------------------------------------------------------------------------------------------
# Error bars of a driven plate's response at many frequencies, from one solve: quadratic forms on plates within its bars.
# Independent sources of error, whose worst changes are added by squares:
#
# * the frequency of each mode, within its bar: at its ends, where the resonance comes nearest to the tone, and half-way there;
# * the stiffness that couples the mode nearest to a frequency with each other one of its group, as `error_bars` has it;
# * the load of each mode: the errors of its patches have one origin and add up by size;
# * the load of each driver, and of all of them, on all modes; the part beyond the modes, as uncertain as the least known mode.

Change = Callable[[Any], ComplexArray]  # of Forms, or of Motions at as many frequencies
SIGNS = np.array([-1.0, 1.0])
AT_ONCE = 16  # tones
ROUNDING = 1e-9  # of the largest sum that amplitudes could give: less counts as no motion


@dataclass(frozen=True, eq=False)
class Doubts:
    """Uncertainties of a plate's n modes: eigenvalues value (n,), their lowest and highest change (n, 2), relative
    errors of the frequencies (n,); errors of the drivers' loads (n, d), and of all of those of a driver, relative, (d,).

    group (n,): number of each mode's group; share: of the bound on mixing that is expected; beyond: relative error of the part
    beyond the modes.
    """

    value: FloatArray
    change: FloatArray
    frequency: FloatArray
    load: FloatArray
    driver: FloatArray
    group: IntArray
    share: float
    beyond: float

    def nearest(self, eigenvalue: FloatArray) -> IntArray:
        """The modes nearest in frequency to scaled eigenvalues (t,), (t,)."""
        return np.asarray(np.abs(np.sqrt(self.value) - np.sqrt(eigenvalue)[:, None]).argmin(axis=1))

    def ends(self, eigenvalue: float) -> tuple[int, FloatArray]:
        """The mode nearest to a frequency, and factors (2,) on its frequency at the ends of its bar."""
        mode = int(self.nearest(np.array([eigenvalue]))[0])
        return mode, np.sqrt(1.0 + self.change[mode] / self.value[mode])

    def at_ends(self, mode: int) -> FloatArray:
        """Changes (2, n, 1) of one mode's stiffness to either end, one at each of two tones."""
        out = np.zeros((2, len(self.value), 1))
        out[:, mode, 0] = self.change[mode]
        return out


def doubts(forced: ForcedPlate, share: float | None, modes: list[GroupModes] | None = None) -> Doubts | None:
    """Collect the uncertainties of a driven plate.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    share : float or None
        Expected fraction of the bound on the mixing of modes; None without a calibration.
    modes : list of GroupModes, optional
        More modes than those that the patches drive, such as all under a finger.

    Returns
    -------
    Doubts or None
        None if a part of them is unknown.
    """
    modes = forced.modes if modes is None else modes
    frequency = np.concatenate([frequency_errors(basis).total for basis in modes])
    loads = [load_errors(basis) for basis in modes]
    if share is None or not len(frequency):
        return None
    load, gain = np.concatenate(loads), np.concatenate([basis.gain for basis in modes])
    if not (np.isfinite(frequency).all() and np.isfinite(load).all()):
        return None
    value = np.concatenate([basis.eigenvalue for basis in modes])
    opened, drivers = forced.sensors, forced.drivers
    capacitance = forced.plate.capacitance_f[opened] / forced.plate.stiffness_unit
    heard = (2.0 * np.abs(gain[:, opened]) * load[:, opened] / capacitance).sum(axis=1)
    ends = value[:, None] * ((1.0 + SIGNS * np.minimum(frequency, 0.5)[:, None]) ** 2 - 1.0) + SIGNS * heard[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):  # a driver that moves no mode has no relative error
        driver = np.linalg.norm(load[:, drivers], axis=0) / np.linalg.norm(gain[:, drivers], axis=0)
    group = np.repeat(np.arange(len(modes)), [len(basis.eigenvalue) for basis in modes])
    beyond = 2.0 * float(frequency.max()) + float(driver.max())
    return Doubts(value, ends, frequency, load[:, drivers], driver, group, share, beyond)


def changes(
    known: Doubts, forms: Forms | Motions, eigenvalue: FloatArray, volts: ComplexArray, still: int | None = None
) -> Iterator[Change]:
    """Yield the changes that each source of error allows: forms S (k, t, m, s, d, d) of m sources with s plates each.

    Parameters
    ----------
    known : Doubts
        Uncertainties of the plate.
    forms : Forms or Motions
        At the frequencies; the changes also apply to forms at as many other frequencies.
    eigenvalue : ndarray, shape (t,)
        Scaled eigenvalues of the frequencies.
    volts : ndarray, shape (t, d)
        Drivers' voltages in V, in whose phases the loads on a mode add up.
    still : int, optional
        Number of a mode that keeps its frequency.

    Yields
    ------
    callable
        Maps forms to the changed forms of one kind of source.
    """
    softer = forms.lossy * forms.own
    nearest = np.clip(-softer.real / np.abs(softer) ** 2, *known.change.T)
    ends = [np.broadcast_to(end, nearest.shape) for end in known.change.T]
    between = [
        0.5 * (end + nearest) for end in ends
    ]  # for figures of several frequencies, whose worst case lies elsewhere
    moved = np.stack([*ends, nearest, *between], axis=-1)
    if still is not None:
        moved[:, still] = 0.0
    yield lambda each: each.softened(moved)
    mode = known.nearest(eigenvalue)
    coupling = _coupling(known, mode)
    yield lambda each: each.coupled(mode, coupling)
    rows = known.load[:, None] * SIGNS[:, None] * _turned(forms, volts)[:, :, None]
    yield lambda each: each.forced(rows)
    yield lambda each: each.rest(known.beyond * SIGNS)
    yield lambda each: each.louder(1.0 + SIGNS[:, None] * _louder(known)[:, None])


def _coupling(known: Doubts, mode: IntArray) -> FloatArray:
    """Stiffness that couples one mode per frequency (t,) with each other one of its group, (t, n, 2)."""
    error = np.maximum(known.frequency, known.frequency[mode][:, None])
    size = 2.0 * known.share * error * np.sqrt(np.maximum(known.value * known.value[mode][:, None], 0.0))
    others = (known.group == known.group[mode][:, None]) & (np.arange(len(known.value)) != mode[:, None])
    return np.asarray(np.where(others, size, 0.0)[..., None] * SIGNS)


def _turned(forms: Forms | Motions, volts: ComplexArray) -> ComplexArray:
    """Phases (t, n, d) with which errors of the drivers' loads on a mode add up, and the motion that moves it."""
    flexible = forms.flexible[..., None]
    moving, most = (forms.modal @ volts[..., None]) / flexible, np.abs(forms.modal) @ np.abs(volts)[..., None]
    fed = np.abs(volts).max(axis=-1, keepdims=True)
    return np.asarray(_phase(moving, most / np.abs(flexible)) * _phase(volts, fed).conj()[:, None])


def _phase(values: ComplexArray, most: FloatArray) -> ComplexArray:
    """values / |values|; 1 where only rounding is left of values that might be as large as `most`."""
    size = np.abs(values)
    has_one = size > ROUNDING * most
    return np.asarray(np.where(has_one, values, 1.0 + 0.0j) / np.where(has_one, size, 1.0), dtype=complex)


def _louder(known: Doubts) -> FloatArray:
    """Relative errors (m, d) of the drivers' loads: of all alike, and of each alone."""
    every = np.full((1, len(known.driver)), known.driver.max())
    return every if len(known.driver) == 1 else np.concatenate([every, np.diag(known.driver)])


def half_widths(
    nominal: FloatArray, sources: Iterator[Change], forms: Sequence[Forms | Motions], figures: Callable[..., FloatArray]
) -> FloatArray:
    """Combine the changes of figures by all sources, as the root of the sum of their squares.

    Parameters
    ----------
    nominal : ndarray, shape (f, t)
        The figures, in any units.
    sources : iterator of callable
        As from `changes`.
    forms : sequence of Forms or Motions
        What the figures are computed from.
    figures : callable
        Computes figures (f, t, m, s) from the changed S (k, t, m, s, d, d) of each of `forms`.

    Returns
    -------
    ndarray, shape (f, t)
        Half-widths of the error bars, in the units of the figures.
    """
    squares = np.zeros_like(nominal)
    for source in sources:
        changed = figures(*(source(each) for each in forms))
        squares += (np.abs(changed - nominal[..., None, None]).max(axis=-1) ** 2).sum(axis=-1)
    return np.asarray(np.sqrt(squares))


def rms_bars(
    known: Doubts, forced: ForcedPlate, grams: FloatArray, frequency_hz: FloatArray, volts: ComplexArray
) -> FloatArray:
    """Compute the error bars of the rms of u_z over parts of the plate.

    Parameters
    ----------
    known : Doubts
        Uncertainties of the plate.
    forced : ForcedPlate
        The plate with its modes.
    grams : ndarray, shape (k, columns, columns)
        Means over the k parts, as for `forms`.
    frequency_hz : ndarray, shape (t,)
        Frequencies of the drive.
    volts : ndarray, shape (f, d)
        Voltages of the drivers, f ways to drive them.

    Returns
    -------
    ndarray, shape (f, k, t)
        Half-widths, in the unit of the rms.
    """

    def bars(part: FloatArray) -> FloatArray:
        own, at = forms(forced, grams, part), forced.plate.scale.eigenvalue(part)
        out = []
        for fed in volts:
            each = np.broadcast_to(fed, (len(part), len(fed)))
            alone = own.fed(each)
            out.append(half_widths(rms(alone.squares), changes(known, own, at, each), [alone], rms))
        return np.array(out)

    return in_parts(bars, frequency_hz)


def rms(squares: ComplexArray) -> FloatArray:
    """Take the rms from the forms of one voltage.

    Parameters
    ----------
    squares : ndarray, shape (k, ..., 1, 1)
        Mean squares.

    Returns
    -------
    ndarray, shape (k, ...)
        Their roots; 0 where rounding made a square negative.
    """
    return np.asarray(np.sqrt(np.maximum(squares[..., 0, 0].real, 0.0)))


def with_peak(
    known: Doubts, forced: ForcedPlate, grams: FloatArray, peak_hz: float, volts: ComplexArray,
    figures: Callable[[ComplexArray], FloatArray],
) -> FloatArray:  # fmt: skip
    """Compute the error bars of figures at a peak that follows the mode nearest to it.

    Parameters
    ----------
    known : Doubts
        Uncertainties of the plate.
    forced : ForcedPlate
        The plate with its modes.
    grams : ndarray, shape (k, columns, columns)
        Means over the k parts, as for `forms`.
    peak_hz : float
        Frequency of the peak.
    volts : ndarray, shape (d,)
        Voltages of the drivers, in V.
    figures : callable
        Computes figures (f, ...) from S (k, ..., 1, 1).

    Returns
    -------
    ndarray, shape (f,)
        Half-widths, in the units of the figures.
    """
    at = forced.plate.scale.eigenvalue(peak_hz)
    mode, ends = known.ends(at)
    own = forms(forced, grams, peak_hz * np.array([1.0, *ends]))
    first = own.at(slice(0, 1))
    alone = first.fed(volts[None])
    nominal = figures(alone.squares)
    half = half_widths(nominal, changes(known, first, np.array([at]), volts[None], mode), [alone], figures)[:, 0]
    last = own.at(slice(1, 3)).fed(np.broadcast_to(volts, (2, len(volts))))
    ended = last.softened(known.at_ends(mode))[:, :, mode, 0]
    return np.hypot(half, np.abs(figures(ended) - nominal).max(axis=1))


def in_parts(bars: Callable[[FloatArray], FloatArray], frequency_hz: FloatArray) -> FloatArray:
    """Evaluate a function at frequencies a few at a time, which bounds its memory.

    Parameters
    ----------
    bars : callable
        Maps frequencies (m,) in Hz to values (..., m).
    frequency_hz : ndarray, shape (n,)
        All frequencies.

    Returns
    -------
    ndarray, shape (..., n)
        The values.
    """
    parts = np.array_split(frequency_hz, -(-len(frequency_hz) // AT_ONCE))
    return np.concatenate([bars(part) for part in parts], axis=-1)


# -- motions under contacts --------------------------------------------------------------------------------------------
# Motions of a driven plate at places where something presses on it, and those of plates like it, as `forms` gives their
# squares.
# Loads L are voltages of patches and forces at the points of a contact. R = G' f G + R0 gives charges and motions,
# with gains G and flexibilities f of the modes, and R0 of the part beyond them. Open patches carry no charge, and a
# contact of stiffness D bears the force -D u: S L_u = -R L_fed with S = R + diag(C, 1/D) of these loads. What a force
# on a mode moves, and how it moves the modes, then is
#
#     y_r = f_r (G' - R S^-1 G'_u) e_r,  f_ij = f_i (delta_ij - G_i S^-1 G'_j f_j).


@dataclass(frozen=True, eq=False)
class Motions:
    """Outputs (t, m, d) of a plate at t places per drive, their part beyond the modes, and those of a force on a mode.

    answers, rest (t, m, d); moved (t, m, n); modal (t, n, d): motion of the modes; within (t, n, n): f_ij; flexible (1, n).
    drivers, volts (t, d): those of each driver, and the drivers' voltages if d = 1 stands for all together.
    """

    lossy: ComplexArray
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
        """Motions with a single voltage, which feeds the drivers by (t, d)."""
        parts = {name: getattr(self, name) @ volts[..., None] for name in ("answers", "rest_only", "modal")}
        return replace(self, **parts, drivers=self, volts=volts)

    def softened(self, change: FloatArray) -> ComplexArray:
        """Outputs with the stiffness of each mode changed by (t, n, s): (t, n, s, m), as fed."""
        return self._forced(softened_rows(np.asarray(self.lossy[:, None] * change), self.own, self.modal)[..., 0])

    def coupled(self, mode: IntArray, change: FloatArray) -> ComplexArray:
        """Outputs with one mode per place (t,) coupled to each other one by a stiffness (t, n, s), 0 to itself."""
        at = np.arange(len(mode))
        rows = coupled_rows(
            np.asarray(self.lossy[:, None] * change), self.own, self.modal, mode, self.within[at, mode]
        )[..., 0]
        first = rows[..., 0][..., None] * self.moved[at, :, mode][:, None, None]
        return self._forced(rows[..., 1]) + first

    def forced(self, rows: ComplexArray) -> ComplexArray:
        """Outputs with a further force on each mode, (t, n, s, drivers) per volt."""
        assert self.volts is not None
        return self._forced((rows @ self.volts[:, None, :, None])[..., 0])

    def rest(self, share: FloatArray) -> ComplexArray:
        """Outputs with the part beyond the modes larger by shares (s,), to first order: (t, 1, s, m)."""
        return np.asarray(self._plain + share[:, None] * self.rest_only[:, None, None, :, 0])

    def louder(self, factor: FloatArray) -> ComplexArray:
        """Outputs with the drivers' answers times factors (k, s, d): (t, k, s, m)."""
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

    beyond (t, l, l): part of the receptance beyond the modes; gains (t, n, l) and scaled eigenvalues value (n,) of the modes;
    unit: N/m of one of stiffness. capacitance_f (patches,); drivers, sensors: by number among the patches, the first loads.
    """

    beyond: ComplexArray
    gains: FloatArray
    value: FloatArray
    loss: FloatArray
    unit: float
    capacitance_f: FloatArray
    drivers: list[int]
    sensors: list[int]

    @classmethod
    def of(cls, receptance: ComplexArray, eigenvalue: float, **plate: Any) -> Contacts:
        """Contacts from receptances (t, l, l) at an eigenvalue."""
        modal = cls(np.zeros_like(receptance), **plate).receptance(eigenvalue)
        return cls(np.asarray(receptance - modal), **plate)

    def receptance(self, eigenvalue: float) -> ComplexArray:
        """Charges and motions per volt and newton, (t, l, l)."""
        modal = (self.gains.swapaxes(1, 2) * self.flexible(eigenvalue)) @ self.gains
        return np.asarray(self.beyond + self.unit * modal)

    def flexible(self, eigenvalue: float) -> ComplexArray:
        """Flexibilities of the modes, (n,)."""
        return np.asarray(1.0 / (self.value * (1.0 + 1j * self.loss) - eigenvalue))

    def answers(
        self, eigenvalue: float, stiffness_n_m: complex | None = None, missing_m_n: float = 0.0
    ) -> ComplexArray:
        """Motions of the contact's points per volt of a driver, then voltages of the sensors, (t, m, d), as in `motions`."""
        pressed = _Pressed.of(self, eigenvalue, stiffness_n_m, missing_m_n)
        given = pressed.receptance[:, :, self.drivers]
        return pressed.outputs(given, pressed.loads(given))

    def motions(self, eigenvalue: float, stiffness_n_m: complex | None = None, missing_m_n: float = 0.0) -> Motions:
        """Motions of the contact's points, then voltages of the sensors, (t, m, d); without a stiffness nothing presses.

        missing_m_n: flexibility of every point in addition to the plate's.
        """
        pressed = _Pressed.of(self, eigenvalue, stiffness_n_m, missing_m_n)
        flexible = self.flexible(eigenvalue)
        by_mode = self.unit * (flexible[:, None] * self.gains).swapaxes(1, 2)
        given, forced = pressed.receptance[:, :, self.drivers], pressed.loads(by_mode)
        loads = pressed.loads(given)
        every = np.zeros((*given.shape[:2], len(self.drivers)), dtype=complex)
        every[:, self.drivers, np.arange(len(self.drivers))] = 1.0
        every[:, pressed.loose] = loads
        more = self.beyond @ every
        within = flexible[:, None] * (np.eye(len(flexible)) + self.gains[:, :, pressed.loose] @ forced)
        return Motions(
            np.asarray(1.0 + 1j * self.loss),
            pressed.outputs(given, loads),
            pressed.outputs(more, pressed.loads(more)),
            pressed.outputs(by_mode, forced),
            flexible[:, None] * (self.gains @ every),
            within,
            flexible[None],
        )


@dataclass(frozen=True, eq=False)
class _Pressed:
    """Contacts at one eigenvalue under a finger: the loads that follow are those of the sensors, then of the pressed points.

    loose: those loads by number; own: their own flexibilities, those of the circuits and of the finger.
    """

    receptance: ComplexArray
    loose: IntArray
    own: ComplexArray
    points: IntArray
    sensors: int
    missing_m_n: float

    @classmethod
    def of(cls, contacts: Contacts, eigenvalue: float, stiffness_n_m: complex | None, missing_m_n: float) -> _Pressed:
        """The contacts pressed by a stiffness; by nothing without one."""
        points = np.arange(len(contacts.capacitance_f), contacts.gains.shape[-1])
        pressed = points[: 0 if stiffness_n_m is None else None]
        own = contacts.capacitance_f[contacts.sensors].astype(complex)
        if stiffness_n_m is not None:
            own = np.append(own, np.full(len(points), 1.0 / stiffness_n_m + missing_m_n))
        loose = np.array([*contacts.sensors, *pressed], dtype=int)
        return cls(contacts.receptance(eigenvalue), loose, own, points, len(contacts.sensors), missing_m_n)

    def loads(self, charge: ComplexArray) -> ComplexArray:
        """Loads (t, u, k) that charges and motions (t, l, k) of the loads which are given bring about."""
        among = self.receptance[:, self.loose[:, None], self.loose]
        return np.asarray(-np.linalg.solve(among + np.diag(self.own), charge[:, self.loose]))

    def outputs(self, charge: ComplexArray, loads: ComplexArray) -> ComplexArray:
        """Motions of the points, then voltages of the sensors, (t, m, k)."""
        moved = charge[:, self.points] + self.receptance[:, self.points[:, None], self.loose] @ loads
        if len(self.loose) > self.sensors:
            moved = moved + self.missing_m_n * loads[:, self.sensors :]
        return np.concatenate([moved, loads[:, : self.sensors]], axis=1)


Figures = Callable[..., FloatArray]


def peak_half_widths(
    known: Doubts, motions: Callable[[float], list[Motions]], eigenvalue: float, volts: ComplexArray, figures: Figures
) -> FloatArray:
    """Compute the error bars of figures of motions at a peak that follows the mode nearest to it.

    Parameters
    ----------
    known : Doubts
        Uncertainties of the plate.
    motions : callable
        Motions at a scaled eigenvalue, such as those of the free and of the touched plate; changes apply to the
        last.
    eigenvalue : float
        Scaled eigenvalue of the peak.
    volts : ndarray, shape (d,)
        Voltages of the drivers, in V.
    figures : callable
        Computes figures (f, t, k, s) from the outputs (t, k, s, m) of each of the motions.

    Returns
    -------
    ndarray, shape (f, t)
        Half-widths, in the units of the figures.
    """
    mode, ends = known.ends(eigenvalue)
    own = motions(eigenvalue)
    every = np.broadcast_to(volts, (len(own[-1].answers), len(volts)))
    alone = [each.fed(every) for each in own]
    nominal = figures(*(each.answers[:, None, None, :, 0] for each in alone))[..., 0, 0]
    sources = changes(known, own[-1], np.full(len(every), eigenvalue), every, mode)
    half = half_widths(nominal, sources, alone, figures)
    moved = np.zeros((2, len(every), len(known.value), 1))
    moved[:, :, mode, 0] = known.change[mode][:, None]
    ended = [
        figures(*(each.fed(every).softened(step)[:, mode, None] for each in motions(eigenvalue * end**2)))
        for end, step in zip(ends, moved, strict=True)
    ]
    return np.hypot(half, np.max([np.abs(each[..., 0, 0] - nominal) for each in ended], axis=0))
