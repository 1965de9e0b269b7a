"""Texts of the report: numbers with units, sentences, and values of the thesis compared with ours."""

from __future__ import annotations

import csv
import json
import math
import shlex
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import metadata
from math import log
from pathlib import Path
from typing import Any

import numpy as np

from pipeline import quantity
from pipeline.case.reading import effective, toml_text
from pipeline.models.answer_parts import ModeRecord, TargetMode
from pipeline.paths import REFERENCE, RESULTS, ROOT, STUDIES
from pipeline.quantity import KHZ, MM, Unit, frequency_figure, level
from pipeline.questions import study as asked
from pipeline.questions.attenuation import AttenuationResult
from pipeline.questions.bands import BandsResult
from pipeline.questions.predesign import PredesignResult
from pipeline.records.record import DesignRecord, Record
from pipeline.records.study import StoredCase, StoredStudy
from pipeline.records.tables import without_effect
from solvers.measures.confinement import CONFINED_DB

FILE = REFERENCE / "thesis.csv"
TITLE = "Design of controlled localized mechanical waves: application to haptics"  # a doctoral thesis


def compare(records: list[Record], path: Path = FILE) -> list[dict[str, Any]]:
    """Return rows {quantity, thesis, ours, shown (in words), unit, note} for every thesis value found in a record."""
    rows = []
    with path.open(newline="", encoding="utf-8") as file:
        for entry in csv.DictReader(file):
            found = next((pair for record in records if (pair := _ours(entry, record)) is not None), None)
            if found is not None:
                keys = ("quantity", "unit", "note")
                ours = {"ours": found[0], "shown": found[1]}
                rows.append({key: entry[key] for key in keys} | {"thesis": _plain(entry["thesis"])} | ours)
    return rows


