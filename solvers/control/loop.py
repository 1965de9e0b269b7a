"""One mode in the frame that turns with its drive, the PI loop that controls it there, and that loop run in time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, inf, isfinite, log, pi
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from geometry.elements import BoolArray, ComplexArray, FloatArray
from solvers.errors import SolverError, check_above_zero, checked_frequencies

# -- rotating frame ----------------------------------------------------------------------------------------------------
# One mode in the frame that turns with its drive, the PI that controls it there, and the limits that the drive sets.
# e^{+j omega t}; U = U_d + j U_q is the phasor of velocity (or of a signal that follows it), V that of the drive: 2 M
# dU/dt + (D + 2 j M d) U = N V, d = omega - omega_0, which is tau dU/dt + (1 + j tau d) U = G V.

SETTLED = log(20.0)  # time constants of a first-order answer until 95 %


@dataclass(frozen=True)
class ModePlant:
    """frequency_hz omega_0/2 pi; tau_s = 2 M/D, decay of the amplitude; gain = N/D, signal per drive at resonance."""

    frequency_hz: float
    tau_s: float
    gain: complex

    def __post_init__(self) -> None:
        check_above_zero("mode: frequency in Hz", self.frequency_hz)
        check_above_zero("mode: tau in s", self.tau_s)
        if not (np.isfinite(self.gain) and self.gain != 0.0):
            raise SolverError(f"mode at {self.frequency_hz:g} Hz: gain {self.gain}: must be finite and other than 0")
        if self.omega_rad_s * self.tau_s <= 1.0:
            raise SolverError(
                f"mode at {self.frequency_hz:g} Hz: tau {self.tau_s:g} s leaves no oscillation (Q <= 1/2)"
            )

    @classmethod
    def from_quality_factor(cls, frequency_hz: float, quality_factor: float, gain: complex) -> ModePlant:
        """tau = 2 Q/omega_0. SolverError without losses (Q infinite: resonance has no bound) or for values not above 0."""
        check_above_zero("mode: frequency in Hz", frequency_hz)
        if not (isfinite(quality_factor) and quality_factor > 0.0):
            raise SolverError(
                f"quality factor {quality_factor:g}: must be finite and above 0; a mode without losses has no steady state"
            )
        return cls(frequency_hz, quality_factor / (pi * frequency_hz), gain)

    @property
    def omega_rad_s(self) -> float:
        """omega_0, rad/s."""
        return 2.0 * pi * self.frequency_hz

    @property
    def quality_factor(self) -> float:
        """Q = omega_0 tau/2."""
        return 0.5 * self.omega_rad_s * self.tau_s

    @property
    def bandwidth_rad_s(self) -> float:
        """2/tau = omega_0/Q: between the half-power points, which are also the extremes of U_q."""
        return 2.0 / self.tau_s

    def response(self, omega: ArrayLike) -> ComplexArray:
        """Exact velocity response G/(1 + j tau (omega^2 - omega_0^2)/(2 omega)), shape of omega."""
        return np.asarray(self.gain / (1.0 + 1j * self.tau_s * stretched_detuning(omega, self.omega_rad_s)))


def stretched_detuning(omega: ArrayLike, omega_0: float) -> FloatArray:
    """Compute the detuning (omega^2 - omega_0^2)/(2 omega) for which the circle of U is exact; near resonance omega - omega_0.

    Parameters
    ----------
    omega : array_like, any shape
        Angular frequencies above 0, in rad/s.
    omega_0 : float
        Angular frequency of the mode, in rad/s.

    Returns
    -------
    ndarray, shape of omega
        In rad/s.

    Raises
    ------
    SolverError
        If a frequency is not finite and above 0.
    """
    w = checked_frequencies(omega)
    return np.asarray((w**2 - omega_0**2) / (2.0 * w))


@dataclass(frozen=True)
class Pi:
    """C(s) = K_p + K_i/s on each axis, drive per signal (and per second)."""

    proportional: float
    integral_per_s: float

    def closed_loop(self, plant: ModePlant, omega: ArrayLike) -> tuple[ComplexArray, ComplexArray]:
        """Open-loop L and U/reference of the resonant axis at envelope frequencies omega (rad/s)."""
        s = 1j * np.asarray(omega, dtype=float)
        size = abs(plant.gain)
        loop = (self.proportional + self.integral_per_s / s) * size / (1.0 + plant.tau_s * s)
        return np.asarray(loop), np.asarray(loop / (1.0 + loop))


def pi_gains(plant: ModePlant, response_s: float) -> Pi:
    """Cancel the plant's pole: K_i = 1/(tau_d G), K_p = tau K_i; the loop becomes 1/(tau_d s + 1).

    Parameters
    ----------
    plant : ModePlant
        Mode with time constant tau and gain G.
    response_s : float
        tau_d; 95 % of a step are reached after tau_d ln 20.

    Returns
    -------
    Pi
        Proportional and integral gain.

    Raises
    ------
    SolverError
        If response_s is not above 0.
    """
    check_above_zero("response in s", response_s)
    integral = 1.0 / (response_s * abs(plant.gain))
    return Pi(plant.tau_s * integral, integral)


@dataclass(frozen=True)
class SampledPi:
    """The PI of a step every T, as the firmware plans it, a = e^{-T/tau}, p = e^{-T/tau_d}; bounded: for the neighbours' sake.

    K_p = (1 - p)/((1 - a) G) with the integral (1 - a) K_p a step cancels the plant's pole a and leaves p.
    """

    proportional: float
    integral: float
    bounded: bool


def _sampled_gains(plant: ModePlant, response_s: float, period_s: float, proportional_max: float = inf) -> SampledPi:
    """Gains of the sampled loop that cancels the plant's pole, K_p at most `proportional_max` and at least 0.1/G.

    SolverError for a response or period that is not above 0.
    """
    check_above_zero("response, period in s", response_s, period_s)
    pole, desired = exp(-period_s / plant.tau_s), exp(-period_s / response_s)
    size = abs(plant.gain)
    proportional = (1.0 - desired) / ((1.0 - pole) * size)
    bounded = max(min(proportional, proportional_max), 0.1 / size)
    return SampledPi(bounded, (1.0 - pole) * bounded, bounded < proportional)


@dataclass(frozen=True)
class Feasibility:
    """Drive that an amplitude needs: to hold it, and at the peak while rising with tau_d; both in units of the drive.

    share: of the amplitude at full drive; feasible: the drive never meets its limit; largest_reference: up to where tau_d is
    kept; least_time_s: to 95 % at full drive, inf beyond what can be held.
    """

    share: float
    reference: float
    steady_drive: float
    peak_drive: float
    feasible: bool
    largest_reference: float
    least_time_s: float


def feasibility(
    plant: ModePlant, reference: float, response_s: float, drive_limit: float, detuning_rad_s: float = 0.0
) -> Feasibility:
    """Compute the drive for U = r (1 - e^{-t/tau_d}): |V| = |tau U' + (1 + j tau d) U|/G, largest at one of its ends.

    At full drive |U| can rise as G V (1 - e^{-t/tau}) whatever the detuning, because the drive may turn with the mode.
    95 % then take -tau ln(1 - 0.95 r/(G V)).

    Parameters
    ----------
    plant : ModePlant
        Mode with time constant tau and gain G.
    reference : float
        Amplitude r, in the unit of U.
    response_s : float
        Time constant tau_d of the closed loop.
    drive_limit : float
        Largest drive, in the unit of V.
    detuning_rad_s : float, optional
        Detuning d of the drive, in rad/s.

    Returns
    -------
    Feasibility
        Steady and peak drive, whether they are within the limit, and the shortest time to 95 %.

    Raises
    ------
    SolverError
        If reference, response or limit is not above 0.
    """
    check_above_zero("reference, response, drive limit", reference, response_s, drive_limit)
    size = abs(plant.gain)
    detuned = abs(1.0 + 1j * plant.tau_s * detuning_rad_s)
    peak = max(plant.tau_s / response_s, detuned)
    reach = size * drive_limit
    within = reference * detuned <= reach
    return Feasibility(
        share=reference / reach,
        reference=reference,
        steady_drive=detuned * reference / size,
        peak_drive=peak * reference / size,
        feasible=peak * reference / size <= drive_limit,
        largest_reference=reach / peak,
        least_time_s=-plant.tau_s * log(1.0 - 0.95 * reference / reach) if within else inf,
    )


# -- loop in time ------------------------------------------------------------------------------------------------------
# The dq loop in time at the firmware's own rates: samples, windows, converters, delay, limit, neighbouring modes.
# Time is cut into periods of `period` samples. A slow step at a period's end fits the window's tone and answers; its
# drive acts `gap` samples later, and the next window begins there. e^{+j omega t}; signals and drives are shares of
# full scale.

AntiWindup = Literal["match", "freeze", "none"]
NEIGHBOUR_LOOP = 0.5  # loop gain that a mode next to the target mode may have, whatever its phase
LEAVING_S = 0.2e-3  # the loop's time constant on the way out of the drive's limit: about a period
LIMITED = 2  # and one less per period, until the end of the limit shows in the measurement


@dataclass(frozen=True)
class Rates:
    """sample_rate_hz; samples in a period and in the gap at its beginning; bits of both converters, 0 for ideal ones."""

    sample_rate_hz: float = 250e3
    period: int = 50
    gap: int = 4
    bits: int = 12

    def __post_init__(self) -> None:
        if not (isfinite(self.sample_rate_hz) and self.sample_rate_hz > 0.0 and 0 < self.gap < self.period - 8):
            raise SolverError(f"{self}: the sample rate must be above 0, the window at least 8 samples")

    @property
    def period_s(self) -> float:
        """Time between two slow steps, s."""
        return self.period / self.sample_rate_hz

    @property
    def ahead_s(self) -> float:
        """Time from the middle of a window to its answer, s."""
        return ((self.period - self.gap) / 2.0 + self.gap) / self.sample_rate_hz


@dataclass(frozen=True)
class Setup:
    """Simulated system: the plate, the controller's model of it, and the imperfections between them.

    modes: the plate's, velocity response from drive to signal (complex gains allowed); the first is controlled.
    known: the controller's copy, None for the truth; detuning_hz: of the drive from the known frequency. delay_s: dead time
    beyond the hold; known_delay_s: the part of it and of the hold's half sample that the controller compensates, None: all.
    """

    modes: tuple[ModePlant, ...]
    known: ModePlant | None = None
    detuning_hz: float = 0.0
    response_s: float = 0.53e-3
    drive_limit: float = 1.0
    delay_s: float = 0.0
    known_delay_s: float | None = None
    noise: float = 0.0
    offset: float = 0.0
    anti_windup: AntiWindup = "match"
    rates: Rates = Rates()
    seed: int = 1

    def __post_init__(self) -> None:
        if not self.modes:
            raise SolverError("a loop needs at least one mode")
        top = 0.45 * self.rates.sample_rate_hz
        if not all(mode.frequency_hz < top for mode in (*self.modes, self.model)):
            raise SolverError(f"modes must lie below {top:g} Hz, 0.45 of the sample rate")
        if not (0.0 < self.response_s < inf and self.drive_limit > 0.0 and 0.0 <= self.delay_s < inf):
            raise SolverError("response time and drive limit must be above 0, the delay 0 or more")
        if self.anti_windup not in ("match", "freeze", "none"):
            raise SolverError(f"anti-windup {self.anti_windup!r}: must be match, freeze or none")

    @property
    def model(self) -> ModePlant:
        """The controller's model of the plate."""
        return self.known if self.known is not None else self.modes[0]

    @property
    def gains(self) -> SampledPi:
        """K_p and its integral, bounded by the strongest neighbour."""
        others = [abs(mode.gain) for mode in self.modes[1:]]
        bound = NEIGHBOUR_LOOP / max(others) if others else inf
        return _sampled_gains(self.model, self.response_s, self.rates.period_s, bound)

    @property
    def leaving(self) -> SampledPi:
        """Gains on the way out of the drive's limit, which ends when one period is about enough to arrive."""
        return replace(self, response_s=min(LEAVING_S, self.response_s)).gains

    @property
    def omega_rad_s(self) -> float:
        """Angular frequency of the drive, rad/s."""
        return 2.0 * pi * (self.model.frequency_hz + self.detuning_hz)


