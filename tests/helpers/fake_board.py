"""Fake board with a few replies, which a test may spoil, behind a port of bytes or a pseudo-terminal."""

from __future__ import annotations

import os
import struct
import threading
import tty
import wave
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from firmware.protocol import LOG_RECORDS, PROTOCOL, REPLY, Kind, Message, decode, encode


def single_status(
    state: int = 0,
    faults: int = 0,
    windows: int = 7,
    cycles: int = 300,
    offset: float = 0.0,
    first: int = 0,
    flags: int = 1,
    reference: float = 0.0,
    metres: float = 0.0,
) -> bytes:
    """A status of the single build: 31250 Hz, 3 ms, gain 0.75, at rest."""
    mode = (31250.0, metres, 0.0, 3e-3, 0.75, 0.0, 9e-6, 0.0, 0.3, 0.002)
    return struct.pack(
        "<BBBBIIIII16f", state, 0, 0, flags, faults, first, windows, 0, cycles, *mode, reference, *[0.0] * 4, offset
    )


STATUS = single_status()
SIX_STATUS = struct.pack(
    "<BBBBIIIII19f", 0, 1, 2, 1, 0, 0, 7, 0, 900, 2400.0, 0.0, 1.5, 0.3, 0.2, 0.01, 0.0, *[0.1] * 12
)
IDENTITY = bytes([PROTOCOL, 1, 1, 3]) + bytes(range(16)) + struct.pack("<2f", 1.0, 0.8)
HEALTH = struct.pack("<11I", 1, 3, 0x08000123, 0x08000200, 0x400, 180_000_000, 210, 900, 90_000, 512, 3)
RECORD = struct.pack("<I5f", 7, 0.1, 0.0, 0.2, 0.0, 0.1)

Spoil = Callable[[Message], bytes]


def sound(request: Message, status: bytes = STATUS) -> Message:
    """The reply of a board that grants everything."""
    samples = bytes([len(request.payload) // 2])
    captured = struct.pack("<HHB4H", 4, 4, 2, 2048, 2049, 2050, 2051)
    column = [0.5 if number // 2 == sum(request.payload[:1]) else 0.05 for number in range(12)]
    more = {
        Kind.STATUS: status,
        Kind.COLUMN: struct.pack("<22f", *column, *[0.999] * 6, 5.9, 5.6, 3e-3, 0.0101),
        Kind.IDENTITY: IDENTITY,
        Kind.HEALTH: HEALTH,
        Kind.SAMPLES: samples,
        Kind.CAPTURED: captured,
    }
    return Message(request.kind | REPLY, request.sequence, b"\0" + more.get(Kind(request.kind), b""))


def log_frame(payload: bytes = RECORD) -> bytes:
    return encode(Message(LOG_RECORDS, 0, payload))


class FakePort:
    """Board that answers requests; `spoil` alters its replies on the line, and `flood` is sent when there is no reply."""

    def __init__(self, spoil: Spoil = encode, status: bytes = STATUS, flood: bytes = b"") -> None:
        self.spoil, self.status, self.flood = spoil, status, flood
        self.requests: list[Message] = []
        self.inward = self.outward = b""

    def write(self, data: bytes) -> int:
        *frames, self.inward = (self.inward + data).split(b"\0")
        for frame in frames:
            request = decode(frame)
            assert request is not None, "the client sent a damaged frame"
            self.requests.append(request)
            answer = self.spoil(self.reply(request))
            self.outward += answer
        return len(data)

    def reply(self, request: Message) -> Message:
        return sound(request, self.status)

    def read(self, size: int = 1) -> bytes:
        while self.flood and len(self.outward) < size:
            self.outward += self.flood
        taken, self.outward = self.outward[:size], self.outward[size:]
        return taken

    @property
    def in_waiting(self) -> int:
        return 4096 if self.flood else len(self.outward)

    def close(self) -> None: ...


def write_sound(path: Path, samples: list[int], rate_hz: int = 2500, width: int = 2, channels: int = 1) -> None:
    """A WAV file; 8-bit samples are unsigned, others signed, all channels but the first are silent."""
    with wave.open(str(path), "wb") as file:
        file.setnchannels(channels)
        file.setsampwidth(width)
        file.setframerate(rate_hz)
        one = [sample.to_bytes(width, "little", signed=width > 1) for sample in samples]
        file.writeframes(b"".join(sample + bytes(width * (channels - 1)) for sample in one))


@contextmanager
def pseudo_terminal(board: FakePort) -> Iterator[str]:
    """Name of a serial port connected to the board, which a thread advances."""
    outer, inner = os.openpty()
    tty.setraw(outer)
    tty.setraw(inner)
    os.set_blocking(outer, False)
    done = threading.Event()
    mover = threading.Thread(target=_move, args=(board, outer, done))
    mover.start()
    try:
        yield os.ttyname(inner)
    finally:
        done.set()
        mover.join()
        os.close(inner)
        os.close(outer)


def _move(board: FakePort, outer: int, done: threading.Event) -> None:
    waiting = b""
    while not done.wait(1e-3):
        with suppress(BlockingIOError):
            board.write(os.read(outer, 4096))
        waiting = waiting or board.read(512)
        with suppress(BlockingIOError):
            waiting = waiting[os.write(outer, waiting) :] if waiting else b""
