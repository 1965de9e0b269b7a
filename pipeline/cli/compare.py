"""Comparisons: two designs and their results (`compare`), gap edges and the committed reference (`check-gap`)."""

from __future__ import annotations

import csv
from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.case.limits import warn_of_doubts
from pipeline.case.model import Case, load_case
from pipeline.case.reading import nearest_file
from pipeline.errors import CheckFailed, InputError
from pipeline.logs import TerminalLog
from pipeline.paths import REFERENCE, STUDIES
from pipeline.plots import style
from pipeline.plots.style import ReportFigure
from pipeline.quantity import KHZ, figure, frequency, percent, percentage, several, signed
from pipeline.questions.bands import NAMES, Bands, BandsResult
from pipeline.questions.command import Answer, emit, of_case
from pipeline.questions.question import Run, ask
from pipeline.records import outputs, store
from pipeline.records.outputs import bar_of, is_relative, reading_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FILE = REFERENCE / "band_gap.csv"


@dataclass(frozen=True)
class Edge:
    """One checked frequency: committed value, computed value (None if the edge is gone), allowed relative change."""

    name: str
    reference_hz: float
    found_hz: float | None
    allowed: float

    @property
    def relative_change(self) -> float | None:
        """Relative change, found/reference - 1."""
        return None if self.found_hz is None else self.found_hz / self.reference_hz - 1.0

    @property
    def holds(self) -> bool:
        """Whether the change is within its limit; a missing edge is not."""
        return self.relative_change is not None and abs(self.relative_change) <= self.allowed

    @property
    def change_text(self) -> str | None:
        """Change in per cent."""
        return None if self.relative_change is None else signed(percentage(self.relative_change, self.allowed))

    def to_dict(self) -> dict[str, Any]:
        """Return the fields of the JSON document; a missing edge is null."""
        names = ("name", "reference_hz", "found_hz", "relative_change", "allowed")
        return {name: getattr(self, name) for name in names}

    @property
    def words(self) -> str:
        """Describe the outcome."""
        if self.relative_change is None:
            return f"{self.name} is missing: the committed value is {frequency(self.reference_hz, self.allowed)}"
        return f"{self.name} moved by {self.change_text}, more than the allowed {percent(self.allowed)}"


def edges_of(bands: BandsResult) -> dict[str, float | None]:
    """Return the edges of the lowest complete gap and the cell's bending frequency at M, Hz; None where absent."""
    gap = bands.gaps[0] if bands.gaps else None
    pair = bands.bending_at_m_hz
    return {
        "gap lower edge": gap.lower_hz if gap else None,
        "gap upper edge": gap.upper_hz if gap else None,
        "bending at M": sum(pair) / len(pair) if pair else None,
    }


def read_reference() -> dict[str, tuple[float, float]]:
    """Return the committed edges, {name: (Hz, allowed relative change)}. Raises CheckFailed without the file."""
    try:
        with FILE.open(newline="", encoding="utf-8") as file:
            return {row["name"]: (float(row["hz"]), float(row["allowed"])) for row in csv.DictReader(file)}
    except (OSError, KeyError, ValueError) as error:
        raise CheckFailed(f"{FILE.name}: {error}: the committed band-gap reference cannot be read") from error


def _figure_of_bands(record: BandsResult) -> ReportFigure:
    """Bands whose edges are checked."""
    return ReportFigure("check-gap", "The checked bands", "Bands of the checked cell", record.as_figure(), vector=True)