@dataclass(frozen=True)
class Trace:
    """One value per period, shape (n,): time of the window's middle, s, reference, measured phasor in the mode's frame, drive.

    limited: where the drive met its limit.
    """

    time_s: FloatArray
    reference: FloatArray
    measured: ComplexArray
    drive: ComplexArray
    limited: BoolArray

    def reached_s(self, share: float = 0.95) -> float:
        """First time at which |U| is `share` of the last reference, between windows by interpolation; inf if never."""
        size, desired = np.abs(self.measured), share * abs(self.reference[-1])
        above = np.flatnonzero(size >= desired)
        if above.size == 0:
            return inf
        i = int(above[0])
        if i == 0:
            return float(self.time_s[0])
        part = (desired - size[i - 1]) / (size[i] - size[i - 1])
        return float(self.time_s[i - 1] + part * (self.time_s[i] - self.time_s[i - 1]))

    def settled_s(self, band: float = 0.05) -> float:
        """Time from which U stays within `band` of the last reference; inf if it does not at the end."""
        off = np.abs(self.measured - self.reference[-1]) > band * abs(self.reference[-1])
        if off[-1]:
            return inf
        late = np.flatnonzero(off)
        return float(self.time_s[late[-1] + 1]) if late.size else float(self.time_s[0])

    def overshoot(self) -> float:
        """Largest |U| over the last reference, minus 1, never below 0."""
        return max(float(np.abs(self.measured).max() / abs(self.reference[-1])) - 1.0, 0.0)


