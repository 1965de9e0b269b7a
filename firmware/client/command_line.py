"""The client's command line: what a person may ask of a board."""

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

from firmware.client import actions, selftest
from firmware.client.client import BoardError, Client, describe, describe_health, describe_identity
from firmware.client.port import NotHere, SerialPort
from firmware.mode_table import from_bytes, to_bytes

EPILOG = """examples: python -m firmware.client /dev/ttyACM0 start 0.1
          python -m firmware.client watch            (the only board that is plugged in)

Exit codes: 0 done, 2 wrong input, 3 the board refused, did not answer or ended in a fault, 4 a check failed,
5 no port or no pyserial, 130 interrupted."""


def number(low: float, high: float) -> Callable[[str], float]:
    """For a number of the command line within bounds."""

    def parsed(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r}, allowed a number from {low:g} to {high:g}")
        return value

    return parsed


def whole(low: int, high: int) -> Callable[[str], int]:
    """For a whole number of the command line within bounds."""

    def parsed(text: str) -> int:
        if not (text.isascii() and text.isdecimal() and len(text) < 10 and low <= int(text) <= high):
            raise argparse.ArgumentTypeError(f"{text!r}, allowed a whole number from {low} to {high}")
        return int(text)

    return parsed


finite = number(-1e9, 1e9)  # no value that the board understands comes near
share = number(0.0, 1.0)
count = whole(1, 50000)  # how many windows or samples something lasts
index = whole(0, 999_999_999)  # of a pattern or shape


def table_of(text: argparse.Namespace) -> bytes:
    """The table to upload, proved sound. Raises ValueError."""
    try:
        data: bytes = text.file.read_bytes()
        table, limit = from_bytes(data), text.drive_limit
        if limit is None:
            return data
        modes = tuple(replace(mode, drive_limit=limit) for mode in table.modes)
        shapes = tuple(replace(shape, drive_limit=limit) for shape in table.shapes)
        return to_bytes(replace(table, modes=modes, shapes=shapes))
    except OSError as error:
        raise ValueError(f"{text.file}: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{text.file}: {error}") from None


Argument = tuple[str, dict[str, Any]]


def argument(name: str, **options: Any) -> Argument:
    """A value that an action takes, as argparse's add_argument does."""
    return name, options


class Action(NamedTuple):
    """What the client can be asked: for the reader, what is done, the values it takes.

    act returns what to print; None stands for the board's status.
    """

    text: str
    act: Callable[[Client, argparse.Namespace], str | None]
    values: tuple[Argument, ...] = ()


LEVEL = argument("reference", type=share, metavar="REFERENCE", help="amplitude, 0 to 1 full scales of the sensor")
ANY_LEVEL = argument("reference", nargs="?", default=0.0, **LEVEL[1])
NUMBER = argument("number", type=index, metavar="NUMBER", help="counted from 0")
SECONDS = argument("--seconds", type=number(1e-3, 1e6), metavar="S", help="end after so long (else at Ctrl-C)")
DETUNING = argument(
    "detuning", type=finite, nargs="?", default=0.0, metavar="DETUNING_HZ", help="off the resonance, Hz"
)

