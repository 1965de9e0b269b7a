"""Drift of the target mode with temperature: the plate solved at several temperatures, and slopes fitted through them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log, pi, sqrt
from typing import Any

import numpy as np

from geometry.layout import Design
from geometry.materials import USUAL_C, Stack
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.answer_parts import LayerStress, WarmPlate
from pipeline.models.modes import solve_modes
from pipeline.models.prestress import bow_share
from pipeline.planning import simplifications
from pipeline.planning.model_choice import of_case
from solvers.measures.loss import SHARES

NEPER_DB = 20.0 / log(10.0)
UNLIKE = 1.5  # largest relative change of a frequency by a body's size: half of 3 by its mass, of 1 by its stiffness
BEND = 2  # degree of the curves over temperature, of which the slope is taken; what they miss is in its bar


@dataclass(frozen=True)
class Slope:
    """Slope of a figure over temperature at the case's own, its half-width and the curve's second derivative."""

    per_k: float
    error: float
    bend: float


def drift(case: Case, span_c: tuple[float, float], points: int, log: Log) -> dict[str, Any]:
    """Solve the target mode at several temperatures; columns of `DriftResult` by name.

    Raises InputError where no material changes with temperature, or the plate has no target mode at three of them.
    """
    checked(case)
    celsius = np.linspace(*span_c, points).tolist()
    alike = simplifications.alike_drift(case.design)
    warm = _scaled(case, celsius, log) if alike else [_at(case, each, log) for each in celsius]
    found = [each for each in warm if each.frequency_hz is not None]
    if len(found) <= BEND:
        where = case.source or case.name
        raise InputError(f"{where}: the plate has a target mode at {len(found)} of {points} temperatures: 3 are needed")
    own_c = case.solve.temperature_C
    tone = _slope(found, "frequency_hz", own_c)
    level = _slope(found, "confinement_db", own_c)
    widest = max((each.error for each in found if each.error is not None), default=None)
    hz = float(np.mean([each.frequency_hz for each in found if each.frequency_hz is not None]))
    answer: dict[str, Any] = {
        "temperature_C": own_c,
        "points": warm,
        "drift_hz_per_K": tone.per_k if tone else None,
        "drift_db_per_K": level and (0.0 if alike else level.per_k),
        "layers": layer_stresses(case.design.stack),
        "curvature_per_m_K": curvatures(case.design.stack),
    }
    if tone and widest is not None:
        shared = 2.0 * SHARES * widest * hz * _spread(case) + UNLIKE * hz * _unlike(case)
        answer["drift_error_hz_per_K"] = tone.error + widest * abs(tone.per_k) + shared + hz * _of_stress(case, found)
        levels = [each.confinement_error_db for each in found if each.confinement_error_db is not None]
        if level and alike:
            answer["drift_error_db_per_K"] = 0.0
        elif level and len(levels) == len(found):
            shift_k = widest * hz / abs(tone.per_k) if tone.per_k else 0.0
            own = max(levels) / NEPER_DB * abs(level.per_k)  # a ratio of motions and its slope are as uncertain
            answer["drift_error_db_per_K"] = level.error + abs(level.bend) * shift_k + own
    return answer


def checked(case: Case) -> None:
    """Raise InputError for a case without target mode, or none of whose materials changes with temperature."""
    case.require_plate("drift")
    case.require("zone", command="drift")
    if not any(material.softening_per_k or material.expansion_per_k for material in case.design.materials):
        names = ", ".join(dict.fromkeys(material.name for material in case.design.materials))
        why = "drift needs dE_dT_per_K or expansion_per_K of one of them"
        raise InputError(f"{case.source or case.name}: {names}: neither is known: {why}")


def unknown(design: Design) -> list[str]:
    """Return what is not known of the materials and is taken for none, in words."""
    out = []
    for material in dict.fromkeys(design.materials):
        known = {"dE_dT_per_K": material.softening_per_k, "expansion_per_K": material.expansion_per_k}
        if lacking := " and ".join(key for key, value in known.items() if value is None):
            out.append(f"{material.name}: {lacking} not known: taken as 0")
    return out


def _at(case: Case, celsius: float, log: Log) -> WarmPlate:
    """The target mode at a temperature, and what the bow of the layers may change of its frequency."""
    warm = case.but({"solve.temperature_C": celsius})
    with log.step(f"modes at {celsius:g} C"):
        row = solve_modes(warm, of_case(warm), log).target_row
    own: dict[str, Any] = {}
    if row:
        own = {"frequency_hz": row.frequency_hz, "error": row.error, "mac": row.mac}
        own |= {"confinement_db": row.confinement_db, "confinement_error_db": row.confinement_error_db}
    return WarmPlate(temperature_C=celsius, **own, left_out=left_out(warm, celsius))


def _scaled(case: Case, celsius: list[float], log: Log) -> list[WarmPlate]:
    """The target mode solved once: where all materials change alike, frequencies follow the root of their stiffness."""
    own_c, material = case.solve.temperature_C, case.design.materials[0]
    own = _at(case, own_c, log)
    if own.frequency_hz is None:
        return [replace(own, temperature_C=each) for each in celsius]
    factors = [sqrt(material.warm(each) / material.warm(own_c)) for each in celsius]
    return [
        replace(own, temperature_C=each, frequency_hz=own.frequency_hz * factor)
        for each, factor in zip(celsius, factors, strict=True)
    ]


def _of_stress(case: Case, found: list[WarmPlate]) -> float:
    """What the stress that supports cause adds to the errors of frequencies per kelvin from 20 C, relative, 1/K."""
    errors = [each.error for each in found if each.error is not None]
    farthest = max(abs(each.temperature_C - USUAL_C) for each in found)
    return (max(errors) - min(errors)) / farthest if case.design.holds_expansion else 0.0


def _spread(case: Case) -> float:
    """Largest difference between two materials' relative changes of stiffness per kelvin, 1/K."""
    known = [(each.softening_per_k or 0.0) + (each.expansion_per_k or 0.0) for each in case.design.materials]
    return max(known) - min(known)


