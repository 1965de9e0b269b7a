"""What the report says about records: numbers with units, sentences, the text's figures beside ours."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from pipeline.records.study import CONFINED_DB, StoredCase, StoredStudy
from pipeline.records.tables import widest_gap
from pipeline.report.thesis import compare

MAX_MODES = 40
MAX_PLANS = 12
WIDE = "\u202f"


@dataclass(frozen=True)
class Card:
    """A headline: its name, its value, a line beneath, its severity (good, bad or plain)."""

    name: str
    value: str
    note: str
    severity: str = "plain"


def si(value: Any, unit: str = "", digits: int = 4) -> str:
    """A number for reading: thin spaces between thousands, '-' for nothing."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        text = f"{value:,}".replace(",", WIDE)
    elif isinstance(value, float):
        text = f"{value:.{digits}g}"
    else:
        text = str(value)
    return f"{text}{WIDE}{unit}" if unit else text


def khz(frequency_hz: float | None) -> str:
    """A frequency in kHz, to 10 Hz."""
    return "–" if frequency_hz is None else f"{frequency_hz / 1e3:.2f}{WIDE}kHz"


def verdict(case: StoredCase) -> str:
    """Whether the wanted mode is confined, as a mode and driven, and whether the expected error leaves that open."""
    as_mode = case.wanted["confinement_db"] >= CONFINED_DB
    level_word = "confined" if case.confined else "confined as a mode, not as driven" if as_mode else "leaking"
    error = case.wanted.get("confinement_error_db")
    close = error is not None and abs(case.wanted["confinement_db"] - CONFINED_DB) <= error
    return f"{level_word}, but nearer to {CONFINED_DB:.0f} dB than its expected error" if close else level_word


def _level(wanted: dict[str, Any]) -> str:
    error = wanted.get("confinement_error_db")
    return f"{wanted['confinement_db']:.1f}" + (" dB" if error is None else f" ± {error:.1f} dB")


def best_case(study: StoredStudy) -> StoredCase | None:
    """The case whose wanted mode is confined best; without any, the first that has one."""
    level_word = [case for case in plates(study) if case.confined is not None]
    if level_word:
        return max(level_word, key=lambda case: case.wanted["confinement_db"])
    return next((case for case in study.cases if case.wanted), None)


def cards(study: StoredStudy) -> list[Card]:
    """Headlines of a study: wanted mode, how well it is confined, gap, how the cases ended."""
    best = best_case(study)
    texts = (_wanted_card, _confinement_card, _rows_card, _gap_card) if best else ()
    cards = [write(study, best) for write in texts if best]
    return [*(card for card in cards if card), _ended(study)]


def _source(study: StoredStudy, case: StoredCase) -> str:
    """Which design a figure is of, where the study has several: all headlines are of one."""
    return f"; plate {case.case_id}" if len(plates(study)) > 1 else ""


def _wanted_card(study: StoredStudy, best: StoredCase) -> Card:
    mac, status = best.wanted.get("mac"), best.wanted_status
    note = "" if mac is None else f"MAC {mac:.2f} to the analytic shape"
    split = ", shape split among several modes" if status == "split" else ""
    return Card("Wanted mode", khz(best.wanted.get("frequency_hz")), note + split + _source(study, best))


def _confinement_card(study: StoredStudy, best: StoredCase) -> Card | None:
    if best.confined is None:
        return None
    driven = "" if best.driven_db is None else f"; driven at its own peak {best.driven_db:.1f}{WIDE}dB"
    count = sum(case.confined is not None for case in plates(study))
    where = f", best of {count} plates" if count > 1 else ""
    level = f"{best.wanted['confinement_db']:.1f}{WIDE}dB"
    note = verdict(best) + where + driven + _source(study, best)
    return Card("Confined to the zone", level, note, "good" if best.confined else "bad")


def _rows_card(study: StoredStudy, best: StoredCase) -> Card | None:
    """The fewest rows on which a finite plate like the best holds its mode; without any, the estimate of endless rows."""
    texts = best.record.get("prediction") or {}
    estimate = texts.get("rows_for_10_db")
    per_row = f"{texts['db_per_row']:.1f}{WIDE}dB a row at the wanted mode, " if texts.get("db_per_row") else ""
    name = f"Rows for {CONFINED_DB:.0f}{WIDE}dB"
    enough = [case.sweep["array.rows"] for case in _like(study, best) if case.confined]
    if enough:
        endless = f"; {per_row}endless rows would take {estimate}" if estimate else ""
        return Card(name, str(min(enough)), f"the fewest that hold it on a finite plate{endless}{_source(study, best)}")
    if estimate:
        return Card(name, f"≥ {estimate}", f"{per_row}an estimate for endless rows{_source(study, best)}")
    return None


