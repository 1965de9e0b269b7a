"""Units and formatting of figures: as many digits as the error bar allows, in a suitable unit.

Files keep full precision; terminal, pages and `run.mess` format every computed figure here.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import floor, isfinite, log10, pi
from typing import NamedTuple

CM, MM, UM, NM = 1e-2, 1e-3, 1e-6, 1e-9  # m
MS, US = 1e-3, 1e-6  # s
KHZ = 1e3
GPA = 1e9
GRAM = 1e-3  # kg
GIB = 2.0**30  # bytes
DEGREE = pi / 180.0  # rad

FEW = 3  # significant digits of a figure without an error bar
MOST = 7  # largest number of significant digits: an error bar excludes round-off
TWO_DIGITS_BELOW = 3.55  # leading digits of an error bar from which one digit is enough
SMALLEST, LARGEST = -4, 9  # powers of ten between which a figure is written without an exponent
UNKNOWN = "–"


class Unit(NamedTuple):
    """A unit with its symbol and its size in SI."""

    symbol: str
    size: float


HZ = Unit("Hz", 1.0)


FREQUENCY_UNITS = (Unit("GHz", 1e9), Unit("MHz", 1e6), Unit("kHz", KHZ), HZ)


def several(count: int, noun: str, shown: str | None = None) -> str:
    """Write a count with its noun, in the plural unless it is one; `shown` in the place of the digits."""
    ending = "" if count == 1 else "es" if noun.endswith("ch") else "s"
    return f"{count if shown is None else shown} {noun}{ending}"


def is_known(value: float | None) -> bool:
    """Whether a value or an error bar is a finite number."""
    return value is not None and isfinite(value)


def decimals(value: float, bar: float | None) -> int:
    """Count the decimals of a figure that its error bar allows; negative left of the decimal point.

    An error bar keeps two digits if these are 10 to 35 and one otherwise; its figure has the same decimals, so that
    rounding moves a figure by at most a seventh of its error bar. A figure without one has three significant digits.

    Parameters
    ----------
    value, bar : float
        The figure and its error bar (half-width) in the same unit; None or infinite without an estimate.

    References
    ----------
    .. [1] pdg2024 (docs/references.bib), section 5.3 of its introduction
    """
    highest = _exponent(value)
    if bar is None or not isfinite(bar):
        return FEW - 1 - highest
    if bar <= 0.0:
        return MOST - 1 - highest if value else 0
    last = _exponent(bar)
    return min((bar / 10.0**last < TWO_DIGITS_BELOW) - last, MOST - 1 - highest)


def figure(value: float | None, bar: float | None = None) -> str:
    """Format a value with the digits that its error bar allows.

    Parameters
    ----------
    value, bar : float or None
        The figure and its error bar (half-width) in the same unit; None without an estimate, 0 for an exact figure.

    Returns
    -------
    str
        A dash for None.

    Examples
    --------
    >>> from pipeline.quantity import figure
    >>> figure(33.49412, 0.11), figure(33.49412, 0.0004), figure(33.49412)
    ('33.49', '33.4941', '33.5')
    """
    if value is None or not isfinite(value):
        return UNKNOWN
    places, highest = decimals(value, bar), _exponent(value)
    if not SMALLEST <= highest <= LARGEST and places + highest >= 0:
        return f"{value:.{places + highest}e}"
    text = _fixed(value, places)
    return text.rstrip("0").rstrip(".") if bar is not None and bar <= 0.0 and "." in text else text


def with_bar(value: float | None, bar: float | None, unit: str = "", space: str = " ") -> str:
    """Format a value, its error bar with the same decimals if known, and their unit.

    >>> from pipeline.quantity import with_bar
    >>> with_bar(12.2519, 0.512, "dB"), with_bar(12.2519, None, "dB")
    ('12.3 ± 0.5 dB', '12.3 dB')
    """
    end = f"{space}{unit}" if unit else ""
    if value is None or bar is None or not (isfinite(value) and isfinite(bar)) or bar <= 0.0:
        return figure(value, bar) + (end if is_known(value) else "")
    places = decimals(value, bar)
    return f"{_fixed(value, places)}{space}±{space}{_fixed(bar, places)}{end}"


def signed(text: str) -> str:
    """Put a plus sign before the text of a figure that is not negative.

    >>> from pipeline.quantity import signed, with_bar
    >>> signed(with_bar(21.4, 3.2, "Hz")), signed(with_bar(-21.4, None, "Hz"))
    ('+21.4 ± 3.2 Hz', '-21.4 Hz')
    """
    return text if text.startswith(("-", UNKNOWN)) else f"+{text}"


def frequency_unit(frequencies_hz: Iterable[float | None]) -> Unit:
    """Return the unit, Hz to GHz, in which the largest of some frequencies reads as 1 or more."""
    known = [abs(value) for value in frequencies_hz if value is not None and isfinite(value)]
    return next((unit for unit in FREQUENCY_UNITS if known and max(known) >= unit.size), FREQUENCY_UNITS[-1])


def frequency_figure(frequency_hz: float | None, error: float | None, unit: Unit) -> str:
    """Format a frequency in a unit without the unit; a dash if the error bar is as large as the frequency.

    Parameters
    ----------
    frequency_hz : float or None
    error : float or None
        Relative error bar (half-width); None without an estimate.
    unit : Unit
    """
    if frequency_hz is None or (error is not None and isfinite(error) and error >= 1.0):
        return UNKNOWN
    return figure(frequency_hz / unit.size, _absolute(frequency_hz / unit.size, error))


def frequency(frequency_hz: float | None, error: float | None = None, space: str = " ") -> str:
    """Format a frequency with the digits that its relative error bar allows, in a suitable unit.

    >>> from pipeline.quantity import frequency
    >>> frequency(219.3012, 6.6e-4), frequency(33494.12, 3.3e-3), frequency(33494.12)
    ('219.30 Hz', '33.49 kHz', '33.5 kHz')
    """
    unit = frequency_unit([frequency_hz])
    text = frequency_figure(frequency_hz, error, unit)
    return text if text == UNKNOWN else f"{text}{space}{unit.symbol}"


def frequency_with_bar(frequency_hz: float | None, error: float | None = None, space: str = " ") -> str:
    """Format a frequency and its error bar, if known, in a suitable unit.

    >>> from pipeline.quantity import frequency_with_bar
    >>> frequency_with_bar(219.3012, 6.6e-4), frequency_with_bar(33494.12)
    ('219.30 ± 0.14 Hz', '33.5 kHz')
    """
    if frequency_hz is None or not is_known(error) or error is None or error >= 1.0:
        return frequency(frequency_hz, error, space)
    unit = frequency_unit([frequency_hz])
    value = frequency_hz / unit.size
    return with_bar(value, _absolute(value, error), unit.symbol, space)


def interval(
    low_hz: float, high_hz: float, low_error: float | None = None, high_error: float | None = None, *,
    to: str = " to ", space: str = " ",
) -> str:  # fmt: skip
    """Format an interval of frequencies in one unit, each end with the digits that its relative error bar allows.

    >>> from pipeline.quantity import interval
    >>> interval(519.21, 548.77, 8e-4, 4e-3)
    '519.2 to 548.8 Hz'
    """
    unit = frequency_unit([low_hz, high_hz])
    low, high = frequency_figure(low_hz, low_error, unit), frequency_figure(high_hz, high_error, unit)
    return f"{low}{to}{high}{space}{unit.symbol}"


def level(level_db: float | None, bar_db: float | None = None, space: str = " ") -> str:
    """Format a level in dB; without an error bar it has one decimal.

    >>> from pipeline.quantity import level
    >>> level(12.2519, 0.06), level(12.2519), level(None)
    ('12.25 dB', '12.3 dB', '–')
    """
    text = level_figure(level_db, bar_db)
    return text if text == UNKNOWN else f"{text}{space}dB"


def level_with_bar(level_db: float | None, bar_db: float | None = None, space: str = " ") -> str:
    """Format a level in dB and its error bar, if known; without one it has one decimal.

    >>> from pipeline.quantity import level_with_bar
    >>> level_with_bar(12.2519, 0.512), level_with_bar(12.2519)
    ('12.3 ± 0.5 dB', '12.3 dB')
    """
    return with_bar(level_db, bar_db, "dB", space) if is_known(bar_db) else level(level_db, None, space)


def level_figure(level_db: float | None, bar_db: float | None = None) -> str:
    """Format a level without its unit; without an error bar it has one decimal."""
    if level_db is None or not isfinite(level_db):
        return UNKNOWN
    return figure(level_db, bar_db) if is_known(bar_db) else _fixed(level_db, 1)


def percentage(ratio: float | None, bar: float | None = None, space: str = " ") -> str:
    """Format a ratio in percent with the digits that its error bar allows, both relative to 1.

    >>> from pipeline.quantity import percentage
    >>> percentage(0.87349, 0.0021), percentage(0.87349), percentage(None)
    ('87.35 %', '87.3 %', '–')
    """
    if ratio is None or not isfinite(ratio):
        return UNKNOWN
    return f"{figure(100.0 * ratio, None if bar is None else 100.0 * bar)}{space}%"


def percent(error: float | None, space: str = " ") -> str:
    """Format a relative error bar in percent with two digits.

    >>> from pipeline.quantity import percent
    >>> percent(0.00113), percent(0.000997), percent(1.2e-6), percent(None)
    ('0.11 %', '0.10 %', '0.00012 %', '–')
    """
    if error is None or not isfinite(error):
        return UNKNOWN
    shown = float(f"{100.0 * error:.1e}")  # two digits, of 0.0996 too: 0.10
    return f"{_fixed(shown, 1 - _exponent(shown))}{space}%"


def _exponent(value: float) -> int:
    return floor(log10(abs(value))) if value else 0


def _fixed(value: float, places: int) -> str:
    return f"{round(value, places):z.{max(places, 0)}f}"


def _absolute(value: float, error: float | None) -> float | None:
    return None if error is None else abs(value) * error