def _unlike(case: Case) -> float:
    """Largest difference between two materials' expansions, 1/K: bodies keep their sizes relative to each other."""
    known = [each.expansion_per_k or 0.0 for each in case.design.materials]
    return max(known) - min(known)


def _slope(found: list[WarmPlate], name: str, own_c: float) -> Slope | None:
    """Slope of a figure at a temperature by least squares; what the curve misses is uncertain over half its span."""
    pairs = [(each.temperature_C - own_c, getattr(each, name)) for each in found if getattr(each, name) is not None]
    if len(pairs) <= BEND:
        return None
    warmer, values = np.array(pairs, dtype=float).T
    half = float(np.ptp(warmer)) / 2.0
    fit = np.polynomial.Polynomial.fit(warmer, values, BEND)
    missed = float(np.abs(fit(warmer) - values).max())
    return Slope(float(fit.deriv()(0.0)), missed / half, float(fit.deriv(2)(0.0)))


def layer_stresses(stack: Stack) -> list[LayerStress]:
    """Return each layer's largest stresses along x and y per kelvin; empty where they are not known or there are none."""
    warming = stack.warming
    if warming is None or len(stack.layers) == 1:
        return []
    names = [material.name for material, _ in stack.layers]
    worst = [own[np.abs(own[:, :2]).max(axis=1).argmax()] for own in warming.stress_pa]
    return [
        LayerStress(material=name, along_Pa_per_K=float(own[0]), across_Pa_per_K=float(own[1]))
        for name, own in zip(names, worst, strict=True)
    ]


def curvatures(stack: Stack) -> list[float] | None:
    """Return the curvatures of the free plate along x and y per kelvin, 1/(m K); None where they are not known."""
    return None if stack.warming is None else [float(each) for each in stack.warming.curvature_per_m[:2]]


def left_out(case: Case, celsius: float) -> float | None:
    """Bound what the bow of a free layered plate changes of the target mode's frequency, relative."""
    stack, warming = case.design.stack, case.design.stack.warming
    if len(stack.layers) == 1:
        return 0.0
    if warming is None:
        return None
    k = max(case.target_kx_per_m, pi / case.design.width_m)
    bow = float(np.abs(warming.curvature_per_m).max()) * abs(celsius - USUAL_C) / (stack.thickness_m * k**2)
    return bow_share(bow)
