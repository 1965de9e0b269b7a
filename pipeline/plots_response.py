"""Forced response: rms per volt on zone and passive face, the sensor's amplitude and phase, the operating shape."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipeline import plots
from pipeline.plots import Drawing
from pipeline.records import StoredCase

KHZ, NM, MM = 1e-3, 1e9, 1e3


def response(case: StoredCase, arrays: dict[str, Any]) -> Drawing | None:
    """The response of a case's record."""
    found = case.record.get("response")
    return curves(found, arrays.get("response_xy"), arrays.get("response_uz")) if found else None


def curves(found: dict[str, Any], points: Any = None, shape: Any = None) -> Drawing:
    """Curves over frequency, and the operating shape at the peak when its field is there."""
    has_sensor = found["sensor_V_per_V"] is not None
    count = 1 + has_sensor + (shape is not None)
    figure = plots.new_figure(plots.WIDTH_IN, 2.3 * count + 0.6)
    panels = list(np.atleast_1d(figure.subplots(count, 1)))
    tone = KHZ * np.array(found["frequency_hz"])
    _amplitudes(panels[0], tone, found)
    if has_sensor:
        _sensor(panels[1], tone, found)
    if shape is not None:
        _shape(panels[-1], points, shape, found)
    return Drawing("response", "Response per volt of drive", _alt(found), figure, vector=shape is None)


def _amplitudes(axes: Any, tone: Any, found: dict[str, Any]) -> None:
    axes.semilogy(tone, NM * np.array(found["zone_rms_m_per_V"]), color=plots.BLUE, label="zone")
    if found["passive_rms_m_per_V"] is not None:
        axes.semilogy(
            tone, NM * np.array(found["passive_rms_m_per_V"]), color=plots.VERMILION, ls="--", label="passive face"
        )
    wanted, highest = found["wanted_peak"], found["highest_peak"]
    for peak, style in ((wanted, ":"), (highest, "-.")) if wanted else ((highest, "-."),):
        axes.axvline(KHZ * peak["frequency_hz"], color=plots.GREY, ls=style, lw=0.8)
    axes.set_ylabel("rms u_z (nm/V)")
    axes.set_xlabel("frequency (kHz)")
    other = f"highest peak at {KHZ * highest['frequency_hz']:.2f} kHz (dash-dotted)"
    own = f"Wanted mode's peak at {KHZ * wanted['frequency_hz']:.2f} kHz (dotted), " if wanted else ""
    axes.set_title(own + other if own else other.capitalize())
    axes.grid(True)
    axes.legend(fontsize=8)


def _sensor(axes: Any, tone: Any, found: dict[str, Any]) -> None:
    volts = np.array(found["sensor_V_per_V"]) @ np.array([1.0, 1j])
    axes.semilogy(tone, np.abs(volts), color=plots.GREEN)
    axes.set_ylabel("sensor (V/V)")
    axes.set_xlabel("frequency (kHz)")
    axes.grid(True)
    phase = axes.twinx()
    phase.plot(tone, np.degrees(np.unwrap(np.angle(volts))), color=plots.ORANGE, ls="--")
    phase.set_ylabel("phase (°)", color=plots.ORANGE)
    phase.spines["right"].set_visible(True)
    axes.set_title(f"Sensor patch {found['sensors'][0]}, open circuit")


def shown_peak(found: dict[str, Any]) -> dict[str, Any]:
    """The wanted mode's peak; the highest where the band has none."""
    return found["wanted_peak"] or found["highest_peak"]


def _shape(axes: Any, points: Any, shape: Any, found: dict[str, Any]) -> None:
    turned = shape * np.exp(-1j * np.angle(shape[np.argmax(np.abs(shape))]))
    limit = NM * np.abs(shape).max()
    x, y = np.unique(points[:, 0]), np.unique(points[:, 1])
    field = NM * turned.real.reshape(len(x), len(y)).T
    image = axes.pcolormesh(
        MM * x, MM * y, field, cmap=plots.SIGNED, vmin=-limit, vmax=limit, shading="gouraud", rasterized=True
    )
    plots.mm_axes(axes)
    axes.set_title(f"Operating shape at {KHZ * shown_peak(found)['frequency_hz']:.2f} kHz")
    axes.figure.colorbar(image, ax=axes, label="u_z (nm/V)")


def _alt(found: dict[str, Any]) -> str:
    peak, whose = shown_peak(found), "the wanted mode peaks" if found["wanted_peak"] else "the zone peaks highest"
    held = "" if peak["confinement_db"] is None else f", {peak['confinement_db']:.1f} dB above the passive face"
    quality = "" if peak["quality"] is None else f", quality factor {peak['quality']:.0f} read from the curve"
    return (
        f"Displacement per volt over frequency: {whose} at {KHZ * peak['frequency_hz']:.2f} kHz with "
        f"{NM * peak['zone_rms_m_per_V']:.2f} nm/V rms{held}{quality}"
    )
