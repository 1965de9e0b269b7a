"""The amplitude loop of one mode designed: poles and margins of the sampled loop, feasibility, response at firmware's rates."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import exp, inf, isfinite, pi
from typing import Any, get_args

import numpy as np
from scipy.optimize import brentq

from geometry.elements import ComplexArray, FloatArray
from solvers.analytic.beams import roots_along
from solvers.control.identification import Identified, Sensor, Sweep, identify, noisy, sweep_of
from solvers.control.loop import (
    SETTLED,
    AntiWindup,
    Controller,
    Feasibility,
    ModePlant,
    Pi,
    Rates,
    SampledPi,
    Setup,
    Trace,
    feasibility,
    pi_gains,
    step_response,
)
from solvers.errors import SolverError

# -- margins -----------------------------------------------------------------------------------------------------------
# Poles and margins of the sampled dq loop, exact for the envelope model, with the phase and gain errors of the
# carrier that it tolerates.
# z = e^{j Omega T} at the slow step's rate. The loop is complex when detuned: both signs of Omega are looked at.

POINTS = 8000


@dataclass(frozen=True)
class SampledLoop:
    """Return ratio L at the plant's input and U/reference over envelope frequencies Omega (n,), rad/s, of both signs."""

    omega_rad_s: FloatArray
    open_loop: ComplexArray
    closed_loop: ComplexArray


@dataclass(frozen=True)
class Margins:
    """gain: factor on the plate's gain that brings the loop to its limit; phase_deg: error of the carrier's phase, the smaller
    of both signs; sensitivity: largest |1/(1 + L)|; stable: all poles (3,) of the closed loop lie inside the circle |z| = 1.
    """

    gain: float
    phase_deg: float
    sensitivity: float
    stable: bool
    poles: ComplexArray


def _coefficients(setup: Setup, gain_error: complex) -> tuple[complex, ...]:
    """Coefficients over a period: U' = a U + b V, mid-window M = c U + e V, then V' = I - state M - feed V, I' = I - i M:
    a, b, c, e, state, feed, i.
    """
    rates, truth, model, control = setup.rates, setup.modes[0], setup.model, Controller(setup)
    detuning = setup.omega_rad_s - truth.omega_rad_s
    rate = 1.0 / truth.tau_s + 1j * detuning
    turned = truth.gain * np.conj(model.gain) / abs(model.gain)  # the controller takes its idea of the phase out
    size = turned * gain_error / (1.0 + 1j * detuning * truth.tau_s)
    middle = (rates.period - rates.gap) / (2.0 * rates.sample_rate_hz)
    a, c = np.exp(-rate * rates.period_s), np.exp(-rate * middle)
    own = complex(control.states[0]), complex(control.feeds[0]), control.gains.integral
    return a, size * (1 - a), c, size * (1 - c), *own


def sampled_loop(setup: Setup) -> SampledLoop:
    """Compute the return ratio and the reference response up to half the slow step's rate, for both signs of frequency.

    Parameters
    ----------
    setup : Setup
        Loop of one mode; of several the first counts.

    Returns
    -------
    SampledLoop
        Envelope frequencies in rad/s, ascending from negative ones, without 0.
    """
    (a, b, c, e, state, feed, integral), period = _coefficients(setup, 1.0), setup.rates.period_s
    half = np.geomspace(1e-4, 1.0, POINTS) * pi / period
    omega = np.concatenate([-half[::-1], half])
    z = np.exp(1j * omega * period)
    # z-transforms of the recursions in _coefficients: M = plant V, and V = -(integral/(z - 1) + state)/(z + feed) M
    plant = e + c * b / (z - a)
    loop = plant * (integral / (z - 1.0) + state) / (z + feed)
    age = setup.rates.ahead_s / period
    forward = setup.gains.proportional + integral * (1.0 - age + age / z) / (z - 1.0)
    return SampledLoop(omega, loop, plant * forward / (z + feed) / (1.0 + loop))


def closed_loop_poles(setup: Setup, gain_error: complex = 1.0) -> ComplexArray:
    """Compute the poles in z of the states (U, V, I) of the sampled loop.

    Parameters
    ----------
    setup : Setup
        Loop of one mode; of several the first counts.
    gain_error : complex, optional
        Factor on the plant's gain; its phase is an error of the carrier's.

    Returns
    -------
    ndarray, shape (3,)
        Complex poles; the loop is stable if all are inside the unit circle.
    """
    a, b, c, e, state, feed, integral = _coefficients(setup, gain_error)
    matrix = [[a, b, 0.0], [-state * c, -state * e - feed, 1.0], [-integral * c, -integral * e, 1.0]]
    return np.asarray(np.linalg.eigvals(np.array(matrix)))