ACTIONS = {
    "status": Action("tell what the board does", lambda client, text: None),
    "identity": Action(
        "tell which image and table the board has", lambda client, text: describe_identity(client.identity())
    ),
    "health": Action(
        "tell clock, longest interrupts, and what was unexpected", lambda client, text: describe_health(client.health())
    ),
    "watch": Action("show bars of what the board measures", actions.watch, (SECONDS,)),
    "log": Action(
        "write what the board measures into a file of comma-separated values",
        actions.log,
        (
            argument("file", type=Path, metavar="FILE.csv"),
            argument(
                "--every", type=count, default=5, metavar="N", help="a record each N windows (0.2 ms), 5 if not given"
            ),
            SECONDS,
        ),
    ),
    "capture": Action(
        "write the codes of ADC and DAC (or of the PWM timers), sample by sample, into a file of comma-separated values",
        actions.capture,
        (
            argument("file", type=Path, metavar="FILE.csv"),
            argument("--every", type=count, default=1, metavar="N", help="a row each N samples, 1 if not given"),
        ),
    ),
    "selftest": Action(
        "go through the first steps of docs/bring-up.md; prints pass or FAIL, exit code 4 when one fails",
        selftest.selftest,
        (
            argument(
                "step", nargs="?", choices=selftest.STEPS, metavar="STEP", help=f"{', '.join(selftest.STEPS)}; else all"
            ),
        ),
    ),
    "identify": Action("measure the plate again, then rest", actions.identify),
    "start": Action(
        "drive the target mode and hold it (without REFERENCE: the lowest useful level) until Ctrl-C",
        actions.start,
        (ANY_LEVEL, DETUNING),
    ),
    "stop": Action("back to rest", lambda client, text: client.stop()),
    "clear": Action("leave the fault state", lambda client, text: client.clear()),
    "reference": Action(
        "another amplitude while running", lambda client, text: client.reference(text.reference), (LEVEL,)
    ),
    "sine": Action(
        "let the amplitude swing between 1 and 1 - DEPTH of the reference",
        lambda client, text: client.sine(text.rate, text.depth),
        (argument("rate", type=finite, metavar="HZ"), argument("depth", type=share, metavar="DEPTH")),
    ),
    "stream": Action(
        "start, play a sound file as the amplitude (-1 is none, 1 the reference), stop",
        actions.stream,
        (
            argument("file", type=Path, metavar="FILE.wav"),
            ANY_LEVEL,
            argument(
                "--every", type=count, default=2, metavar="N", help="windows (0.2 ms) a sample lasts, 2 if not given"
            ),
        ),
    ),
    "upload": Action(
        "put another mode table into the board's flash memory",
        lambda client, text: client.upload(text.table),
        (
            argument("file", type=Path, metavar="FILE"),
            argument(
                "drive_limit", type=finite, nargs="?", metavar="DRIVE_LIMIT", help="0.001 to 1, for all its modes"
            ),
        ),
    ),
    "pattern": Action(
        "six channels: hold a pattern (without REFERENCE: half of what is reachable) until Ctrl-C",
        actions.pattern,
        (NUMBER, ANY_LEVEL),
    ),
    "shape": Action(
        "six channels: another shape, which is another frequency; while idle",
        lambda client, text: client.choose(text.number),
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
    parser.add_argument("port", help="serial port of the board (also --port PORT), or auto: the one that is plugged in")
    words = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    for name, action in ACTIONS.items():
        own = words.add_parser(name, help=action.text, description=action.text)
        for value, options in action.values:
            own.add_argument(value, **options)
    return parser


def with_port(arguments: list[str]) -> list[str]:
    """The arguments with the port in front: as it stands there, after --port, or "auto" when none is named."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--port")
    named, rest = parser.parse_known_args(arguments)
    if named.port is not None:
        return [named.port, *rest]
    is_word = len(rest) == 1 and rest[0][:1] not in ("-", "/")  # meant to be an action, if none that there is
    return ["auto", *rest] if rest and (rest[0] in ACTIONS or is_word) else rest


def prepare(text: argparse.Namespace) -> None:
    """Reads and checks the files that an action names, before the board is spoken to. Raises ValueError."""
    if text.action == "upload":
        text.table = table_of(text)
    elif text.action == "stream":
        text.factors = actions.factors_of(text.file, actions.WINDOW_HZ / text.every)
    elif text.action in ("log", "capture") and (text.file.exists() or not text.file.parent.is_dir()):
        raise ValueError(f"{text.file}: {'is there already' if text.file.exists() else 'no such folder'}")


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    text = parser_of_all().parse_args(with_port(sys.argv[1:] if arguments is None else arguments))
    try:
        prepare(text)
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
    """Does what was asked; returns the exit code. What was started here is stopped when it ends early, by Ctrl-C too."""
    action = ACTIONS[text.action]
    try:
        said = action.act(client, text)
        if said := describe(client.status()) if said is None else said:
            print(said)
        return 0
    except (BoardError, OSError) as error:
        return _failed(f"{error}{_rested(client)}", 3)
    except selftest.ChecksFailed as error:
        return _failed(f"{error}{_rested(client)}", 4)
    except KeyboardInterrupt:
        print(f"client: interrupted{_rested(client)}", file=sys.stderr)
        return 130


def _rested(client: Client) -> str:
    """Stops what was started here; what to say of it."""
    if not client.drives:
        return ""
    try:
        client.stop()
        return "; stopped"
    except (BoardError, OSError):
        return "; it could not be stopped, but stops by itself half a second after the last word it heard"


@contextmanager
def _ended_like_interrupted() -> Iterator[None]:
    """SIGTERM ends as Ctrl-C does."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _failed(error: object, code: int) -> int:
    print(f"client: {' '.join(str(error).split())}", file=sys.stderr)
    return code
