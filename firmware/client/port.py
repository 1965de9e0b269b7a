"""The serial port that a board is on."""

from __future__ import annotations

import os
from importlib.util import find_spec

from firmware.protocol import BAUD

ST_LINK = 0x0483  # USB vendor number of the debugger on a Nucleo


class NotHere(RuntimeError):
    """Something that this machine lacks; the message says how to get it."""


class SerialPort:
    """A serial port whose read returns what has come, after 20 ms at the latest. Raises NotHere when it cannot be opened."""

    def __init__(self, name: str) -> None:
        try:
            from serial import Serial
        except ImportError:
            raise NotHere("pyserial is not installed: pip install pyserial") from None
        if not find_spec("cobs"):
            raise NotHere("cobs, which makes the frames, is not installed: pip install cobs")
        name = the_board() if name == "auto" else name
        try:
            self.serial = Serial(name, BAUD, timeout=0.02, write_timeout=1.0)
        except (OSError, ValueError) as error:  # pyserial's SerialException is an OSError
            number = getattr(error, "errno", None)
            reason = os.strerror(number) if number else str(error)
            hint = "is the board plugged in, its port called so, and used by no other program?"
            raise NotHere(f"{name}: {reason}; {hint}") from None

    def write(self, data: bytes) -> object:
        """Bytes to the board."""
        return self.serial.write(data)

    def read(self, size: int = 1) -> bytes:
        """At most size bytes from it."""
        first: bytes = self.serial.read(1)
        waiting = min(self.serial.in_waiting, size - 1) if first else 0
        return first + self.serial.read(waiting) if waiting else first

    def close(self) -> None:
        """Gives the port back."""
        self.serial.close()


def the_board() -> str:
    """The name of the only serial port that a board's debugger offers. Raises NotHere, ValueError when there are several."""
    from serial.tools.list_ports import comports

    ports = list(comports())
    boards = [port.device for port in ports if port.vid == ST_LINK]
    if not boards:
        others = ", ".join(port.device for port in ports) or "none"
        raise NotHere(f"no board's serial port is here (other ports: {others}): plug it in, or name its port")
    if len(boards) > 1:
        raise ValueError(f"several boards are here: name one of {', '.join(boards)} by --port")
    return boards[0]
