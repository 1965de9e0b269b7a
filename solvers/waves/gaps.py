"""Band gaps: complete ones, those of one polarisation, and their edges refined between the sampled wavevectors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geometry.elements import FloatArray
from geometry.lattice import Path
from solvers.analytic.beams import root_between
from solvers.superelement.lattice import Periodic, ReducedLattice, Waves
from solvers.waves.branches import Branches, Label, Solved, label_of, modal_overlap, one_sided

# -- extremes ----------------------------------------------------------------------------------------------------------
# Extremes of bands between the sampled wavevectors: along straight segments of a path, and over the irreducible zone.
# A segment is searched where the cubic through sampled values and group velocities (Hellmann-Feynman, one-sided at
# degenerate points) may exceed the best sample; the zone from its best grid points, with the gradient. For a cell that gives
# frequencies only, the chords of the neighbouring intervals stand for the group velocities.

CLOSE = 1e-3  # of an interval: where a search stops; a smooth extreme is then known to its square
INSIDE = np.linspace(0.0, 1.0, 18)[1:-1]
STARTS = 4  # grid points from which an extreme over the zone is sought
SIMPLEX_SOLVES = 40  # at most, of a search for an extreme over the zone without a gradient
Solve = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Extreme:
    """A band's largest or smallest frequency in Hz and where it is, wavevector (2,) in rad/m."""

    hz: float
    wavevector: FloatArray


class Line:
    """The sorted bands on a straight segment of a path, sampled at its wavevectors (m, 2), with slopes along the segment.

    value, beyond, before (m, bands): what `solve` gives at a wavevector, and its slopes after and before each sample over the
    segment's length; hz: the frequency of a value.
    """

    def __init__(self, solve: Solve, wavevectors: FloatArray, hz: Callable[[float], float]) -> None:
        self.solve, self.hz = solve, hz
        self.start, self.along = wavevectors[0], wavevectors[-1] - wavevectors[0]
        self.at = np.linalg.norm(wavevectors - self.start, axis=1) / np.linalg.norm(self.along)
        self.value = self.beyond = self.before = np.empty((0, 0))
        self._extremes: dict[tuple[int, int], Extreme] = {}

    @classmethod
    def of_waves(cls, solved: Solved, wavevectors: FloatArray) -> Line:
        """Slopes by Hellmann-Feynman, values scaled eigenvalues."""
        line = cls(lambda k: solved(k).eigenvalue, wavevectors, lambda value: _hz(solved.lattice, value))
        waves = [solved(k) for k in wavevectors]
        line.value = np.array([w.eigenvalue for w in waves])[:, : solved.count]
        slopes = [one_sided(solved.lattice, w, line.along) for w in waves]
        line.beyond, line.before = (np.array(side)[:, : solved.count] for side in zip(*slopes, strict=True))
        return line

    @classmethod
    def of_samples(cls, solve: Solve, wavevectors: FloatArray, frequency_hz: FloatArray) -> Line:
        """Slopes by the chords of the neighbouring intervals, 0 at the ends, where bands are extreme by symmetry; values in
        Hz.
        """
        line = cls(solve, wavevectors, float)
        line.value = frequency_hz
        chords = np.diff(frequency_hz, axis=0) / np.diff(line.at)[:, None]
        still = np.zeros_like(frequency_hz[:1])
        line.beyond, line.before = np.vstack([still, chords]), np.vstack([chords, still])
        return line

    def extreme(self, band: int, sign: int) -> Extreme:
        """The largest (sign 1) or smallest (-1) frequency of a sorted band (from 0) on the segment, ends included."""
        if (band, sign) not in self._extremes:
            self._extremes[band, sign] = self._search(band, sign)
        return self._extremes[band, sign]

    def _search(self, band: int, sign: int) -> Extreme:
        value = sign * self.value[:, band]
        beyond, before = sign * self.beyond[:, band], sign * self.before[:, band]
        ends, top = np.maximum(value[:-1], value[1:]), cubic_top(self.at, value, beyond, before)
        bound = np.maximum(2.0 * top - ends, tent_top(self.at, value, beyond, before))
        best, where = float(value.max()), float(self.at[value.argmax()])
        for i in np.flatnonzero((top > ends) & (bound >= best)):
            inside, at = self._inside(band, sign, self.at[i], self.at[i + 1])
            if inside > best:
                best, where = inside, at
        return Extreme(self.hz(sign * best), self.start + where * self.along)

    def _inside(self, band: int, sign: int, low: float, high: float) -> tuple[float, float]:
        """The largest value of sign times a band's eigenvalue between two samples, and where it is."""
        from scipy.optimize import minimize_scalar  # slow to import

        minimum = minimize_scalar(
            lambda s: -sign * self.solve(self.start + float(s) * self.along)[band],
            bounds=(low, high),
            method="bounded",
            options={"xatol": CLOSE * (high - low)},
        )
        return float(-minimum.fun), float(minimum.x)


