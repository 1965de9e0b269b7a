"""The firmware's images run without a board: emulated Cortex-M4, emulated converters, a plate computed from the mode table."""

from __future__ import annotations

import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware.build import BuildError, build
from firmware.emulate.plant import Plate, plate_from_table
from firmware.table_format import header_text, verify

NEEDS = ("unicorn", "cffi")
WINDOW_S = 50 / 250e3


class EmulationError(RuntimeError):
    """The image on the emulated board did not do what it was asked; the message names its fault."""


def step_response(
    table: bytes, plate: Plate | None = None, share: float = 0.2, seconds: float = 15e-3
) -> dict[str, NDArray[np.float64]]:
    """A reference step of the unmodified image on the emulated board, joined to the plate that the table describes.

    The image identifies the mode first when the table leaves its gain open, settles at zero, and is then asked for share
    of the largest steady amplitude. Returns time_s (zero at the step), reference, u_d, u_q (what the sensor shows, in full
    scales, reference along d) and drive (|V|, in full scales), one entry for each window of 0.2 ms. plate defaults to
    plate_from_table with noise of 1e-3 of full scale. Raises BuildError (exit_code 5 when something is not installed),
    ValueError for a damaged table, EmulationError when the image faulted.
    """
    verify(table)
    missing = [name for name in NEEDS if not find_spec(name)]
    if missing:
        raise BuildError(f"emulation needs {' and '.join(missing)}: pip install {' '.join(missing)}", 5)
    with tempfile.TemporaryDirectory() as folder:
        image = build(header_text(table), Path(folder))
        return _stepped(image.elf, plate or plate_from_table(table, noise=1e-3), share, seconds)


def _stepped(image: Path, plate: Plate, share: float, seconds: float) -> dict[str, NDArray[np.float64]]:
    from firmware.emulate.single import IDENTIFY, RUN, EmulatedSingle
    from firmware.protocol import fault_names

    board = EmulatedSingle(image, plate)
    board.run(2e-3)
    board.push_button()
    board.run_until(lambda: board.app.state != IDENTIFY, 20.0)
    board.app.slow.reference = 0.0
    board.run(10.0 * board.app.mode.tau_s)
    before = len(board.reports)
    board.run(2e-3)
    origin = len(board.reports)
    board.app.slow.reference = (
        share * abs(complex(board.app.mode.gain.re, board.app.mode.gain.im)) * board.app.mode.drive_limit
    )
    board.run(seconds)
    if board.app.state != RUN:
        raise EmulationError(f"the image ended in a fault: {', '.join(fault_names(board.app.faults)) or 'none'}")
    measured, drive, reference = (np.array(column) for column in zip(*board.reports[before:], strict=True))
    return {
        "time_s": (np.arange(before, len(board.reports)) - origin) * WINDOW_S,
        "reference": reference,
        "u_d": measured.real,
        "u_q": measured.imag,
        "drive": np.abs(drive),
    }
