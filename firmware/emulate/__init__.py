"""The firmware's images run without a board: emulated Cortex-M4, emulated converters, a plate computed from the mode table."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware.build import BuildError, Image, build
from firmware.emulate.plant import Plate, Structure, plate_from_table
from firmware.host import Supervised
from firmware.mode_table import from_bytes
from firmware.protocol import IDENTIFY, RUN, fault_names

NEEDS = {"unicorn": "unicorn", "cffi": "cffi", "elftools": "pyelftools"}
WINDOW_S = 50 / 250e3
HALF_WINDOW_S = 23 / 250e3


class EmulationError(RuntimeError):
    """The image on the emulated board did not do what it was asked; the message names its fault."""


@dataclass(frozen=True)
class BoardRun:
    """A reference step of the image, and what the image found out about the mode before.

    columns: time_s (zero at the step), reference, u_d, u_q (what the sensor shows, in full scales, reference along d) and drive
    (|V|, in full scales), one entry for each window of 0.2 ms.
    The identification's results are those it works with: Hz, s, full scale over full scale, s; swept, whether it measured
    them itself.
    """

    columns: dict[str, NDArray[np.float64]]
    swept: bool
    frequency_hz: float
    tau_s: float
    gain: complex
    delay_s: float
    compiler: str

    @property
    def level(self) -> float:
        """What the reference steps to, full scales."""
        return float(self.columns["reference"][-1])

    @property
    def t95_s(self) -> float | None:
        """From the step to the middle of the first window at 95 % of it; None when it never gets there."""
        reached = np.flatnonzero((self.columns["u_d"] >= 0.95 * self.level) & (self.columns["time_s"] >= 0.0))
        return float(self.columns["time_s"][reached[0]] + WINDOW_S - HALF_WINDOW_S) if reached.size else None

    @property
    def overshoot(self) -> float:
        """The largest u_d beyond the step, as a share of it; noise included."""
        return float(self.columns["u_d"].max() / self.level - 1.0)


def board_run(table: bytes, plate: Plate | None = None, share: float = 0.2, seconds: float = 15e-3) -> BoardRun:
    """A reference step of the unmodified image on the emulated board, joined to the plate that the table describes.

    The image identifies the mode first unless the table holds a measured one, settles at zero, and is then asked for share
    of the largest steady amplitude. plate defaults to plate_from_table with noise of 1e-3 of full scale. Raises BuildError
    (exit_code 5 when something is not installed), ValueError for a damaged table, EmulationError when the image faulted.
    """
    with _built(table, "single") as image:
        return _stepped(image, plate or plate_from_table(table, noise=1e-3), share, seconds)


@contextmanager
def _built(table: bytes, variant: str) -> Iterator[Image]:
    """An image with a table inside, while the context lasts."""
    from_bytes(table)
    missing = [package for name, package in NEEDS.items() if not find_spec(name)]
    if missing:
        raise BuildError(f"emulation needs {' and '.join(missing)}: pip install {' '.join(missing)}", 5)
    with tempfile.TemporaryDirectory() as folder:
        yield build(table, Path(folder), variant)


def _check_runs(board: Supervised) -> None:
    if board.state != RUN:
        raise EmulationError(f"the image ended in a fault: {', '.join(fault_names(board.faults)) or 'none'}")


def _stepped(image: Image, plate: Plate, share: float, seconds: float) -> BoardRun:
    from firmware.emulate.images import EmulatedSingle

    board = EmulatedSingle(image.elf, plate)
    board.run(2e-3)
    board.start()
    swept = board.state == IDENTIFY
    board.run_until(lambda: board.state != IDENTIFY, 20.0)
    board.app.slow.reference = 0.0
    board.run(10.0 * board.app.mode.tau_s)
    mode, before = board.app.mode, len(board.reports)
    gain = complex(mode.gain.re, mode.gain.im)
    board.run(2e-3)
    origin = len(board.reports)
    board.app.slow.reference = min(share * abs(gain) * mode.drive_limit, 0.9 * mode.amplitude_limit)
    board.run(seconds)
    _check_runs(board)
    measured, drive, reference = (np.array(column) for column in zip(*board.reports[before:], strict=True))
    columns = {
        "time_s": (np.arange(before, len(board.reports)) - origin) * WINDOW_S,
        "reference": reference,
        "u_d": measured.real,
        "u_q": measured.imag,
        "drive": np.abs(drive),
    }
    frequency_hz = board.app.centre / 2**32 * plate.sample_rate_hz
    return BoardRun(columns, swept, frequency_hz, mode.tau_s, gain, mode.delay_s, image.compiler)


def six_run(table: bytes, plate: Structure, patterns: int, seconds: float) -> NDArray[np.complex128]:
    """The drives that the unmodified six-channel image settles at on the emulated board, (patterns, 6) in full scales.

    Each of the table's first patterns is held, one after another. Raises BuildError (exit_code 5 when something is not
    installed), ValueError for a damaged table, EmulationError when the image faulted.
    """
    drives = []
    with _built(table, "six") as image:
        from firmware.emulate.images import EmulatedSix

        board = EmulatedSix(image.elf, plate)
        board.run(5e-3)
        for pattern in range(patterns):
            if pattern:
                board.call("an_six_change", board.symbol("app"), pattern)
            else:
                board.start(pattern)
            board.run(seconds)
            _check_runs(board)
            drives.append(board.drives)
    return np.array(drives)
