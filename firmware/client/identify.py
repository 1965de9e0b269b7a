"""Identification of a plate by chirps: find the resonance, measure it, fit one or two modes, choose the gains, load them.

The board drives and records, `firmware.client.chirp` fits, `firmware.client.margins` states what the loop's gains leave.
Nothing is loaded that the plate's response does not support: each of the refusals below is one line with what to do.
"""

from __future__ import annotations

import cmath
import math
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from firmware.client.chirp import FULL_SCALE, WINDOW_S, Complexes, Fit, Floats, Mode, Sweep, fit, without_delay
from firmware.client.client import OTHER_VERSION, BoardError, Client
from firmware.client.margins import GAIN_LEAST_DB, PHASE_LEAST_DEG, Loop, widest
from firmware.mode_table import PIN_VOLTS
from firmware.protocol import CHIRP_ROWS, Chirp, Flag, Measured, SingleStatus

SEARCH_SHARE = 0.04  # of the frequency, to either side
QUALITY_MOST = 1000.0  # whose time constant a search lets settle
SEARCH_LEVELS = (0.01, 0.04, 0.16)  # of the drive limit, while only noise is seen
MOTION = 0.35  # of the amplitude limit: intended largest response
RAISED_MOST = 64.0  # in one step
ABOVE_NOISE = 8.0  # least peak over rms noise
PAIRS, SEARCH_PAIRS, SOFT_PAIRS = 3, 2, 1  # of periods, recorded at least
COHERENCE_LEAST = 0.9
MISFIT_MOST, ERROR_MOST, GAIN_ERROR = 0.03, 0.05, 0.1  # the last one for the gains of two modes, relative
SPAN = 8.0  # half-bandwidths
CLOSE, STRONG = 3.0, 0.1  # a second mode within a number of spans, of at least a share of the first one
LINES_LEAST = 10
BAND = 0.35  # of the step rate: farther lines are weak and mixed with their images
NEIGHBOUR_HZ = 1500.0
TWO_BETTER = 0.5  # misfit of two modes over that of one, at most
SECOND_LEAST = 0.02  # gain over the first one's
ALIKE = 0.9  # gain over the first one's, above which neither is the target
LINEAR, BENT = 0.01, 0.1  # relative change of the response with the level: none, and too much
QUIETER, REPEATS = 0.25, 2
TIMES_LEAST = 1.2  # from one level to the other: closer ones say nothing about the response's change
CODES_LEAST = 16.0  # of the DAC, in amplitude
ADC_STEP = 1.0 / 2048.0
STEPS_ERROR = 2.0 / math.pi * ADC_STEP  # of an amplitude: a square wave of half a step either way
REST_S, LOOK_S = 1.0, 2e-3
SURVEY_NOISE = 6.0
OPPOSED, OPPOSED_MOST, OPPOSED_NEAR = 3.0, 0.65, 6.0  # bound of the loop, ratio of gains, half-bandwidths


@dataclass(frozen=True)
class Response:
    """Response to a sweep, sensor over drive: one row per pair of periods, and the largest motion, of full scale."""

    sweep: Sweep
    pairs: Complexes
    level: float
    motion: float

    @property
    def mean(self) -> Complexes:
        """Mean over the pairs."""
        return np.asarray(self.pairs.mean(axis=0))

    @property
    def noise2(self) -> float:
        """Variance of the mean due to noise, the same at each line."""
        return float(np.var(self.pairs, axis=0, ddof=1).mean() / len(self.pairs))

    @property
    def coherence(self) -> Floats:
        """Magnitude-squared coherence of drive and sensor, from the pairs."""
        return np.asarray(np.abs(self.mean) ** 2 / np.maximum(np.mean(np.abs(self.pairs) ** 2, axis=0), 1e-300))


class NotIdentified(BoardError):
    """The response does not support values to hold the plate with; it is attached, with its fit if there is one."""

    def __init__(self, text: str, response: Response, fitted: Fit | None = None) -> None:
        super().__init__(f"identify: {text}")
        self.response, self.fitted = response, fitted


class Board(NamedTuple):
    """State of a board before: the mode as known so far, the kind of its sensor, and limits as fractions of full scale."""

    frequency_hz: float
    delay_s: float
    displacement: bool
    drive_limit: float
    amplitude_limit: float


