"""Gap edges of slender rods on a plate at G, where rods stretch and the plate between them bends.

A rod of section A on a cell of plate of mass m: EA k tan(kL) C = 1 at the foot, k = omega / sqrt(E / rho) with Love's
lateral inertia. A rigid cell has C = -1 / (m omega^2). The waves of reciprocal vectors G != 0 bend and shear the plate
(mindlin1951) and add the sum of J^2 / a^2 [1 / (D G^4 - rho h omega^2) + 1 / (kappa mu h G^2)], J the transform of the foot.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt

import numpy as np
import pytest
from scipy.optimize import brentq

from pipeline.case.model import case_from_dict
from tests.helpers.asked import solve_bands
from tests.helpers.recording_log import RecordingLog

YOUNG, POISSON, DENSITY = 69e9, 0.33, 2700.0
PITCH, THICKNESS, SIDE = 20e-3, 6e-3, 6.35e-3
RIGID, MINDLIN = False, True
SHARE = 0.1  # of what the plate's compliance lowers an edge by: plate theory next to a foot as wide as it is thick


def edges_hz(length_m: float, high_hz: float, bends: bool) -> list[float]:
    """Upper edges of the rods' longitudinal gaps at G, Hz."""
    area, mass = SIDE**2, DENSITY * THICKNESS * PITCH**2
    shear = YOUNG / (2.0 * (1.0 + POISSON))
    rigidity = YOUNG * THICKNESS**3 / (12.0 * (1.0 - POISSON**2))
    number = np.arange(-80, 81)
    foot = np.sinc(number * SIDE / PITCH)
    squared = (2.0 * pi / PITCH) ** 2 * (number[:, None] ** 2 + number**2).ravel()
    weight = ((foot[:, None] * foot) ** 2).ravel()[squared > 0.0] / PITCH**2
    squared = squared[squared > 0.0]

    def fault(tone: float) -> float:
        omega = 2.0 * pi * tone
        k = omega * sqrt(DENSITY / YOUNG)
        k *= sqrt(1.0 + (POISSON * k * SIDE) ** 2 / 6.0)  # I_p = side^4 / 6
        bending = weight / (rigidity * squared**2 - DENSITY * THICKNESS * omega**2)
        local = float((bending + weight / (5.0 / 6.0 * shear * THICKNESS * squared)).sum()) if bends else 0.0
        return cos(k * length_m) - YOUNG * area * k * sin(k * length_m) * (local - 1.0 / (mass * omega**2))

    tones = np.linspace(0.01, 1.0, 400) * high_hz
    signs = np.sign([fault(tone) for tone in tones])
    return [brentq(fault, tones[i], tones[i + 1]) for i in np.flatnonzero(signs[1:] != signs[:-1])]


@pytest.mark.slow
@pytest.mark.parametrize(("length_m", "count", "high_hz"), [(140e-3, 20, 16e3), (400e-3, 38, 11.5e3)])
def test_the_plate_between_rods_lowers_the_edges_of_their_gaps(length_m: float, count: int, high_hz: float) -> None:
    case = case_from_dict(
        {
            "name": "rods",
            "material": {"young_GPa": YOUNG / 1e9, "poisson": POISSON, "density_kg_m3": DENSITY},
            "plate": {"thickness_mm": THICKNESS * 1e3},
            "pillar": {"shape": "square", "side_mm": SIDE * 1e3, "height_mm": length_m * 1e3},
            "array": {"pitch_mm": PITCH * 1e3},
            "bands": {"points": 2, "count": count, "grid": 4, "path": "GX"},
            "solve": {"accuracy": 0.01},
        }
    )
    bands = solve_bands(case, RecordingLog())
    at_g, errors = bands.frequencies_hz[0], bands.error[0]
    for rigid, edge in zip(edges_hz(length_m, high_hz, RIGID), edges_hz(length_m, high_hz, MINDLIN), strict=True):
        nearest = int(np.argmin(np.abs(at_g - edge)))
        assert abs(at_g[nearest] - edge) <= errors[nearest] * edge + SHARE * (rigid - edge)
        assert rigid - at_g[nearest] > (1.0 - SHARE) * (rigid - edge) - errors[nearest] * edge
