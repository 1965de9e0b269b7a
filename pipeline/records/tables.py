"""table.csv: one row per case, the same bytes from one run of a study to the next.

So it holds no times, and nothing of pytetwild's meshes, which differ from run to run: the page shows those.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.records import store, tracking
from pipeline.records.outputs import no_formula
from pipeline.records.study import StoredCase, StoredStudy, read_study

TABLE = "table.csv"


@dataclass(frozen=True)
class Column:
    """A column: its name in the file, its heading and unit for readers, its value, its format."""

    name: str
    heading: str
    value: Callable[[StoredCase], Any]
    format: str = ""
    unit: str = ""


def _wanted(key: str) -> Callable[[StoredCase], Any]:
    return lambda case: case.wanted.get(key)


def _part(part: str, key: str) -> Callable[[StoredCase], Any]:
    return lambda case: (case.record.get(part) or {}).get(key)


def _peak(which: str, key: str, factor: float = 1.0) -> Callable[[StoredCase], Any]:
    def value(case: StoredCase) -> Any:
        peak = ((case.record.get("response") or {}).get(which) or {}).get(key)
        return None if peak is None else factor * peak

    return value


def _spread(figure: str, key: str) -> Callable[[StoredCase], Any]:
    return lambda case: ((case.record.get("tolerance") or {}).get(figure) or {}).get(key)


def _beside(kind: str, key: str) -> Callable[[StoredCase], Any]:
    return lambda case: ((case.record.get("measured") or {}).get(kind) or {}).get(key)


def _dof(case: StoredCase) -> int | None:
    return next((part["dof"] for key in ("modes", "bands") if (part := case.record.get(key)) and part.get("dof")), None)


def _count_check(case: StoredCase) -> str | None:
    check = (case.record.get("modes") or {}).get("count_check")
    if not check:
        return None
    return "holds" if check["expected"] == check["found"] else f"{check['found']} of {check['expected']}"


def _confined(case: StoredCase) -> str | None:
    return None if case.confined is None else ("yes" if case.confined else "no")


def widest_gap(case: StoredCase) -> dict[str, Any]:
    """The widest complete gap of a case's bands, {} when there is none."""
    gaps = (case.record.get("bands") or {}).get("gaps") or []
    return max(gaps, key=lambda gap: gap["upper_hz"] - gap["lower_hz"], default={})


def _gap(key: str) -> Callable[[StoredCase], Any]:
    return lambda case: widest_gap(case).get(key)


def _bending(index: int) -> Callable[[StoredCase], Any]:
    def value(case: StoredCase) -> Any:
        pair = (case.record.get("bands") or {}).get("bending_at_m_hz") or []
        return pair[index] if index < len(pair) else None

    return value


def _rivals(case: StoredCase) -> str | None:
    rivals = case.wanted.get("rivals") or []
    return "; ".join(f"{rival['frequency_hz']:.0f} Hz" for rival in rivals) or None


