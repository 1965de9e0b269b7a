"""Fingers that lift from the six-channel build: `python -m firmware.six_lifts` prints a table of docs/board/loop.md.

A finger on the clamped beam multiplies the damping by six and adds a tenth of the beam's mass at one place. The loop
adapts; then damping and mass fall linearly. Motion is that of the beam at the sensors, over the largest target.

The least possible motion is that of a loop that is warned: it gives up its integrals, which compensate for the finger, at the
end of the first window in which the lift exceeds the noise SIGMAS times. No law that reads windows can do so earlier.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware.closed_loop import LIFTS_S, PAGE, PEAK_MOST, SIGMAS, TOUCHED, write_into_page
from firmware.emulate.plant import Beam, Structure, measured_table
from firmware.host import NoCompiler
from firmware.host.hosted import HostedSix
from firmware.mode_table import Pattern
from firmware.protocol import RUN, fault_names

BEAM = Beam(noise=1e-3)
FINGER_M, ADDED = 0.06, 0.1  # where a finger rests, and its mass over the beam's
REFERENCE = 0.1
STARTED_S, ADAPTS_S, STEP_S, AFTER_S = 0.2, 1.2, 0.5e-3, 50e-3
SEEN = 40  # windows whose noise is seen
MOMENTS = 4  # of a window at which the finger starts to lift
WAVELENGTH_M = 2.0 * np.pi / np.sqrt(2.0 * np.pi * BEAM.frequency_hz / BEAM.stiffness)
PATTERNS = {
    "left": Pattern("left", (1, 0.5, 0, 0, 0, 0)),
    "travelling, even targets": Pattern("wave", tuple(np.exp(-2j * np.pi * BEAM.places_m / WAVELENGTH_M).tolist())),
    # of `python -m pipeline.board.six_channels --points --frequency 2.4kHz`
    "travelling, largest ratio": Pattern(
        "wave+", (-0.354 + 0.664j, 1, -0.8 - 0.596j, 0.287 + 0.953j, 0.353 - 0.934j, -0.73 + 0.07j)
    ),
}
COMMAND = "python -m firmware.six_lifts --write"


def pressed(structure: Structure, share: float = 1.0) -> Structure:
    """Beam under a finger that has a share of its full damping and mass."""
    shapes = BEAM.shapes(np.array([FINGER_M]))[:, 0]
    angular = structure.angular / np.sqrt(1.0 + ADDED * share * shapes**2)
    return replace(
        structure, angular=angular, quality_factor=structure.quality_factor / (1.0 + (TOUCHED - 1.0) * share)
    )


def started(table: bytes, beam: Beam) -> HostedSix:
    """Make a board that has just started the first pattern at REFERENCE. Raises NoCompiler."""
    board = HostedSix(table, beam)
    board.run(5e-3)
    board.lib.an_six_start(board.app, 0, REFERENCE)
    return board


def touched(pattern: Pattern) -> HostedSix:
    """Make a board that holds a pattern under a finger to which it has adapted.

    Raises
    ------
    NoCompiler
    RuntimeError
        If the application stops with a fault.
    """
    board = started(measured_table(BEAM, pattern), BEAM)
    board.run(STARTED_S)
    board.beam.become(pressed(BEAM.structure))
    board.run(ADAPTS_S)
    require_held(board)
    return board


def shown(board: HostedSix) -> float:
    """Share of the integrals that the sensors show on top of their targets."""
    target, integral = _complex(board.app.slow.target), _complex(board.app.slow.integral)
    return float(np.real((board.measured - target) @ integral.conj()) / ((np.abs(integral) ** 2).sum() + 1e-9))


def windows(board: HostedSix, count: int) -> Iterator[None]:
    """Advance to the end of each of a number of windows."""
    for _ in range(count):
        board.tick()
        while board.fast.tick:
            board.tick()
        yield


def lifted(board: HostedSix, lift_s: float, warned: int = 0) -> tuple[float, list[float]]:
    """Largest motion over the reference while a finger lifts and shortly after, and what each window shows of it.

    Parameters
    ----------
    board : HostedSix
        Adapted to the finger.
    lift_s : float
        Duration of the lift, in s.
    warned : int, optional
        Number of the window at whose end the loop gives up its integrals, from 1; 0 leaves it alone.

    Returns
    -------
    float
    list of float

    Raises
    ------
    RuntimeError
        If the application stops with a fault.
    """
    peak, seen = 0.0, list[float]()
    for step in range(1, round((lift_s + AFTER_S) / STEP_S) + 1):
        board.beam.become(pressed(BEAM.structure, max(1.0 - step * STEP_S / lift_s, 0.0)))
        for _ in range(round(STEP_S * board.sample_rate_hz)):
            if len(seen) == warned - 1 and board.fast.tick == board.fast.end - 1:  # the tick that ends the window
                for integral in board.app.slow.integral:
                    integral.re = integral.im = 0.0
            board.tick()
            peak = max(peak, float(np.abs(board.beam.motion).max()))
            if board.fast.tick == 0:
                seen.append(shown(board))
    require_held(board)
    return peak / REFERENCE, seen


def peaks(pattern: Pattern, lift_s: float) -> Iterator[tuple[float, float]]:
    """Largest motion and the least possible one for each moment of a window at which the lift starts."""
    board = touched(pattern)
    with board.undone():
        still = [shown(board) for _ in windows(board, SEEN)]
    visible = np.mean(still) + SIGMAS * np.std(still)
    for _ in range(MOMENTS):
        board.run((board.app.window + board.lib.AN_SIX_GAP) * board.sample_s / MOMENTS)
        with board.undone():
            own, seen = lifted(board, lift_s)
        first = next((number for number, share in enumerate(seen, 1) if share > visible), 0)
        with board.undone():
            least, _ = lifted(board, lift_s, warned=first)
        yield own, least


def table() -> str:
    """Return the table, with the worst case over the moments."""
    lines = ["| pattern | " + " | ".join(f"{1e3 * lift_s:g} ms" for lift_s in LIFTS_S) + " |"]
    lines.append("|---" * (len(LIFTS_S) + 1) + "|")
    for name, pattern in PATTERNS.items():
        cells = [_cell(list(peaks(pattern, lift_s))) for lift_s in LIFTS_S]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cell(pairs: list[tuple[float, float]]) -> str:
    own, least = (max(each) for each in zip(*pairs, strict=True))
    return f"{own:.2f}" + (f" ({least:.2f})" if least > PEAK_MOST else "")


def _complex(values: Any) -> NDArray[np.complex128]:
    return np.array([complex(z.re, z.im) for z in values])


def require_held(board: HostedSix) -> None:
    """Raise RuntimeError if the application has stopped with a fault."""
    if board.state != RUN:
        raise RuntimeError(f"the pattern is not held: faults {', '.join(fault_names(board.faults))}")


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m firmware.six_lifts", description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the table to docs/board/loop.md")
    chosen = parser.parse_args(arguments)
    try:
        text = table()
    except NoCompiler as missing:
        print(f"firmware.six_lifts: {missing}", file=sys.stderr)
        return 5
    if chosen.write:
        write_into_page(PAGE, COMMAND, text)
    else:
        print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