def cubic_top(at: FloatArray, value: FloatArray, beyond: FloatArray, before: FloatArray) -> FloatArray:
    """Largest value inside each interval of the cubic through values and slopes at its ends.

    Parameters
    ----------
    at : ndarray, shape (m,)
        Places of the samples, ascending.
    value : ndarray, shape (m,)
        Values there.
    beyond, before : ndarray, shape (m,)
        Slopes towards the next sample and from the previous one.

    Returns
    -------
    ndarray, shape (m - 1,)
        Maximum over points strictly inside each interval, in the unit of the values.
    """
    step = np.diff(at)[:, None]
    t = INSIDE[None]
    low, high = value[:-1, None], value[1:, None]
    rise = (t * (1.0 - t)) * ((1.0 - t) * step * beyond[:-1, None] - t * step * before[1:, None])
    cubic = low + (high - low) * t * t * (3.0 - 2.0 * t) + rise
    return np.asarray(cubic.max(axis=1))


def tent_top(at: FloatArray, value: FloatArray, beyond: FloatArray, before: FloatArray) -> FloatArray:
    """Intersect the tangents from both ends of each interval: the top of a crossing, above any concave arc.

    Parameters
    ----------
    at : ndarray, shape (m,)
        Places of the samples, ascending.
    value : ndarray, shape (m,)
        Values there.
    beyond, before : ndarray, shape (m,)
        Slopes towards the next sample and from the previous one.

    Returns
    -------
    ndarray, shape (m - 1,)
        Values at the intersections; -inf unless the slopes rise from the left and fall to the right.
    """
    step, up, down = np.diff(at), beyond[:-1], -before[1:]
    rising = (up > 0.0) & (down > 0.0)
    share = (value[1:] - value[:-1] + down * step) / np.where(rising, up + down, 1.0)
    return np.asarray(np.where(rising, value[:-1] + up * share, -np.inf))


def zone_extreme(solved: Solved, grid: FloatArray, eigenvalue: FloatArray, band: int, sign: int) -> Extreme:
    """Search the extreme of a sorted band over the zone, with the gradient, from the best points of a grid.

    Parameters
    ----------
    solved : Solved
        Waves of the lattice.
    grid : ndarray, shape (n, 2)
        Wavevectors in rad/m.
    eigenvalue : ndarray, shape (n, bands)
        Scaled eigenvalues on the grid.
    band : int
        Number of the band, from 0.
    sign : int
        1 for the largest frequency, -1 for the smallest.

    Returns
    -------
    Extreme
        Frequency and wavevector, at least as extreme as the best grid point.
    """
    lattice, value = solved.lattice, eigenvalue[:, band]
    edge = np.pi / np.array(lattice.cell.size_m[:2])
    if lattice.cell.edges_m is not None:
        edge = np.abs(Periodic([lattice.cell]).lattice.zone).max(axis=0)
    scale = float(np.abs(value).max()) or 1.0
    order = np.argsort(-sign * value, kind="stable")
    best, where = sign * float(value[order[0]]), grid[order[0]]

    def objective(share: FloatArray) -> tuple[float, FloatArray]:
        nonlocal best, where
        waves = solved(share * edge)
        if sign * float(waves.eigenvalue[band]) > best:
            best, where = sign * float(waves.eigenvalue[band]), share * edge
        slope = np.array([part[band, band].real for part in lattice.slopes(waves)])
        return -sign * float(waves.eigenvalue[band]) / scale, -sign * slope * edge / scale

    from scipy.optimize import minimize  # slow to import

    for start in _spread(grid[order] / edge, STARTS):
        minimize(objective, start, jac=True, method="L-BFGS-B", bounds=[(-1.0, 1.0)] * 2, options={"ftol": 1e-12})
    return Extreme(_hz(lattice, sign * best), where)