def step_response(setup: Setup, reference: float, seconds: float = 20e-3) -> Trace:
    """Simulate a step from rest to a reference at time 0, right after a slow step, the worst moment.

    Parameters
    ----------
    setup : Setup
        Plate, controller and rates.
    reference : float
        Amplitude, in the unit of the sensor.
    seconds : float, optional
        Simulated time, in s.

    Returns
    -------
    Trace
        Phasors and drives, one per period.

    Raises
    ------
    SolverError
        If the reference is not above 0.
    """
    check_above_zero("reference", reference)
    periods = max(round(seconds / setup.rates.period_s), 1)
    return run(setup, np.full(periods, reference))


def run(setup: Setup, references: FloatArray) -> Trace:
    """Simulate the loop from rest, with one reference per period.

    Parameters
    ----------
    setup : Setup
        Plate, controller and rates.
    references : ndarray, shape (periods,)
        Amplitudes, in the unit of the sensor.

    Returns
    -------
    Trace
        Times in s, references, measured phasors, drives and whether they are limited, (periods,) each.
    """
    plate, control = Plate(setup), Controller(setup)
    start = (setup.rates.gap + (setup.rates.period - setup.rates.gap - 1) / 2.0) / setup.rates.sample_rate_hz
    measured, drives, limited = [], [], []
    command, acting = 0j, 0j
    for reference in references:
        samples = plate.period(acting, command)
        acting = command
        phasor = control.fit(samples)
        measured.append(phasor)
        command, at_limit = control.step(phasor, float(reference))
        drives.append(control.drive)
        limited.append(at_limit)
    time = np.arange(len(references), dtype=np.float64) * setup.rates.period_s + start
    return Trace(time, np.asarray(references, dtype=float), np.array(measured), np.array(drives), np.array(limited))


