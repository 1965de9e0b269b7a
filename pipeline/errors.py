"""What a command raises, each with the exit code it stands for."""

from __future__ import annotations

from collections.abc import Iterable


class CommandError(Exception):
    """A refusal or failure told to the user in one line per reason, without a traceback."""

    exit_code = 1

    def __init__(self, lines: str | Iterable[str]) -> None:
        self.lines: list[str] = [lines] if isinstance(lines, str) else list(lines)
        super().__init__("\n".join(self.lines))


class InputFault(CommandError):
    """The input is wrong; every line says where, what came and what is allowed."""

    exit_code = 2


class CheckFailed(CommandError):
    """A check did not hold; every line says by how much."""

    exit_code = 4


class NotAvailable(CommandError):
    """Not in this version or not on this machine; the line says what is missing and how to get it."""

    exit_code = 5