MEASURES = (
    Column("wanted_status", "wanted mode: single, split or none", lambda case: case.wanted_status),
    Column("wanted_hz", "wanted mode", _wanted("frequency_hz"), ".2f", "Hz"),
    Column("wanted_error", "expected error of the wanted mode", _wanted("frequency_error"), ".2%"),
    Column("confinement_db", "confinement", _wanted("confinement_db"), ".2f", "dB"),
    Column("confinement_error_db", "expected error of the confinement", _wanted("confinement_error_db"), ".2f", "dB"),
    Column("confined", "confined (at least 10 dB)", _confined),
    Column("zone_to_extension_db", "zone to extension", _wanted("extension_db"), ".2f", "dB"),
    Column("db_per_row", "decay per row", _part("prediction", "db_per_row"), ".2f", "dB"),
    Column("rows_db", "predicted by the rows", _part("prediction", "rows_db"), ".2f", "dB"),
    Column("mac", "MAC", _wanted("mac"), ".4f"),
    Column("zone_share", "zone share", _wanted("zone_share"), ".4f"),
    Column("pillar_share", "pillars' share of energy", _wanted("pillar_energy_share"), ".4f"),
    Column("strength", "strength in the wanted shape", _wanted("strength"), ".4f"),
    Column("shape_share", "share of the wanted shape", _wanted("share"), ".4f"),
    Column("rivals", "other modes that carry it", _rivals),
    Column("count_check", "count check", _count_check),
    Column("gap_lower_hz", "gap from", _gap("lower_hz"), ".2f", "Hz"),
    Column("gap_upper_hz", "gap to", _gap("upper_hz"), ".2f", "Hz"),
    Column("bending_m_1_hz", "bending at M, first", _bending(0), ".2f", "Hz"),
    Column("bending_m_2_hz", "bending at M, second", _bending(1), ".2f", "Hz"),
    Column("wanted_peak_hz", "wanted mode's peak, driven", _peak("wanted_peak", "frequency_hz"), ".2f", "Hz"),
    Column("wanted_peak_nm_per_v", "zone at that peak", _peak("wanted_peak", "zone_rms_m_per_V", 1e9), ".4g", "nm/V"),
    Column("wanted_peak_db", "confinement at that peak", _peak("wanted_peak", "confinement_db"), ".2f", "dB"),
    Column("highest_peak_hz", "highest peak of the response", _peak("highest_peak", "frequency_hz"), ".2f", "Hz"),
    Column(
        "highest_peak_nm_per_v", "zone at the highest", _peak("highest_peak", "zone_rms_m_per_V", 1e9), ".4g", "nm/V"
    ),
    Column("highest_peak_db", "confinement at the highest", _peak("highest_peak", "confinement_db"), ".2f", "dB"),
    Column("measured_hz", "measured resonance", _beside("sweep", "frequency_hz"), ".2f", "Hz"),
    Column("measured_shift_hz", "measured less computed", _beside("sweep", "frequency_shift_hz"), "+.2f", "Hz"),
    Column("measured_quality", "measured quality factor", _beside("sweep", "quality"), ".1f"),
    Column("measured_db", "measured confinement", _beside("map", "confinement_db"), ".2f", "dB"),
    Column("measured_mac", "MAC, measured to computed", _beside("map", "mac_operating"), ".4f"),
    Column("tolerance_peak_hz", "peak, pillars unlike: mean", _spread("peak_hz", "mean"), ".1f", "Hz"),
    Column("tolerance_peak_spread_hz", "its spread", _spread("peak_hz", "deviation"), ".1f", "Hz"),
    Column("tolerance_db", "confinement, pillars unlike: mean", _spread("confinement_db", "mean"), ".2f", "dB"),
    Column("tolerance_spread_db", "its spread", _spread("confinement_db", "deviation"), ".2f", "dB"),
    Column("tolerance_worst_db", "the worst", _spread("confinement_db", "lowest"), ".2f", "dB"),
    Column("dof", "dofs", _dof, "d"),
    Column("mass_kg", "mass", _part("geometry", "mass_kg"), ".6f", "kg"),
)


def columns_of(study: StoredStudy) -> list[Column]:
    """Columns of a study's table: id, swept keys, status, measures that some case has, diagnosis."""
    swept = [Column(key, key, lambda case, key=key: case.sweep.get(key)) for key in study.swept]  # type: ignore[misc]
    known = (*MEASURES, *_followed(study))
    measured = [column for column in known if any(column.value(case) is not None for case in study.cases)]
    head, tail = (
        Column("case", "case", lambda case: case.case_id),
        Column("diagnosis", "diagnosis", lambda c: c.diagnosis),
    )
    return [head, *swept, Column("status", "status", lambda case: case.status), *measured, tail]


def _followed(study: StoredStudy) -> tuple[Column, ...]:
    """Columns of the mode that is followed along the sweep from where the wanted one is plainest."""
    peak = tracking.along_sweep(study)

    def column(key: str) -> Callable[[StoredCase], Any]:
        return lambda case: getattr(peak.get(case.case_id), key, None)

    return (
        Column("tracked_hz", "tracked mode", column("frequency_hz"), ".2f", "Hz"),
        Column("tracked_mac", "MAC with the case before", column("mac"), ".4f"),
        Column("tracking", "tracking along the sweep", column("identity")),
    )


def cell(column: Column, case: StoredCase) -> str:
    """A cell's text: '' for what has no value."""
    value = column.value(case)
    if value is None:
        return ""
    return format(value, column.format) if column.format else str(value)


def table_text(study: StoredStudy, columns: Sequence[Column] | None = None) -> str:
    """The table as CSV."""
    columns = columns or columns_of(study)
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow([no_formula(column.name) for column in columns])
    writer.writerows([no_formula(cell(column, case)) for column in columns] for case in study.cases)
    return buffer.getvalue()


def write_table(folder: Path) -> Path:
    """Write table.csv of a study from its records, atomically. Raises store.BadRecord when nothing is stored."""
    path = folder / TABLE
    store.write_atomic(path, table_text(read_study(folder)).encode())
    return path
