"""Plan of a case: its steps with model, mesh, symmetry classes, window and reasons, and what they leave out.

A plan and the computation call the same functions (`model_choice`, `request`, `simplifications`), so they cannot differ;
`pipeline.batch.case_study` runs a study's case by its plan. Nothing here solves or meshes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from pipeline.case.model import Case
from pipeline.planning import driven_demand, resource_estimate, simplifications
from pipeline.planning.model_choice import (
    ModelChoice,
    Request,
    driven_band_hz,
    model_choice_of,
    model_high_hz,
    response_high_hz,
    spared,
    with_defaults,
    with_search,
)
from pipeline.planning.resources import ResourceEstimate, shortfall
from pipeline.planning.simplifications import Simplification, khz
from pipeline.quantity import several

RESPONSE_POINTS = 401


@dataclass(frozen=True)
class Step:
    """One computation: its measure, model and mesh in words, symmetry classes, search window and reasons.

    `numbers` holds them for scripts: band_hz or near_hz with count, wavevectors, frequencies, kx_per_m, patches.
    `choice` is the model and mesh from which the computation then builds.
    """

    measure: str
    name: str
    model: str
    mesh: str
    classes: tuple[str, ...]
    looks_for: str
    why: tuple[str, ...]
    left_out: tuple[Simplification, ...] = ()
    numbers: dict[str, Any] = field(default_factory=dict)
    demand: ResourceEstimate | None = None
    choice: ModelChoice | None = None

    def text(self) -> str:
        """Return the step as one line."""
        parts = [self.model, self.mesh, f"class {', '.join(self.classes)}" if self.classes else "", self.looks_for]
        said = "; ".join(part for part in parts if part)
        return f"{self.name}: {said}" if said else self.name

    def to_dict(self) -> dict[str, Any]:
        """Return the step as plain JSON."""
        keys = ("measure", "name", "model", "mesh", "looks_for")
        plain: dict[str, Any] = {key: getattr(self, key) for key in keys}
        foreseen = {"foreseen": self.demand.to_dict()} if self.demand else {}
        return plain | {"classes": list(self.classes), "why": list(self.why), **self.numbers, **foreseen}


@dataclass(frozen=True)
class Plan:
    """Steps in order, and the simplifications of the scene as a whole."""

    name: str
    steps: tuple[Step, ...]
    whole: tuple[Simplification, ...]

    @property
    def left_out(self) -> tuple[Simplification, ...]:
        """Return every simplification of a step or of the whole scene, each once."""
        return tuple(dict.fromkeys([each for step in self.steps for each in step.left_out] + [*self.whole]))

    @property
    def demands(self) -> dict[str, ResourceEstimate]:
        """Return the resource estimate of each step, by the step's name."""
        return {step.name: step.demand for step in self.steps if step.demand}

    def text(self) -> str:
        """Return the plan as text: every step with its reasons, then the simplifications."""
        lines = [f"plan for {self.name}"]
        for number, step in enumerate(self.steps, start=1):
            lines.append(f"{number}. {step.text()}")
            lines += [f"   because {reason}" for reason in step.why]
            lines += [f"   {line}" for line in _estimated(step)]
        left_out = [f"   {each.rule}: {each.what} ({each.why})" for each in self.left_out]
        lines += ["left out", *left_out] if left_out else []
        return "\n".join(lines)

    def short(self) -> str:
        """Return one line per step with its reasons, and the names of the simplifications."""
        lines = []
        for step in self.steps:
            lines.append("; because ".join([step.text(), *([", ".join(step.why)] if step.why else [])]))
            lines += _estimated(step)
        return "\n".join([*lines, f"left out: {', '.join(dict.fromkeys(each.rule for each in self.left_out))}"])

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain JSON."""
        return {
            "name": self.name,
            "steps": [step.to_dict() for step in self.steps],
            "left_out": [vars(each) for each in self.left_out],
        }


def _estimated(step: Step) -> list[str]:
    """Describe the resource estimate of a step, and whether it exceeds the available memory."""
    if not step.demand:
        return []
    reason = shortfall(step.demand)
    return [step.demand.text(), *([f"will not run: {reason}"] if reason else [])]


def plan_of(case: Case, step: Step, *whole: Simplification | None) -> Plan:
    """Return the plan of one step with the simplifications of the whole scene."""
    return Plan(case.name, (step,), tuple(each for each in whole if each))


def modes_step(case: Case, request: Request) -> Step:
    """Plan the modes of a part."""
    query = with_defaults(case, request)
    high_hz = model_high_hz(case, query)
    choice = spared(case, model_choice_of(case, query.part, high_hz), high_hz)
    classes = choice.classes if query.symmetry is None else (query.symmetry,)
    window = simplifications.other_frequencies(query.band_hz, query.near_hz, query.count)
    left_out = (*choice.left_out, simplifications.other_classes(choice.classes, query.symmetry), window)
    numbers: dict[str, Any] = {"band_hz": list(query.band_hz)} if query.band_hz else {}
    if not query.band_hz:
        numbers = {"near_hz": query.near_hz, "count": query.count}
    step = step_of("modes", f"modes of the {query.part}", choice, classes, _window(query), left_out, numbers)
    return replace(step, demand=resource_estimate.of_modes(case, choice, with_search(case, query)))


def _window(query: Request) -> str:
    if query.band_hz:
        return f"every mode from {khz(query.band_hz[0])} to {khz(query.band_hz[1])}"
    return f"the {query.count} modes " + (f"nearest {khz(query.near_hz)}" if query.near_hz else "lowest")


def response_step(case: Case, band_hz: tuple[float, float] | None, points: int) -> Step:
    """Plan the forced response to the patches."""
    case.require("patches", command="response")
    patches = case.patches
    assert patches is not None
    low, high = driven_band_hz(case, band_hz)
    choice = driven_demand.as_driven(case, model_choice_of(case, "plate", response_high_hz(case, (low, high))))
    own = several(patches.count, "patch")
    looks = f"{points} frequencies from {khz(low)} to {khz(high)}, more around the peak; {own}"
    numbers = {
        "band_hz": [low, high],
        "frequencies": points,
        "patches": patches.count,
        "quality_factor": case.quality_factor or "materials",
    }
    demand = driven_demand.of_response(case, choice, (low, high), points)
    if given := simplifications.material_loss(case.design, case.quality_factor):
        choice = replace(choice, left_out=(*choice.left_out, given))
    if not choice.quarter:
        return step_of("response", "forced response", choice, ("whole",), looks, choice.left_out, numbers, demand)
    undriven = simplifications.undriven_classes(patches)
    still = set(simplifications.undriven(patches))
    groups = [group for group in simplifications.patch_groups(patches) if not set(group) <= still]
    classes = tuple(" with ".join(group) for group in groups)
    apart = [axis for axis, kept in zip("xy", simplifications.patch_mirrors(patches), strict=True) if not kept]
    step = step_of("response", "forced response", choice, classes, looks, (*choice.left_out, undriven), numbers, demand)
    if not apart:
        return step
    coupled = f"the patches are not symmetric in {' and '.join(apart)}, so symmetry classes are solved together"
    return replace(step, why=(*step.why, coupled))


def tolerance_step(case: Case, band_hz: tuple[float, float] | None) -> Step:
    """Plan plates whose pillars differ: they have neither mirror symmetry nor equal cells."""
    given = case.tolerance
    assert given is not None
    low, high = driven_band_hz(case, band_hz)
    choice = model_choice_of(case, "plate", response_high_hz(case, (low, high)))
    scattered = simplifications.is_scattered(case)
    not_taken = {"mirror_images", "alike_cells"}
    kept = [each for each in choice.left_out if each.rule not in not_taken]
    mirrored = (
        simplifications.mirror_images(case.design, "plate", scattered),
        simplifications.alike_cells(case.design, scattered),
    )
    looks = f"{given.samples} random plates (seed {given.seed}), from {khz(low)} to {khz(high)}"
    numbers = {"band_hz": [low, high], "samples": given.samples, "seed": given.seed}
    demand = driven_demand.of_tolerance(case, choice, (low, high), given.samples * RESPONSE_POINTS)
    classes = choice.classes if mirrored[0] else (None,)
    return step_of(
        "tolerance", "plates with printed tolerances", choice, classes, looks, (*kept, *mirrored), numbers, demand
    )


def plain_step(measure: str, name: str, model: str) -> Step:
    """Return a step described by its name and model alone."""
    return Step(measure, name, model, "", (), "", ())


def step_of(
    measure: str, name: str, choice: ModelChoice, classes: tuple[str | None, ...], looks: str,
    left_out: tuple[Simplification | None, ...], numbers: dict[str, Any], demand: ResourceEstimate | None = None,
) -> Step:  # fmt: skip
    """Return a step with its model and mesh in words."""
    model, details = choice.name, dict(numbers)
    if choice.reduction:
        face = choice.reduction.interface
        model += f", interface polynomials of degree {face.along} in plane and {face.through} through the thickness, "
        model += f"fixed-interface modes to {khz(choice.reduction.top_hz)}"
        details["degrees"] = [face.along, face.through]
    if choice.hexahedra and choice.kind == "hex":
        mesh = choice.hexahedra
        details |= {"order": mesh.order, "size_m": mesh.size_m, "layers": mesh.layers, "through": mesh.through}
    classes_shown = tuple("whole" if symmetry is None else symmetry for symmetry in classes)
    return Step(
        measure,
        name,
        model,
        choice.mesh,
        classes_shown,
        looks,
        choice.why,
        tuple(o for o in left_out if o),
        details,
        demand,
        choice,
    )
