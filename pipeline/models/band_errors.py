"""Error bars of what is read from bands: the edges of gaps, and the widest bar of all bands along the path."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.lattice import Path
from pipeline.planning.error_bar import WidestBar
from pipeline.quantity import figure
from solvers.waves.gaps import DirectionalGap, Gap

SAMPLED = 0.5  # of the larger step to a neighbouring sample: a kink half-way between two samples rises by no more


def edge_error(frequency_hz: FloatArray, error: FloatArray, edge_hz: float, sign: int) -> float | None:
    """Bound the relative error of a gap's edge, an extreme of a band.

    With f (1 - e) <= f_exact <= f (1 + e) at every wavevector, max f_exact lies between f_m (1 - e_m), m the wavevector of
    the largest f, and max f (1 + e).

    Parameters
    ----------
    frequency_hz, error : ndarray, shape (n,)
        The band in Hz and the relative half-widths of its bars; NaN where unknown.
    edge_hz : float
        The extreme, which may lie between two of the wavevectors.
    sign : int
        1 for the maximum of the band below the gap, -1 for the minimum of the one above.

    Returns
    -------
    float or None
        Relative half-width of the edge's bar; None where one of the bars is unknown.
    """
    if not len(error) or np.isnan(error).any() or edge_hz <= 0.0:
        return None
    own = float(error[np.argmax(sign * frequency_hz)])
    farthest = float((sign * frequency_hz + error * frequency_hz).max())
    return max(own, (farthest - sign * edge_hz) / edge_hz)


def gap_errors(gap: Gap, frequencies_hz: FloatArray, errors: FloatArray) -> dict[str, float | None]:
    """Return `lower_error` and `upper_error` of a gap of bands (wavevectors, bands) with their bars, relative."""
    lower, upper = gap.lower_band - 1, gap.upper_band - 1
    return {
        "lower_error": edge_error(frequencies_hz[:, lower], errors[:, lower], gap.lower_hz, 1),
        "upper_error": edge_error(frequencies_hz[:, upper], errors[:, upper], gap.upper_hz, -1),
    }


def nearest_error(frequencies_hz: FloatArray, errors: FloatArray, edge_hz: float) -> float | None:
    """Relative half-width of the bar of the frequency nearest to an edge, over all bands (wavevectors, bands)."""
    error = float(errors.flat[np.argmin(np.abs(frequencies_hz - edge_hz))])
    return None if np.isnan(error) else error


def of_samples(path: Path, frequencies_hz: FloatArray) -> FloatArray:
    """Bound how far a band's extreme may lie beyond its samples, relative, (wavevectors, bands).

    Half of the larger step to a neighbour on the same segment; 0 at a segment's ends, where a band is extreme by symmetry.
    """
    steps = np.zeros_like(frequencies_hz)
    for segment in path.segments:
        here = frequencies_hz[segment.first : segment.last + 1]
        change = np.abs(np.diff(here, axis=0))
        steps[segment.first + 1 : segment.last] = np.maximum(change[:-1], change[1:])
    return np.asarray(SAMPLED * steps / np.maximum(frequencies_hz, 1e-300))


def widest(path: Path, by_mesh: FloatArray, truncated: FloatArray) -> WidestBar:
    """Find the widest bar of the bands (wavevectors, bands) along a path."""
    total = by_mesh + truncated
    if not total.size or np.isnan(total).any():
        return WidestBar(None)
    point, band = (int(index) for index in np.unravel_index(np.argmax(total), total.shape))
    where = path.labels[point] or "k = ({}, {}) rad/m".format(*map(figure, path.wavevectors[point]))
    parts = {"mesh": float(by_mesh[point, band]), "truncation": float(truncated[point, band])}
    return WidestBar(float(total[point, band]), f"band {band + 1} at {where}", parts)


def with_edges(gaps: Sequence[Any], path: Path, frequencies_hz: FloatArray, errors: FloatArray) -> list[dict[str, Any]]:
    """The fields of gaps with the bars of their edges: of their bands, else of the frequency nearest to an edge."""
    return [vars(gap) | _edges(gap, path, frequencies_hz, errors) for gap in gaps]


def _edges(gap: Any, path: Path, frequencies_hz: FloatArray, errors: FloatArray) -> dict[str, float | None]:
    if isinstance(gap, DirectionalGap):
        own = next(each for each in path.segments if (each.start, each.end) == (gap.start, gap.end))
        here = slice(own.first, own.last + 1)
        return gap_errors(gap, frequencies_hz[here], errors[here])
    if isinstance(gap, Gap):
        return gap_errors(gap, frequencies_hz, errors)
    sides = ("lower", "upper")
    return {f"{side}_error": nearest_error(frequencies_hz, errors, getattr(gap, f"{side}_hz")) for side in sides}
