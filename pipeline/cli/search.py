"""The command `antinode search`: what the arguments mean, and what is printed of the result."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING, Any

from pipeline.case.model import load_case
from pipeline.case.plausible import warn_of_doubts
from pipeline.case.quantities import parse_frequency
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.quantity import frequency, level, level_with_bar, signed, with_bar
from pipeline.records.reading import filled, reading_table
from pipeline.search.limits import Limits
from pipeline.search.space import read_space
from pipeline.units import GRAM, MM
from pipeline.views.answer import Answer, emit, of_case

if TYPE_CHECKING:
    from pipeline.search.designs import Evaluation, Outcome

SHOWN = 8
MEASURES = (
    *("frequency_hz", "frequency_error", "confinement_db", "confinement_error_db", "extension_db", "mac"),
    *("worst_db", "band_khz", "isolation_db", "gap_mm"),
)


def search(arguments: Namespace) -> int:
    """Search the design that confines the wanted mode best."""
    limits = limits_of(arguments)
    space = read_space(arguments.case, arguments.set, arguments.vary)
    case = load_case(arguments.case, arguments.set)
    if case.design.zones > 1 and arguments.verify_with == "solid":
        raise InputError(
            f"--verify-with solid: zone.count = {case.design.zones}, must be plate: no solid carries patches"
        )
    of_case(arguments, case)
    from pipeline.search.designs import Settings
    from pipeline.search.optimiser import search as find
    from pipeline.search.plots import landscape

    log = TerminalLog(arguments.quiet)
    warn_of_doubts(case.design, log)
    outcome = find(space, Settings(arguments.goal, limits, arguments.evaluations), log)
    document = to_dict(outcome) | _proof(outcome, arguments, log)
    head = ("fidelity", *(v.name for v in space.variables), *MEASURES, "mass_kg", "violations", "why_not")
    rows = []
    for each in document["evaluations"]:
        figures = [each[key] for key in (*MEASURES, "mass_kg")]
        rows.append([each["fidelity"], *each["set"].values(), *figures, "; ".join(each["violations"]), each["why_not"]])
    answer = Answer(document, _lines(outcome, document), head, rows, lambda: [landscape(document)])
    return emit(arguments, "search", answer, log)


def limits_of(arguments: Namespace) -> Limits:
    """Read the limits of the command line. Raises InputError for a size or share that cannot be one."""
    sizes = {f"--{name}": getattr(arguments, name.replace("-", "_")) for name in ("max-half-wavelength", "min-feature")}
    faults = [
        f"{name} = {value:g}: must be a length in mm above 0" for name, value in sizes.items() if not 0.0 < value < 1e6
    ]
    if arguments.min_isolation is not None and not 0.0 < arguments.min_isolation < 1e3:
        faults.append(f"--min-isolation = {arguments.min_isolation:g}: must be a number of dB above 0")
    if not 0.0 <= arguments.mac <= 1.0:
        faults.append(f"--mac = {arguments.mac:g}: must be a number from 0 to 1")
    if faults:
        raise InputError(faults)
    lowest = parse_frequency(arguments.min_frequency, "--min-frequency")
    lengths = MM * arguments.max_half_wavelength, MM * arguments.min_feature
    return Limits(lowest, *lengths, arguments.mac, arguments.min_isolation)


def _proof(outcome: Outcome, arguments: Namespace, log: TerminalLog) -> dict[str, Any]:
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


def to_dict(outcome: Outcome) -> dict[str, Any]:
    """The document, without times."""
    from pipeline.search.fidelity import MODELS

    def design(each: Evaluation) -> dict[str, Any]:
        result = each.result
        return {
            "fidelity": result.fidelity,
            "set": {v.name: v.written(value) for v, value in zip(outcome.space.variables, each.values, strict=False)},
            **{name: getattr(result, name) for name in MEASURES},
            "mass_kg": each.mass_kg,
            "violations": list(each.violations),
            "why_not": result.why_not or None,
        }

    return {
        "goal": outcome.settings.goal,
        "vary": [
            {"key": v.name, "low": v.low, "high": v.high, "step": v.step}
            | ({"words": list(v.words)} if v.words else {})
            for v in outcome.space.variables
        ],
        "limits": vars(outcome.settings.limits),
        "fidelities": [
            {
                "name": name,
                "model": MODELS[name],
                "designs": len(each),
                "not_evaluated": sum(e.goal_db is None for e in each),
            }
            for name, each in outcome.by_fidelity.items()
        ],
        "softness": outcome.softness,
        "repeat": outcome.repeat,
        "base": design(outcome.base),
        "best": design(outcome.best),
        "gain_db": outcome.gain_db if outcome.best.unit == "dB" else None,
        "gain_khz": outcome.gain_db if outcome.best.unit == "kHz" else None,
        "gain_mm": outcome.gain_db if outcome.best.unit == "mm" else None,
        "gain_error_db": outcome.gain_error_db,
        "tradeoff": [design(each) for each in outcome.tradeoff],
        "evaluations": [design(each) for listed in outcome.by_fidelity.values() for each in listed],
    }


def _gain(outcome: Outcome) -> str:
    unit = outcome.best.unit
    return (
        level_with_bar(outcome.gain_db, outcome.gain_error_db)
        if unit == "dB"
        else with_bar(outcome.gain_db, None, unit)
    )


def _lines(outcome: Outcome, document: dict[str, Any]) -> list[str]:
    """The best designs as a table, the gain, and the words to repeat it."""
    from pipeline.search.designs import summary
    from pipeline.search.fidelity import PLATE

    plates = sorted((e for e in outcome.by_fidelity[PLATE] if e.keeps), key=lambda e: -e.objective)[:SHOWN]
    rows = [
        [
            *outcome.space.written(e.values),
            *(getattr(e.result, name) for name in MEASURES),
            None if e.mass_kg is None else e.mass_kg / GRAM,
        ]
        for e in plates
    ]
    gain = "" if outcome.gain_db is None else f", {signed(_gain(outcome))}"
    command = "modes" if outcome.best.result.isolation_db is None else "crosstalk"
    counts = ", ".join(f"{len(each)} by {fidelity}" for fidelity, each in outcome.by_fidelity.items())
    return [
        f"{counts}; the best assembled plates:",
        reading_table(*filled((*(v.name for v in outcome.space.variables), *MEASURES, "mass_g"), rows)),
        f"as given: {summary(outcome.base)}",
        f"best:     {summary(outcome.best)}{gain}",
        *(
            f"solid mesh, {name}: {level(values['confinement_db'])} at {frequency(values['frequency_hz'])}"
            for name, values in document.get("solid", {}).items()
        ),
        f"repeat it: antinode {command} {outcome.space.path} " + " ".join(f"--set {part}" for part in outcome.repeat),
    ]