class Plate:
    """The modes between two converters: each state z' = p z + u exactly, u held between samples and delayed.

    The signal is Re(r z), r = 2 G (2/tau) p/(p - p*), which answers G to a drive at omega_0.
    """

    def __init__(self, setup: Setup) -> None:
        rates = setup.rates
        ts = 1.0 / rates.sample_rate_hz
        poles = np.array([-1.0 / m.tau_s + 1j * np.sqrt(m.omega_rad_s**2 - m.tau_s**-2) for m in setup.modes])
        whole, part = divmod(setup.delay_s / ts, 1.0)
        hold = (np.exp(poles * (1.0 - part) * ts) - 1.0) / poles
        self.decay = np.exp(poles * ts)
        self.push = np.stack([hold, (self.decay - 1.0) / poles - hold], axis=1)
        self.residue = [4.0 * m.gain / m.tau_s * p / (p - np.conj(p)) for m, p in zip(setup.modes, poles, strict=True)]
        self.state = np.zeros(len(poles), dtype=complex)
        self.line = np.zeros(int(whole) + 2)  # levels that are on their way, the code of the last sample among them
        self.phase, self.turn = 0.0, setup.omega_rad_s * ts
        self.setup, self.random = setup, np.random.default_rng(setup.seed)

    def period(self, acting: complex, command: complex) -> FloatArray:
        """The window's samples of one period in which `command` takes over from `acting` after the gap."""
        from scipy.signal import lfilter  # slow to import

        rates = self.setup.rates
        n = np.arange(rates.period)
        carrier = np.exp(1j * (self.phase + self.turn * n))
        levels = _converted(np.where(n < rates.gap, acting * carrier, command * carrier).real, rates.bits, False)
        in_transit = np.concatenate([self.line, levels])
        new, old = in_transit[1 : rates.period + 1], in_transit[: rates.period]
        signal = np.full(rates.period, self.setup.offset)
        for i, (decay, (now, before)) in enumerate(zip(self.decay, self.push, strict=True)):
            drive = now * new + before * old
            path = lfilter([1.0], [1.0, -decay], drive, zi=[decay * self.state[i]])[0]
            states = np.concatenate([[self.state[i]], path[:-1]])
            self.state[i] = path[-1]
            signal += (self.residue[i] * states).real
        self.line = in_transit[rates.period :]
        self.phase = (self.phase + self.turn * rates.period) % (2.0 * pi)
        if self.setup.noise:
            signal += self.random.normal(scale=self.setup.noise, size=signal.size)
        return _converted(signal, rates.bits, True)[rates.gap :]


