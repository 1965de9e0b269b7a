"""The wanted mode and its neighbours as a mode table for the firmware: binary and C header with the same bytes."""

from __future__ import annotations

import hashlib
from pathlib import Path

from pipeline import mode_table
from pipeline.case import Case
from pipeline.fingerprint import canonical_json, code_hash
from pipeline.mode_table import Mode, ModeTable
from pipeline.modes import PartModes
from pipeline.store import write_atomic

SAMPLE_RATE_HZ = 250e3
NEIGHBOURS = 6


def table_of(case: Case, found: PartModes, wanted: int) -> ModeTable:
    """Wanted mode and nearest neighbours, ascending; time constants from the case's quality factor, gains unidentified."""
    by_distance = sorted(
        range(len(found.rows)), key=lambda i: abs(found.rows[i].frequency_hz - found.rows[wanted].frequency_hz)
    )
    kept = sorted(by_distance[: NEIGHBOURS + 1])
    modes = tuple(Mode.from_quality(found.rows[i].frequency_hz, case.quality) for i in kept)
    identity = canonical_json(case.as_understood()) + code_hash()
    return ModeTable(SAMPLE_RATE_HZ, hashlib.sha256(identity.encode()).digest()[:16], modes, kept.index(wanted))


def write_table(case: Case, found: PartModes, wanted: int, folder: Path, stem: str = "mode_table") -> list[Path]:
    """Write STEM.bin and STEM.h; both hold the same bytes."""
    table = table_of(case, found, wanted)
    files = [folder / f"{stem}.bin", folder / f"{stem}.h"]
    write_atomic(files[0], mode_table.to_bytes(table))
    write_atomic(files[1], mode_table.to_header(table).encode())
    return files
