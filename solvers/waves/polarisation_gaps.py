"""Frequencies without waves of one polarisation, along a path: flexural waves may be missing where others pass.

A step of a branch between two samples counts for a polarisation when either of its ends has it; edges are then moved to
the branch's extreme or to the wavevector where its label changes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray
from solvers.analytic.root_finding import root_between
from solvers.superelement.lattice import Waves
from solvers.waves.branches import Branches, Solved, modal_overlap
from solvers.waves.gaps import SMALLEST
from solvers.waves.polarisation import Label, label_of
from solvers.waves.refine import CLOSE, tent_top

SHARP = 1e-5  # of a step: a label's change is no smooth extreme
KNOWN = 1e-4  # relative: an edge where a label changes, well below what the reduction is good for


@dataclass(frozen=True)
class PolarisationGap:
    """An interval without waves of a polarisation of the plate, Hz; other waves may pass."""

    polarisation: str
    lower_hz: float
    upper_hz: float


def labels_along(solved: Solved, branches: Branches) -> list[list[Label]]:
    """Labels of every wave at every wavevector, pillars told; at k = 0 for the direction of the path."""
    vectors = np.array([waves.wavevector for waves in branches.waves])
    labels = []
    for index, waves in enumerate(branches.waves):
        towards = vectors[index + 1 if index == 0 else index - 1]
        k = waves.wavevector if waves.wavevector.any() else 1e-6 * towards
        labels.append(_labels(solved, waves, k))
    return labels


def polarisation_gaps(solved: Solved, branches: Branches, labels: list[list[Label]]) -> list[PolarisationGap]:
    """Gaps of each polarisation that has waves below and above them, within the bands asked for."""
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

    @property
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
    openings = []
    reached = steps[:1]
    for step in steps[1:]:
        top = max(below.high for below in reached)
        if step.low > top:
            lower = _outermost(solved, [below for below in reached if below.high >= _near(top, step.low)], name, 1)
            above = [other for other in steps if _near(step.low, top) >= other.low > top]
            upper = _outermost(solved, above, name, -1)
            openings.append(PolarisationGap(name, _hz(solved, lower), _hz(solved, upper)))
        reached.append(step)
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
    """What sign * eigenvalue stays below on a step: its ends, or where the tangents at them meet."""
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
        value, label = _between(solved, step, middle)
        keeping, lost = ((middle, value), lost) if label.plate == name else (keeping, (middle, value))
    return keeping[1]


def _between(solved: Solved, step: _Step, share: float) -> tuple[float, Label]:
    """Eigenvalue and label of the step's wave on the way."""
    waves, place = _in_between(solved, step, share)
    return float(waves.eigenvalue[place]), _labels(solved, waves, waves.wavevector)[place]


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


def _hz(solved: Solved, eigenvalue: float) -> float:
    return float(solved.lattice.cell.scale.frequency(np.array(eigenvalue)))