def check_gap(arguments: Namespace) -> int:
    """Compare committed edges with the computed ones. Raises CheckFailed with a line for each that moved too far."""
    place = arguments.case or str(STUDIES / "three-rows.toml")
    case, log = of_case(arguments, load_case(place, arguments.set)), TerminalLog(arguments.quiet)
    warn_of_doubts(case.design, log)
    record = ask(case, Bands(), Run(log, detailed=False))
    computed = edges_of(record)
    edges = [Edge(name, hz, computed.get(name), allowed) for name, (hz, allowed) in read_reference().items()]
    head = ("edge", "reference_hz", "found_hz", "change", "allowed", "holds")
    rows = [[e.name, e.reference_hz, e.found_hz, e.change_text, e.allowed, e.holds] for e in edges]
    document = {"holds": all(e.holds for e in edges), "edges": [e.to_dict() for e in edges]}
    answer = Answer(document, [reading_table(head, rows)], head, rows, lambda: [_figure_of_bands(record)])
    emit(arguments, "check-gap", answer)
    if not document["holds"]:
        raise CheckFailed(e.words for e in edges if not e.holds)
    return 0


Flat = dict[str, Any]
ROUNDING = 1e-9  # relative difference between two computations of the same figure
# field that names an item of a list: states under a finger, methods of confinement, complete gaps
NAMED = (("state",), ("method",), ("lower_band", "upper_band"))
NOT_COMPARED = (
    "schema",
    "kind",
    "options",
    "warnings",
    "seconds",
    "proof",
    "plan",
    "meshes",
    "times",
    "directional_gaps",
)

# parts of a computation's record, not of its design
BEHIND = {"case_id", "input_hash", "diagnosis", "dof", "count_check", "error_bar", "widest_bar", "index", "shapes"}


@dataclass(frozen=True)
class Design:
    """Quantities of a design by dotted name, its bands as a document where known, and the kind of file it came from."""

    quantities: Flat
    bands: dict[str, Any] | None = None
    kind: str = "case"


def run(arguments: Namespace) -> int:
    """Read both designs, line up their quantities, and print those that differ."""
    one, two = (read(Path(place), arguments.solve, arguments.quiet) for place in (arguments.a, arguments.b))
    known = lined_up(one.quantities, two.quantities)
    # a case, a record and a result hold different quantities: those are not differences between two designs
    alike = [row for row in known if one.kind == two.kind or None not in (row["a"], row["b"])]
    rows = known if arguments.all else [row for row in alike if _differs(row)]
    head = ("quantity", "a", "b", "difference")
    cells = [[row[key] for key in head] for row in rows]
    document = {"a": arguments.a, "b": arguments.b, "rows": rows}
    shown = [row for row in rows if arguments.all or not _is_behind(row["quantity"])]
    lines = [_in_words(row, one.quantities, two.quantities) for row in shown]
    nothing = "no figure differs" if rows else "nothing differs"
    words = [outputs.table(head, lines) if lines else nothing]
    if behind := len(rows) - len(shown):
        words.append(f"{several(behind, 'row')} of error bars, counts and identifiers differ, too: --all lists them")
    left = 0 if arguments.all else len(known) - len(alike)
    if left:
        words.append(f"{left} quantities are known for only one of the two: --all lists them")
    pictures = lambda: [_figure_of_both(arguments, one, two, rows)]  # noqa: E731
    return emit(arguments, "compare", Answer(document, words, head, cells, pictures))


def _is_behind(name: str) -> bool:
    """Whether a quantity is an error bar, a count or an identifier of a computation, not a figure of the design."""
    parts = name.split(".")
    return not BEHIND.isdisjoint(parts) or "error" in parts[-1]


def _in_words(row: dict[str, Any], one: Flat, two: Flat) -> list[str | None]:
    """Format a row: figures with the digits of their error bars, given values unchanged, differences in percent or dB."""
    name, difference = row["quantity"], row["difference"]
    apart = None if difference is None else signed(percentage(difference))
    if difference is not None and _named(name.rpartition(".")[2])[1].unit == "dB":
        bars = [bar for known in (one, two) if (bar := known.get(bar_of(name, known) or "")) is not None]
        apart = f"{signed(figure(row['b'] - row['a'], sum(bars) if len(bars) > 1 else None))} dB"
    return [_heading(name), _shown(name, one), _shown(name, two), apart]


