"""What a list of modes says about the wanted one and about the count, in whole sentences."""

from __future__ import annotations

from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models.mode_rows import ModeRow
from pipeline.models.modes import PartModes
from pipeline.models.wanted_search import Wanted
from pipeline.quantity import figure, frequency, frequency_with_bar, interval, with_bar
from solvers.measures.wanted_mode import CLEAR


def lines(part_modes: PartModes, design: Design) -> list[str]:
    """Describe the wanted mode, its error bar, and the count."""
    said = verdict(part_modes.wanted, design) if part_modes.wanted else []
    row = part_modes.wanted.row if part_modes.wanted else None
    if row and part_modes.index(row) is None:
        said.append("It lies outside the modes listed above.")
    if row and part_modes.bar:
        said.append(f"expected errors: {part_modes.bar.text()}")
    return [*said, count(part_modes)]


def verdict(wanted: Wanted, design: Design) -> list[str]:
    """Say which mode is the wanted one, or why none is."""
    name, row = f"(0, {design.nodal_lines})", wanted.row
    window = interval(wanted.low_hz, wanted.high_hz, to=" and ")
    if row is None and wanted.count is None:
        return [f"The wanted {name} mode is expected between {window}: {wanted.why}."]
    if row is None:
        return [f"No mode between {window} has the wanted {name} shape: the best are less than half alike (MAC)."]
    level_text = _level(row)
    tone = frequency_with_bar(row.frequency_hz, row.error)
    if wanted.status == "single":
        return [f"wanted {name} mode: {tone}, {_alike(row)}{level_text}"]
    others = "; ".join(_named(rival) for rival in wanted.rivals)
    how = "is split among several modes" if others or not wanted.is_open else "may be split among several modes"
    return [
        f"The wanted {name} shape {how}: strongest at {tone}, "
        f"{_alike(row)}{level_text}" + (f"; others: {others}" if others else _alone(row)) + _outside(wanted)
    ]


def _outside(wanted: Wanted) -> str:
    """Say what modes that were not computed may carry, where that could rival the strongest."""
    if not wanted.is_open or wanted.reach_hz is None:
        return ""
    reach = interval(*wanted.reach_hz)
    most = figure(wanted.missing, wanted.missing)
    return f"; modes outside the searched range of {reach} may have a strength of up to {most}"


def _named(row: ModeRow) -> str:
    tone = frequency_with_bar(row.frequency_hz, row.error)
    return f"{tone} ({_alike(row)}{_level(row)})"


def _alike(row: ModeRow) -> str:
    return f"MAC {figure(row.mac, row.mac_error)}, strength {figure(row.strength, row.strength_error)}"


def _level(row: ModeRow) -> str:
    return "" if row.confinement_db is None else f", {with_bar(row.confinement_db, row.confinement_error_db, 'dB')}"


def _alone(row: ModeRow) -> str:
    return f"; no other is a quarter as strong, but its MAC is below {CLEAR:g}" if (row.mac or 0.0) < CLEAR else ""


def count(part_modes: PartModes) -> str:
    """Say what the count by inertia counts and what it proves."""
    check = part_modes.count
    text = f"count by inertia of the {part_modes.counts}: {check.expected}, found: {check.found}"
    if part_modes.counts == "mesh":
        return text
    if part_modes.more_in_mesh is None:
        return f"{text}; how many the meshes behind it have is not bounded"
    if part_modes.more_in_mesh == 0:
        return f"{text}; the meshes behind it have no more of them up to {frequency(check.high_hz)}"
    return f"{text}; the meshes behind it have at most {part_modes.more_in_mesh} more up to {frequency(check.high_hz)}"


def warn_of_wanted(wanted: Wanted, case: Case, log: Log) -> None:
    """Log which mode is the wanted one; a warning where none is, or where several share its shape."""
    (said,) = verdict(wanted, case.design)
    if wanted.status == "single":
        log.info(said)
    else:
        log.warning("NO_MODE" if wanted.status == "none" else "SPLIT_MODE", said)