def _like(study: StoredStudy, best: StoredCase) -> list[StoredCase]:
    """Plates that differ from the best in their rows alone."""
    others = {key: value for key, value in best.sweep.items() if key != "array.rows"}
    return [
        case
        for case in study.cases
        if "array.rows" in case.sweep and {k: v for k, v in case.sweep.items() if k != "array.rows"} == others
    ]


def _gap_card(study: StoredStudy, best: StoredCase) -> Card | None:
    gap = widest_gap(best)
    if not gap:
        return None
    value = f"{gap['lower_hz'] / 1e3:.1f}–{gap['upper_hz'] / 1e3:.1f}{WIDE}kHz"
    note = f"of its unit cell, between bands {gap['lower_band']} and {gap['upper_band']}{_source(study, best)}"
    return Card("Complete gap", value, note)


def plates(study: StoredStudy) -> list[StoredCase]:
    """The study's cases, each design once: a plate computed beside a sweep may be one of the sweep's own."""
    seen: list[Any] = []
    kept = []
    for case in sorted(study.cases, key=lambda case: not case.sweep):
        design = case.record.get("design")
        if design is None or design not in seen:
            kept.append(case)
            seen.append(design)
    return [case for case in study.cases if case in kept]


def _ended(study: StoredStudy) -> Card:
    counts = Counter(case.status for case in study.cases)
    done = counts["OK"] + counts["WARNING"]
    words = [
        f"{counts[key]} {word}"
        for key, word in (("WARNING", "with warnings"), ("FAILED", "failed"), ("MISSING", "missing"))
    ]
    texts = ", ".join(word for word in words if not word.startswith("0 ")) or "no warning"
    good = done == len(study.cases)
    return Card("Cases", f"{done} of {len(study.cases)} done", texts, "good" if good else "bad")


def sentences(study: StoredStudy) -> list[str]:
    """The study's answer in a few sentences."""
    said = []
    level_word = [case for case in plates(study) if case.confined is not None]
    if len(level_word) > 1:
        confined = [case.case_id for case in level_word if case.confined]
        names = f": {', '.join(confined)}" if 0 < len(confined) <= 6 else ""
        said.append(
            f"{len(confined)} of {len(level_word)} plates confine the wanted mode by at least {CONFINED_DB:.0f} dB{names}."
        )
    for case in level_word[: 1 if len(level_word) == 1 else 0]:
        said.append(_confinement_sentence(case))
    best = best_case(study)
    bending = (best.record.get("bands") or {}).get("bending_at_m_hz") if best else None
    if best and bending:
        tones = " and ".join(dict.fromkeys(f"{tone / 1e3:.2f}" for tone in bending))
        whose = f" of plate {best.case_id}" if len(plates(study)) > 1 else ""
        said.append(f"The pillars' bending bands of the unit cell{whose} meet M at {tones} kHz.")
    for case in study.cases:
        if case.status in {"FAILED", "MISSING"}:
            said.append(f"{case.case_id} gave no answer: {case.diagnosis}.")
    return said


def _confinement_sentence(case: StoredCase) -> str:
    verb = "holds" if case.confined else "does not hold"
    share = case.wanted.get("zone_share")
    inside = f"; {share:.0%} of its squared normal displacement lies in the zone" if share is not None else ""
    return f"The plate {verb} the wanted mode: {case.wanted['confinement_db']:.1f} dB{inside}."


def comparison(study: StoredStudy) -> list[dict[str, Any]]:
    """The text's figures beside ours, from the records that carry them, with the difference where both are numbers."""
    rows = []
    ours = {"comparison": compare([case.record for case in study.cases])}
    for source in [study.about, *(case.record for case in study.cases), ours]:
        for row in source.get("comparison") or []:
            pair = row.get("thesis"), row.get("ours")
            numeric = all(isinstance(value, (int, float)) for value in pair) and pair[0]
            difference = f"{(pair[1] - pair[0]) / pair[0]:+.1%}" if numeric else ""
            rows.append({"unit": "", "note": "", **row, "case": source.get("case_id", ""), "difference": difference})
    return rows


def facts(case: StoredCase) -> list[tuple[str, str]]:
    """A case's results in words and numbers."""
    texts = (_mode_facts, _response_facts, _band_facts, _part_facts, _plate_facts, _mesh_facts)
    return [fact for write in texts for fact in write(case)]


