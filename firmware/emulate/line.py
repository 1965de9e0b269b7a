"""A serial port whose other end is an emulated board: reading lets the board's time go on."""

from __future__ import annotations

from firmware.emulate.board import EmulatedBoard


class EmulatedPort:
    """Has write and read, as a pyserial port has; each read waits one millisecond of the board's time."""

    def __init__(self, board: EmulatedBoard) -> None:
        self.board = board

    def write(self, data: bytes) -> int:
        """Bytes to the board."""
        self.board.send(data)
        return len(data)

    def read(self, size: int = 1) -> bytes:
        """What the board has sent, at most size bytes."""
        self.board.run(1e-3)
        taken = bytes(self.board.received[:size])
        del self.board.received[:size]
        return taken