class Controller:
    """The slow step: three-parameter fit of the tone, the PI with its model carried on to where the answer acts."""

    def __init__(self, setup: Setup) -> None:
        rates, model, gains = setup.rates, setup.model, setup.gains
        self.setup, self.gains, self.size = setup, gains, abs(model.gain)
        detuning = 2.0 * pi * setup.detuning_hz
        leaves = setup.leaving if setup.anti_windup == "match" else gains
        self.proportional = np.array([gains.proportional, leaves.proportional])
        feedback = self.proportional - 1j * detuning * model.tau_s / self.size
        decay = np.exp(-(1.0 / model.tau_s + 1j * detuning) * rates.ahead_s)
        steady = self.size / (1.0 + 1j * detuning * model.tau_s)
        self.states, self.feeds = feedback * decay, feedback * steady * (1.0 - decay)
        known = setup.known_delay_s
        late = setup.delay_s + 0.5 / rates.sample_rate_hz if known is None else known
        turn = setup.omega_rad_s / rates.sample_rate_hz
        self.lead = np.exp(1j * (turn + setup.omega_rad_s * late)) * np.conj(model.gain) / self.size
        n = np.arange(rates.gap, rates.period)
        tone = np.stack([np.cos(turn * n), -np.sin(turn * n), np.ones(n.size)], axis=1)
        self.fitting = np.linalg.pinv(tone)
        self.advance, self.phase = np.exp(-1j * turn * rates.period), 1.0 + 0.0j
        self.age = rates.ahead_s / rates.period_s
        self.integral, self.drive, self.last, self.limited = 0j, 0j, 0.0, 0

    def fit(self, samples: FloatArray) -> complex:
        """a + j b of a cos - b sin + c over the window, exact at any frequency, turned to the drive's phase."""
        a, b, _ = self.fitting @ samples
        phasor = complex(a, b) * self.phase
        self.phase *= self.advance
        return complex(phasor)

    def step(self, measured: complex, reference: float) -> tuple[complex, bool]:
        """The next drive, turned ahead for delay and the gain's phase, and whether it met its limit."""
        law = int(self.limited == LIMITED)
        predicted = self.states[law] * measured + self.feeds[law] * self.drive
        drive = complex(self.integral + self.proportional[law] * reference - predicted)
        limited = abs(drive) > self.setup.drive_limit
        matched = self.setup.anti_windup == "match" and (limited or self.limited > 0)
        self.limited = LIMITED if limited else max(self.limited - 1, 0)
        if limited:
            drive *= self.setup.drive_limit / abs(drive)
        if matched:  # as if the loop had just started from here
            self.integral = measured / self.size
        elif not (limited and self.setup.anti_windup == "freeze"):
            then = reference - self.age * (reference - self.last)
            self.integral += self.gains.integral * (then - measured)
        self.drive, self.last = drive, reference
        return drive * self.lead, limited


def _converted(level: FloatArray, bits: int, inwards: bool) -> FloatArray:
    """The level of the nearest code up to 2^(b-1) - 1: the DAC's full scale, one less than that of the ADC (inwards)."""
    if bits == 0:
        return level
    top = 2.0 ** (bits - 1) - 1.0
    full = top + inwards
    return np.asarray(np.clip(np.round(level * full), -full, top) / full)
