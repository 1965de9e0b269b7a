"""Mean pressure of a squeeze film against its own integral; where the relation says nothing it raises and tells why."""

from __future__ import annotations

import numpy as np
import pytest

from solvers.touch.effects import MIN_SQUEEZE_NUMBER, PRESSURE_PA, OutOfValidity, SqueezeFilm

FILM = SqueezeFilm(gap_m=5e-6, radius_m=5e-3, force_n=0.5)
AREA_M2 = np.pi * 25e-6


@pytest.mark.parametrize("share", [0.01, 0.2, 0.9])
def test_the_mean_pressure_is_that_of_air_that_cannot_escape(share: float) -> None:
    """At a large squeeze number p h = const within, and its square is <h^3>/<h>, the rim at room pressure (langlois1962)."""
    gap = 1.0 + share * np.cos(2.0 * np.pi * np.arange(4096) / 4096)
    inside = np.sqrt(np.mean(gap**3) / np.mean(gap))
    mean = np.mean(inside / gap)
    assert FILM.lift_n(share * FILM.gap_m) == pytest.approx(PRESSURE_PA * AREA_M2 * (mean - 1.0), rel=1e-9)


def test_a_small_amplitude_lifts_with_its_square_and_friction_falls_by_that_share() -> None:
    lift = FILM.lift_n(5e-8)
    assert lift == pytest.approx(1.25 * 1e-4 * PRESSURE_PA * AREA_M2, rel=1e-3)
    assert FILM.friction_ratio(5e-8, 32e3) == pytest.approx(1.0 - lift / 0.5, rel=1e-12)
    assert FILM.friction_ratio(0.0, 32e3) == 1.0


@pytest.mark.parametrize(
    ("film", "amplitude_m", "text"),
    [
        (FILM, 5e-6, "not below a gap of 5 um"),
        (FILM, 2e-6, "more than the finger's 0.5 N"),
        (SqueezeFilm(5e-7, 5e-3, 0.5), 1e-9, "not a continuum"),
        (SqueezeFilm(40e-6, 5e-3, 0.5), 1e-9, "air escapes"),
    ],
)
def test_beyond_its_validity_it_says_why(film: SqueezeFilm, amplitude_m: float, text: str) -> None:
    with pytest.raises(OutOfValidity, match=text):
        film.friction_ratio(amplitude_m, 32e3)


def test_the_squeeze_number_is_12_eta_omega_r2_over_p_h2() -> None:
    gap = np.sqrt(12.0 * 1.81e-5 * 2.0 * np.pi * 32e3 * 25e-6 / (PRESSURE_PA * MIN_SQUEEZE_NUMBER))
    assert SqueezeFilm(gap, 5e-3, 0.5).squeeze_number(32e3) == pytest.approx(MIN_SQUEEZE_NUMBER, rel=1e-12)
