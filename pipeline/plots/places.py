"""Fields over places of the touch face, as a finger finds them there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.plots import style
from pipeline.units import MM

LOOK = {"shading": "nearest", "rasterized": True}


def panels(count: int, width_m: float | None) -> tuple[Any, list[Any]]:
    """Return a figure and axes for fields one below another, with the zone's borders where its width is known."""
    figure, grid = style.panels(2.4 * count + 0.4, count, 1, squeeze=False)
    sides = () if width_m is None else (-width_m / 2.0, width_m / 2.0)
    for axes in grid[:, 0]:
        for y_m in sides:
            axes.axhline(y_m / MM, color="black", lw=0.6, ls="--")
    return figure, list(grid[:, 0])


def field(axes: Any, x_m: Sequence[float], y_m: Sequence[float], values: Any, label: str, title: str) -> None:
    """Draw a field over places, x first; nothing where it is None."""
    shown = np.ma.masked_invalid(np.array(values, dtype=float).T)
    image = axes.pcolormesh(np.array(x_m) / MM, np.array(y_m) / MM, shown, cmap=style.QUALITY, **LOOK)
    style.mm_axes(axes)
    axes.set_title(title)
    axes.set_anchor("W")
    axes.figure.colorbar(image, cax=axes.inset_axes((1.03, 0.0, 0.03, 1.0)), label=label)
