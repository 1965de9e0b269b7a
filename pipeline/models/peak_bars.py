"""Error bars of a response: of its curves, and of a peak's quality factor and level over the passive face."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.accuracy import calibration
from solvers.control.identification import half_power_points
from solvers.driven.curve_bars import doubts, rms_bars, with_peak
from solvers.driven.error_bars import (
    Louder,
    Variation,
    WidthRates,
    frequency_errors,
    half_widths,
    is_known,
    louder,
    variations,
    width_rates,
)
from solvers.driven.forms import face_grams
from solvers.measures.confinement import ratio_db
from solvers.piezo.forced import Curve, ForcedPlate
from solvers.piezo.peak_errors import height_error
from solvers.piezo.responses import Peak, curve_about, near_hz, peak_of

DECAYED = 4.0  # half-power widths to both sides of a peak: where its quality factor is read
AROUND_PEAK = 65  # points over them, and more at the peak
FIRST_ORDER = 0.05  # of a change: what its second order may add where the plate is not computed again


def quality_error(forced: ForcedPlate, peak: Peak) -> float | None:
    """Compute the half-width of the bar of a peak's quality factor; None where it is not known.

    The damping is given and not judged. A peak is wider or narrower than its own mode where neighbours carry some of the
    response: the factor is read again on plates whose resonances lie elsewhere within their bars, whose modes are mixed within
    them, and whose patches push harder by the error of their loads; to first order where that is enough. The change by a finer
    curve is added.

    Parameters
    ----------
    forced : ForcedPlate
    peak : Peak
        A peak of its response.
    """
    share, errors = calibration.mixing(), frequency_errors(forced)
    if peak.quality_factor is None or share is None or not is_known(errors):
        return None

    def again(each: Variation | Louder) -> FloatArray:
        return _quality(*_curve(each.of(forced), peak.frequency_hz * each.own))

    top, curve = _curve(forced, peak.frequency_hz)
    nominal, load = _quality(top, curve), height_error(forced, peak.frequency_hz)
    ends = half_power_points(
        curve.frequency_hz, curve.zone_rms_m_per_v, int(np.argmin(np.abs(curve.frequency_hz - top)))
    )
    far, near = 0.0, list(variations(forced, errors, peak.frequency_hz, share))
    if ends is not None:
        far, near = _parted(width_rates(forced, top, ends), near)
    rest: Iterable[tuple[Variation | Louder, ...]] = chain(near, louder(forced, np.nan if load is None else load))
    half = half_widths(nominal, rest, again)
    error = float(np.hypot(half[0], far * nominal[0]) + abs(nominal[0] - peak.quality_factor))
    return error if np.isfinite(error) else None


def level_error_db(forced: ForcedPlate, peak: Peak) -> float | None:
    """Compute the half-width of the bar of a peak's level over the passive face, dB, the peak following its mode.

    None where it is not known, as where a charge feeds the drivers.
    """
    known = doubts(forced, calibration.mixing())
    if known is None or peak.passive_rms is None or forced.circuit != "short":
        return None

    def level(squares: ComplexArray) -> FloatArray:
        zone, passive = np.sqrt(squares[..., 0, 0].real)
        return ratio_db(zone, passive)[None]

    fed = forced.signs[forced.drivers].astype(complex)
    error = float(with_peak(known, forced, face_grams(forced), peak.frequency_hz, fed, level)[0])
    return error if np.isfinite(error) else None


def curve_errors(forced: ForcedPlate, curve: Curve) -> FloatArray | None:
    """Compute the half-widths of the bars of a curve's rms at its own frequencies, zone and passive face, (1 or 2, n) in m/V.

    None where they are not known, as where a charge feeds the drivers.
    """
    known = doubts(forced, calibration.mixing())
    if known is None or forced.circuit != "short":
        return None
    fed = forced.signs[forced.drivers].astype(complex)
    (half,) = rms_bars(known, forced, face_grams(forced), curve.frequency_hz, fed[None])
    return half if np.isfinite(half).all() else None


def _parted(rates: WidthRates, every: list[tuple[Variation, ...]]) -> tuple[float, list[tuple[Variation, ...]]]:
    """Relative half-width by all sources whose change is that of first order, and the other sources."""
    far: list[float] = []
    near: list[tuple[Variation, ...]] = []
    for source in every:
        if max(rates.ratio(each) for each in source) <= FIRST_ORDER:
            far.append(max(abs(rates.change(each)) for each in source))
        else:
            near.append(source)
    return float(np.linalg.norm(far)), near


def _quality(top: float, curve: Curve) -> FloatArray:
    """The quality factor of a curve's peak, (1,); NaN where the curve has no half-power points there."""
    found = peak_of(curve, top).quality_factor
    return np.array([np.nan if found is None else found])


def _curve(forced: ForcedPlate, tone: float) -> tuple[float, Curve]:
    """A peak near a frequency, Hz, and the response about it."""
    top = near_hz(forced, tone)
    reach = DECAYED * top * forced.loss
    return top, curve_about(forced, top - reach, top + reach, AROUND_PEAK, [top])
