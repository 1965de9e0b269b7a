"""The client's command line: what a person may ask of a board."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware.client import BoardError, Client, describe, figure
from firmware.protocol import BAUD
from firmware.table_format import verify, with_drive_limit

EPILOG = """example: python -m firmware.client /dev/ttyACM0 start 0.1

Exit codes: 0 done, 2 wrong input, 3 the board refused or did not answer, 5 no port or no pyserial, 130 interrupted."""


MOST = 1e9  # no value that the board understands comes near; larger ones may not fit into its single precision


class NotHere(RuntimeError):
    """Something that this machine lacks; the message says how to get it."""


def start(client: Client, told: argparse.Namespace) -> None:
    """Drives the wanted mode and holds it."""
    client.start(told.reference, told.detuning)
    keep_running(client)


def pattern(client: Client, told: argparse.Namespace) -> None:
    """Holds a pattern of the present shape."""
    client.pattern(told.number, told.reference)
    keep_running(client)


def keep_running(client: Client) -> None:
    """Prints a line ten times a second and thereby keeps the board from stopping, until it rests."""
    state = "run"
    while state in ("identify", "run"):
        status = client.look()
        state = status.state
        measured = figure(abs(status.measured), ".4f")
        print(f"{state}  reference {figure(status.reference, '.4f')}  measured {measured}", flush=True)
        time.sleep(0.1)


def finite(text: str) -> float:
    """A number of the command line that single precision can hold."""
    return _number(text, -MOST, MOST)


def share(text: str) -> float:
    """A number from 0 to 1 of the command line."""
    return _number(text, 0.0, 1.0)


def _number(text: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"{text!r}, allowed a number from {low:g} to {high:g}")
    return value


def index(text: str) -> int:
    """A number of a pattern or shape."""
    if not (text.isascii() and text.isdecimal() and len(text) < 10):
        raise argparse.ArgumentTypeError(f"{text!r}, allowed a whole number from 0")
    return int(text)


def table_of(told: argparse.Namespace) -> bytes:
    """The table to upload, proved whole. Raises ValueError."""
    try:
        table: bytes = told.file.read_bytes()
        verify(table)
        return table if told.drive_limit is None else with_drive_limit(table, told.drive_limit)
    except OSError as error:
        raise ValueError(f"{told.file}: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{told.file}: {error}") from None


Act = Callable[[Client, argparse.Namespace], object]
Argument = tuple[str, dict[str, Any]]


def argument(name: str, **options: Any) -> Argument:
    """A value that an action takes, as argparse's add_argument does."""
    return name, options


@dataclass(frozen=True)
class Action:
    """What the client can be asked: for the reader, what is done, the values it takes."""

    text: str
    act: Act
    values: tuple[Argument, ...] = ()


LEVEL = argument("reference", type=share, metavar="REFERENCE", help="amplitude, 0 to 1 full scales of the sensor")
ANY_LEVEL = argument("reference", nargs="?", default=0.0, **LEVEL[1])
NUMBER = argument("number", type=index, metavar="NUMBER", help="counted from 0")

ACTIONS = {
    "status": Action("tell what the board does", lambda client, told: None),
    "start": Action(
        "drive the wanted mode and hold it (without REFERENCE: the lowest useful level) until Ctrl-C",
        start,
        (
            ANY_LEVEL,
            argument(
                "detuning", type=finite, nargs="?", default=0.0, metavar="DETUNING_HZ", help="off the resonance, Hz"
            ),
        ),
    ),
    "stop": Action("back to rest", lambda client, told: client.stop()),
    "clear": Action("leave the fault state", lambda client, told: client.clear()),
    "reference": Action(
        "another amplitude while running", lambda client, told: client.reference(told.reference), (LEVEL,)
    ),
    "sine": Action(
        "let the amplitude swing between 1 and 1 - DEPTH of the reference",
        lambda client, told: client.sine(told.rate, told.depth),
        (argument("rate", type=finite, metavar="HZ"), argument("depth", type=share, metavar="DEPTH")),
    ),
    "upload": Action(
        "put another mode table into the board's flash memory",
        lambda client, told: client.upload(told.table),
        (
            argument("file", type=Path, metavar="FILE"),
            argument(
                "drive_limit", type=finite, nargs="?", metavar="DRIVE_LIMIT", help="0.001 to 1, for all its modes"
            ),
        ),
    ),
    "pattern": Action(
        "six channels: hold a pattern (without REFERENCE: half of what is reachable) until Ctrl-C",
        pattern,
        (NUMBER, ANY_LEVEL),
    ),
    "shape": Action(
        "six channels: another shape, which is another frequency; while idle",
        lambda client, told: client.choose(told.number),
        (NUMBER,),
    ),
}


def parser_of_all() -> argparse.ArgumentParser:
    """The command line's parser."""
    parser = argparse.ArgumentParser(
        prog="python -m firmware.client",
        description="Talks to a board over its serial line.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("port", help="serial port of the board")
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    for name, action in ACTIONS.items():
        own = actions.add_parser(name, help=action.text, description=action.text)
        for value, options in action.values:
            own.add_argument(value, **options)
    return parser


def open_port(name: str) -> Any:
    """The board's serial port. Raises NotHere."""
    try:
        from serial import Serial
    except ImportError:
        raise NotHere("pyserial is not installed: pip install pyserial") from None
    try:
        return Serial(name, BAUD, timeout=0.02, write_timeout=1.0)
    except (OSError, ValueError) as error:  # pyserial's SerialException is an OSError
        number = getattr(error, "errno", None)
        reason = os.strerror(number) if number else str(error)
        raise NotHere(
            f"{name}: {reason}; is the board plugged in, its port called so, and used by no other program?"
        ) from None


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    told = parser_of_all().parse_args(arguments)
    try:
        if told.action == "upload":
            told.table = table_of(told)
    except ValueError as error:
        return _failed(error, 2)
    try:
        with closing(open_port(told.port)) as port:
            client = Client(port)
            ACTIONS[told.action].act(client, told)
            print(describe(client.look()))
    except NotHere as error:
        return _failed(error, 5)
    except (BoardError, OSError) as error:
        return _failed(error, 3)
    except KeyboardInterrupt:
        return 130
    return 0


def _failed(error: Exception, code: int) -> int:
    print(f"client: {' '.join(str(error).split())}", file=sys.stderr)
    return code
