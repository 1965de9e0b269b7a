"""The rational fit of a resonance against exact responses."""

from __future__ import annotations

import math

import numpy as np
import pytest

POINTS, SPAN = 33, 105.0


def fitted(core, response: np.ndarray, span_hz: float = SPAN):
    fit = core.ffi.new("an_resonance *")
    points = core.ffi.new("an_complex []", [{"re": z.real, "im": z.imag} for z in response.tolist()])
    return fit if core.lib.an_resonance_fit(fit, points, len(response), span_hz) else None


def one_mode(offset_hz: float, tau_s: float, gain: complex, points: int = POINTS) -> np.ndarray:
    away = np.linspace(-SPAN, SPAN, points) - offset_hz
    return gain / (1.0 + 2j * np.pi * tau_s * away)


@pytest.mark.parametrize("offset_hz", [-60.0, 0.0, 31.7])
@pytest.mark.parametrize("tau_s", [1.5e-3, 3.04e-3, 6e-3])
def test_exact_response_gives_back_its_mode(core, offset_hz: float, tau_s: float) -> None:
    gain = 0.8 * np.exp(-0.7j)
    fit = fitted(core, one_mode(offset_hz, tau_s, gain))
    assert fit.offset_hz == pytest.approx(offset_hz, abs=2e-3)
    assert fit.tau_s == pytest.approx(tau_s, rel=1e-4)
    assert complex(fit.gain.re, fit.gain.im) == pytest.approx(gain, rel=2e-4)
    assert fit.misfit < 1e-5


def test_background_of_neighbours_does_not_bias_it(core) -> None:
    away = np.linspace(-SPAN, SPAN, POINTS)
    background = sum(
        g / (1.0 + 2j * np.pi * 3e-3 * (away - offset)) for g, offset in ((0.2, -700.0), (-0.3, 900.0), (0.2, 1500.0))
    )
    fit = fitted(core, one_mode(10.0, 3.04e-3, 0.8) + background + 0.01)
    assert fit.offset_hz == pytest.approx(10.0, abs=0.05)
    assert fit.tau_s == pytest.approx(3.04e-3, rel=2e-3)
    assert abs(complex(fit.gain.re, fit.gain.im) - 0.8) < 2e-3


def test_noise_costs_what_its_share_of_the_peak_suggests(core) -> None:
    random = np.random.default_rng(3)
    errors = []
    for _ in range(40):
        noise = 1e-3 * (random.normal(size=POINTS) + 1j * random.normal(size=POINTS))
        fit = fitted(core, one_mode(0.0, 3.04e-3, 1.0) + noise)
        errors.append((fit.offset_hz, fit.tau_s / 3.04e-3 - 1.0, abs(complex(fit.gain.re, fit.gain.im)) - 1.0))
    offset_hz, tau, gain = np.sqrt(np.mean(np.square(errors), axis=0))
    assert offset_hz < 0.1 and tau < 5e-3 and gain < 5e-3
    assert offset_hz > 1e-3  # the noise was there


def test_responses_without_a_resonance_are_refused(core) -> None:
    assert fitted(core, np.zeros(POINTS, complex)) is None
    for value in (math.nan, math.inf):
        assert fitted(core, np.full(POINTS, value + 0j)) is None
    growing = one_mode(0.0, 3.04e-3, 1.0).conj()  # a pole on the other side: a motion that grows
    assert fitted(core, growing) is None
    flat = fitted(core, np.ones(POINTS, complex))
    assert flat is None or not math.isfinite(flat.tau_s) or flat.misfit < 1.0
