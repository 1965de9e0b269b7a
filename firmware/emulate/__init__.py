"""Emulation of a board: Cortex-M4 and converters that run the firmware's images, with a plate from the mode table."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from firmware.build import BuildError, Image, build
from firmware.emulate.plant import Plate, Structure, plate_from_table
from firmware.host import Supervised
from firmware.mode_table import PERIOD, RATE_HZ, WINDOW, from_bytes
from firmware.protocol import IDENTIFY, RUN, fault_names

if TYPE_CHECKING:
    from firmware.emulate.images import EmulatedPort, EmulatedSingle

NEEDS = {"unicorn": "unicorn", "cffi": "cffi", "elftools": "pyelftools"}
WINDOW_S, HALF_WINDOW_S = PERIOD / RATE_HZ["single"], WINDOW / 2 / RATE_HZ["single"]


class EmulationError(RuntimeError):
    """The image on the emulated board ended in a fault; the message names it."""


@dataclass(frozen=True)
class BoardRun:
    """Response of the image to a step of the reference, and the mode as identified before.

    Attributes
    ----------
    columns : dict of str to ndarray, shape (windows,)
        One entry per window of 0.2 ms: time_s (zero at the step), reference, u_d, u_q (components of the sensor signal,
        the reference along d) and drive (|V|), as fractions of full scale.
    swept : bool
        Whether the image measured the mode itself.
    frequency_hz, tau_s, gain, delay_s : float or complex
        Mode used by the image, in Hz, s, full scale over full scale, and s.
    compiler : str
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
        """Reference after the step, as a fraction of full scale."""
        return float(self.columns["reference"][-1])

    @property
    def t95_s(self) -> float | None:
        """Time from the step to the middle of the first window at 95 % of it; None if the signal never gets there."""
        reached = np.flatnonzero((self.columns["u_d"] >= 0.95 * self.level) & (self.columns["time_s"] >= 0.0))
        return float(self.columns["time_s"][reached[0]] + WINDOW_S - HALF_WINDOW_S) if reached.size else None

    @property
    def overshoot(self) -> float:
        """Largest excess of u_d over the step, relative to it, including noise."""
        return float(self.columns["u_d"].max() / self.level - 1.0)


def board_run(table: bytes, plate: Plate | None = None, share: float = 0.2, seconds: float = 15e-3) -> BoardRun:
    """Run a step of the reference with the unmodified image on the emulated board.

    The image identifies the mode first, unless the table holds a measured one, and settles at zero before the step.

    Parameters
    ----------
    table : bytes
        Mode table.
    plate : Plate, optional
        By default the plate described by the table, with noise of 1e-3 of full scale.
    share : float, optional
        Step as a fraction of the largest steady-state amplitude.
    seconds : float, optional
        Duration after the step, in s.

    Returns
    -------
    BoardRun

    Raises
    ------
    BuildError
        If the image cannot be built; exit_code is 5 if a package is missing.
    ValueError
        If the table is damaged.
    EmulationError
        If the image ends in a fault.
    """
    with _built(table, "single") as image:
        return _stepped(image, plate or plate_from_table(table, noise=1e-3), share, seconds)


@contextmanager
def _built(table: bytes, variant: str) -> Iterator[Image]:
    """Build an image with a table, for the duration of the context."""
    from_bytes(table)
    missing = [package for name, package in NEEDS.items() if not find_spec(name)]
    if missing:
        raise BuildError(f"emulation needs {' and '.join(missing)}: pip install {' '.join(missing)}", 5)
    with tempfile.TemporaryDirectory() as folder:
        yield build(table, Path(folder), variant)


def _booted(image: Image, plate: Plate) -> EmulatedSingle:
    """Emulate a board with the single-mode image, up to its rest."""
    from firmware.emulate.images import EmulatedSingle

    board = EmulatedSingle(image.elf, plate)
    board.run(2e-3)
    return board


def _check_runs(board: Supervised) -> None:
    if board.state != RUN:
        raise EmulationError(f"the image ended in a fault: {', '.join(fault_names(board.faults)) or 'none'}")


def _stepped(image: Image, plate: Plate, share: float, seconds: float) -> BoardRun:
    board = _booted(image, plate)
    board.start()
    board.run_until(lambda: board.state != IDENTIFY, 20.0)
    swept = board.app.base.measured > 0
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


def emulated_port(table: bytes, plate: Plate | None = None) -> EmulatedPort:
    """Return the serial port of an emulated board that runs the unmodified single-mode image with a table.

    The board's time advances by one millisecond with each read.

    Parameters
    ----------
    table : bytes
        Mode table.
    plate : Plate, optional
        By default the plate described by the table, with noise of 1e-3 of full scale.

    Returns
    -------
    EmulatedPort
        Port for a `firmware.client.client.Client`; its `board` runs on with `board.run(seconds)`.

    Raises
    ------
    BuildError
        If the image cannot be built; exit_code is 5 if a package is missing.
    ValueError
        If the table is damaged.
    """
    with _built(table, "single") as image:
        from firmware.emulate.images import EmulatedPort

        return EmulatedPort(_booted(image, plate or plate_from_table(table, noise=1e-3)))


def six_run(table: bytes, plate: Structure, patterns: int, seconds: float) -> NDArray[np.complex128]:
    """Hold the first patterns of a table in turn, with the unmodified six-channel image on the emulated board.

    Parameters
    ----------
    table : bytes
        Mode table.
    plate : Structure
        Plate under the six actuators and sensors.
    patterns : int
        Number of patterns.
    seconds : float
        Duration of each pattern, in s.

    Returns
    -------
    ndarray, shape (patterns, 6)
        Complex drives at the end of each pattern, as fractions of full scale.

    Raises
    ------
    BuildError
        If the image cannot be built; exit_code is 5 if a package is missing.
    ValueError
        If the table is damaged.
    EmulationError
        If the image ends in a fault.
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
                board.run_until(lambda: board.state != IDENTIFY, 60.0)
            board.run(seconds)
            _check_runs(board)
            drives.append(board.drives)
    return np.array(drives)
