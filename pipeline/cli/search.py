"""The command `antinode search`: what the arguments mean, and what is told of what was found."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from pipeline.case.model import load_case
from pipeline.case.quantities import parse_frequency
from pipeline.errors import InputFault
from pipeline.logs import TerminalLog
from pipeline.records import outputs
from pipeline.search.limits import Limits
from pipeline.search.space import read_space

SHOWN = 8


def search(arguments: Namespace) -> int:
    """Search the design that holds the wanted mode best."""
    limits = limits_of(arguments)
    space = read_space(arguments.case, arguments.set, arguments.vary)
    outputs.of_case(arguments, load_case(arguments.case, arguments.set))
    outputs.check_places(arguments)
    from pipeline.search.designs import Settings
    from pipeline.search.optimiser import search as find

    log = TerminalLog(arguments.quiet)
    found = find(space, Settings(arguments.goal, limits, arguments.evaluations), log)
    proof = _proof(found, arguments, log)
    document = as_json(found) | proof | {"seconds": log.seconds | {"total": log.elapsed}}
    outputs.emit(arguments, "search", document, text(found, proof))
    if arguments.out:
        _write(found, document, arguments.out)
    return 0


def limits_of(arguments: Namespace) -> Limits:
    """The limits of the command line. InputFault for a size or share that cannot be one."""
    faults = []
    for name, value in (("--half-wave", arguments.half_wave), ("--feature", arguments.feature)):
        if not 0.0 < value < 1e6:
            faults.append(f"{name} = {value:g}: must be a length in mm above 0")
    if not 0.0 <= arguments.mac <= 1.0:
        faults.append(f"--mac = {arguments.mac:g}: must be a number from 0 to 1")
    if faults:
        raise InputFault(faults)
    above = parse_frequency(arguments.above, "--above")
    return Limits(above, 1e-3 * arguments.half_wave, 1e-3 * arguments.feature, arguments.mac)


def _proof(found: Any, arguments: Namespace, log: TerminalLog) -> dict[str, Any]:
    """Both designs by the whole plate as a solid mesh, when asked for."""
    if arguments.confirm != "solid":
        return {}
    from pipeline.search.fidelity import SOLID, EvaluationShelf, judge

    proof = {}
    for name, each in (("base", found.base), ("best", found.best)):
        with log.step(f"solid model of the {name} design"):
            judged = judge(found.space.case(each.values), SOLID, each.judged.frequency_hz, EvaluationShelf())
        if judged.why_not:
            raise InputFault(f"--confirm solid: the {name} design: {judged.why_not}")
        proof[name] = {"frequency_hz": judged.frequency_hz, "confinement_db": judged.confinement_db, "mac": judged.mac}
    return {"solid": proof}


def as_json(found: Any) -> dict[str, Any]:
    """The document, without times."""
    from pipeline.search.fidelity import MODELS

    limits = found.settings.limits
    return {
        "schema": 1,
        "goal": found.settings.goal,
        "vary": [{"key": v.key, "low": v.low, "high": v.high, "step": v.step} for v in found.space.variables],
        "limits": vars(limits),
        "rungs": [
            {
                "name": rung,
                "model": MODELS[rung],
                "designs": len(each),
                "not_judged": sum(e.goal_db is None for e in each),
            }
            for rung, each in found.by_rung.items()
        ],
        "softness": found.softness,
        "repeat": [*found.space.fixed, *found.space.overrides(found.best.values), *found.window],
        "base": design_json(found, found.base),
        "best": design_json(found, found.best),
        "gain_db": found.gain_db,
        "gain_error_db": found.gain_error_db,
        "tradeoff": [design_json(found, each) for each in found.tradeoff],
        "evaluations": [design_json(found, each) for each in all_judged(found)],
    }


def all_judged(found: Any) -> list[Any]:
    """Every evaluation, the cheapest rung first."""
    return [each for listed in found.by_rung.values() for each in listed]


def design_json(found: Any, each: Any) -> dict[str, Any]:
    """One evaluation."""
    judged = each.judged
    return {
        "rung": judged.rung,
        "set": {v.key: value for v, value in zip(found.space.variables, each.values, strict=False)},
        "frequency_hz": judged.frequency_hz,
        "confinement_db": judged.confinement_db,
        "extension_db": judged.extension_db,
        "mac": judged.mac,
        "frequency_error": judged.frequency_error,
        "confinement_error_db": judged.confinement_error_db,
        "mass_kg": each.mass_kg,
        "breaks": list(each.broken),
        "why_not": judged.why_not or None,
    }


def text(found: Any, proof: dict[str, Any]) -> str:
    """The best designs as a table, the gain, and the words to repeat it."""
    from pipeline.search.fidelity import PLATE

    keys = [v.key for v in found.space.variables]
    head = (*keys, "frequency_hz", "confinement_db", "extension_db", "mac", "mass_g")
    plates = sorted((e for e in found.by_rung[PLATE] if e.keeps), key=lambda e: -e.merit)[:SHOWN]
    rows = [_row(each) for each in plates]
    best, base = found.best, found.base
    lines = [
        f"{', '.join(f'{len(each)} by {rung}' for rung, each in found.by_rung.items())}; the best joined plates:",
        outputs.table(head, rows),
        f"as it was: {_told(base)}",
        f"best:      {_told(best)}" + ("" if found.gain_db is None else f", {found.gain_db:+.2f} dB"),
        *(f"solid mesh, {name}: {values['confinement_db']:.2f} dB at {values['frequency_hz']:.1f} Hz"
          for name, values in (proof.get("solid") or {}).items()),
        f"repeat it: antinode modes {found.space.path} "
        + " ".join(f"--set {part}" for part in [*found.space.fixed, *found.space.overrides(best.values), *found.window]),
    ]  # fmt: skip
    return "\n".join(lines)


def _row(each: Any) -> list[Any]:
    judged, mass = each.judged, None if each.mass_kg is None else 1e3 * each.mass_kg
    return [*each.values, judged.frequency_hz, judged.confinement_db, judged.extension_db, judged.mac, mass]


def _told(each: Any) -> str:
    from pipeline.search.designs import told

    return told(each)


def _write(found: Any, document: dict[str, Any], out: str) -> None:
    """Every evaluation as CSV, and the picture."""
    from pipeline.plots import style
    from pipeline.search.plots import landscape

    folder = outputs.folder(out)
    keys = [v.key for v in found.space.variables]
    head = ("rung", *keys, "frequency_hz", "confinement_db", "extension_db", "mac", "mass_kg", "breaks", "why_not")
    rows = [
        [each["rung"], *each["set"].values(), *(each[key] for key in head[1 + len(keys) : -2]),
         "; ".join(each["breaks"]), each["why_not"]]
        for each in document["evaluations"]
    ]  # fmt: skip
    outputs.write_file(folder / "search.csv", outputs.csv_bytes(head, rows))
    with style.style():
        style.save(landscape(document), folder)
