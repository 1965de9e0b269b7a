"""The three-parameter fit against exact tones and against numpy's least squares."""

from __future__ import annotations

import math

import numpy as np
import pytest

RATE, WINDOW, TURN = 250e3, 46, 2.0**32
RANDOM = np.random.default_rng(7)


def phases(step: int, first: int) -> np.ndarray:
    return np.array([(first + n * step) % 2**32 for n in range(WINDOW)], dtype=np.uint64)


def tone(step: int, first: int, phasor: complex, offset: float) -> np.ndarray:
    angle = 2.0 * math.pi * phases(step, first) / TURN
    return phasor.real * np.cos(angle) - phasor.imag * np.sin(angle) + offset


def fit(core, step: int, first: int, samples: np.ndarray) -> tuple[complex, float]:
    demod, sums = core.ffi.new("an_demod *"), core.ffi.new("an_sums *")
    assert core.lib.an_demod_plan(demod, step, WINDOW, 1.0)
    cosine, sine, offset = np.float32(0), np.float32(0), np.float32(0)
    for phase, sample in zip(phases(step, first).tolist(), samples.astype(np.float32), strict=True):
        carrier = core.lib.an_turn(phase)
        cosine += sample * np.float32(carrier.re)
        sine += sample * np.float32(carrier.im)
        offset += sample
    sums.cosine, sums.sine, sums.offset = float(cosine), float(sine), float(offset)
    result = core.lib.an_demod_fit(demod, sums, int(phases(step, first)[-1]))
    return complex(result.tone.re, result.tone.im), result.offset


def random_case() -> tuple[int, int, complex]:
    step = int(RANDOM.uniform(25e3, 40e3) / RATE * TURN)
    angle = RANDOM.uniform(-math.pi, math.pi)
    return step, int(RANDOM.integers(0, 2**32)), complex(math.cos(angle), math.sin(angle))


def test_unquantised_tone_with_offset_to_a_millionth(core) -> None:
    worst = 0.0
    for _ in range(1000):
        step, first, phasor = random_case()
        result, offset = fit(core, step, first, tone(step, first, phasor, 0.1))
        worst = max(worst, abs(result - phasor))
        assert abs(offset - 0.1) < 1e-6
    assert worst < 1e-6


def test_twelve_bit_samples_stay_on_the_quantisation_floor(core) -> None:
    errors = []
    for _ in range(500):
        step, first, phasor = random_case()
        codes = np.floor(tone(step, first, 0.8 * phasor, 0.05) * 2048.0 + 2048.5) - 2048.0
        errors.append(abs(fit(core, step, first, codes / 2048.0)[0] - 0.8 * phasor))
    uniform_rounding = 1.0 / 2048.0 / math.sqrt(12.0)
    floor = uniform_rounding * math.sqrt(2.0 / WINDOW) * math.sqrt(2.0)
    assert np.sqrt(np.mean(np.square(errors))) < 1.15 * floor


def test_noise_is_fitted_as_numpy_does(core) -> None:
    for _ in range(50):
        step, first, _ = random_case()
        samples = RANDOM.normal(size=WINDOW).astype(np.float32)
        angle = 2.0 * math.pi * phases(step, first) / TURN
        matrix = np.stack([np.cos(angle), -np.sin(angle), np.ones(WINDOW)], axis=1)
        a, b, c = np.linalg.lstsq(matrix, samples, rcond=None)[0]
        result, offset = fit(core, step, first, samples)
        assert result == pytest.approx(complex(a, b), abs=2e-6)
        assert offset == pytest.approx(c, abs=2e-6)


def test_the_other_side_of_the_carrier_is_a_conjugate_not_the_same(core) -> None:
    """A reversed q axis would still measure every amplitude rightly, and drive the loop apart."""
    step, first, phasor = random_case()
    result, _ = fit(core, step, first, tone(step, first, phasor, 0.0))
    assert abs(result - phasor.conjugate()) > 0.1 or abs(phasor.imag) < 0.05
    assert result.imag * phasor.imag >= 0.0


@pytest.mark.parametrize("frequency_hz", [0.0, 100.0, 124.9e3, 125.1e3, 218.7e3, 249e3])
def test_tones_that_a_window_cannot_tell_from_an_offset_are_refused(core, frequency_hz: float) -> None:
    """Nor one above half the sample rate."""
    step = int(frequency_hz / RATE * TURN)
    assert not core.lib.an_demod_plan(core.ffi.new("an_demod *"), step, WINDOW, 1.0)


def test_windows_too_short_or_long_are_refused(core) -> None:
    for window in (0, 3, 65537):
        assert not core.lib.an_demod_plan(core.ffi.new("an_demod *"), int(0.13 * TURN), window, 1.0)
