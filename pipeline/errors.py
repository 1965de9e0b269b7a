"""What a command raises, each with the exit code it stands for."""

from __future__ import annotations

from collections.abc import Iterable

LONGEST_LINE = 2000  # characters: a screen; what is longer holds somebody's file, not a reason


class CommandError(Exception):
    """A refusal or failure told to the user in one line per reason, without a traceback."""

    exit_code = 1

    def __init__(self, lines: str | Iterable[str]) -> None:
        self.lines: list[str] = [_one_line(line) for line in ([lines] if isinstance(lines, str) else lines)]
        super().__init__("\n".join(self.lines))


def _one_line(text: str) -> str:
    """The text on one line of printable characters, its middle left out where it is too long to read."""
    if len(text) > LONGEST_LINE:
        text = f"{text[: LONGEST_LINE // 2]} ... {text[-LONGEST_LINE // 2 :]}"
    if text.isprintable():
        return text
    return "".join(letter if letter.isprintable() else _escaped(letter) for letter in text)


def _escaped(letter: str) -> str:
    return " " if letter in "\n\r\t" else letter.encode("unicode_escape").decode()


class InputFault(CommandError):
    """The input is wrong; every line says where, what came and what is allowed."""

    exit_code = 2


class CheckFailed(CommandError):
    """A check did not hold; every line says by how much."""

    exit_code = 4


class NotAvailable(CommandError):
    """Not in this version or not on this machine; the line says what is missing and how to get it."""

    exit_code = 5