def _spread(points: FloatArray, count: int) -> list[FloatArray]:
    """The first points that lie apart from one another, at most `count`: starts of a search in several valleys."""
    apart = 2.0 / np.sqrt(len(points))
    chosen: list[FloatArray] = []
    for point in points:
        if all(np.linalg.norm(point - other) > apart for other in chosen):
            chosen.append(point)
        if len(chosen) == count:
            break
    return chosen


def _hz(lattice: ReducedLattice, eigenvalue: float) -> float:
    return float(lattice.cell.scale.frequency(np.array(eigenvalue)))


# -- complete gaps -----------------------------------------------------------------------------------------------------
# Band gaps: complete along a path, on one of its segments, over the whole zone, and of one polarisation.

SMALLEST = 1e-3  # relative width: sampled bands that touch between two wavevectors leave narrower openings


@dataclass(frozen=True)
class Gap:
    """An interval without waves between bands `lower_band` and `upper_band` (from 1), Hz."""

    lower_band: int
    upper_band: int
    lower_hz: float
    upper_hz: float


@dataclass(frozen=True)
class DirectionalGap(Gap):
    """A gap for wavevectors on one segment of the path, named by its letters."""

    start: str
    end: str


@dataclass(frozen=True)
class BrillouinZoneGap(Gap):
    """A gap over the whole zone, and the wavevectors (2,) in rad/m of its edges."""

    lower_at: tuple[float, float]
    upper_at: tuple[float, float]


def complete_gaps(frequencies_hz: FloatArray) -> list[Gap]:
    """Find the gaps of sampled bands: max of band n < min of band n + 1.

    Parameters
    ----------
    frequencies_hz : ndarray, shape (wavevectors, bands)
        Frequencies in Hz, ascending at each wavevector.

    Returns
    -------
    list of Gap
        Gaps wider than SMALLEST relative to their upper edge, ascending.
    """
    top, bottom = frequencies_hz.max(axis=0), frequencies_hz.min(axis=0)
    openings = np.flatnonzero(bottom[1:] - top[:-1] > SMALLEST * bottom[1:])
    return [Gap(int(n) + 1, int(n) + 2, float(top[n]), float(bottom[n + 1])) for n in openings]


def path_lines(solved: Solved, path: Path) -> list[Line]:
    """Return the segments of a path with their bands and slopes.

    Parameters
    ----------
    solved : Solved
        Waves of the lattice.
    path : Path
        Wavevectors with their labelled points.

    Returns
    -------
    list of Line
        One line per segment, in the path's order.
    """
    return [Line.of_waves(solved, path.wavevectors[segment.first : segment.last + 1]) for segment in path.segments]


def sampled_lines(solve: Solve, path: Path, frequency_hz: FloatArray) -> list[Line]:
    """Return the segments of a path with bands known by their frequencies alone.

    Parameters
    ----------
    solve : callable
        Frequencies (bands,) in Hz at a wavevector (2,) in rad/m.
    path : Path
        Wavevectors with their labelled points.
    frequency_hz : ndarray, shape (n, bands)
        Frequencies at the path's wavevectors.

    Returns
    -------
    list of Line
        One line per segment, in the path's order.
    """
    parts = [slice(segment.first, segment.last + 1) for segment in path.segments]
    return [Line.of_samples(solve, path.wavevectors[part], frequency_hz[part]) for part in parts]


def path_gaps(lines: list[Line]) -> list[Gap]:
    """Find the complete gaps along a path, their edges searched between the samples, too.

    Parameters
    ----------
    lines : list of Line
        Segments that a gap must span.

    Returns
    -------
    list of Gap
        Gaps wider than SMALLEST relative to their upper edge, ascending.
    """
    gaps = []
    for band in range(lines[0].value.shape[1] - 1):
        if not _may_open([line.value for line in lines], band):
            continue
        lower = max(line.extreme(band, 1).hz for line in lines)
        upper = min(line.extreme(band + 1, -1).hz for line in lines)
        if _is_open(lower, upper):
            gaps.append(Gap(band + 1, band + 2, lower, upper))
    return gaps


