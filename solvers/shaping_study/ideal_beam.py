"""The idealised beam of the thesis: point forces F = K_f V, and sensors that give K_s times the deflection under them.

T_kj = K_s K_f sum over modes of phi_m(x_k) phi_m(x_j)/(omega_m^2 - omega^2 + i omega omega_m/Q), phi mass-normalised:
(3.35) with the gains of actuators and sensors kept apart.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from geometry.elements import FloatArray
from solvers.analytic.beams import beam_mode, frequency_hz
from solvers.errors import SolverError
from solvers.shaping.modal_table import ModalTable
from solvers.shaping_study.patched_beam import PatchedBeam, section


def point_beam_table(
    beam: PatchedBeam,
    modes: int = 20,
    force_n_v: float = 1.0,
    sense_v_m: float = 1.0,
    points_m: FloatArray | None = None,
) -> ModalTable:
    """The bare beam of the same material and ends with points in place of its patches; default: 301 points along it.

    phi = phi_exact/sqrt(rho A L), phi_exact of mean square 1. SolverError for an empty list of places, places off the beam,
    modes below 1, or ends that are unknown or leave a rigid-body mode.
    """
    places = np.array(beam.centres_m)
    if not places.size:
        raise SolverError("beam: the list of actuators is empty, at least one place is needed")
    if (places < 0.0).any() or (places > beam.length_m).any():
        raise SolverError(f"beam: places must lie from 0 to {beam.length_m:g} m")
    if "clamped" not in beam.ends and beam.ends != ("pinned", "pinned"):
        raise SolverError(f"beam: ends {beam.ends} leave a rigid-body mode; clamp one or pin both")
    if modes < 1:
        raise SolverError(f"modes = {modes}: must be 1 or more")
    points = np.linspace(0.0, beam.length_m, 301) if points_m is None else points_m
    _, _, bending, mass = section(beam, False)
    left, right = beam.ends
    shapes = [beam_mode(left, right, number) for number in range(1, modes + 1)]
    unit = 1.0 / sqrt(mass * beam.length_m)
    at_places = unit * np.stack([shape.shape(places / beam.length_m) for shape in shapes])
    return ModalTable(
        frequencies_hz=frequency_hz(np.array([shape.kappa for shape in shapes]), beam.length_m, bending, mass),
        quality_factor=np.full(modes, beam.quality_factor),
        actuators=force_n_v * at_places,
        sensors=sense_v_m * at_places,
        field=unit * np.stack([shape.shape(points / beam.length_m) for shape in shapes]),
        points_m=np.asarray(points)[:, None],
    )
