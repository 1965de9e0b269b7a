"""What a command raises, each with the exit code it stands for."""

from __future__ import annotations

from collections.abc import Iterable

MAX_LINE_LENGTH, MAX_END = 2000, 400


def one_line(text: str) -> str:
    """A message as one line that any terminal shows: control characters escaped, the middle of a very long one left out."""
    if len(text) > MAX_LINE_LENGTH:
        text = f"{text[: MAX_LINE_LENGTH - MAX_END]} ... {text[-MAX_END:]}"
    return text if text.isprintable() else "".join(map(_printable, text))


def _printable(letter: str) -> str:
    return letter if letter.isprintable() else letter.encode("unicode_escape", "backslashreplace").decode()


def reason(fault: Exception) -> str:
    """Why a file cannot be read, without the system's number and the file's name over again."""
    return getattr(fault, "strerror", None) or str(fault)


class CommandError(Exception):
    """A refusal or failure, said to the user in one line per reason without a traceback."""

    exit_code = 1

    def __init__(self, lines: str | Iterable[str]) -> None:
        self.lines = [one_line(line) for line in ([lines] if isinstance(lines, str) else lines)]
        super().__init__("\n".join(self.lines))


class InputError(CommandError):
    """The input is wrong; every line of `lines` says where, what came and what is allowed.

    >>> import antinode
    >>> try:
    ...     antinode.load("examples/small.toml", pitch_mm=-4.0)
    ... except antinode.InputError as fault:
    ...     print(fault.lines[0].partition(": ")[2])
    array.pitch_mm = -4: must be a finite number above 0, from 0.001 to 10000
    """

    exit_code = 2


class CheckFailed(CommandError):
    """A check did not hold; every line says by how much."""

    exit_code = 4


class NotAvailable(CommandError):
    """Not in this version or not on this machine; the line says what is missing and how to get it."""

    exit_code = 5