def _heading(name: str) -> str:
    """Name a quantity and its unit for a reader: case.design.pillar.height_m -> pillar: height (mm)."""
    *owners, last = name.removeprefix("case.").removeprefix("design.").split(".")
    words, form = _named(last)
    return "".join(f"{owner.replace('_', ' ')}: " for owner in owners) + (
        f"{words} ({form.unit})" if form.unit else words
    )


def _named(last: str) -> tuple[str, outputs.Form]:
    """Return heading and format of a quantity; lengths of a design are in mm."""
    if last.endswith("_m"):
        return last.removesuffix("_m").replace("_", " "), outputs.Form("mm", 1e3)
    return outputs.named(last)


def _shown(name: str, known: Flat) -> Any:
    value, bar = known.get(name), bar_of(name, known)
    if not isinstance(value, float):
        return value
    form = _named(name.rpartition(".")[2])[1]
    factor = form.factor
    if name.startswith("case."):
        return outputs.shown(name, value, form._replace(is_given=True))
    half = known[bar] if bar else value if "error" in name else None
    half = abs(value) * half if bar and half is not None and is_relative(name, bar) else half
    return figure(factor * value, None if half is None else factor * half)


def _figure_of_both(arguments: Namespace, one: Design, two: Design, rows: list[dict[str, Any]]) -> ReportFigure:
    """Draw both band diagrams over one path where both have one, else relative differences as a bar chart."""
    drawn, axes = style.panels(3.6)
    if one.bands and two.bands:
        _overlaid(axes, {f"A: {arguments.a}": one.bands, f"B: {arguments.b}": two.bands})
    else:
        _differences(axes, rows)
    return ReportFigure("compare", "Comparison of two designs", f"{arguments.a} and {arguments.b}", drawn, True)


def _differences(ax: Axes, rows: list[dict[str, Any]]) -> None:
    """Draw relative differences of two designs as a bar chart, the largest at the top."""
    known = sorted((row for row in rows if row["difference"]), key=lambda row: abs(row["difference"]))
    ax.figure.set_size_inches(style.WIDTH_IN, 1.2 + 0.28 * max(1, len(known)))  # type: ignore[union-attr]
    ax.barh(
        [_heading(row["quantity"]) for row in known], [100.0 * row["difference"] for row in known], color=style.BLUE
    )
    ax.axvline(0.0, color=style.GREY, lw=0.8)
    ax.set(xlabel="(B - A) / A (%)")


def _overlaid(ax: Axes, named: dict[str, dict[str, Any]]) -> None:
    """Draw bands of several cells over one path, its corners aligned for any pitch; gaps shaded."""
    import numpy as np

    for (name, document), colour in zip(named.items(), style.CYCLE, strict=False):
        bands = BandsResult.from_document(document)
        corners = [place for place, label in enumerate(bands.labels) if label]
        along = np.interp(np.arange(len(bands.points)), corners, np.arange(len(corners)))
        ax.plot(along, bands.frequencies_hz / KHZ, color=colour, lw=1.0)[0].set_label(name)
        for gap in bands.gaps:
            ax.axhspan(gap.lower_hz / KHZ, gap.upper_hz / KHZ, color=colour, alpha=0.15, lw=0)
        labels = [NAMES.get(label, label) for label in bands.labels if label]
        ax.set_xticks(range(len(labels)), labels)
    ax.grid(True, axis="x")
    ax.set(xlabel="wavevector along the path", ylabel="frequency (kHz)", ylim=(0.0, None))
    ax.legend(fontsize=7)