def margins(setup: Setup) -> Margins:
    """Compute the gain and phase margins and the sensitivity of the sampled loop.

    Parameters
    ----------
    setup : Setup
        Loop of one mode; of several the first counts.

    Returns
    -------
    Margins
        Gain factor (inf without a limit), phase in degrees up to 180, sensitivity and poles.

    Raises
    ------
    SolverError
        If the loop is unstable to begin with.
    """
    poles = closed_loop_poles(setup)
    if not np.all(np.abs(poles) < 1.0):
        raise SolverError(f"the loop is unstable: a pole of modulus {np.abs(poles).max():.3f} per step")

    def edge(direction: complex, end: float) -> float:
        """Change of the plant's logarithm in a direction at which the largest pole leaves the circle; inf if it does not."""

        def growth(x: float) -> float:
            return float(np.abs(closed_loop_poles(setup, np.exp(x * direction))).max()) - 1.0

        return next(roots_along(growth, np.linspace(0.0, end, 181), 1e-13), inf)

    gain, turned, loop = edge(1.0, 7.0), (edge(1j, pi), edge(-1j, pi)), sampled_loop(setup)
    return Margins(
        gain=exp(gain) if gain < inf else inf,
        phase_deg=float(np.degrees(min(*turned, pi))),
        sensitivity=float(np.abs(1.0 / (1.0 + loop.open_loop)).max()),
        stable=True,
        poles=poles,
    )


# -- study -------------------------------------------------------------------------------------------------------------
# The mode's loop as a whole: design, feasibility, identification, and the response at the firmware's own rates.

SWEEP_WIDTHS = 2.4  # bandwidths on each side of the resonance
SWEEP_POINTS = 101
SHARES = (0.1, 0.2, 0.4, 0.6, 0.9)
SATURATED = 0.5  # of G Vmax, to compare anti-windups
THESIS_95_S = 2e-3
FIRMWARE_RESPONSE_S = 0.53e-3  # the time constant that the firmware plans with


@dataclass(frozen=True)
class DqData:
    """The controlled mode and its controller. The thesis states no identified values; ours follow its prototype: 31 kHz.

    target, neighbours: velocity response of each mode, signal over drive in full scales; for sensor "displacement" their
    gains are turned by -j. within_s: asked 95 % response. share: of G Vmax, the requested step. delay_s: dead time beyond
    the hold; delay_guess_s: known part of delay and hold before identification; noise: rms of a sample.
    """

    target: ModePlant = field(default_factory=lambda: ModePlant.from_quality_factor(31_000.0, 300.0, 0.8))
    neighbours: tuple[ModePlant, ...] = ()
    within_s: float = THESIS_95_S
    share: float = 0.18
    drive_limit: float = 1.0
    amplitude_limit: float = 0.8
    delay_s: float = 7e-6
    delay_guess_s: float = 6e-6
    noise: float = 1e-3
    feedthrough: float = 0.002
    sensor: Sensor = "displacement"
    detunings_hz: tuple[float, ...] = (-300.0, 0.0, 300.0)
    rates: Rates = field(default_factory=Rates)

    @property
    def latency_s(self) -> float:
        """Longest time from a change of the reference to its drive, s: a period's wait, the gap, a sample, the delay."""
        samples = self.rates.period + self.rates.gap + 1
        return samples / self.rates.sample_rate_hz + self.delay_s

    @property
    def response_s(self) -> float:
        """tau_d that leaves 95 % within the asked time. SolverError when the loop's own latency takes it all."""
        if not isfinite(self.within_s) or self.within_s <= self.latency_s:
            raise SolverError(
                f"95 % within {self.within_s:g} s: must be finite and above the loop's own latency, {self.latency_s:.3g} s"
            )
        return (self.within_s - self.latency_s) / SETTLED


@dataclass(frozen=True)
class Step:
    """One simulated step: what was special about it, the reference, and the loop's trace."""

    name: str
    detuning_hz: float
    reference: float
    trace: Trace

    def to_dict(self) -> dict[str, Any]:
        """Times in s, inf where never reached."""
        return {
            "name": self.name,
            "detuning_hz": self.detuning_hz,
            "reference": self.reference,
            "reached_95_s": self.trace.reached_s(),
            "settled_5_s": self.trace.settled_s(),
            "overshoot": self.trace.overshoot(),
            "limited_periods": int(self.trace.limited.sum()),
        }


