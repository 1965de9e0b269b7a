"""docs/thesis-reproduction.md: the thesis' figures compared with ours, `python -m studies.reproduction [--results DIR]`.

Plates and cells come from stored studies (`antinode run NAME` for each of STUDIES); isolated pillars and chapters 1 and 3 are
computed here. The page names a study that was not run instead of its figures. The outlook has its own studies (WISHES) and
pictures. `--only NAME ...` rewrites only the rows and the outlook's sections of these studies.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geometry.files import written_whole
from geometry.hex.boxes import hex_mesh, pillar_boxes
from pipeline.case.model import load_case
from pipeline.paths import RESULTS
from pipeline.planning import mesh_rules
from pipeline.plots import style
from pipeline.quantity import UM
from pipeline.questions.bands import BandsResult
from pipeline.questions.broadband import BroadbandResult
from pipeline.questions.crosstalk import CrosstalkResult
from pipeline.questions.hybrid import HybridResult
from pipeline.questions.result import Result
from pipeline.questions.touch import TouchResult
from pipeline.questions.travel import TravelResult
from pipeline.records import outputs
from pipeline.records.record import Record
from pipeline.records.store import BadRecord, write_atomic
from pipeline.records.study import read_study
from pipeline.report.text import compare
from solvers.analytic.predesign import pillar_frequencies_hz
from solvers.fem.eigen import modes_near
from solvers.fem.solid import SolidModel
from solvers.measures.confinement import CONFINED_DB
from studies import ladder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = Path(__file__).resolve().parents[1] / "docs" / "thesis-reproduction.md"
STUDIES = ("rows", "extension", "periodicity", "prototype", "height", "cell")
ACTIVE = {"shaping": "shaping (chapter 3)", "dq": "closed loop (chapter 2)"}
PILLARS_MM = {7.1: 32.0, 6.5: 35.0, 6.3: 38.0}
NEAR = 0.02
NOT_IN_THESIS, MIRRORED = ("not given", "not treated"), "confined right"
FURTHER = "; (any voltages|on the mode|free wave)"  # of our own figures: where what the thesis does not have begins
INTRODUCTION = """# The thesis' figures compared with ours

