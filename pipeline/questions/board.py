"""Firmware run on the emulated board with the mode table of a study's case."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pipeline.quantity import figure, frequency
from pipeline.questions.late import Case, Plan
from pipeline.questions.question import Question, Run, Unanswered
from pipeline.questions.result import Result
from pipeline.records.part import column

NAME = "closed loop on the emulated board"
TABLE = "mode_table.bin"
# of the step: amplitudes in full scales of the converters, axes rotated into the frame of the mode
COLUMNS = ("time_s", "reference", "u_d", "u_q", "drive")
SOURCES = (".c", ".h", ".inc", ".ld", ".py")


class BoardResult(Result, axes=()):
    """Reference step run by the firmware image on the emulated board; only the fault if it ended in one."""

    compiler: str | None = column("compiler of the image", default=None)
    swept: bool | None = column("whether the image identified the mode first", default=None)
    frequency_hz: float | None = column("frequency of the mode", "Hz", default=None)
    tau_s: float | None = column("time constant of the mode", "s", default=None)
    gain: list[float] | None = column("sensor / drive, real and imaginary, in full scales", table=False, default=None)
    delay_s: float | None = column("delay between drive and sensor", "s", default=None)
    reference: float | None = column("requested step, in full scales", default=None)
    t95_s: float | None = column("time to 95 %; None if not reached", "s", default=None)
    overshoot: float | None = column("overshoot, relative", default=None)
    fault: str | None = column("fault that stopped the image", default=None)

    def lines(self) -> Iterator[str]:
        """Yield the mode driven by the image and the duration of the step."""
        from pipeline.quantity import MS

        if self.fault is not None:
            yield f"emulated board: {self.fault}"
            return
        assert self.gain and self.frequency_hz and self.tau_s and self.reference
        origin = "identified" if self.swept else "taken from the table"
        reached = "not reached" if self.t95_s is None else f"after {figure(self.t95_s / MS)} ms"
        yield (
            f"emulated board: mode at {frequency(self.frequency_hz)} {origin}, tau {figure(self.tau_s / MS)} ms, gain "
            f"{figure(abs(complex(*self.gain)))}; 95 % of a step to {figure(self.reference)} {reached}"
        )


class Board(Question[BoardResult], in_studies_only=True, after="modes", pictures=("report.gallery.board",)):
    """Run a reference step with the case's mode table in the firmware image on the emulated board."""

    step = (NAME, "firmware image and mode table")

    @classmethod
    def inputs(cls) -> dict[str, Any]:
        """Return the hash of the firmware's sources."""
        return {"firmware": sources_hash()}

    def compute(self, case: Case, plan: Plan, run: Run) -> BoardResult:
        """Run the image with the mode table in the case's folder."""
        from firmware.build import BuildError
        from firmware.emulate import EmulationError, board_run

        assert run.folder
        if not run.target:
            raise Unanswered(NAME, "no mode has the target shape, so there is no mode table")
        if not (run.folder / TABLE).exists():
            raise Unanswered(NAME, "the firmware cannot play the target mode, so there is no mode table")
        try:
            with run.step(NAME):
                played = board_run((run.folder / TABLE).read_bytes())
        except BuildError as missing:
            if missing.exit_code != 5:
                raise
            raise Unanswered(NAME, str(missing)) from missing
        except EmulationError as error:
            run.log.warning("BOARD", f"emulated board: {error}")
            return BoardResult(fault=str(error))
        run.arrays |= {f"board_{name}": played.columns[name] for name in COLUMNS}
        result = BoardResult.of(played, gain=[played.gain.real, played.gain.imag], reference=played.level)
        run.report(result)
        return result


def sources_hash() -> str:
    """Return a sha256 of the firmware's sources, on which a run of the image depends besides the table."""
    import hashlib

    from pipeline.paths import ROOT
    from pipeline.records.store import file_hash

    folders = ("core", "board", "emulate", "host")
    paths = [path for name in folders for path in (ROOT / "firmware" / name).rglob("*") if path.suffix in SOURCES]
    paths += (ROOT / "firmware").glob("*.py")
    lines = [f"{path.relative_to(ROOT).as_posix()} {file_hash(path)}" for path in sorted(paths)]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
