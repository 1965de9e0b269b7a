"""The command `antinode search`: what the arguments mean, and what is printed of the result."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from pipeline.case.model import load_case
from pipeline.case.quantities import parse_frequency
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.records import outputs
from pipeline.search.limits import Limits
from pipeline.search.space import read_space

SHOWN = 8


def search(arguments: Namespace) -> int:
    """Search the design that confines the wanted mode best."""
    limits = limits_of(arguments)
    space = read_space(arguments.case, arguments.set, arguments.vary)
    outputs.of_case(arguments, load_case(arguments.case, arguments.set))
    outputs.check_places(arguments)
    from pipeline.search.designs import Settings
    from pipeline.search.optimiser import search as find

    log = TerminalLog(arguments.quiet)
    outcome = find(space, Settings(arguments.goal, limits, arguments.evaluations), log)
    proof = _proof(outcome, arguments, log)
    document = to_dict(outcome) | proof | {"seconds": log.seconds | {"total": log.elapsed}}
    outputs.emit(arguments, "search", document, text(outcome, proof))
    if arguments.out:
        _write(outcome, document, arguments.out)
    return 0


def limits_of(arguments: Namespace) -> Limits:
    """Read the limits of the command line. Raises InputError for a size or share that cannot be one."""
    faults = []
    for name, value in (
        ("--max-half-wavelength", arguments.max_half_wavelength),
        ("--min-feature", arguments.min_feature),
    ):
        if not 0.0 < value < 1e6:
            faults.append(f"{name} = {value:g}: must be a length in mm above 0")
    if not 0.0 <= arguments.mac <= 1.0:
        faults.append(f"--mac = {arguments.mac:g}: must be a number from 0 to 1")
    if faults:
        raise InputError(faults)
    lowest = parse_frequency(arguments.min_frequency, "--min-frequency")
    return Limits(lowest, 1e-3 * arguments.max_half_wavelength, 1e-3 * arguments.min_feature, arguments.mac)


def _proof(outcome: Any, arguments: Namespace, log: TerminalLog) -> dict[str, Any]:
    """Solve both designs by the whole plate as a solid mesh, where asked for."""
    if arguments.verify_with != "solid":
        return {}
    from pipeline.search.fidelity import SOLID, EvaluationCache, evaluate

    proof = {}
    for name, each in (("base", outcome.base), ("best", outcome.best)):
        with log.step(f"solid model of the {name} design"):
            result = evaluate(outcome.space.case(each.values), SOLID, each.result.frequency_hz, EvaluationCache())
        if result.why_not:
            raise InputError(f"--verify-with solid: the {name} design: {result.why_not}")
        proof[name] = {"frequency_hz": result.frequency_hz, "confinement_db": result.confinement_db, "mac": result.mac}
    return {"solid": proof}


def to_dict(outcome: Any) -> dict[str, Any]:
    """The document, without times."""
    from pipeline.search.fidelity import MODELS

    limits = outcome.settings.limits
    return {
        "schema": 1,
        "goal": outcome.settings.goal,
        "vary": [{"key": v.key, "low": v.low, "high": v.high, "step": v.step} for v in outcome.space.variables],
        "limits": vars(limits),
        "fidelities": [
            {
                "name": fidelity,
                "model": MODELS[fidelity],
                "designs": len(each),
                "not_judged": sum(e.goal_db is None for e in each),
            }
            for fidelity, each in outcome.by_fidelity.items()
        ],
        "softness": outcome.softness,
        "repeat": [*outcome.space.fixed, *outcome.space.overrides(outcome.best.values), *outcome.window],
        "base": design_json(outcome, outcome.base),
        "best": design_json(outcome, outcome.best),
        "gain_db": outcome.gain_db,
        "gain_error_db": outcome.gain_error_db,
        "tradeoff": [design_json(outcome, each) for each in outcome.tradeoff],
        "evaluations": [design_json(outcome, each) for each in all_results(outcome)],
    }


def all_results(outcome: Any) -> list[Any]:
    """Every evaluation, the cheapest fidelity first."""
    return [each for listed in outcome.by_fidelity.values() for each in listed]


def design_json(outcome: Any, each: Any) -> dict[str, Any]:
    """One evaluation."""
    result = each.result
    return {
        "fidelity": result.fidelity,
        "set": {v.key: value for v, value in zip(outcome.space.variables, each.values, strict=False)},
        "frequency_hz": result.frequency_hz,
        "confinement_db": result.confinement_db,
        "extension_db": result.extension_db,
        "mac": result.mac,
        "frequency_error": result.frequency_error,
        "confinement_error_db": result.confinement_error_db,
        "mass_kg": each.mass_kg,
        "violations": list(each.violations),
        "why_not": result.why_not or None,
    }


def text(outcome: Any, proof: dict[str, Any]) -> str:
    """The best designs as a table, the gain, and the words to repeat it."""
    from pipeline.search.fidelity import PLATE

    keys = [v.key for v in outcome.space.variables]
    head = (*keys, "frequency_hz", "confinement_db", "extension_db", "mac", "mass_g")
    plates = sorted((e for e in outcome.by_fidelity[PLATE] if e.keeps), key=lambda e: -e.objective)[:SHOWN]
    rows = [_row(each) for each in plates]
    best, base = outcome.best, outcome.base
    lines = [
        f"{', '.join(f'{len(each)} by {fidelity}' for fidelity, each in outcome.by_fidelity.items())}; "
        "the best assembled plates:",
        outputs.table(head, rows),
        f"as it was: {_summary(base)}",
        f"best:      {_summary(best)}" + ("" if outcome.gain_db is None else f", {outcome.gain_db:+.2f} dB"),
        *(f"solid mesh, {name}: {values['confinement_db']:.2f} dB at {values['frequency_hz']:.1f} Hz"
          for name, values in (proof.get("solid") or {}).items()),
        f"repeat it: antinode modes {outcome.space.path} "
        + " ".join(f"--set {part}" for part in [*outcome.space.fixed, *outcome.space.overrides(best.values), *outcome.window]),
    ]  # fmt: skip
    return "\n".join(lines)


def _row(each: Any) -> list[Any]:
    result, mass = each.result, None if each.mass_kg is None else 1e3 * each.mass_kg
    return [*each.values, result.frequency_hz, result.confinement_db, result.extension_db, result.mac, mass]


def _summary(each: Any) -> str:
    from pipeline.search.designs import summary

    return summary(each)


def _write(outcome: Any, document: dict[str, Any], out: str) -> None:
    """Every evaluation as CSV, and the picture."""
    from pipeline.plots import style
    from pipeline.search.plots import landscape

    folder = outputs.folder(out)
    keys = [v.key for v in outcome.space.variables]
    head = (
        "fidelity",
        *keys,
        "frequency_hz",
        "confinement_db",
        "extension_db",
        "mac",
        "mass_kg",
        "violations",
        "why_not",
    )
    rows = [
        [each["fidelity"], *each["set"].values(), *(each[key] for key in head[1 + len(keys) : -2]),
         "; ".join(each["violations"]), each["why_not"]]
        for each in document["evaluations"]
    ]  # fmt: skip
    outputs.write_file(folder / "search.csv", outputs.csv_bytes(head, rows))
    with style.style():
        style.save(landscape(document), folder)