@dataclass(frozen=True)
class DqStudy:
    """Design, limits of the drive, the identified mode, margins and simulated steps.

    pi: in continuous time; planned_s: the time constant to plan the sampled gains with so that the loop as it is simulated
    meets the asked time; steps: the asked one for each detuning, with the firmware's own constant, with neighbours; windups:
    a saturated step for each anti-windup; sweep: as measured for the identification.
    """

    data: DqData
    pi: Pi
    planned_s: float
    sampled: SampledPi
    feasible: tuple[Feasibility, ...]
    sweep: Sweep
    identified: Identified
    margins: Margins
    steps: tuple[Step, ...]
    windups: tuple[Step, ...]

    @property
    def query(self) -> Step:
        """The step at the smallest detuning, without neighbours."""
        return min((s for s in self.steps if s.name == "alone"), key=lambda s: abs(s.detuning_hz))

    def step(self, name: str) -> Step:
        """The first simulated step of that name."""
        return next(step for step in self.steps if step.name == name)

    def sampled_loop(self) -> SampledLoop:
        """Return ratio and reference response of the sampled loop at resonance, the identified mode alone."""
        return sampled_loop(
            replace(_setup(self.data, self.identified), modes=(self.identified.plant,), response_s=self.planned_s)
        )

    @property
    def largest_share(self) -> float:
        """Largest step without meeting the limit, as a share of the amplitude at full drive: 1/(K_p G)."""
        return 1.0 / (self.sampled.proportional * abs(self.identified.plant.gain))

    def to_dict(self) -> dict[str, Any]:
        """Plant, design, feasibility, identification, margins, steps and the entries of the mode table."""
        data, plant, found = self.data, self.data.target, self.identified.to_dict()
        carried = {name: found[name] for name in ("frequency_hz", "tau_s", "gain", "delay_s")}
        return {
            "plant": {
                **{name: getattr(plant, name) for name in ("frequency_hz", "quality_factor", "tau_s")},
                "gain": abs(plant.gain),
                "sensor": data.sensor,
                "delay_s": data.delay_s,
            },
            "neighbours": [{"frequency_hz": m.frequency_hz, "gain": abs(m.gain)} for m in data.neighbours],
            "design": {
                "within_s": data.within_s,
                "latency_s": data.latency_s,
                "response_s": data.response_s,
                **vars(self.pi),
                "sampled": {
                    "period_s": data.rates.period_s,
                    "planned_s": self.planned_s,
                    "largest_share": self.largest_share,
                    "proportional": self.sampled.proportional,
                    "integral": self.sampled.integral,
                    "bounded_by_neighbours": self.sampled.bounded,
                },
            },
            "feasibility": self.feasible,
            "margins": self.margins,
            "identified": found | {"printed_tau_s": 1.0 / found["circle"].radius},  # of (2.44), no time constant at all
            "steps": [step.to_dict() for step in self.steps],
            "anti_windup": [step.to_dict() for step in self.windups],
            "table_entry": carried | {"drive_limit": data.drive_limit, "amplitude_limit": data.amplitude_limit},
        }


def dq_study(data: DqData | None = None) -> DqStudy:
    """Design and simulate the loop of one mode; deterministic.

    Parameters
    ----------
    data : DqData, optional
        Mode, controller and rates; by default the study's own.

    Returns
    -------
    DqStudy
        Design, limits of the drive, identification, margins and steps.

    Raises
    ------
    SolverError
        If the response asked for is faster than the loop allows, a value is not above 0 or the sweep shows no circle.
    """
    data = DqData() if data is None else data
    if not (isfinite(data.share) and 0.0 < data.share < 1.0):
        raise SolverError(f"share {data.share:g} of the amplitude at full drive: must be above 0 and below 1")
    seen = _measured(data)
    identified = identify(seen, data.sensor, data.delay_guess_s)
    plant, response = identified.plant, data.response_s
    reach = abs(plant.gain) * data.drive_limit
    setup = _setup(data, identified)
    setup = replace(setup, response_s=planned_response_s(setup, data.within_s))
    return DqStudy(
        data=data,
        pi=pi_gains(plant, response),
        planned_s=setup.response_s,
        sampled=_with_neighbours(setup, data).gains,
        feasible=tuple(feasibility(plant, share * reach, response, data.drive_limit) for share in SHARES),
        sweep=seen,
        identified=identified,
        margins=margins(replace(setup, modes=(plant,), known=None, known_delay_s=None)),
        steps=tuple(_steps(data, setup, reach)),
        windups=tuple(
            _step(f"anti-windup {kind}", replace(setup, anti_windup=kind), SATURATED * reach)
            for kind in get_args(AntiWindup)
        ),
    )


