"""Errors of commands, each with its exit code."""

from __future__ import annotations

from collections.abc import Iterable

MAX_LINE_LENGTH, MAX_END = 2000, 400


def one_line(text: str) -> str:
    """Return a message as one printable line: control characters escaped, a very long one shortened in the middle."""
    if len(text) > MAX_LINE_LENGTH:
        text = f"{text[: MAX_LINE_LENGTH - MAX_END]} ... {text[-MAX_END:]}"
    return text if text.isprintable() else "".join(map(_printable, text))


def _printable(letter: str) -> str:
    return letter if letter.isprintable() else letter.encode("unicode_escape", "backslashreplace").decode()


def reason(fault: Exception) -> str:
    """Return why a file cannot be read, without the errno and a repeated file name."""
    return getattr(fault, "strerror", None) or str(fault)


class CommandError(Exception):
    """An expected failure, shown to the user in one line per reason without a traceback."""

    exit_code = 1

    def __init__(self, lines: str | Iterable[str]) -> None:
        self.lines = [one_line(line) for line in ([lines] if isinstance(lines, str) else lines)]
        super().__init__("\n".join(self.lines))


class InputError(CommandError):
    """The input is wrong; every line of `lines` names the place, the value and what is allowed.

    Parameters
    ----------
    lines : str or iterable of str
        One line per fault.

    Examples
    --------
    >>> import antinode
    >>> try:
    ...     antinode.load("examples/small.toml", pitch_mm=-4.0)
    ... except antinode.InputError as fault:
    ...     print(fault.lines[0].partition(": ")[2])
    array.pitch_mm = -4: must be a finite number above 0, from 1e-06 to 1e+07
    """

    exit_code = 2


class CheckFailed(CommandError):
    """A check failed; every line says by how much."""

    exit_code = 4


class NotAvailable(CommandError):
    """Not available in this version or on this machine; the line says what is missing and how to get it."""

    exit_code = 5