def directional_gaps(path: Path, lines: list[Line]) -> list[DirectionalGap]:
    """Find the gaps of each segment of a path alone.

    Parameters
    ----------
    path : Path
        Path that names the segments.
    lines : list of Line
        Its segments.

    Returns
    -------
    list of DirectionalGap
        Gaps of the first segment first, each segment's ascending.
    """
    gaps = []
    for segment, line in zip(path.segments, lines, strict=True):
        gaps += [DirectionalGap(**vars(gap), start=segment.start, end=segment.end) for gap in path_gaps([line])]
    return gaps


def zone_gaps(along: list[Gap], extreme: Callable[[int, int], Extreme]) -> list[BrillouinZoneGap]:
    """Select the gaps of a path that span the whole zone, with their edges there.

    Parameters
    ----------
    along : list of Gap
        Gaps along the path.
    extreme : callable
        Extreme of a band (from 0) over the zone: its largest frequency for sign 1, its smallest for -1.

    Returns
    -------
    list of BrillouinZoneGap
        Gaps that stay open, in the path's order.
    """
    gaps = []
    for gap in along:
        lower, upper = extreme(gap.lower_band - 1, 1), extreme(gap.upper_band - 1, -1)
        if _is_open(lower.hz, upper.hz):
            gaps.append(BrillouinZoneGap(gap.lower_band, gap.upper_band, lower.hz, upper.hz, _at(lower), _at(upper)))
    return gaps


def sampled_extreme(wavevectors: FloatArray, frequencies_hz: FloatArray, band: int, sign: int) -> Extreme:
    """Find the extreme of a band among its samples.

    Parameters
    ----------
    wavevectors : ndarray, shape (n, 2)
        Wavevectors in rad/m.
    frequencies_hz : ndarray, shape (n, bands)
        Frequencies there in Hz.
    band : int
        Number of the band, from 0.
    sign : int
        1 for the largest frequency, -1 for the smallest.

    Returns
    -------
    Extreme
        Frequency and wavevector of the best sample.
    """
    best = int(np.argmax(sign * frequencies_hz[:, band]))
    return Extreme(float(frequencies_hz[best, band]), wavevectors[best])


def searched_extreme(
    solve: Solve, wavevectors: FloatArray, frequencies_hz: FloatArray, band: int, sign: int
) -> Extreme:
    """Search the extreme of a band from the best of its samples, without a gradient.

    Parameters
    ----------
    solve : callable
        Frequencies (bands,) in Hz at a wavevector (2,) in rad/m.
    wavevectors : ndarray, shape (n, 2)
        Wavevectors of the samples in rad/m.
    frequencies_hz : ndarray, shape (n, bands)
        Frequencies there in Hz.
    band : int
        Number of the band, from 0.
    sign : int
        1 for the largest frequency, -1 for the smallest.

    Returns
    -------
    Extreme
        Frequency and wavevector, at least as extreme as the best sample.
    """
    from scipy.optimize import minimize  # slow to import

    best = sampled_extreme(wavevectors, frequencies_hz, band, sign)
    distance = np.linalg.norm(wavevectors - best.wavevector, axis=1)
    step = float(distance[distance > 0.0].min(initial=np.inf))
    if not np.isfinite(step):
        return best
    simplex = best.wavevector + step * np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]])
    options = {"initial_simplex": simplex, "maxfev": SIMPLEX_SOLVES, "xatol": CLOSE * step, "fatol": CLOSE**2 * best.hz}
    found = minimize(lambda k: -sign * solve(k)[band], best.wavevector, method="Nelder-Mead", options=options)
    return best if found.fun >= -sign * best.hz else Extreme(float(-sign * found.fun), found.x)


def _may_open(values: list[FloatArray], band: int) -> bool:
    """Whether the samples leave an opening above a band."""
    return max(v[:, band].max() for v in values) < min(v[:, band + 1].min() for v in values)


def _is_open(lower_hz: float, upper_hz: float) -> bool:
    return upper_hz - lower_hz > SMALLEST * upper_hz


def _at(extreme: Extreme) -> tuple[float, float]:
    return float(extreme.wavevector[0]), float(extreme.wavevector[1])