@dataclass(frozen=True)
class Found:
    """Identified mode, and what it rests on.

    Attributes
    ----------
    values : Measured
        Values for the board.
    response : Response
    fit : Fit
    coherence : float
        Mean over the lines within half a bandwidth of the resonance.
    loop : Loop
    table_hz : float
        Frequency in the table.
    bent : float or None
        Relative change of the response from a level to four times that; 0 where it is small, None where it is unknown.
    seconds : float
        Duration on the board.
    metres : float
        Motion at full scale of the sensor, in m; 0 if the table does not give it.
    """

    values: Measured
    response: Response
    fit: Fit
    coherence: float
    loop: Loop
    table_hz: float
    bent: float | None
    seconds: float
    metres: float = 0.0


def measure(client: Client, sweep: Sweep, level: float, drive_limit: float, least: int) -> Response:
    """Drive a sweep at a share of the drive limit, and return at least some pairs of periods of the response."""
    taken: list[int] = []
    rows = min(CHIRP_ROWS, 2 * least * sweep.steps) if sweep.slow else CHIRP_ROWS
    for _ in range(max(1, 2 * least * sweep.steps // CHIRP_ROWS)):
        taken += _recorded(client, sweep.request(level), rows)
    motion = np.abs(np.array(taken, np.uint16).view(np.int16).reshape(-1, 2) @ np.array([1.0, 1j])).max() / FULL_SCALE
    periods = sweep.responses(taken, level * drive_limit)
    pairs = np.asarray(periods.reshape(-1, 2, sweep.steps).mean(axis=1), complex)
    return Response(sweep, pairs, level, float(motion))


def _recorded(client: Client, chirp: Chirp, rows: int) -> list[int]:
    client.chirp(chirp)
    words: list[int] = []
    heard = time.monotonic()
    while len(words) < 2 * rows:
        part = client.captured(len(words))
        if (part.row, part.total) != (2, 2 * CHIRP_ROWS):
            raise BoardError(f"identify: the board records {part.total} words in rows of {part.row}; {OTHER_VERSION}")
        words += part.words
        if part.words:
            heard = time.monotonic()
        else:
            _check_drives(client)
            if time.monotonic() - heard > REST_S + 2.0 * chirp.settle * chirp.every * WINDOW_S:
                raise BoardError("identify: the board records nothing: check that it is sampling")
            time.sleep(LOOK_S)
    client.stop()
    _wait_for_rest(client)
    return words[: 2 * rows]


def _check_drives(client: Client) -> None:
    status = client.status()
    if status.state != "identify":
        raise BoardError(f"identify: ended in {status.state}, faults {', '.join(status.faults) or 'none'}")


def _wait_for_rest(client: Client) -> None:
    end = time.monotonic() + REST_S
    while client.status().state == "identify" and time.monotonic() < end:
        time.sleep(LOOK_S)


def identify(client: Client) -> Found:
    """Identify the plate of a single-mode board, load the values, and leave the board at rest.

    Raises
    ------
    NotIdentified
        If the response supports no values.
    BoardError
        If the board refuses, or ends in a fault.
    """
    status = client.status()
    if not isinstance(status, SingleStatus):
        raise BoardError("identify: this board runs the six-channel image")
    identity = client.identity()
    displacement = bool(status.flags & Flag.DISPLACEMENT)
    board = Board(status.frequency_hz, status.delay_s, displacement, identity.drive_limit, identity.amplitude_limit)
    began = status.windows
    response, first = _search(client, board)
    found, bent = _measured(client, board, response, first)
    values, chosen, coherence, best = _values(board, found)
    client.set(values)
    seconds = (client.status().windows - began) % 2**32 * WINDOW_S
    return Found(values, found, best, coherence, chosen, board.frequency_hz, bent, seconds, status.metres)


def _search(client: Client, board: Board) -> tuple[Response, Mode]:
    """Find the resonance near the table's frequency, at the lowest level that shows it."""
    hertz = board.frequency_hz
    edge_hz, tau_s = SEARCH_SHARE * hertz, QUALITY_MOST / (math.pi * hertz)
    sweeps = [Sweep.for_tau(hertz, tau_s).coarser]
    if edge_hz > 0.49 / sweeps[0].step_s:
        sweeps += [Sweep.for_tau(hertz + sign * edge_hz, tau_s).coarser for sign in (-1.0, 1.0)]
    wider = math.sqrt(sweeps[0].settle)  # so that a sweep of half the period and twice the band moves the plate as much
    for level in [max(wider * level, _least_level(board)) for level in SEARCH_LEVELS]:
        seen = [measure(client, sweep, level, board.drive_limit, SEARCH_PAIRS) for sweep in sweeps]
        best = max(seen, key=lambda one: float(np.abs(one.mean).max() / math.sqrt(one.noise2 + 1e-300)))
        if np.abs(best.mean).max() > ABOVE_NOISE * math.sqrt(best.noise2) and best.motion > 4.0 * ADC_STEP:
            break
    else:
        raise NotIdentified(
            f"no response within {100.0 * SEARCH_SHARE:g} % of {hertz:.0f} Hz at {SEARCH_LEVELS[-1]:g} of the drive limit: "
            "check amplifier, sensor wire and the table's frequency",
            best,
        )
    first = _first_guess(best)
    away_hz = best.sweep.carrier_hz + first.away_hz - hertz
    if abs(away_hz) > edge_hz:
        raise NotIdentified(
            f"the strongest response, at {hertz + away_hz:.0f} Hz, is {100.0 * abs(away_hz) / hertz:.1f} % from the table's "
            f"{hertz:.0f} Hz: upload a table of this plate",
            best,
        )
    return best, first


def _least_level(board: Board) -> float:
    """Share of the drive limit below which the steps of the DAC distort the drive."""
    return min(1.0, CODES_LEAST / (2047.0 * board.drive_limit))


def _first_guess(response: Response) -> Mode:
    """Guess the strongest mode from its peak and the lines above half of its power."""
    lines_hz, power = response.sweep.lines_hz, np.abs(response.mean) ** 2
    peak = int(power.argmax())
    wide = lines_hz[1] - lines_hz[0]
    above = np.count_nonzero(power[max(peak - 40, 0) : peak + 41] > 0.5 * power[peak])
    return Mode(float(lines_hz[peak]), 1.0 / (math.pi * wide * max(above, 1)))


def _measured(client: Client, board: Board, response: Response, first: Mode) -> tuple[Response, float | None]:
    """Measure about the resonance, at a level at which the response is in proportion to the drive."""
    sweep = response.sweep
    mode = fit(sweep, response.mean, board.delay_s, first, 1, _span(sweep, first)).modes[0]
    aimed = response.level * MOTION * board.amplitude_limit / response.motion
    level = max(min(1.0, RAISED_MOST * response.level, aimed), _least_level(board))
    sweep = Sweep.for_tau(sweep.carrier_hz + mode.away_hz, mode.tau_s)
    loud = measure(client, sweep, level, board.drive_limit, PAIRS)
    least, bent = _least_level(board), 0.0
    for _ in range(REPEATS + 1):
        soft = measure(client, sweep, max(QUIETER * loud.level, least), board.drive_limit, SOFT_PAIRS)
        times = loud.level / soft.level
        if times < TIMES_LEAST:
            return loud, None
        bent = _change(loud, soft, mode, board.drive_limit) * (1.0 - QUIETER) / (1.0 - 1.0 / times)
        if bent < LINEAR:
            return loud, 0.0
        if soft.level == least:
            break
        loud = measure(client, sweep, soft.level, board.drive_limit, PAIRS)
    if bent > BENT:
        raise NotIdentified(
            f"the response still changes by {100.0 * bent:.0f} % with the level, at {loud.level:.3g} of the drive limit: "
            "keep hands off the plate; check glue, clamps and whether the amplifier clips",
            loud,
        )
    return loud, bent


def _change(loud: Response, soft: Response, mode: Mode, drive_limit: float) -> float:
    """Relative rms change of the response near the resonance from one level to another, without noise and ADC steps."""
    near = np.abs(loud.sweep.lines_hz) <= max(2.0 * mode.half_hz, 3.0 * loud.sweep.spacing_hz)
    changed = np.mean(np.abs(loud.mean - soft.mean)[near] ** 2)
    averaged = (loud.level / soft.level) ** 2 * len(loud.pairs) / len(soft.pairs)
    steps2 = (STEPS_ERROR / drive_limit) ** 2 * (loud.level**-2 + soft.level**-2)
    noise = loud.noise2 * (1.0 + averaged) + steps2
    if changed < 3.0 * noise:
        return 0.0
    return float(math.sqrt((changed - noise) / np.mean(np.abs(loud.mean[near]) ** 2)))


def _span(sweep: Sweep, first: Mode, least_hz: float = 0.0) -> float:
    """Distance of the lines to fit from a mode: some half-bandwidths, some lines, within the band."""
    return min(max(SPAN * first.half_hz, LINES_LEAST * sweep.spacing_hz, least_hz), BAND / sweep.step_s, NEIGHBOUR_HZ)


def _values(board: Board, response: Response) -> tuple[Measured, Loop, float, Fit]:
    """Fit the modes, judge the fit, and choose the gains."""
    sweep = response.sweep
    delay_s, guess = board.delay_s, replace(_first_guess(response), away_hz=0.0)
    for _ in range(3):
        single = fit(sweep, response.mean, delay_s, guess, 1, _span(sweep, guess))
        delay_s += _late(single.modes[0], sweep.carrier_hz, board.displacement, delay_s)
        guess = single.modes[0]
    best = _of_one_or_two(response, single, delay_s)
    if len(best.modes) > 1:
        delay_s += _late(best.modes[0], sweep.carrier_hz, board.displacement, delay_s)
        best = _of_one_or_two(response, single, delay_s)
    mode, noise2 = best.modes[0], response.noise2
    misfit = _without_noise(best, noise2)
    lines = np.abs(sweep.lines_hz - mode.away_hz) <= max(mode.half_hz, 1.5 * sweep.spacing_hz)
    coherence = float(response.coherence[lines].mean())
    _judge(response, best, misfit, coherence)
    neighbour = max([_neighbour(response, best, delay_s), *(_weight(mode, other) for other in best.modes[1:])])
    chosen = widest(best.modes, complex(best.background[0]), neighbour, delay_s)
    if not chosen.holds:
        raise NotIdentified(
            f"neighbouring modes leave no loop with {PHASE_LEAST_DEG:g} deg and {GAIN_LEAST_DB:g} dB of margin "
            f"({chosen.phase_deg:.0f} deg, {chosen.gain_db:.1f} dB): move the sensor or the patch",
            response,
            best,
        )
    hertz = sweep.carrier_hz + mode.away_hz
    values = Measured(
        frequency_hz=hertz + 0.5 * mode.half_hz**2 / hertz,
        tau_s=mode.tau_s,
        gain=mode.gain,
        delay_s=delay_s,
        neighbour=chosen.neighbour,
        motion=min(response.motion, 1.0),
        misfit=min(misfit, 1.0),
    )
    return values, chosen, coherence, best


def _of_one_or_two(response: Response, alone: Fit, delay_s: float) -> Fit:
    """Return the fit of two modes where it is clearly the better one.

    A second mode far off may disturb what is fitted up to it more than one or two modes explain: then the target's own
    surroundings are fitted, and the second mode counts as a neighbour.
    """
    mode, sweep = alone.modes[0], response.sweep
    span_hz = _span(sweep, mode, _reach_of_second(response, mode, delay_s))
    single, double = (fit(sweep, response.mean, delay_s, mode, count, span_hz) for count in (1, 2))
    first, second = double.modes
    told_apart = (
        max(first.gain_error, second.gain_error) < GAIN_ERROR and max(first.tau_error, second.tau_error) < ERROR_MOST
    )
    better = _without_noise(double, response.noise2) < TWO_BETTER * _without_noise(single, response.noise2)
    counts = abs(second.gain) > SECOND_LEAST * abs(first.gain) and double.misfit < TWO_BETTER * single.misfit
    if told_apart and better and counts:
        return double
    if _without_noise(single, response.noise2) > MISFIT_MOST and better and not told_apart:
        if _without_noise(alone, response.noise2) <= MISFIT_MOST:
            return alone
        near = [response.sweep.carrier_hz + mode.away_hz for mode in double.modes]
        raise NotIdentified(
            f"two modes near {near[0]:.0f} and {near[1]:.0f} Hz cannot be told apart: change the plate or the place "
            "of the patch, so that one of them is not driven",
            response,
            double,
        )
    return single


def _left(response: Response, mode: Mode, delay_s: float) -> Complexes:
    """Response that a mode does not explain, without the delay."""
    sweep = response.sweep
    own = mode.gain * mode.response(sweep.lines_hz, sweep.step_s, delay_s)
    return without_delay(sweep, response.mean, delay_s) - own


def _reach_of_second(response: Response, mode: Mode, delay_s: float) -> float:
    """Distance at which a strong second mode close by has decayed, or 0."""
    away = np.abs(response.sweep.lines_hz - mode.away_hz)
    left = np.where(away < CLOSE * _span(response.sweep, mode), np.abs(_left(response, mode, delay_s)), 0.0)
    return float(away[left.argmax()] + 0.5 * SPAN * mode.half_hz) if left.max() > STRONG * abs(mode.gain) else 0.0


def _without_noise(one: Fit, noise2: float) -> float:
    """Misfit beyond that of noise."""
    power = float(np.mean(np.abs(one.measured) ** 2))
    return math.sqrt(max(one.misfit**2 - noise2 / power, 0.0))


def _judge(response: Response, best: Fit, misfit: float, coherence: float) -> None:
    """Raise NotIdentified unless the fit describes one mode to hold."""
    mode, *others = best.modes
    hertz = [response.sweep.carrier_hz + each.away_hz for each in best.modes]
    wrong = ""
    if coherence < COHERENCE_LEAST:
        wrong = (
            f"coherence {coherence:.2f} at {hertz[0]:.0f} Hz, at least {COHERENCE_LEAST:g} needed: keep hands off the plate; "
            "raise the gain of the conditioner or the drive limit"
        )
    elif abs(mode.gain) < abs(best.background[0]) or mode.half_hz > 0.5 * float(np.ptp(best.lines_hz)):
        wrong = (
            f"the response near {hertz[0]:.0f} Hz is flat, not a resonance: check whether the drive reaches the plate, "
            "and not only the sensor's wire"
        )
    elif misfit > MISFIT_MOST or mode.tau_error > ERROR_MOST:
        wrong = (
            f"no mode fits the response near {hertz[0]:.0f} Hz (misfit {100.0 * misfit:.1f} %, time constant within "
            f"{100.0 * mode.tau_error:.0f} %): keep hands off the plate; --plot shows response and fit"
        )
    elif others and abs(others[0].gain) > (OPPOSED_MOST if _opposes(mode, others[0]) else ALIKE) * abs(mode.gain):
        wrong = (
            f"modes at {hertz[0]:.0f} and {hertz[1]:.0f} Hz respond alike: move the patch or the sensor, so that one of them "
            "is clearly the target"
        )
    if wrong:
        raise NotIdentified(wrong, response, best)


def _late(mode: Mode, carrier_hz: float, displacement: bool, delay_s: float) -> float:
    """Delay beyond the one assumed: any phase of the gain, modulo half a turn, that the sensor's kind does not explain."""
    hertz = carrier_hz + mode.away_hz
    turns = (cmath.phase(mode.gain) + (0.5 * math.pi if displacement else 0.0)) / math.pi
    late_s = -((turns + 0.5) % 1.0 - 0.5) / (2.0 * hertz)
    return late_s if delay_s + late_s >= 0.0 else late_s + 0.5 / hertz


def _opposes(mode: Mode, other: Mode) -> bool:
    """True for a second mode close by that moves against the first one: their beats resemble a reversed sensor."""
    return (other.gain / mode.gain).real < 0.0 and abs(other.away_hz - mode.away_hz) < OPPOSED_NEAR * mode.half_hz


def _weight(mode: Mode, other: Mode) -> float:
    """Response of a second mode as a bound of the loop."""
    return abs(other.gain) * (OPPOSED if _opposes(mode, other) else 1.0)


def _neighbour(response: Response, best: Fit, delay_s: float) -> float:
    """Largest response that the target mode does not explain, corrected for the length of a step and of a window."""
    sweep, mode = response.sweep, best.modes[0]
    lines_hz = sweep.lines_hz
    left2 = np.abs(_left(response, mode, delay_s)) ** 2 - SURVEY_NOISE * response.noise2
    away = np.abs(lines_hz - mode.away_hz)
    size = np.sqrt(np.maximum(left2, 0.0)) / (
        np.sinc(lines_hz * sweep.step_s) * np.sinc(lines_hz * sweep.step_s * 0.92)
    )
    return float(size[(away < NEIGHBOUR_HZ) & (np.abs(lines_hz) < BAND / sweep.step_s)].max())


class Units(NamedTuple):
    """Words for fractions of full scale: micrometres, and volts at the DAC, where the table has the motion at full scale."""

    metres: float

    def motion(self, share: float) -> str:
        """Write an amplitude."""
        return f"{1e6 * self.metres * share:.2g} um" if self.metres > 0.0 else f"{share:.2g} of full scale"

    def gain(self, gain: float, digits: str) -> str:
        """Write a response, sensor over drive."""
        scale = 1e6 * self.metres / PIN_VOLTS
        return f"{scale * gain:{digits}} um/V" if self.metres > 0.0 else f"{gain:{digits}}"

    def law(self, gain: float) -> str:
        """Write a gain of the loop, drive over sensor."""
        return f"{gain * PIN_VOLTS / (1e6 * self.metres):.3g} V/um" if self.metres > 0.0 else f"{gain:.3g}"


def describe(found: Found) -> str:
    """Describe an identification for a reader."""
    values, fitted, chosen = found.values, found.fit, found.loop
    off = 100.0 * (values.frequency_hz / found.table_hz - 1.0)
    quality = math.pi * values.frequency_hz * values.tau_s
    carrier, units = found.response.sweep.carrier_hz, Units(found.metres)
    others = "".join(
        f"; another one at {carrier + mode.away_hz:.1f} Hz, gain {units.gain(abs(mode.gain), '.3g')}"
        for mode in fitted.modes[1:]
    )
    bent = f", {100.0 * found.bent:.1f} % softer or stiffer at four times the level" if found.bent else ""
    if found.bent is None:
        bent = ", not compared with a lower level, since the DAC's steps would distort that"
    return "\n".join(
        [
            f"mode {values.frequency_hz:.2f} Hz ({off:+.2f} % from the table), Q {quality:.1f}, "
            f"gain {units.gain(abs(values.gain), '.4g')} "
            f"within {100.0 * fitted.modes[0].gain_error:.2g} %, delay {1e6 * values.delay_s:.2f} us{others}",
            f"fit of {len(fitted.modes)} mode{'s' if len(fitted.modes) > 1 else ''} to {len(fitted.lines_hz)} lines: misfit "
            f"{100.0 * fitted.misfit:.2g} %, coherence {found.coherence:.4f} at the resonance, at up to "
            f"{units.motion(values.motion)}{bent}",
            f"loop: proportional gain {units.law(chosen.proportional)}, phase margin {chosen.phase_deg:.0f} deg (at least "
            f"{PHASE_LEAST_DEG:g}), gain margin {chosen.gain_db:.1f} dB (at least {GAIN_LEAST_DB:g}), neighbours up to "
            f"{units.gain(chosen.neighbour, '.3g')}",
            f"loaded after {found.seconds:.1f} s of the board's time",
        ]
    )


def draw(file: Path, response: Response, fitted: Fit | None) -> None:
    """Draw measured lines, fit and coherence to a picture (PNG, SVG or PDF, by its name)."""
    from matplotlib.figure import Figure

    sweep = response.sweep
    figure = Figure(figsize=(7.0, 7.5), layout="constrained")
    size, phase, coherence = figure.subplots(3, 1, sharex=True)
    hertz = sweep.carrier_hz + sweep.lines_hz
    measured = without_delay(sweep, response.mean, fitted.delay_s if fitted else 0.0)
    size.semilogy(hertz, np.abs(measured), ".", color="0.4", markersize=4, label="measured")
    phase.plot(hertz, np.angle(measured, deg=True), ".", color="0.4", markersize=4)
    if fitted:
        label = f"fit of {len(fitted.modes)} mode{'s' if len(fitted.modes) > 1 else ''}, misfit {100.0 * fitted.misfit:.2g} %"
        fine = sweep.carrier_hz + fitted.lines_hz
        size.semilogy(fine, np.abs(fitted.model), color="#00598a", label=label)
        phase.plot(fine, np.angle(fitted.model, deg=True), color="#00598a")
    coherence.plot(hertz, response.coherence, color="#8f3f77")
    coherence.axhline(COHERENCE_LEAST, color="0.6", linestyle="--")
    size.set(ylabel="sensor over drive")
    phase.set(ylabel="phase, degrees", yticks=range(-180, 181, 90))
    coherence.set(ylabel="coherence", xlabel="frequency, Hz", ylim=(0.0, 1.05))
    size.legend()
    figure.savefig(file)
