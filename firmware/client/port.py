"""Serial port of a board."""

from __future__ import annotations

import os
from importlib.util import find_spec

from firmware.protocol import BAUD

ST_LINK = 0x0483  # USB vendor number of the debugger on a Nucleo


class NotHere(RuntimeError):
    """A port or package is missing; the message says how to provide it."""


class SerialPort:
    """Serial port whose read returns the bytes received, after 20 ms at the latest.

    Raises
    ------
    NotHere
        If the port cannot be opened, or a package is missing.
    """

    def __init__(self, name: str) -> None:
        try:
            from serial import Serial
        except ImportError:
            raise NotHere("pyserial is not installed: pip install pyserial") from None
        if not find_spec("cobs"):
            raise NotHere("cobs (needed for the frames) is not installed: pip install cobs")
        name = the_board() if name == "auto" else name
        try:
            self.serial = Serial(name, BAUD, timeout=0.02, write_timeout=1.0)
        except (OSError, ValueError) as error:  # pyserial's SerialException is an OSError
            number = getattr(error, "errno", None)
            reason = os.strerror(number) if number else str(error)
            hint = "check that the board is plugged in, the name of the port, and that no other program uses it"
            raise NotHere(f"{name}: {reason}; {hint}") from None

    def write(self, data: bytes) -> object:
        """Send bytes to the board."""
        return self.serial.write(data)

    def read(self, size: int = 1) -> bytes:
        """Receive at most size bytes."""
        first: bytes = self.serial.read(1)
        waiting = min(self.serial.in_waiting, size - 1) if first else 0
        return first + self.serial.read(waiting) if waiting else first

    def close(self) -> None:
        """Close the port."""
        self.serial.close()


def the_board() -> str:
    """Return the name of the only serial port that belongs to a board's debugger.

    Raises
    ------
    NotHere
        If there is none.
    ValueError
        If there are several.
    """
    from serial.tools.list_ports import comports

    ports = list(comports())
    boards = [port.device for port in ports if port.vid == ST_LINK]
    if not boards:
        others = ", ".join(port.device for port in ports) or "none"
        raise NotHere(f"no board found (other serial ports: {others}): plug it in, or name its port")
    if len(boards) > 1:
        raise ValueError(f"several boards found: choose one of {', '.join(boards)} with --port")
    return boards[0]