# -- gaps of one polarisation ------------------------------------------------------------------------------------------
# Frequencies without waves of one polarisation, along a path: flexural waves may be missing where others pass.
# A step of a branch between two samples counts for a polarisation when either of its ends has it; edges are then
# moved to the branch's extreme or to the wavevector where its label changes.

SHARP = 1e-5  # of a step: a label's change is not a smooth extreme
KNOWN = 1e-4  # relative: an edge where a label changes, well below the error of the reduction


@dataclass(frozen=True)
class PolarisationGap:
    """An interval without waves of a polarisation of the plate, Hz; other waves may pass."""

    polarisation: str
    lower_hz: float
    upper_hz: float


def labels_along(solved: Solved, branches: Branches) -> list[list[Label]]:
    """Label every wave at every wavevector, with pillars; at k = 0 for the direction of the path.

    Parameters
    ----------
    solved : Solved
        Waves of the lattice.
    branches : Branches
        Waves along a path.

    Returns
    -------
    list of list of Label
        Labels of the waves at each wavevector.
    """
    vectors = np.array([waves.wavevector for waves in branches.waves])
    labels = []
    for index, waves in enumerate(branches.waves):
        towards = vectors[index + 1 if index == 0 else index - 1]
        k = waves.wavevector if waves.wavevector.any() else 1e-6 * towards
        labels.append(_labels(solved, waves, k))
    return labels


def polarisation_gaps(solved: Solved, branches: Branches, labels: list[list[Label]]) -> list[PolarisationGap]:
    """Find the gaps of each polarisation that has waves below and above them, within the requested bands.

    Parameters
    ----------
    solved : Solved
        Waves of the lattice, solved further where an edge lies between samples.
    branches : Branches
        Waves along a path.
    labels : list of list of Label
        Labels of these waves, as of `labels_along`.

    Returns
    -------
    list of PolarisationGap
        Gaps wider than SMALLEST relative to their upper edge: flexural ones, then shear, then longitudinal.
    """
    ceiling = min(float(waves.eigenvalue[solved.count - 1]) for waves in branches.waves)
    gaps = []
    for name in ("flexural", "shear", "longitudinal"):
        steps = [step for step in _steps(branches, labels, name) if step.low < ceiling]
        gaps += [gap for gap in _openings(solved, steps, name) if gap.upper_hz - gap.lower_hz > SMALLEST * gap.upper_hz]
    return gaps


@dataclass(frozen=True)
class _Step:
    """A wave on its way from one sample to the next: the samples, its index at each, and which of them have the label."""

    start: Waves
    end: Waves
    at_start: int
    at_end: int
    holds: tuple[bool, bool]

    @cached_property
    def ends(self) -> tuple[float, float]:
        return float(self.start.eigenvalue[self.at_start]), float(self.end.eigenvalue[self.at_end])

    @property
    def low(self) -> float:
        return min(self.ends)

    @property
    def high(self) -> float:
        return max(self.ends)


def _steps(branches: Branches, labels: list[list[Label]], name: str) -> list[_Step]:
    """Steps with the label at either end, by their lower end."""
    steps = []
    for index in range(len(branches.waves) - 1):
        here, there = branches.waves[index : index + 2]
        places = {int(number): place for place, number in enumerate(branches.number[index + 1])}
        for place, number in enumerate(branches.number[index]):
            partner = places.get(int(number), place)  # a lost branch goes on with its band, which is continuous
            holds = labels[index][place].plate == name, labels[index + 1][partner].plate == name
            if any(holds):
                steps.append(_Step(here, there, place, partner, holds))
    return sorted(steps, key=lambda step: step.low)


def _openings(solved: Solved, steps: list[_Step], name: str) -> list[PolarisationGap]:
    openings, top = [], np.inf
    for count, step in enumerate(steps):
        if step.low > top:
            lower = _outermost(solved, [each for each in steps[:count] if each.high >= _near(top, step.low)], name, 1)
            above = [other for other in steps if _near(step.low, top) >= other.low > top]
            upper = _outermost(solved, above, name, -1)
            openings.append(PolarisationGap(name, _hz(solved.lattice, lower), _hz(solved.lattice, upper)))
        top = max(top, step.high) if count else step.high
    return openings


def _near(edge: float, other: float) -> float:
    """A tenth of the opening away from its edge on the far side: steps that reach there may move the edge."""
    return edge - 0.1 * (other - edge)


