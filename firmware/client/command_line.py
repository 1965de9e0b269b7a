"""Command line of the client."""

from __future__ import annotations

import argparse
import math
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from firmware.client import actions, page
from firmware.client.client import (
    BoardError,
    Client,
    Level,
    NotHere,
    SerialPort,
    describe,
    describe_health,
    describe_identity,
)
from firmware.mode_table import ALLOWED, from_bytes, to_bytes
from firmware.protocol import EVERY, Reference, Sine, Start, limits

EPILOG = """examples: python -m firmware.client /dev/ttyACM0 start 0.1
          python -m firmware.client watch            (the only board plugged in)

Exit codes: 0 success, 2 invalid input, 3 the board refused, did not answer or ended in a fault, 4 a check failed,
5 no port or no pyserial, 130 interrupted."""


def number(low: float, high: float) -> Callable[[str], float]:
    """Make an argparse type for a number within bounds."""

    def parsed(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r}: must be a number from {low:g} to {high:g}")
        return value

    return parsed


def whole(low: int, high: int) -> Callable[[str], int]:
    """Make an argparse type for an integer within bounds."""

    def parsed(text: str) -> int:
        if not (text.isascii() and text.isdecimal() and len(text) < 10 and low <= int(text) <= high):
            raise argparse.ArgumentTypeError(f"{text!r}: must be an integer from {low} to {high}")
        return int(text)

    return parsed


def within(kind: type, name: str) -> Callable[[str], float]:
    """Make an argparse type for a member of a request."""
    return number(*limits(kind, name)[:2])


def level(text: str) -> Level:
    """Parse an amplitude: a fraction of full scale, or micrometres with their unit."""
    value = text.removesuffix("um").removesuffix("µm")
    if value == text:
        return Level(within(Reference, "reference")(text))
    return Level(number(0.0, 1e3)(value.strip()), "um")


count = whole(*(int(limit) for limit in EVERY[:2]))  # duration in windows or samples
index = whole(0, 999_999_999)  # of a pattern or shape


def table_of(text: argparse.Namespace) -> bytes:
    """Read and check the table to upload. Raises ValueError."""
    try:
        data: bytes = text.file.read_bytes()
        table, limit = from_bytes(data), text.drive_limit
        if text.sensor_volts is not None:
            table = replace(table, sensor_volts=text.sensor_volts)
        if limit is not None:
            modes = tuple(replace(mode, drive_limit=limit) for mode in table.modes)
            shapes = tuple(replace(shape, drive_limit=limit) for shape in table.shapes)
            table = replace(table, modes=modes, shapes=shapes)
        return to_bytes(table)
    except OSError as error:
        raise ValueError(f"{text.file}: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{text.file}: {error}") from None


Argument = tuple[str, dict[str, Any]]


def argument(name: str, **options: Any) -> Argument:
    """Describe an argument of an action, as for argparse's add_argument."""
    return name, options


class Action(NamedTuple):
    """Command of the client: help text, function, and arguments.

    act returns the text to print, or None to print the board's status.
    """

    text: str
    act: Callable[[Client, argparse.Namespace], str | None]
    values: tuple[Argument, ...] = ()


LEVEL = argument(
    "reference", type=level, metavar="REFERENCE", help="amplitude: 1.5um, or 0 to 1 of the sensor's full scale"
)
ANY_LEVEL = argument("reference", nargs="?", default=Level(0.0), **LEVEL[1])
NUMBER = argument("number", type=index, metavar="NUMBER", help="counted from 0")
SECONDS = argument("--seconds", type=number(1e-3, 1e6), metavar="S", help="duration in seconds (default: until Ctrl-C)")
DETUNING = argument(
    "detuning",
    type=within(Start, "detuning_hz"),
    nargs="?",
    default=0.0,
    metavar="DETUNING_HZ",
    help="offset from the resonance, Hz",
)