*Design of controlled localized mechanical waves: application to haptics* is a doctoral thesis of the project HASAMé
(ANR-21-CE33-0020); our copy names no author, university or year. `python -m studies.reproduction` writes this page from
stored studies ({studies}) and the models of `antinode active`. Our meshes have a [known error](verification.md), and
nothing was tuned towards the thesis. "agrees" means within {near:.0%}, or the same verdict; for `antinode active`, within
the digits of the text. These commands also print the reasons, and figures that the thesis does not give. The figures of
`antinode active mason`, `pillar` and `beam` (chapters 1 and 3) are in [Errors in the thesis' formulas](thesis-errata.md).
The outlook has its own studies, named in each section. In a "split" mode, several modes share the target shape.
"""
HEADINGS = ("quantity", "thesis", "ours", "verdict")
CENTRE_HZ = 34.6e3  # of the band of three rows of 6.2 mm
OFF_MM = 0.41
EDGE_HZ = 200.0  # two points of the studies' grid: at the ends it is 10 dB by definition

Row = tuple[str, str, str, str]


def stored(folder: Path, name: str) -> list[Record]:
    """The records of a study; none where it is not stored."""
    try:
        return [case.record for case in read_study(folder / name).cases]
    except BadRecord:
        return []


def plates(folder: Path) -> tuple[list[Row], list[str]]:
    """Figures that the studies' records answer, and the studies that are not stored."""
    records = {name: stored(folder, name) for name in STUDIES}
    entries = compare([record for own in records.values() for record in own])
    return [_row(entry) for entry in entries], [name for name, own in records.items() if not own]


def _row(entry: dict[str, Any]) -> Row:
    words = f" {entry['unit']}" if entry["unit"] else ""
    verdict = verdict_of(entry["thesis"], entry["ours"])
    if entry["note"] and verdict != "agrees":
        verdict += f": {entry['note']}"
    return entry["quantity"], f"{entry['thesis']}{words}", f"{entry['shown']}{words}", verdict


def verdict_of(thesis: Any, ours: Any) -> str:
    """Agreement of two figures, or of two verdicts by their first word."""
    if isinstance(thesis, str) or isinstance(ours, str):
        return "agrees" if str(thesis).split()[0] == str(ours).split()[0] else "differs"
    change = ours / thesis - 1.0
    return "agrees" if abs(change) <= NEAR else f"differs by {change:+.1%}"


def pillars() -> list[Row]:
    """The lone pillar of three lengths, foot clamped, in three dimensions; the longest by beam theory too."""
    case = load_case(Path(__file__).parent / "three-rows.toml", [])
    rows: list[Row] = []
    assert case.design.pillar
    for height_mm, thesis_khz in PILLARS_MM.items():
        pillar = replace(case.design.pillar, height_m=1e-3 * height_mm)
        design = replace(case.design, pillar=pillar)
        settings = mesh_rules.pillar_mesh(design, mesh_rules.mesh_level("pillar", 1e-3))
        model = SolidModel(
            hex_mesh(pillar_boxes(pillar, settings), settings.order), ladder.materials(), ("touch",), True
        )
        ours = min(modes_near(model.pencil(symmetry), 0.0, 1).frequency_hz[0] for symmetry in model.symmetries) / 1e3
        what, figure, words = "foot clamped", ours, f"{ours:.2f} kHz"
        if height_mm == max(PILLARS_MM):
            what, figure = "analytic", float(pillar_frequencies_hz(pillar, "euler")[0]) / 1e3
            words = f"{figure:.2f} kHz by beam theory, {ours:.2f} in three dimensions"
        rows.append((f"pillar {height_mm} mm, {what}", f"{thesis_khz:g} kHz", words, verdict_of(thesis_khz, figure)))
    return rows


def active(model: str) -> list[Row]:
    """The entries of one model of chapters 1 and 3 that the thesis has, without the mirror image of a region."""
    command = [sys.executable, "-m", "pipeline.cli.main", "active", model, "--json", "-", "--quiet"]
    documents = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    given = (e for e in documents["comparison"] if e["thesis"] not in NOT_IN_THESIS)
    rows = [
        (e["quantity"], e["thesis"], re.split(FURTHER, e["ours"])[0], re.split("(?<! for):|;", e["agreement"])[0])
        for e in given
    ]
    return [row for row in rows if not row[0].startswith(MIRRORED)]


def heights_mm(record: Record) -> tuple[float, ...]:
    """Heights of a case's rows from the zone outwards."""
    design = record.design
    assert design and design.pillar
    return tuple(1e3 * pillar.height_m for pillar in design.graded_pillars or [design.pillar] * design.rows)


def _of_graded(record: Record, others: list[Record]) -> tuple[str, ...] | None:
    """A design's line; `others` holds it with the same deviation of every height."""
    broad, target, own = record.of(BroadbandResult), record.target, heights_mm(record)
    if broad is None:
        return None
    levels = {
        off: held.taken_db(target.frequency_hz)
        for other in others
        if target and (held := other.of(BroadbandResult)) and (off := _off_mm(heights_mm(other), own)) is not None
    }
    both_ends = levels and min(levels) < 0.02 - OFF_MM and max(levels) > OFF_MM - 0.02
    band = broad.stopped_hz
    inner = [p.taken_db for p in broad.points if band and band[0] + EDGE_HZ <= p.frequency_hz <= band[1] - EDGE_HZ]
    return (
        ", ".join(f"{height:g}" for height in own),
        f"{band[0] / 1e3:.1f} to {band[1] / 1e3:.1f}" if band else "none",
        f"{min(inner):.1f}" if inner else "none",
        f"{broad.taken_db(CENTRE_HZ):.1f}",
        f"{target.frequency_hz / 1e3:.2f} kHz, {target.confinement_db:.1f} dB" if target else "none",
        f"{min(levels.values()):.1f} to {max(levels.values()):.1f}" if both_ends else "not stored",
    )


def _off_mm(heights: tuple[float, ...], own: tuple[float, ...]) -> float | None:
    """How far all heights are off together; None where they are not, or by more than OFF_MM."""
    changes = [there - here for there, here in zip(heights, own, strict=True)]
    alike = max(changes) - min(changes) < 1e-6 and abs(changes[0]) <= OFF_MM
    return changes[0] if alike else None


def _by_frequency(records: list[Record]) -> Figure:
    """What the rows of the first two designs take over frequency."""
    figure, axes = style.panels(3.8)
    for record, colour in zip(records[:2], (style.GREY, style.BLUE), strict=False):
        held = record.of(BroadbandResult)
        points = held.points if held else []
        tone = [point.frequency_hz / 1e3 for point in points]
        name = ", ".join(f"{height:g}" for height in heights_mm(record))
        axes.plot(tone, [point.taken_db for point in points], color=colour, label=f"rows of {name} mm")
    axes.axhline(CONFINED_DB, color=style.GREEN, lw=0.9, ls="--", label=f"{CONFINED_DB:g} dB")
    axes.set(xlabel="frequency (kHz)", ylabel="taken from a flexural wave (dB)", ylim=(0.0, 60.0))
    axes.legend()
    return figure


def _touched_design(record: Record) -> str:
    rows = record.sweep.get("array.rows")
    return f"{rows} {'row' if rows == 1 else 'rows'}, {record.sweep.get('touch.impedance')}"


def _by_power(records: list[Record]) -> Figure:
    """Power at 1 um under the finger of each design, all patches in phase and with shaped voltages."""
    figure, axes = style.panels(2.8)
    looks = ((-0.2, "touched", "in phase", style.BLUE), (0.2, "shaped", "shaped for contrast", style.VERMILION))
    for offset, name, label, colour in looks:
        states = [touch and touch.state(name) for touch in (record.of(TouchResult) for record in records)]
        powers = [(i, s.drawn_mW_at_1um) for i, s in enumerate(states) if s and s.drawn_mW_at_1um is not None]
        axes.bar([i + offset for i, _ in powers], [power for _, power in powers], 0.38, color=colour, label=label)
    axes.set_xticks(range(len(records)), [_touched_design(record).replace(", ", ",\n") for record in records])
    axes.set(ylabel="power at 1 µm (mW)", yscale="log")
    axes.legend()
    return figure


def _of_touch(record: Record) -> tuple[str, ...] | None:
    touch = record.of(TouchResult)
    if touch is None:
        return None
    states = [touch.state(name) for name in ("free", "touched", "shaped")]
    shift = "unknown" if touch.mode is None else f"{touch.mode.shift_hz:+.0f}"
    amplitudes = ["none" if s is None else f"{s.finger_m / UM:.3g}" for s in states[:2]]
    levels = ["none" if s is None or s.confinement_db is None else f"{s.confinement_db:.1f}" for s in states]
    watts = [_watts(None if s is None else s.drawn_mW_at_1um) for s in states[1:]]
    return _touched_design(record), shift, *amplitudes, *levels, *watts


def _watts(power_mw: float | None) -> str:
    if power_mw is None:
        return "none"
    return f"{power_mw:.3g} mW" if power_mw < 1e3 else f"{float(f'{power_mw / 1e3:.3g}'):g} W"


def _of_glass(record: Record) -> tuple[str, ...] | None:
    design = record.design
    if design is None:
        return None
    pillar = design.pillar if design.rows else None
    cap = pillar.upper[-1] if pillar and pillar.upper else None
    return (
        str(design.rows),
        f"{1e3 * pillar.base_m:g} x {1e3 * pillar.height_m:g}" if pillar else "none",
        f"{1e3 * cap.base_m:g} x {1e3 * cap.height_m:g}" if cap else "none",
        f"{1e3 * design.width_m:g}",
        *_mode(record),
    )


def _mode(record: Record) -> tuple[str, str]:
    """The target mode's frequency and how it stands, and its confinement with its bar."""
    target = record.target
    bar = f" ± {target.confinement_error_db:.1f}" if target and target.confinement_error_db is not None else ""
    return (
        f"{target.frequency_hz / 1e3:.2f}, {target.status}" if target else "none",
        "none" if record.confinement_db is None else f"{record.confinement_db:.1f}{bar}",
    )


@dataclass(frozen=True)
class Wish:
    """A wish of the thesis' outlook with a stored study: its table, with rows from another study if given, and its picture."""

    study: str
    title: str
    words: str
    headings: str
    row: Callable[..., tuple[str, ...] | None]
    draw: Callable[[list[Record]], Figure]
    other: str = ""
    listed: Callable[[Record], bool] = lambda record: True  # of the cases of the picture, those of the table

    def text(self, folder: Path) -> str:
        """The section, with its picture stored next to the page; empty if the study is not stored."""
        others = [stored(folder, self.other)] if self.other else []
        rows = {row: record for record in stored(folder, self.study) if (row := self.row(record, *others))}
        if not rows:
            return ""
        picture = f"pictures/{self.study}.svg"
        with style.style(), written_whole(PAGE.parent / picture) as temporary:
            self.draw([*rows.values()]).savefig(temporary, format="svg", bbox_inches="tight", metadata={"Date": None})
        words = f"{self.words} (`antinode run {self.study}`)."
        body = outputs.markdown(
            self.headings.split(" | "), [row for row, record in rows.items() if self.listed(record)]
        )
        return f"\n## Outlook: {self.title}\n\n{words}\n\n{body}\n![{self.title}]({picture})\n"


def _of_faces(record: Record) -> tuple[str, ...] | None:
    design = record.design
    if design is None or design.pillar is None:
        return None
    stopped = (held := record.of(BroadbandResult)) and held.stopped_hz
    low, high = (end / 1e3 for end in stopped) if stopped else (0.0, 0.0)
    band = f"{low:.1f} to {high:.1f}" if stopped else "none"
    return f"{design.rows}", _faces(record), band, *_mode(record)


def _of_staggered(record: Record) -> tuple[str, ...] | None:
    design, bands = record.design, record.of(BandsResult)
    if design is None or bands is None:
        return None
    gap = next(iter(bands.gaps), None)
    none = f"none up to {bands.known_to_hz / 1e3:.1f}"
    edges = f"{gap.lower_hz / 1e3:.1f} to {gap.upper_hz / 1e3:.1f}" if gap else none
    return f"{design.rows}", _stand(record), edges, *_mode(record)


def _stand(record: Record) -> str:
    return "shifted" if record.design and record.design.staggered else "in line"


def _pillars(record: Record) -> str:
    pillar = record.design.pillar if record.design and record.design.rows else None
    return "no pillars" if pillar is None else "heavy caps" if pillar.upper else "plain pillars"


def _faces(record: Record) -> str:
    pillar = record.design.pillar if record.design else None
    return "both" if pillar and pillar.faces == 2 else "back alone"


def _by_rows(title: str, kind: Callable[[Record], str]) -> Callable[[list[Record]], Figure]:
    """Draws the target mode's confinement over the rows, with its bars, kind by kind."""

    def draw(records: list[Record]) -> Figure:
        figure, axes = style.panels(3.0)
        known = [record for record in records if record.confinement_db is not None and record.design and record.target]
        for number, (name, marker) in enumerate(zip(dict.fromkeys(map(kind, known)), "os^", strict=False)):
            own = [record for record in known if kind(record) == name]
            bars = [(record.target and record.target.confinement_error_db) or 0.0 for record in own]
            rows = [(record.design.rows if record.design else 0) + 0.04 * number for record in own]
            levels = [record.confinement_db for record in own]
            axes.errorbar(rows, levels, bars, fmt=marker, capsize=3, color=style.CYCLE[number], label=name)
        axes.set(xlabel="rows on either side of the zone", ylabel="confinement (dB)")
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.legend(title=title)
        return figure

    return draw


def _of_hybrid(record: Record) -> tuple[str, ...] | None:
    hybrid = record.of(HybridResult)
    if hybrid is None or hybrid.target_hz is None:
        return None

    def level(method: str, values: str = "confinement_db") -> str:
        figure = hybrid.at_target(method, values) if hybrid else None
        return "none" if figure is None else f"{figure:.3g}"

    off = [level("rows", "rows_off_db"), level("patches", "off_db"), level("both", "rows_off_db")]
    volts = [level(method, "volts_per_um") for method in ("rows", "patches", "both")]
    levels = [level(method) for method in ("neither", "rows", "patches", "both")]
    return f"{record.design.rows if record.design else '?'}", f"{hybrid.target_hz / 1e3:.2f}", *levels, *off, *volts


def _of_travel(record: Record) -> tuple[str, ...] | None:
    travel = record.of(TravelResult)
    if travel is None:
        return None
    level = "none" if travel.confinement_db is None else f"{travel.confinement_db:.1f}"
    watts = max(map(abs, travel.flow_W)), max(map(abs, travel.standing_flow_W))
    crests = "none" if travel.shear is None else f"{1e3 * abs(travel.shear.fastest_m_s):.3g}"
    ratios = (f"{travel.twr:.2f}", f"{travel.best_twr:.2f}", level)
    rows = f"{record.design.rows if record.design else '?'}"
    return (
        *(rows, f"{travel.frequency_hz / 1e3:.2f}", *ratios, f"{travel.drive_V_at_1um:.3g}"),
        *(f"{1e3 * each:.3g}" for each in watts),
        crests,
    )


def _of_zones(record: Record) -> tuple[str, ...] | None:
    crosstalk = record.of(CrosstalkResult)
    if crosstalk is None or crosstalk.worst_db is None:
        return None
    first = crosstalk.zones[0]
    passive = "none" if first.passive_db is None else f"{first.passive_db:.1f}"
    gap, tone = f"{1e3 * crosstalk.gap_m:.1f}", f"{first.peak_hz / 1e3:.2f}"
    return f"{crosstalk.shared_rows}", gap, tone, f"{crosstalk.worst_db:.1f}", passive


def _by_gap(records: list[Record]) -> Figure:
    figure, axes = style.panels(3.0)
    known = sorted(
        (found.gap_m, found.worst_db)
        for found in (record.of(CrosstalkResult) for record in records)
        if found and found.worst_db is not None
    )
    axes.plot([1e3 * gap for gap, _ in known], [level for _, level in known], "o-", color=style.BLUE)
    axes.set(xlabel="gap between the zones (mm)", ylabel="other zone over the driven one (dB)")
    return figure


def _picture_of(kind: type[Result]) -> Callable[[list[Record]], Figure]:
    """Draws the answer of a kind in the last case."""

    def draw(records: list[Record]) -> Figure:
        answer = records[-1].of(kind)
        assert answer
        return answer.pictures()[0].figure

    return draw


WISHES = (
    Wish(
        "graded",
        "broadband rows",
        "The thesis wishes for passive confinement over a wide band. Three rows of different heights (`[array] "
        "heights_mm`) are compared with three equal ones, with the same footprint, pitch and margin (25 mm): power "
        "stopped of a flexural wave at the target wavenumber, target mode of the finite plate, and the effect of a batch "
        "deviation (study graded-heights)",
        "heights from the zone outwards (mm) | 10 dB stopped around the target mode (kHz) | least inside (dB) | at 34.6 "
        "kHz (dB) | target mode, finite plate | at the target mode, heights ±0.4 mm (dB)",
        _of_graded,
        _by_frequency,
        "graded-heights",
    ),
    Wish(
        "touch",
        "vibration under a finger",
        "Not in the thesis: amplitudes at the study's voltage, and the power of the patches for 1 um under the finger. The "
        "picture also has the fingertips `light` and `tissue`",
        "design, fingertip | detuning (Hz) | free (um) | touched (um) | confinement free (dB) | touched (dB) | shaped "
        "(dB) | power in phase | power shaped",
        _of_touch,
        _by_power,
        listed=lambda record: record.sweep.get("touch.impedance") == "finger",
    ),
    Wish(
        "glass",
        "tip masses on a cover glass",
        "Not in the thesis: glass 0.7 mm thick with a half-wavelength of 15 mm and at most 3 mm of height behind it. "
        "`antinode search` maximised the confinement above 25 kHz, for plain pillars and for pillars with a tip mass "
        "(studies/glass-plate.toml)",
        "rows | pillars, width x height (mm) | tip masses (mm) | zone's width (mm) | target mode (kHz) | confinement (dB)",
        _of_glass,
        _by_rows("rows of", _pillars),
    ),
    Wish(
        "hybrid",
        "rows and patches together",
        "The thesis wishes for passive and active confinement together. At the target peak, the patches inside the zone "
        "drive in phase (neither, rows), or all patches, including those behind the rows, with voltages shaped for "
        "contrast (patches, both). Detuned: the pillars' resonances (without rows, every resonance) shifted by 2 %. "
        "Drive: largest voltage for 1 um rms",
        "rows | frequency (kHz) | neither (dB) | rows | patches | both | rows, detuned (dB) | patches | both | "
        "rows, drive (V) | patches | both",
        _of_hybrid,
        _picture_of(HybridResult),
    ),
    Wish(
        "travelling",
        "a travelling wave inside the zone",
        "Six patches drive two modes a quarter period apart, for 1 um rms in the zone. Ratio and power (the largest through "
        "a section) are those of the pair; the columns next to them have any voltages and all patches in phase. Crests: "
        "largest crest speed under a resting finger, along the plate and against the wave",
        "rows | frequency (kHz) | ratio | any voltages | confinement (dB) | drive (V) | "
        "power (mW) | in phase (mW) | crests (mm/s)",
        _of_travel,
        _picture_of(TravelResult),
    ),
    Wish(
        "zones",
        "two zones on one plate",
        "Two zones of the thesis with rows between them, one driven at its own peak",
        "shared rows | gap (mm) | frequency (kHz) | other zone (dB) | passive face (dB)",
        _of_zones,
        _by_gap,
    ),
    Wish(
        "faces",
        "pillars on both faces",
        "Every pillar of the thesis' plate has a mirror image on the touch face, with a margin of 25 mm and the same "
        "heights. The stopped power is that of the rows alone",
        "rows | pillars on | 10 dB stopped (kHz) | target mode (kHz) | confinement (dB)",
        _of_faces,
        _by_rows("pillars on", _faces),
    ),
    Wish(
        "staggered",
        "staggered rows",
        "Every other row is shifted by half a pitch along the zone, with a pitch of 5 mm and a margin of 25 mm. The gap "
        "is the first complete one of the lattice",
        "rows | arrangement | gap (kHz) | target mode (kHz) | confinement (dB)",
        _of_staggered,
        _by_rows("rows stand", _stand),
    ),
)


def text(folder: Path) -> str:
    """The page."""
    documents, missing = plates(folder)
    page = INTRODUCTION.format(studies=", ".join(STUDIES), near=NEAR)
    page += "\n## Zone, pillars, cell and plates (chapter 2)\n\n" + outputs.markdown(HEADINGS, [*pillars(), *documents])
    if missing:
        page += f"\nNot stored, hence not compared: {', '.join(missing)} (`antinode run NAME`).\n"
    for model, chapter in ACTIVE.items():
        page += f"\n## `antinode active {model}`: {chapter}\n\n" + outputs.markdown(HEADINGS, active(model))
    wishes = {wish.study: wish.text(folder) for wish in WISHES}
    page += "".join(wishes.values())
    absent = [name for name, section in wishes.items() if not section]
    return page + (f"\nNot stored: {', '.join(absent)} (`antinode run NAME`).\n" if absent else "")


def renewed(page: str, sections: list[str]) -> str:
    """A page with some of its sections, each with its heading, in place of those of the same heading, or at its end."""
    parts = page.split("\n## ")
    for section in sections:
        own = f"{section.strip().removeprefix('## ')}\n"
        headings = [part.partition("\n")[0] for part in parts]
        heading = own.partition("\n")[0]
        if heading in headings:
            parts[headings.index(heading)] = own
        else:
            parts.append(own)
    return "\n## ".join(parts)


def with_rows(page: str, rows: list[Row]) -> str:
    """A page with rows of its tables in place of those of the same quantity."""
    for row in rows:
        line = f"| {' | '.join(row)} |".replace("\\", r"\\")
        page = re.sub(rf"^\| {re.escape(row[0])} \|.*$", line, page, flags=re.MULTILINE)
    return page


def _only(page: str, names: list[str], folder: Path) -> str:
    """A page with what these studies say of it. SystemExit for a study without a place there, or that is not stored."""
    known = {wish.study: wish for wish in WISHES}
    for name in names:
        section = known[name].text(folder) if name in known else ""
        rows = [_row(entry) for entry in compare(stored(folder, name))] if name in STUDIES else []
        if not section and not rows:
            raise SystemExit(f"--only {name}: must be a stored study of {', '.join([*STUDIES, *known])}")
        page = with_rows(renewed(page, [section] if section else []), rows)
    return page


def main() -> int:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", type=Path, default=RESULTS, metavar="DIR")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME")
    arguments = parser.parse_args()
    folder = arguments.results
    page = _only(PAGE.read_text(), arguments.only, folder) if arguments.only else text(folder)
    write_atomic(PAGE, page.encode())
    print(f"reproduction {PAGE}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