def read(place: Path, solve: bool, quiet: bool) -> Design:
    """Read a design from a file. Raises InputError for anything other than a case or a result."""
    if place.suffix == ".toml":
        return _of_case(place, solve, quiet)
    file = place / store.RECORD if place.is_dir() else place
    try:
        document = store.read_record(file.parent) if file.name == store.RECORD else store.read_json(file)
    except store.BadRecord as error:
        near = "" if file.exists() else nearest_file(file)
        raise InputError(
            f"{file}: cannot be read as a case (.toml), a record or a JSON result: {error}{near}"
        ) from error
    store.refuse_earlier(file, document)
    if not isinstance(document, dict):
        raise InputError(
            f"{file}: contains neither a record nor a JSON result; name a case file, a record.json or a file written "
            "by --json"
        )
    bands = document if {"points", "gaps"} <= document.keys() else document.get("bands")
    quantities = {key: value for key, value in document.items() if key not in NOT_COMPARED}
    if "with_defaults" in quantities:
        return Design(flat(quantities | {"case": quantities.pop("with_defaults")}), bands, "result")
    if "design" in quantities:
        quantities["case"] = {"design": quantities.pop("design")}
    return Design(flat(quantities), bands, "record")


def _of_case(place: Path, solve: bool, quiet: bool) -> Design:
    from pipeline.questions.predesign import sized

    case, log = load_case(place), TerminalLog(quiet)
    warn_of_doubts(case.design, log)
    quantities = {"case": case.to_dict()}
    design = quantities["case"]["design"]
    design |= {f"row_{number}": pillar for number, pillar in enumerate(design.pop("graded", ()), start=1)}
    if {"plate", "zone"} <= case.given:
        quantities["predesign"] = {key: value for key, value in sized(case.design).values().items() if key != "limits"}
    if not solve:
        return Design(flat(quantities))
    case.refuse("compare --solve")
    case.require_plate("compare --solve")
    solved, bands = _solved(case, log)
    return Design(flat(quantities | solved), bands)


def _solved(case: Case, log: TerminalLog) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Compute the target mode and the gaps of a case, and its bands if it has a single cell."""
    from pipeline.models.modes import solve_modes
    from pipeline.planning.model_choice import of_case as request_of

    found = solve_modes(case, request_of(case), log).target_part()
    target = found.to_dict() if found else {}
    quantities = {"target": {key: value for key, value in target.items() if not isinstance(value, list)}}
    if "array.pitch_mm" not in case.given or case.design.is_graded:
        return quantities, None
    bands = ask(case, Bands(), Run(log, detailed=False))
    gaps = [{name: value for name, value in gap.values().items() if "error" not in name} for gap in bands.gaps]
    return quantities | {"gaps": gaps}, bands.to_dict()


def flat(value: Any, name: str = "") -> Flat:
    """Return numbers, words and short lists by dotted name, named parts by their names, without tables of points."""
    if isinstance(value, dict):
        inside = (flat(item, f"{name}.{key}" if name else str(key)) for key, item in value.items())
        return {key: item for part in inside for key, item in part.items()}
    if isinstance(value, list):
        for own in NAMED:
            if value and all(isinstance(item, dict) and item.keys() >= set(own) for item in value):
                names = ["-".join(str(item[key]) for key in own) for item in value]
                parts = [{key: item[key] for key in item if key not in own} for item in value]
                return flat(dict(zip(names, parts, strict=True)), name)
        return {name: value} if len(value) <= 3 and not any(isinstance(item, (dict, list)) for item in value) else {}
    return {name: value}


def lined_up(one: Flat, two: Flat) -> list[dict[str, Any]]:
    """Return one row per quantity of either design; the difference is relative to A where both are numbers."""
    both = ((name, one.get(name), two.get(name)) for name in dict.fromkeys((*one, *two)))
    return [{"quantity": name, "a": a, "b": b, "difference": _difference(a, b)} for name, a, b in both]


def _differs(row: dict[str, Any]) -> bool:
    """Whether two designs differ in a quantity; an expected error is not one of a design."""
    if row["a"] == row["b"] or ".expected_error." in row["quantity"]:
        return False
    return row["difference"] is None or abs(row["difference"]) > ROUNDING


def _difference(a: Any, b: Any) -> float | None:
    numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in (a, b))
    return b / a - 1.0 if numbers and a else None