ACTIONS = {
    "status": Action("report the state of the board", lambda client, text: None),
    "identity": Action(
        "report the image and table on the board", lambda client, text: describe_identity(client.identity())
    ),
    "health": Action(
        "report clock, longest interrupts and last exception", lambda client, text: describe_health(client.health())
    ),
    "watch": Action("show the measured values as bars", actions.watch, (SECONDS,)),
    "log": Action(
        "write the measured values to a CSV file",
        actions.log,
        (
            argument("file", type=Path, metavar="FILE.csv"),
            argument("--every", type=count, default=5, metavar="N", help="windows of 0.2 ms per record (default: 5)"),
            SECONDS,
        ),
    ),
    "capture": Action(
        "write the codes of ADC and DAC (or of the PWM timers), sample by sample, to a CSV file",
        actions.capture,
        (
            argument("file", type=Path, metavar="FILE.csv"),
            argument("--every", type=count, default=1, metavar="N", help="samples per row (default: 1)"),
        ),
    ),
    "selftest": Action(
        "run the first steps of docs/bring-up.md; print pass or FAIL, exit code 4 if any fails",
        actions.selftest,
        (
            argument(
                "step",
                nargs="?",
                choices=actions.STEPS,
                metavar="STEP",
                help=f"{', '.join(actions.STEPS)} (default: all)",
            ),
        ),
    ),
    "identify": Action(
        "measure the plate, choose and load the gains, then hold REFERENCE until Ctrl-C (without it: rest)",
        actions.identify,
        (
            argument(
                "reference",
                type=level,
                nargs="?",
                metavar="REFERENCE",
                help="amplitude: 1.5um, or 0 to 1 of the sensor's full scale (0: the lowest useful level)",
            ),
            argument(
                "--plot", type=Path, metavar="FILE", help="picture of response, fit and coherence: .png, .svg or .pdf"
            ),
        ),
    ),
    "start": Action(
        "drive the target mode and hold it (without REFERENCE: the lowest useful level) until Ctrl-C",
        actions.start,
        (ANY_LEVEL, DETUNING),
    ),
    "stop": Action("return to rest", actions.stop),
    "clear": Action("leave the fault state", lambda client, text: client.clear()),
    "reference": Action(
        "change the amplitude while running",
        lambda client, text: client.reference(client.share_of(text.reference)),
        (LEVEL,),
    ),
    "sine": Action(
        "modulate the amplitude between 1 and 1 - DEPTH of the reference",
        lambda client, text: client.sine(text.rate, text.depth),
        (
            argument("rate", type=within(Sine, "rate_hz"), metavar="HZ"),
            argument("depth", type=within(Sine, "depth"), metavar="DEPTH"),
        ),
    ),
    "stream": Action(
        "start, play a sound file as the amplitude (-1: zero, 1: the reference), stop",
        actions.stream,
        (
            argument("file", type=Path, metavar="FILE.wav"),
            ANY_LEVEL,
            argument("--every", type=count, default=2, metavar="N", help="windows of 0.2 ms per sample (default: 2)"),
        ),
    ),
    "upload": Action(
        "write another mode table to the board's flash memory",
        lambda client, text: client.upload(text.table),
        (
            argument("file", type=Path, metavar="FILE"),
            argument(
                "drive_limit",
                type=number(*ALLOWED["drive_limit"]),
                nargs="?",
                metavar="DRIVE_LIMIT",
                help="drive limit of all modes, 0.001 to 1",
            ),
            argument(
                "--sensor-volts",
                type=number(*ALLOWED["sensor_volts"]),
                metavar="V",
                help="amplitude at the sensor patch for full scale at the pin: 1.65 over the conditioner's gain",
            ),
        ),
    ),
    "pattern": Action(
        "six channels: hold a pattern (without REFERENCE: half of the reachable amplitude) until Ctrl-C",
        actions.pattern,
        (NUMBER, ANY_LEVEL),
    ),
    "shape": Action(
        "six channels: select another shape, and with it another frequency (only when idle)",
        lambda client, text: client.choose(text.number),
        (NUMBER,),
    ),
}


PAGE = "page"  # needs no board


def parser_of_all() -> argparse.ArgumentParser:
    """Build the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m firmware.client",
        description="Control a board over its serial line.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "port", help="serial port of the board (also --port PORT), or auto for the only board plugged in"
    )
    words = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    for name, action in ACTIONS.items():
        own = words.add_parser(name, help=action.text, description=action.text)
        for value, options in action.values:
            own.add_argument(value, **options)
    text = "write a page that shows what watch does, in Chromium, Chrome or Edge, without Python (needs no board)"
    words.add_parser(PAGE, help=text, description=text).add_argument("file", type=Path, metavar="FILE.html")
    return parser


def with_port(arguments: list[str]) -> list[str]:
    """Move the port to the front of the arguments; it may already be there, follow --port, or default to "auto"."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--port")
    named, rest = parser.parse_known_args(arguments)
    if named.port is not None:
        return [named.port, *rest]
    is_word = len(rest) == 1 and rest[0][:1] not in ("-", "/")  # probably a mistyped action
    return ["auto", *rest] if rest and (rest[0] in (*ACTIONS, PAGE) or is_word) else rest


PICTURES = (".png", ".svg", ".pdf")


def prepare(text: argparse.Namespace) -> None:
    """Read and check the files of an action before contacting the board. Raises ValueError."""
    written = text.file if text.action in ("log", "capture", PAGE) else getattr(text, "plot", None)
    if written and (written.exists() or not written.parent.is_dir()):
        raise ValueError(f"{written}: {'file already exists' if written.exists() else 'no such folder'}")
    if text.action == "upload":
        text.table = table_of(text)
    elif text.action == "stream":
        text.factors = actions.factors_of(text.file, actions.WINDOW_HZ / text.every)
    elif text.action == "identify" and text.plot and text.plot.suffix not in PICTURES:
        raise ValueError(f"{text.plot}: must end in {', '.join(PICTURES)}")


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    text = parser_of_all().parse_args(with_port(sys.argv[1:] if arguments is None else arguments))
    try:
        prepare(text)
        if text.action == PAGE:
            print(page.write(text.file))
            return 0
        with closing(SerialPort(text.port)) as port, _ended_like_interrupted():
            return carry_out(Client(port), text)
    except ValueError as error:
        return _failed(error, 2)
    except NotHere as error:
        return _failed(error, 5)
    except OSError as error:
        return _failed(error, 3)
    except KeyboardInterrupt:
        return 130


def carry_out(client: Client, text: argparse.Namespace) -> int:
    """Execute an action and return the exit code; if it ends early, also by Ctrl-C, stop what it started."""
    action = ACTIONS[text.action]
    try:
        said = action.act(client, text)
        if said := describe(client.status()) if said is None else said:
            print(said)
        return 0
    except (BoardError, OSError) as error:
        return _failed(f"{error}{_rested(client)}", 3)
    except actions.ChecksFailed as error:
        return _failed(f"{error}{_rested(client)}", 4)
    except KeyboardInterrupt:
        print(f"client: interrupted{_rested(client)}", file=sys.stderr)
        return 130


def _rested(client: Client) -> str:
    """Stop what was started here and return a note about it for the message."""
    if not client.drives:
        return ""
    try:
        client.stop()
        return "; stopped"
    except (BoardError, OSError):
        return "; stopping failed, but the board stops by itself half a second after the last request"


@contextmanager
def _ended_like_interrupted() -> Iterator[None]:
    """Treat SIGTERM like Ctrl-C."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _failed(error: object, code: int) -> int:
    print(f"client: {' '.join(str(error).split())}", file=sys.stderr)
    return code
