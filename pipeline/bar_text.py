"""A figure with its error bar in words."""

from __future__ import annotations


def with_bar(value: float, error: float | None, unit: str = "", digits: str = ".3g", sign: str = "") -> str:
    """Return `value ± error unit`, both in the same unit; the value alone to `digits` where its error is not known."""
    tail = f" {unit}" if unit else ""
    if error is None:
        return f"{value:{sign}{digits}}{tail}"
    if not error:
        return f"{value:{sign}{digits}} ± 0{tail}"
    places = max(0, 1 - _exponent(error))
    if places > 12 or abs(value) >= 1e6:
        return f"{value:{sign}.3g} ± {error:.2g}{tail}"
    return f"{value:{sign}.{places}f} ± {error:.{places}f}{tail}"


def _exponent(value: float) -> int:
    return int(f"{value:.1e}".partition("e")[2])