def _mode_facts(case: StoredCase) -> list[tuple[str, str]]:
    wanted, lines = case.wanted, []
    if wanted:
        error = "" if wanted.get("frequency_error") is None else f" ± {wanted['frequency_error']:.2%}"
        lines.append(
            ("wanted mode", f"{khz(wanted.get('frequency_hz'))}{error}, MAC {si(wanted.get('mac'), digits=3)}")
        )
    if case.confined is not None:
        driven = "" if case.driven_db is None else f" as a mode, {case.driven_db:.1f} dB driven at its own peak"
        lines.append(("confinement", f"{_level(wanted)}{driven}: {verdict(case)} (at least {CONFINED_DB:.0f} dB)"))
    for key, name in (
        ("zone_share", "share of the touch face's u_z² in the zone"),
        ("pillar_energy_share", "pillars' share of energy"),
    ):
        if wanted.get(key) is not None:
            lines.append((name, f"{wanted[key]:.1%}"))
    if wanted.get("status") == "split":
        texts = [f"{khz(rival['frequency_hz'])} (strength {rival['strength']:.3f})" for rival in wanted["rivals"]]
        lines.append(
            ("the wanted shape is split: other modes that carry it", ", ".join(texts) or "none a quarter as strong")
        )
    check = (case.record.get("modes") or {}).get("count_check")
    if check:
        outcome = "holds" if check["expected"] == check["found"] else "does not hold"
        band = f"{khz(check['low_hz'])} to {khz(check['high_hz'])}"
        lines.append(
            ("count check by inertia", f"{outcome}: {check['found']} found, {check['expected']} expected in {band}")
        )
    tet = case.record.get("tet_modes") or {}
    if tet.get("frequency_hz"):
        gap = (
            f", {tet['relative_difference']:+.2%} from hexahedra" if tet.get("relative_difference") is not None else ""
        )
        lines.append(
            (
                "wanted mode, tetrahedra (pytetwild)",
                f"{khz(tet['frequency_hz'])}{gap}, {si(tet.get('dof'))} degrees of freedom",
            )
        )
    return lines


def _response_facts(case: StoredCase) -> list[tuple[str, str]]:
    """What was measured beside the response, and what unlike pillars do to it."""
    lines: list[tuple[str, str]] = []
    measured, spread = case.record.get("measured") or {}, case.record.get("tolerance") or {}
    if sweep := measured.get("sweep"):
        marked = ", synthetic" if sweep["synthetic"] else ""
        quality = "" if sweep["quality"] is None else f", quality factor {sweep['quality']:.0f}"
        shift = f"{sweep['frequency_shift_hz']:+.0f} Hz from the computed one"
        lines.append(
            (f"measured resonance ({sweep['file']}{marked})", f"{khz(sweep['frequency_hz'])}, {shift}{quality}")
        )
    if field := measured.get("map"):
        level = "no passive face" if field["confinement_db"] is None else f"{field['confinement_db']:.1f} dB"
        marked = ", synthetic" if field["synthetic"] else ""
        name = f"measured confinement ({field['file']}{marked})"
        lines.append((name, f"{level}; MAC {field['mac_operating']:.3f} to the computed operating shape"))
    if spread:
        peak, level = spread["peak_hz"], spread["confinement_db"]
        if peak:
            kept = len(spread["samples"]) - spread["lost"]
            lines.append((f"wanted mode's peak of {kept} plates of unlike pillars", _spread_words(peak, "Hz", 1)))
        if spread["lost"]:
            lines.append(("plates that lost the wanted mode", f"{spread['lost']} of {len(spread['samples'])}"))
        if level:
            lines.append(("their confinement", f"{_spread_words(level, 'dB', 1)}; worst {level['lowest']:.1f} dB"))
    return lines


def _spread_words(lines: dict[str, Any], unit: str, digits: int) -> str:
    return f"{lines['mean']:.{digits}f}{WIDE}{unit}, spread {lines['deviation']:.{digits}f}{WIDE}{unit}"


def _band_facts(case: StoredCase) -> list[tuple[str, str]]:
    bands, lines = case.record.get("bands") or {}, []
    for gap in bands.get("gaps") or []:
        name = f"complete gap, bands {gap['lower_band']} to {gap['upper_band']}"
        lines.append((name, f"{khz(gap['lower_hz'])} to {khz(gap['upper_hz'])}"))
    if bands and not bands.get("gaps"):
        lines.append(("complete gap", "none along the path"))
    if bands.get("bending_at_m_hz"):
        tones = dict.fromkeys(khz(tone) for tone in bands["bending_at_m_hz"])
        both = " (both)" if len(tones) < len(bands["bending_at_m_hz"]) else ""
        lines.append(("bending bands at M", " and ".join(tones) + both))
    worst = band_difference(case)
    if worst is not None:
        lines.append(("bands, tetrahedra against hexahedra", f"at most {worst:.2%} apart at the labelled points"))
    return lines