def _plain(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _ours(entry: dict[str, str], record: Record) -> tuple[float | str, str] | None:
    """Return a figure of a record in kHz or a verdict, and its words; None if the record has none."""
    if record.design is None or not _same_design(entry, record.design):
        return None
    value, error = _figure(entry["key"], record)
    if not isinstance(value, float):
        return (value, value) if value else None
    return value / KHZ, frequency_figure(value, error, Unit("kHz", KHZ))


def _same_design(entry: dict[str, str], design: DesignRecord) -> bool:
    if design.graded_pillars:  # all rows of the thesis are identical
        return False
    ours = {
        "rows": design.rows,
        "pitch_mm": (design.pitch_x_m or 0.0) / MM,
        "extension_mm": (design.extension_m or 0.0) / MM,
    }
    return all(not entry[key] or math.isclose(float(entry[key]), value, abs_tol=1e-6) for key, value in ours.items())


def confinement_words(mode_db: float | None, driven_db: float | None, error_db: float | None = None) -> str | None:
    """Return whether a plate confines its mode, as in the thesis and also when driven; None without passive face.

    error_db: error bar of the level of the mode (half-width).
    """
    if mode_db is None:
        return None
    said = f"{'confined' if mode_db >= CONFINED_DB else 'leaks'} ({level(mode_db, error_db)} as a mode"
    if driven_db is None:
        return f"{said})"
    apart = mode_db >= CONFINED_DB > driven_db
    return f"{said}, {level(driven_db)} driven by its patches{', which is not confined' if apart else ''})"


def _figure(key: str, record: Record) -> tuple[float | str | None, float | None]:
    """Return a figure in Hz, or the verdict, and its relative error bar."""
    target, bands, zone, pillar = (
        record.target,
        record.of(BandsResult),
        record.held("zone_modes"),
        record.held("pillar_modes"),
    )
    gap = bands.gaps[0] if bands and bands.gaps else None
    peak = record.response.target_peak if record.response else None
    known = record.of(PredesignResult)
    sizes = known.zone if known else None
    level_error, none = target.confinement_error_db if target else None, (None, None)
    figures: dict[str, Callable[[], tuple[float | str | None, float | None]]] = {
        "verdict": lambda: (confinement_words(record.confinement_db, record.driven_db, level_error), None),
        "zone": lambda: (zone.target.frequency_hz, zone.target.frequency_error) if zone and zone.target else none,
        "pillar": lambda: (pillar.modes[0].frequency_hz, pillar.modes[0].error) if pillar else none,
        "bending": lambda: (
            (bands.bending_at_m_hz[0], bands.bending_errors[0]) if bands and bands.bending_at_m_hz else none
        ),
        "formula": lambda: (sizes.formula_hz, None) if sizes else none,
        "target": lambda: (target.frequency_hz, target.frequency_error) if target else none,
        "peak": lambda: (peak.frequency_hz, peak.frequency_error) if peak else none,
        "gap_lower": lambda: (gap.lower_hz, gap.lower_error) if gap else none,
        "gap_upper": lambda: (gap.upper_hz, gap.upper_error) if gap else none,
    }
    return figures[key]()


MAX_MODES = 40
MAX_PLANS = 12
WIDE = "\u202f"


@dataclass(frozen=True)
class Card:
    """Headline: name, value, note below it, severity (good, bad or plain)."""

    name: str
    value: str
    note: str
    severity: str = "plain"


def si(value: Any) -> str:
    """Format a number: a count with thin spaces between thousands, a figure without an error bar, '-' for None."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}".replace(",", WIDE)
    return quantity.figure(value) if isinstance(value, float) else str(value)


def khz(frequency_hz: float | None, error: float | None = None) -> str:
    """Format a frequency with the digits that its relative error bar allows, in a suitable unit."""
    return quantity.frequency(frequency_hz, error, WIDE)


def db(level_db: float | None, error_db: float | None = None) -> str:
    """Format a level in dB with the digits that its error bar allows."""
    return quantity.level(level_db, error_db, WIDE)


def bar(value: float | None, error: float | None, unit: str) -> str:
    """Format a frequency in Hz with its relative error bar, or a level in dB with its own."""
    if unit == "Hz":
        return quantity.frequency_with_bar(value, error, WIDE)
    return quantity.with_bar(value, error, unit, WIDE) if error is not None else db(value)


def share_of_zone(target: TargetMode) -> str:
    """Format the zone fraction of the squared normal displacement with the digits of its error bar."""
    return quantity.percentage(target.zone_share, target.zone_share_error, WIDE)


def verdict(record: Record) -> str:
    """Describe whether the target mode is confined, as a mode and driven, or left open by the expected error."""
    level, error = record.confinement_db, record.target.confinement_error_db if record.target else None
    close = error is not None and level is not None and abs(level - CONFINED_DB) <= error
    return f"{record.verdict}, but within its expected error of {CONFINED_DB:g} dB" if close else record.verdict


def best_case(study: StoredStudy) -> StoredCase | None:
    """Return the case with the best confined target mode, as driven if patches exist; else the first with a mode."""
    levels = {case.case_id: level for case in plates(study) if (level := case.record.ranked_db) is not None}
    best = max(levels, key=lambda name: levels[name]) if levels else None
    return next((case for case in study.cases if case.case_id == best or (best is None and case.record.target)), None)


def cards(study: StoredStudy) -> list[Card]:
    """Return the headlines of a study: target mode, its confinement, drive, rows, their band, status of the cases."""
    best = best_case(study)
    makers = (_target_card, _confinement_card, _voltage_card, _rows_card, _band_card) if best else ()
    made = [make(study, best) for make in makers if best]
    return [*(card for card in made if card), _ended(study)]


def _source(study: StoredStudy, case: StoredCase) -> str:
    """Name the design of a figure if the study has several; all headlines refer to one."""
    return f"; plate {case.case_id}" if len(plates(study)) > 1 else ""


def _target_card(study: StoredStudy, best: StoredCase) -> Card | None:
    target = best.record.target
    if target is None:
        return None
    note = "" if target.mac is None else f"MAC {quantity.figure(target.mac, target.mac_error)} to the analytic shape"
    split = ", shape split among several modes" if target.status == "split" else ""
    return Card(
        "Target mode", bar(target.frequency_hz, target.frequency_error, "Hz"), note + split + _source(study, best)
    )


def _confinement_card(study: StoredStudy, best: StoredCase) -> Card | None:
    record = best.record
    if record.confinement_db is None:
        return None
    driven, level = "", bar(record.confinement_db, record.target.confinement_error_db if record.target else None, "dB")
    if record.driven_db is not None:
        driven = f"; driven at its own peak, {level} as a mode"
        level = bar(record.driven_db, record.driven_error_db, "dB")
    count = sum(case.record.confined is not None for case in plates(study))
    where = f", best of {count} plates" if count > 1 else ""
    note = verdict(record) + driven + where + _source(study, best)
    return Card("Confined to the zone", level, note, "good" if record.confined else "bad")


def _rows_card(study: StoredStudy, best: StoredCase) -> Card | None:
    """Return the smallest number of rows that confines the mode on a finite plate, else the infinite-array estimate."""
    prediction = best.record.held("prediction")
    estimate = prediction.rows_needed if prediction else None
    per_row = (
        f"{db(prediction.db_per_row, prediction.db_error)} per row at the target mode, "
        if prediction and prediction.db_per_row
        else ""
    )
    name = f"Rows for {CONFINED_DB:g}{WIDE}dB"
    enough = [case.sweep["array.rows"] for case in _like(study, best) if case.record.confined]
    if enough:
        infinite = f"; {per_row}an infinite array would need {estimate}" if estimate else ""
        return Card(
            name, str(min(enough)), f"the fewest that confine it on a finite plate{infinite}{_source(study, best)}"
        )
    if estimate:
        return Card(name, f"≥ {estimate}", f"{per_row}an estimate for an infinite array{_source(study, best)}")
    return None


def _like(study: StoredStudy, best: StoredCase) -> list[StoredCase]:
    """Return plates that differ from the best only in their rows."""
    others = {key: value for key, value in best.sweep.items() if key != "array.rows"}
    return [
        case
        for case in study.cases
        if "array.rows" in case.sweep and {k: v for k, v in case.sweep.items() if k != "array.rows"} == others
    ]


def _voltage_card(study: StoredStudy, best: StoredCase) -> Card | None:
    """Return the amplitude of the drive for one micrometre at the target mode's peak."""
    peak = best.record.response.target_peak if best.record.response else None
    if peak is None or peak.volts_per_um is None:
        return None
    value = quantity.with_bar(peak.volts_per_um, peak.volts_error_per_um, "V", WIDE)
    height = quantity.with_bar(peak.zone_nm_per_V, peak.zone_error_nm_per_V, "nm/V", WIDE)
    quality = best.record.response.quality_factor_given if best.record.response else None
    given = f", with a quality factor of {quantity.figure(quality)}" if quality else ""
    return Card("Drive for 1 µm", value, f"{height} rms over the zone at its driven peak{given}{_source(study, best)}")


def _band_card(study: StoredStudy, best: StoredCase) -> Card | None:
    """Return the band around the target mode in which the rows of an infinite array take as much as confinement needs."""
    known, target = best.record.of(AttenuationResult), best.record.target
    if known is None or target is None or target.frequency_hz is None or not known.rows or not len(known.decay):
        return None
    count = f"{known.rows} row{'s' if known.rows != 1 else ''}"
    name, wave = (
        f"{count} take {CONFINED_DB:g}{WIDE}dB",
        "from flexural waves of the zone's wavelength, in an infinite array",
    )
    ends = band_of_rows(known, target.frequency_hz)
    if ends is None:
        return Card(name, "not at the target mode", f"{wave}{_source(study, best)}", "bad")
    limits = known.decay[0, 0], known.decay[-1, 0]
    cut = " or wider: the computed band ends there" if ends[0] <= limits[0] or ends[1] >= limits[1] else ""
    value = quantity.interval(*ends, None, None, to="–", space=WIDE)
    return Card(name, value, f"{wave}{cut}{_source(study, best)}", "good")


def band_of_rows(known: AttenuationResult, frequency_hz: float) -> tuple[float, float] | None:
    """Return the frequencies around one between which the rows take at least CONFINED_DB; None if they do not at it."""
    tone, excess = known.decay[:, 0], known.rows * known.decay[:, 1] - CONFINED_DB
    if not tone[0] <= frequency_hz <= tone[-1] or np.interp(frequency_hz, tone, excess) < 0.0:
        return None
    crossings = [
        float(a + (b - a) * low / (low - high))
        for a, b, low, high in zip(tone[:-1], tone[1:], excess[:-1], excess[1:], strict=True)
        if (low < 0.0) != (high < 0.0)
    ]
    lower = max((at for at in crossings if at <= frequency_hz), default=float(tone[0]))
    return lower, min((at for at in crossings if at > frequency_hz), default=float(tone[-1]))


def plates(study: StoredStudy) -> list[StoredCase]:
    """Return the study's cases, each plate once: a plate in addition to a sweep may also be one of the sweep."""
    first: dict[str, str] = {}
    for case in sorted(study.cases, key=lambda case: not case.sweep):
        first.setdefault(_plate_key(case), case.case_id)
    return [case for case in study.cases if first[_plate_key(case)] == case.case_id]


def _plate_key(case: StoredCase) -> str:
    """Return the key of the plate; the case's name without one, so that it counts once."""
    return case.record.keys.plate if case.record.keys else case.case_id


def _ended(study: StoredStudy) -> Card:
    counts = Counter[str](case.record.status for case in study.cases)
    done = counts["OK"] + counts["WARNING"]
    words = (("WARNING", "with warnings"), ("FAILED", "failed"), ("MISSING", "missing"))
    texts = ", ".join(f"{counts[key]} {word}" for key, word in words if counts[key]) or "no warning"
    good = done == len(study.cases)
    return Card("Cases", f"{done} of {len(study.cases)} done", texts, "good" if good else "bad")


def headline(study: StoredStudy) -> str:
    """Return the study's answer in one sentence for a lay reader; '' if no level was computed."""
    best = best_case(study)
    if best is None or best.record.confinement_db is None or best.record.target is None:
        return ""
    record, peak = best.record, best.record.response.target_peak if best.record.response else None
    target, ranked = best.record.target, record.confinement_db if record.ranked_db is None else record.ranked_db
    assert ranked is not None
    ratio = 10.0 ** (ranked / 20.0)
    ranked_error = record.driven_error_db if peak else target.confinement_error_db
    error = None if ranked_error is None else ratio * log(10.0) / 20.0 * ranked_error
    design = record.design
    tone = khz(peak.frequency_hz, peak.frequency_error) if peak else khz(target.frequency_hz, target.frequency_error)
    rows, gaps = (design.rows, design.row_gaps_m) if design else (0, [])
    ends = dict.fromkeys(f"{end(gaps) / MM:g}" for end in (min, max) if gaps)
    apart = f" {' to '.join(ends)}{WIDE}mm apart" if ends else ""
    what = (
        f"{rows} row{'s' if rows != 1 else ''} of pillars{apart} on each side of the zone" if rows else "a bare plate"
    )
    first = "Best of this study: " if len(plates(study)) > 1 else ""
    as_mode = db(record.confinement_db, target.confinement_error_db)
    both = f"{db(ranked, ranked_error)} as driven, {as_mode} as a mode" if peak else as_mode
    level = f"{both}; {CONFINED_DB:g}{WIDE}dB counts as confined"
    times = f"{quantity.figure(ratio, error)} times as much as the rest of the plate"
    return f"{first}{what}. At {tone} the active zone moves {times} ({level})."


def _materials(design: dict[str, Any]) -> list[str]:
    """Return the plate's materials from the touch face to the back, and those of its pillars from the foot up, if others."""

    def names(parts: Iterable[dict[str, Any]]) -> list[str]:
        found = [str((each.get("material") or {}).get("name", "")) for each in parts]
        return [name for name, before in zip(found, ["", *found], strict=False) if name and name != before]

    pillar = design.get("pillar") or {}
    plate, sections = names(design.get("layers") or [design]), names([pillar, *(pillar.get("upper") or ())])
    words = [" on ".join(plate)] if plate else []
    return [*words, f"pillars of {' under '.join(sections)}"] if sections and sections != plate else words


def facts_of(study: StoredStudy) -> list[str]:
    """Return plate, pillars, material, date and version of the best case, or of the first."""
    case = best_case(study) or study.cases[0]
    design, stored = case.record.design, (case.read("input.json") or {}).get("case") or {}
    words = []
    if design:
        words.append(
            f"plate {2.0 * design.half_length_m / MM:g} × {2.0 * design.half_span_m / MM:g} × "
            f"{design.thickness_m / MM:g}{WIDE}mm, "
            f"zone {design.width_m / MM:g}{WIDE}mm"
        )
    if design and design.pillar and design.rows:
        words.append(", ".join([design.pillar_text, *design.section_texts]))
    words += _materials(stored.get("design") or {})
    measured = ", ".join(study.about.get("measure") or [])
    words.append(
        f"{len(study.cases)} case{'s' if len(study.cases) != 1 else ''}" + (f" of {measured}" if measured else "")
    )
    words += [
        f"{key} does not affect this study: none of its measures depends on it"
        for key in without_effect(study, asked.columns_of(study))
    ]
    if day := computed_on(study):
        words.append(f"computed {day}")
    return [*words, f"Antinode {metadata.version('antinode')}"]


def computed_on(study: StoredStudy) -> str:
    """Return the day of the study's last run from its journal, '' without one."""
    try:
        lines = (study.folder / "journal.jsonl").read_text(encoding="utf-8").splitlines()
        return str(json.loads(lines[-1])["at"])[:10] if lines else ""
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def command(study: StoredStudy, case: StoredCase) -> str:
    """Return the command that computes a case's plate again."""
    base = case_file(study)
    settings = [word for key, value in effective(case.sweep.items()) for word in ("--set", f"{key}={toml_text(value)}")]
    return shlex.join(["antinode", "modes", base, *settings]) if base else ""


def case_file(study: StoredStudy) -> str:
    """Return the case file for a command: relative to the checkout for its own studies, else next to the study file."""
    base = study.about.get("case")
    if not isinstance(base, str):
        return ""
    own = study.folder.parent == RESULTS and (STUDIES / base).is_file()
    return (STUDIES / base).relative_to(ROOT).as_posix() if own else base


def sentences(study: StoredStudy) -> list[str]:
    """Return the study's answer in a few sentences."""
    said = []
    result = [case for case in plates(study) if case.record.confined is not None]
    if len(result) > 1:
        confined = [case.case_id for case in result if case.record.confined]
        names = f": {', '.join(confined)}" if 0 < len(confined) <= 6 else ""
        said.append(
            f"{len(confined)} of {len(result)} plates confine the target mode by at least {CONFINED_DB:g} dB{names}."
        )
    elif result:
        said.append(_confinement_sentence(result[0].record))
    best = best_case(study)
    bands = best.record.of(BandsResult) if best else None
    if best and bands and bands.bending_at_m_hz:
        tones = " and ".join(dict.fromkeys(map(khz, bands.bending_at_m_hz, bands.bending_errors)))
        whose = f" of plate {best.case_id}" if len(plates(study)) > 1 else ""
        said.append(f"The pillars' bending bands of the unit cell{whose} meet M at {tones}.")
    without: dict[str, list[str]] = {}
    for case in study.cases:
        if not case.record.answered:
            without.setdefault(case.record.diagnosis, []).append(case.case_id)
    for diagnosis, failed in without.items():
        who = f"{failed[0]} has" if len(failed) == 1 else f"{len(failed)} cases, {failed[0]} the first, have"
        said.append(f"{who} no result: {diagnosis}.")
    return said


def _confinement_sentence(record: Record) -> str:
    verb, target = "confines" if record.confined else "does not confine", record.target
    known = target is not None and target.zone_share is not None
    share = share_of_zone(target) if target and known else ""
    inside = f"; {share} of its squared normal displacement lies in the zone" if share else ""
    level = quantity.level(record.confinement_db, target.confinement_error_db if target else None)
    return f"The plate {verb} the target mode: {level}{inside}."


def comparison(study: StoredStudy) -> list[dict[str, Any]]:
    """Return the thesis' values compared with ours, with the difference if both are numbers; for its own studies only."""
    own = isinstance(study.about.get("case"), str) and (STUDIES / study.about["case"]).is_file()
    rows = compare([case.record for case in study.cases]) if own else []
    return [{**row, "difference": _difference(row["thesis"], row["ours"])} for row in rows]


def _difference(thesis: float | str, ours: float | str) -> str:
    if isinstance(thesis, str) or isinstance(ours, str) or not thesis:
        return ""
    return quantity.signed(quantity.percentage((ours - thesis) / thesis))


def band_difference(record: Record) -> float | None:
    """Return the largest relative difference of the two meshes' bands at common wavevectors, without zero modes."""
    bands, tetrahedra = record.of(BandsResult), record.answers.get("tet_bands")
    ours, worst = bands.labelled if bands else {}, None
    for point in tetrahedra.points if tetrahedra else []:
        pair = ours[point.label].frequencies_hz if point.label in ours else []
        for one, two in zip(pair, point.frequencies_hz, strict=False):
            if one > 1e-3 * pair[-1]:
                worst = max(worst or 0.0, abs(two - one) / one)
    return worst


def modes(record: Record) -> list[dict[str, Any]]:
    """Return at most forty modes nearest the target mode, each with whether it is the target mode."""
    lines = record.modes.modes if record.modes else []
    index = record.target.index if record.target else None
    rows = [{"mode": mode, "number": number + 1, "target": number == index} for number, mode in enumerate(lines)]
    start = max(0, min(len(rows) - MAX_MODES, (index or 0) - MAX_MODES // 2))
    return rows[start : start + MAX_MODES]


def mode_cells(mode: ModeRecord) -> list[str]:
    """Return the cells of a mode: frequency in kHz, error bar in percent, symmetry, MAC, zone fraction, level in dB."""
    tone = quantity.frequency_figure(mode.frequency_hz, mode.error, quantity.Unit("kHz", KHZ))
    both = (mode.mac, mode.mac_error), (mode.zone_share, mode.zone_share_error)
    shares = [quantity.figure(value, error) for value, error in both]
    level = quantity.level_figure(mode.confinement_db, mode.confinement_error_db)
    return [tone, quantity.percent(mode.error).removesuffix(" %"), mode.symmetry or "–", *shares, level]


def left_out(study: StoredStudy) -> list[dict[str, str]]:
    """Return each simplification and its reason once, with the cases to which it applies."""
    texts: dict[str, list[str]] = {}
    for case in study.cases:
        for text in case.record.left_out:
            texts.setdefault(text, []).append(case.case_id)
    return [{"text": text, "cases": _which(names, study)} for text, names in texts.items()]


def _which(names: list[str], study: StoredStudy) -> str:
    total = len(study.cases)
    return "all cases" if len(names) == total else f"{len(names)} of {total}: {', '.join(names[:4])}"


def plans(study: StoredStudy) -> list[dict[str, Any]]:
    """Return every distinct plan, step by step with reasons, and the cases that followed it."""
    texts: dict[str, tuple[list[str], list[list[str]]]] = {}
    for case in study.cases:
        plan = case.record.plan
        steps = [
            [*(text or "–" for text in (step.name, step.model, step.mesh, step.looks_for)), "; ".join(step.why)]
            for step in (plan.steps if plan else [])
        ]
        if steps:
            texts.setdefault(str(steps), ([], steps))[0].append(case.case_id)
    return [{"cases": _which(names, study), "steps": steps} for names, steps in list(texts.values())[:MAX_PLANS]]
