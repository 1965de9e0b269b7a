"""Error bar of the quality factor that is read from a response's peak."""

from __future__ import annotations

import numpy as np

from geometry.elements import FloatArray
from pipeline.planning import calibration
from solvers.driven.error_bars import Louder, Variation, frequency_errors, half_widths, is_known, sources
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.height import height_error
from solvers.piezo.peaks import Peak, curve_about, near_hz, peak_of

DECAYED = 4.0  # half-power widths to both sides of a peak: where its quality factor is read
AROUND_PEAK = 65  # points over them, and more at the peak


def quality_error(forced: ForcedPlate, peak: Peak) -> float | None:
    """Compute the half-width of the bar of a peak's quality factor; None where it is not known.

    The damping is given and not judged. A peak is wider or narrower than its own mode where neighbours carry some of the
    response: the factor is read again on plates whose resonances lie elsewhere within their bars, whose modes are mixed within
    them, and whose patches push harder by the error of their loads. The change by a finer curve is added.

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
        return _read(each.of(forced), peak.frequency_hz * each.own)

    nominal, load = _read(forced, peak.frequency_hz), height_error(forced, peak.frequency_hz)
    half = half_widths(nominal, sources(forced, errors, peak.frequency_hz, share, load), again)
    error = float(half[0] + abs(nominal[0] - peak.quality_factor))
    return error if np.isfinite(error) else None


def _read(forced: ForcedPlate, tone: float) -> FloatArray:
    """The quality factor of a peak near a frequency, (1,); NaN where the curve has no half-power points there."""
    top = near_hz(forced, tone)
    reach = DECAYED * top * forced.loss
    found = peak_of(curve_about(forced, top - reach, top + reach, AROUND_PEAK, [top]), top)
    return np.array([np.nan if found.quality_factor is None else found.quality_factor])