def _part_facts(case: StoredCase) -> list[tuple[str, str]]:
    """The pre-design, the bare zone and the lone pillar, where they were computed."""
    lines = []
    predesign = case.record.get("predesign") or {}
    if (predesign.get("zone") or {}).get("frequency_hz"):
        lines.append(("pre-design: zone", khz(predesign["zone"]["frequency_hz"])))
    if (predesign.get("pillar") or {}).get("frequency_hz"):
        pillar = predesign["pillar"]
        height = f", {pillar['height_mm']:.2f} mm high" if pillar.get("height_mm") else ""
        lines.append(("pre-design: pillar", f"{khz(pillar['frequency_hz'])}{height}"))
    zone = case.record.get("zone_modes") or {}
    if (zone.get("wanted") or {}).get("frequency_hz"):
        name = f"bare zone, long sides clamped, {zone.get('nodal_lines')} nodal lines"
        lines.append((name, khz(zone["wanted"]["frequency_hz"])))
    pillars = (case.record.get("pillar_modes") or {}).get("modes") or []
    if pillars:
        lines.append(("lone pillar, foot clamped", ", ".join(khz(mode["frequency_hz"]) for mode in pillars[:4])))
    return lines


def band_difference(case: StoredCase) -> float | None:
    """Largest relative difference between the two meshes' bands at the wavevectors that both have; zero modes left out."""
    ours = {point["label"]: point for point in (case.record.get("bands") or {}).get("points", []) if point.get("label")}
    worst = None
    for point in (case.record.get("tet_bands") or {}).get("points", []):
        pair = ours.get(point.get("label"), {}).get("frequencies_hz") or []
        for one, two in zip(pair, point["frequencies_hz"], strict=False):
            if one > 1e-3 * pair[-1]:
                worst = max(worst or 0.0, abs(two - one) / one)
    return worst


def _plate_facts(case: StoredCase) -> list[tuple[str, str]]:
    plate = case.record.get("geometry") or {}
    lines = []
    if plate.get("mass_kg") is not None:
        volume = f", {plate['volume_m3'] * 1e9:.0f} mm³" if plate.get("volume_m3") else ""
        lines.append(("mass", f"{plate['mass_kg'] * 1e3:.2f} g{volume}"))
    if plate.get("watertight") is not None:
        tight = "watertight" if plate["watertight"] else "NOT watertight"
        lines.append(
            (
                "print file",
                f"{tight}, {plate.get('bodies', '?')} body, volume error {si(plate.get('volume_error'), digits=2)}",
            )
        )
    if plate.get("smallest_feature_m") is not None:
        lines.append(("smallest feature", f"{plate['smallest_feature_m'] * 1e3:g} mm"))
    return lines


def _mesh_facts(case: StoredCase) -> list[tuple[str, str]]:
    kinds = {"hex": "hexahedra", "tet": "tetrahedra"}
    return [
        (
            f"mesh of the {mesh.get('what', '?')}, {kinds.get(mesh.get('kind', ''), mesh.get('kind'))}",
            f"{si(mesh.get('cells'))} cells of order {si(mesh.get('order'))}, {si(mesh.get('dof'))} degrees of freedom",
        )
        for mesh in case.record.get("meshes") or []
    ]


def modes(case: StoredCase) -> list[dict[str, Any]]:
    """The modes nearest the wanted one, at most forty, each told whether it is the wanted one."""
    lines = list((case.record.get("modes") or {}).get("modes") or [])
    index = case.wanted.get("index")
    rows = [{**mode, "number": number + 1, "wanted": number == index} for number, mode in enumerate(lines)]
    if len(rows) > MAX_MODES:
        start = max(0, min(len(rows) - MAX_MODES, (index or 0) - MAX_MODES // 2))
        rows = rows[start : start + MAX_MODES]
    return rows


def left_out(study: StoredStudy) -> list[dict[str, str]]:
    """What was left out and why, each once, with the cases it holds for."""
    texts: dict[str, list[str]] = {}
    for case in study.cases:
        for text in case.record.get("left_out") or []:
            texts.setdefault(text, []).append(case.case_id)
    return [{"text": text, "cases": _which(names, study)} for text, names in texts.items()]


def _which(names: list[str], study: StoredStudy) -> str:
    total = len(study.cases)
    return "all cases" if len(names) == total else f"{len(names)} of {total}: {', '.join(names[:4])}"


def plans(study: StoredStudy) -> list[dict[str, Any]]:
    """What was computed and why, step by step: every distinct plan with the cases that followed it."""
    texts: dict[str, tuple[list[str], list[list[str]]]] = {}
    for case in study.cases:
        steps = [_step(step) for step in (case.record.get("plan") or {}).get("steps") or []]
        if steps:
            texts.setdefault(str(steps), ([], steps))[0].append(case.case_id)
    return [{"cases": _which(names, study), "steps": steps} for names, steps in list(texts.values())[:MAX_PLANS]]


def _step(step: dict[str, Any]) -> list[str]:
    return [
        *(str(step.get(key) or "–") for key in ("name", "model", "mesh", "looks_for")),
        "; ".join(step.get("why") or []),
    ]