def planned_response_s(setup: Setup, within_s: float) -> float:
    """Find the time constant that plans the sampled gains for 95 % within a time.

    The loop is simulated without noise and limit. The planned pole is not the loop's: the integral and the age of a
    measurement slow it.

    Parameters
    ----------
    setup : Setup
        Loop of one mode; of several the first counts.
    within_s : float
        Time to 95 % of the reference.

    Returns
    -------
    float
        Time constant in s, at most `within_s`.

    Raises
    ------
    SolverError
        If no gain below that of a deadbeat answer reaches 95 % in time.
    """
    exact = replace(setup.rates, bits=0)
    ideal = replace(setup, modes=setup.modes[:1], noise=0.0, offset=0.0, drive_limit=inf, rates=exact)

    def late(response: float) -> float:
        trace = step_response(replace(ideal, response_s=response), 1.0, 3.0 * within_s + 10.0 * setup.rates.period_s)
        return min(trace.reached_s(), 10.0 * within_s) - within_s

    fastest, slowest = 0.2 * setup.rates.period_s, within_s
    if late(fastest) > 0.0:
        raise SolverError(f"95 % within {within_s:g} s: the sampled loop is not that fast at any gain")
    return float(brentq(late, fastest, slowest, rtol=1e-6)) if late(slowest) > 0.0 else slowest


def _measured(data: DqData) -> Sweep:
    """The sweep the loop would measure: all modes, delay, the hold's droop and half sample, noise of a window's fit."""
    f0, width = data.target.frequency_hz, data.target.bandwidth_rad_s / (2.0 * pi)
    frequencies = np.linspace(f0 - SWEEP_WIDTHS * width, f0 + SWEEP_WIDTHS * width, SWEEP_POINTS)
    turn = 2j * pi * frequencies / data.rates.sample_rate_hz
    window = data.rates.period - data.rates.gap
    noise = data.noise * 2.0 / window**0.5  # of a phasor fitted to this number of samples, drive 1
    modes = (data.target, *data.neighbours)
    sweep = noisy(sweep_of(modes, frequencies, data.sensor, data.delay_s, data.feedthrough), noise)
    return replace(sweep, response=sweep.response * (1.0 - np.exp(-turn)) / turn)


def _setup(data: DqData, identified: Identified) -> Setup:
    """The loop with the identified mode as the controller's model."""
    return Setup(
        modes=(_sensed(data.target, data.sensor),),
        known=identified.plant,
        response_s=data.response_s,
        drive_limit=data.drive_limit,
        delay_s=data.delay_s,
        known_delay_s=identified.delay_s,
        noise=data.noise,
        rates=data.rates,
    )


def _sensed(mode: ModePlant, sensor: Sensor) -> ModePlant:
    return replace(mode, gain=-1j * mode.gain) if sensor == "displacement" else mode


def _with_neighbours(setup: Setup, data: DqData) -> Setup:
    return replace(setup, modes=(*setup.modes, *(_sensed(mode, data.sensor) for mode in data.neighbours)))


def _steps(data: DqData, setup: Setup, reach: float) -> list[Step]:
    steps = []
    for detuning in data.detunings_hz:
        detuned = abs(1.0 + 2j * pi * detuning * data.target.tau_s)
        reference = data.share * reach / max(1.0, detuned * data.response_s / data.target.tau_s)
        steps.append(_step("alone", replace(setup, detuning_hz=detuning), reference))
    steps.append(_step("firmware's constant", replace(setup, response_s=FIRMWARE_RESPONSE_S), 0.5 * data.share * reach))
    if data.neighbours:
        steps.append(_step("with neighbours", _with_neighbours(setup, data), data.share * reach))
    return steps


def _step(name: str, setup: Setup, reference: float) -> Step:
    return Step(name, setup.detuning_hz, reference, step_response(setup, reference))


def envelope_frequencies(data: DqData) -> FloatArray:
    """Return the frequencies of the Bode diagram, up to half the slow step's rate.

    Parameters
    ----------
    data : DqData
        Data with the rates of the loop.

    Returns
    -------
    ndarray, shape (400,)
        Envelope frequencies in rad/s, from 1 Hz, geometrically spaced.
    """
    return np.asarray(np.geomspace(2.0 * pi, pi / data.rates.period_s, 400))
