"""Fault injection in a closed loop, and the time until the outputs are at rest: `python -m firmware.injection`.

On the rig of firmware.closed_loop, faults are injected at every tick of one second: faults found by interrupts, failed
sensors (also while the level is modulated between zero and full), and one flipped bit of the state, chosen by the
number of the tick. firmware.injection_jobs adds lifts, softening plates, retries and chirps, firmware.injection_six
the same for six channels. On the emulated board, with the unmodified images of both builds, they are lost
interrupts, failed sensors and flipped bits, at every 101st tick of one second (six channels: every 17th). These
numbers are coprime to the ticks of a window and of a check of the guard, so that every phase of both occurs. --stride
and --image-stride change them; --write writes the rows to docs/board/safety.md. A run takes some ten minutes on one processor.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from firmware import injection_jobs, injection_six
from firmware.build import BuildError, build
from firmware.closed_loop import GAIN, PAGE, held_plate, write_into_page
from firmware.host import NoCompiler, load
from firmware.injection_rig import HEAD, SIX_WORDS, WORDS, Row, bits_of, rig_rows
from firmware.injection_trials import (
    BOARD_KINDS,
    break_one_of_six,
    break_single,
    breaking,
    flipping,
    image_rows,
    sensor_kinds,
)
from firmware.protocol import RUN

SAFETY = PAGE.with_name("safety.md")


def _runs(board: Any) -> bool:
    return bool(board.state == RUN)


def held_images() -> tuple[Any, Any]:
    """Make emulated boards of both builds that hold their plates. Raises BuildError."""
    from firmware.emulate.images import EmulatedSingle, EmulatedSix
    from firmware.emulate.plant import Beam, measured_table

    with TemporaryDirectory() as folder:
        table, plate = held_plate(300.0, noise=1e-3)
        single = EmulatedSingle(build(table, Path(folder)).elf, plate)
        beam = Beam(noise=1e-3)
        six = EmulatedSix(build(measured_table(beam), Path(folder), "six").elf, beam)
    single.run(2e-3)
    single.start(0.15 * GAIN)
    six.run(5e-3)
    six.start(0, 0.1)
    for board in (single, six):
        board.run_until(partial(_runs, board), 5.0)  # after the check of a first start
        board.run(0.3)
    return single, six


def board_rows(seconds: float, single_stride: int, six_stride: int) -> Iterator[Row]:
    """Yield the rows measured on the images of both builds. Raises BuildError."""
    single, six = held_images()
    ffi, _ = load()
    single_kinds = BOARD_KINDS | sensor_kinds(break_single)
    six_kinds = BOARD_KINDS | sensor_kinds(break_one_of_six) | {"break pulled": lambda one: one.pull_break()}
    for name, board, stride, kinds, bits in (
        ("one mode", single, single_stride, single_kinds, bits_of(ffi, "an_single", WORDS)),
        ("six channels", six, six_stride, six_kinds, bits_of(ffi, "an_six", SIX_WORDS)),
    ):
        trials = {f"image, {name}: {what}": breaking(go_wrong) for what, go_wrong in kinds.items()}
        trials[f"image, {name}: flipped bit"] = flipping(bits)
        yield from image_rows(board, trials, seconds, stride)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m firmware.injection", description=__doc__)
    parser.add_argument("--seconds", type=float, default=1.0, help="length of the run, s")
    parser.add_argument("--stride", type=int, default=1, help="ticks between two injections on the rig")
    parser.add_argument(
        "--image-stride",
        type=int,
        nargs=2,
        default=(101, 17),
        metavar=("ONE", "SIX"),
        help="ticks between two injections on the images",
    )
    parser.add_argument("--image-seconds", type=float, default=1.0, help="length of the run on the images, s")
    parser.add_argument("--write", action="store_true", help="write the rows to docs/board/safety.md, too")
    chosen = parser.parse_args(arguments)
    rows: list[Row] = []
    head = f"{HEAD}\n{'|---' * 5}|"
    print(head)
    try:
        for result in (
            rig_rows(chosen.seconds, chosen.stride),
            injection_jobs.rows(chosen.seconds, chosen.stride),
            injection_six.rows(chosen.seconds),
            board_rows(chosen.image_seconds, *chosen.image_stride),
        ):
            for one in result:
                print(one.text, flush=True)
                rows.append(one)
    except (NoCompiler, BuildError) as missing:
        print(f"injection: {missing}", file=sys.stderr)
        return 5
    if chosen.write:
        write_into_page(SAFETY, "python -m firmware.injection --write", "\n".join([head, *(one.text for one in rows)]))
    return 0 if all(one.is_sound for one in rows) else 4


if __name__ == "__main__":
    sys.exit(main())
