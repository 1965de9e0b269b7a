"""The closed loop of a case: the unmodified image with its mode table, on the emulated board, driving the table's plate."""

from __future__ import annotations

from pathlib import Path

from geometry.elements import FloatArray
from pipeline.logs import Log
from pipeline.quantity import figure, frequency
from pipeline.records.record import BoardFault, BoardRecord
from pipeline.units import MS

TABLE = "mode_table.bin"
COLUMNS = ("time_s", "reference", "u_d", "u_q", "drive")


def solve(folder: Path, log: Log) -> tuple[BoardRecord | BoardFault | None, dict[str, FloatArray]]:
    """Record and arrays (board_time_s, board_reference, board_u_d, board_u_q, board_drive) of a step of 0.2 G Vmax.

    Amplitudes in full scales of the converters; board_u_d and board_u_q turned into the mode's frame. (None, {}) when what
    it needs is not installed; a fault of the image is a warning and stands in the record.
    """
    from firmware.build import BuildError
    from firmware.emulate import EmulationError, board_run

    try:
        with log.step("closed loop on the emulated board"):
            run = board_run((folder / TABLE).read_bytes())
    except BuildError as missing:
        if missing.exit_code != 5:
            raise
        log.left_out("closed loop on the emulated board", str(missing))
        return None, {}
    except EmulationError as error:
        log.warning("BOARD", f"emulated board: {error}")
        return BoardFault(fault=str(error)), {}
    record = BoardRecord.of(run, gain=(run.gain.real, run.gain.imag), reference=run.level)
    _log_summary(record, log)
    return record, {f"board_{name}": run.columns[name] for name in COLUMNS}


def _log_summary(record: BoardRecord, log: Log) -> None:
    origin = "identified" if record.swept else "taken from the table"
    reached = "not reached" if record.t95_s is None else f"after {figure(record.t95_s / MS)} ms"
    log.info(
        f"emulated board: mode at {frequency(record.frequency_hz)} {origin}, tau {figure(record.tau_s / MS)} ms, gain "
        f"{figure(abs(complex(*record.gain)))}; 95 % of a step to {figure(record.reference)} {reached}"
    )


def sources_hash() -> str:
    """sha256 over the firmware's sources: what a run of the image depends on beside the table."""
    import hashlib

    from pipeline.paths import ROOT
    from pipeline.records.fingerprint import file_hash

    folders = ("core", "board", "emulate", "host")
    paths = [path for name in folders for path in (ROOT / "firmware" / name).rglob("*") if path.suffix in SOURCES]
    paths += (ROOT / "firmware").glob("*.py")
    lines = [f"{path.relative_to(ROOT).as_posix()} {file_hash(path)}" for path in sorted(paths)]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


SOURCES = (".c", ".h", ".inc", ".ld", ".py")