def _outermost(solved: Solved, steps: list[_Step], name: str, sign: int) -> float:
    """The largest (sign 1) or smallest edge of the steps, searched only where a step may yet reach further."""
    best = -np.inf
    bounded = [(_bound(solved, step, sign), step) for step in steps]
    for bound, step in sorted(bounded, key=lambda pair: -pair[0]):
        if bound <= best:
            break
        best = max(best, sign * _edge(solved, step, name, sign))
    return float(sign * best)


def _bound(solved: Solved, step: _Step, sign: int) -> float:
    """Upper bound of sign * eigenvalue on a step: its ends, or the intersection of the tangents at them."""
    ends, rates = sign * np.array(step.ends), sign * np.array(_rates(solved, step))
    at, beyond, before = np.array([0.0, 1.0]), np.array([rates[0], 0.0]), np.array([0.0, rates[1]])
    return float(max(ends.max(), tent_top(at, ends, beyond, before)[0])) if all(step.holds) else float(ends.max())


def _rates(solved: Solved, step: _Step) -> list[float]:
    """d lambda / d share of the step's wave at both ends."""
    along, rates = step.end.wavevector - step.start.wavevector, []
    for waves, place in ((step.start, step.at_start), (step.end, step.at_end)):
        slope = np.tensordot(along, solved.lattice.slopes(waves), axes=1)
        rates.append(float(slope[place, place].real))
    return rates


def _edge(solved: Solved, step: _Step, name: str, sign: int) -> float:
    """The largest (sign 1) or smallest eigenvalue with the label on a step and the samples at its ends."""
    ends = sign * np.array(step.ends)
    if all(step.holds):
        return sign * max(float(ends.max()), _inside(solved, step, sign))
    inner = ends[0] if step.holds[0] else ends[1]
    if inner >= ends.max():
        return float(sign * inner)
    return float(sign * max(inner, sign * _change(solved, step, name)))


def _inside(solved: Solved, step: _Step, sign: int) -> float:
    """The largest value of sign * eigenvalue strictly between the ends, where the slopes say that there may be one."""
    rates = _rates(solved, step)
    if not sign * rates[0] > 0.0 > sign * rates[1]:
        return -np.inf
    along = step.end.wavevector - step.start.wavevector
    best = -np.inf

    def rate(share: float) -> float:
        nonlocal best
        if share in (0.0, 1.0):
            return rates[int(share)]
        waves, place = _in_between(solved, step, share)
        best = max(best, sign * float(waves.eigenvalue[place]))
        return float(np.tensordot(along, solved.lattice.slopes(waves), axes=1)[place, place].real)

    root_between(rate, 0.0, 1.0, CLOSE)
    return best


def _change(solved: Solved, step: _Step, name: str) -> float:
    """Eigenvalue at the wavevector where the label is lost on the way, by bisection."""
    keeping, lost = (0.0, step.ends[0]), (1.0, step.ends[1])
    if not step.holds[0]:
        keeping, lost = lost, keeping
    while abs(keeping[0] - lost[0]) > SHARP and abs(keeping[1] - lost[1]) > KNOWN * keeping[1]:
        middle = (keeping[0] + lost[0]) / 2.0
        waves, place = _in_between(solved, step, middle)
        here = middle, float(waves.eigenvalue[place])
        label = _labels(solved, waves, waves.wavevector)[place]
        keeping, lost = (here, lost) if label.plate == name else (keeping, here)
    return keeping[1]


def _in_between(solved: Solved, step: _Step, share: float) -> tuple[Waves, int]:
    """The waves between the samples, and which is the step's: the likest to its two ends, each by how near it is."""
    waves = solved(step.start.wavevector + share * (step.end.wavevector - step.start.wavevector))
    like = (1.0 - share) * modal_overlap(solved.lattice, step.start, waves)[step.at_start]
    like = like + share * modal_overlap(solved.lattice, step.end, waves)[step.at_end]
    return waves, int(like.argmax())


def _labels(solved: Solved, waves: Waves, wavevector: FloatArray) -> list[Label]:
    """Labels of the waves, named for a wavevector (2,)."""
    vectors = np.tile(np.asarray(wavevector, dtype=complex)[:, None], len(waves.eigenvalue))
    return label_of(solved.lattice.cell, waves.dofs, vectors, with_pillars=True)
