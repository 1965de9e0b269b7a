"""Talks to a board over its serial line: `python -m firmware.client PORT status`, `start 0.1`, `upload FILE`, `watch` ..."""

from __future__ import annotations

import argparse
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from firmware.protocol import (
    BAUD,
    LOG_RECORDS,
    PAYLOAD_MAX,
    REPLY,
    RESULT_TEXT,
    TABLE_TEXT,
    Kind,
    Message,
    Record,
    Result,
    SixStatus,
    Status,
    decode,
    encode,
    parse_any_status,
    parse_log,
    parse_status,
)
from firmware.table_format import with_drive_limit


class Port(Protocol):
    """What is asked of a serial port: pyserial's Serial with a time-out has it."""

    def write(self, data: bytes, /) -> object: ...
    def read(self, size: int = 1, /) -> bytes: ...


class BoardError(RuntimeError):
    """The board refused, or did not answer."""


class Client:
    """One board on a port. Requests are repeated when nothing comes back; all of them may be repeated safely."""

    def __init__(self, port: Port, attempts: int = 3, reads: int = 50) -> None:
        self.port, self.attempts, self.reads = port, attempts, reads
        self.sequence = 0
        self.buffer = b""
        self.records: list[Record] = []

    def request(self, kind: Kind, payload: bytes = b"") -> bytes:
        """The reply's payload behind its result. Raises BoardError when the board refuses or stays silent."""
        self.sequence = (self.sequence + 1) % 256
        frame = encode(Message(kind, self.sequence, payload))
        for _ in range(self.attempts):
            self.port.write(frame)
            reply = self._reply(kind)
            if reply is not None:
                return self._accepted(kind, reply)
        raise BoardError(f"no answer to {kind.name.lower()}")

    def status(self) -> Status:
        """What the board does now; also tells it that the host is alive."""
        return parse_status(self.request(Kind.STATUS))

    def look(self) -> Status | SixStatus:
        """The same of a board of either build."""
        return parse_any_status(self.request(Kind.STATUS))

    def pattern(self, number: int, reference: float = 0.0) -> None:
        """Six channels: holds a pattern of the present shape; 0 asks for half of what is reachable. Talk on as after start."""
        if self.look().state == "run":
            self.request(Kind.PATTERN, struct.pack("<II", self.shape(), number))
        else:
            self.request(Kind.START, struct.pack("<If", number, reference))

    def choose(self, shape: int) -> None:
        """Six channels: another shape, which is another frequency; only when idle."""
        if shape != self.shape():
            self.request(Kind.PATTERN, struct.pack("<II", shape, 0))

    def shape(self) -> int:
        """Six channels: the present shape."""
        status = self.look()
        return status.shape if isinstance(status, SixStatus) else 0

    def start(self, reference: float = 0.0, detuning_hz: float = 0.0) -> None:
        """Drives the wanted mode; 0 asks for the lowest useful level. From then on talk at least twice a second."""
        self.request(Kind.START, struct.pack("<ff", reference, detuning_hz))

    def stop(self) -> None:
        """Back to rest."""
        self.request(Kind.STOP)

    def clear(self) -> None:
        """Leaves the fault state."""
        self.request(Kind.CLEAR)

    def reference(self, level: float) -> None:
        """A new amplitude while running, in full scales of the sensor."""
        self.request(Kind.REFERENCE, struct.pack("<f", level))

    def sine(self, rate_hz: float, depth: float) -> None:
        """A texture: the amplitude swings between 1 and 1 - depth of the reference."""
        self.request(Kind.SINE, struct.pack("<ff", rate_hz, depth))

    def stream(self, every: int) -> None:
        """A texture of samples that follow, each for so many windows."""
        self.request(Kind.STREAM, struct.pack("<I", every))

    def samples(self, factors: list[float]) -> int:
        """Adds factors from 0 to 1 to the stream; returns how many there was room for."""
        codes = [round(min(max(factor, 0.0), 1.0) * 65535) for factor in factors[: PAYLOAD_MAX // 2]]
        return self.request(Kind.SAMPLES, struct.pack(f"<{len(codes)}H", *codes))[0]

    def log(self, every: int) -> None:
        """A record each so many windows, to be taken by take_records; 0 ends it."""
        self.request(Kind.LOG, struct.pack("<I", every))

    def upload(self, table: bytes) -> None:
        """Puts another mode table into the board's flash memory; the outputs rest meanwhile."""
        self.request(Kind.UPLOAD_BEGIN, struct.pack("<I", len(table)))
        piece = PAYLOAD_MAX - 4
        for offset in range(0, len(table), piece):
            self.request(Kind.UPLOAD_DATA, struct.pack("<I", offset) + table[offset : offset + piece])
        self.request(Kind.UPLOAD_END)

    def take_records(self) -> list[Record]:
        """The log's records that came since the last time."""
        messages = list(self._arrived())
        while messages:
            for message in messages:
                self._keep(message)
            messages = list(self._arrived())
        taken, self.records = self.records, []
        return taken

    def _reply(self, kind: Kind) -> Message | None:
        for _ in range(self.reads):
            for message in self._arrived():
                if message.kind == kind | REPLY and message.sequence == self.sequence:
                    return message
                self._keep(message)
        return None

    def _arrived(self) -> Iterator[Message]:
        self.buffer += self.port.read(256)
        *frames, self.buffer = self.buffer.split(b"\0")
        for frame in frames:
            message = decode(frame)
            if message is not None:
                yield message

    def _keep(self, message: Message) -> None:
        if message.kind == LOG_RECORDS:
            self.records += parse_log(message.payload)

    def _accepted(self, kind: Kind, reply: Message) -> bytes:
        result = Result(reply.payload[0])
        if result is Result.OK:
            return reply.payload[1:]
        more = f": {TABLE_TEXT[reply.payload[1]]}" if result is Result.TABLE_REFUSED else ""
        raise BoardError(f"{kind.name.lower()}: {RESULT_TEXT[result]}{more}")


def describe(status: Status | SixStatus) -> str:
    """A status for a reader."""
    if isinstance(status, SixStatus):
        return _describe_six(status)
    gain = f"{abs(status.gain):.5g}" if status.gain_identified else "unidentified"
    return "\n".join(
        [
            f"state {status.state}" + (f", faults: {', '.join(status.faults)}" if status.faults else ""),
            f"mode {status.frequency_hz:.3f} Hz, tau {status.tau_s * 1e3:.4g} ms, gain {gain}, "
            f"delay {status.delay_s * 1e6:.3g} us, neighbours up to {status.neighbour:.3g}",
            f"reference {status.reference:.4g}, measured {abs(status.measured):.4g}, drive {abs(status.drive):.4g}, "
            f"offset {status.offset:.3g} of full scale",
            f"worst fast interrupt {status.worst_cycles} cycles of 720",
        ]
    )


def _describe_six(status: SixStatus) -> str:
    matrix = f"condition {status.condition:.3g}" if status.identified else "not measured yet"
    sensors = ", ".join(f"{abs(z):.4g}" for z in status.sensors)
    return "\n".join(
        [
            f"state {status.state}" + (f", faults: {', '.join(status.faults)}" if status.faults else ""),
            f"shape {status.shape} at {status.frequency_hz:.3f} Hz, matrix {matrix}, pattern {status.pattern}",
            f"reference {status.reference:.4g}, at most {status.reachable:.4g}; sensors {sensors} of full scale",
            f"worst fast interrupt {status.worst_cycles} cycles of 4500",
        ]
    )


def keep_running(client: Client, seconds: float) -> None:
    """Prints a line ten times a second and thereby keeps the board from stopping."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        status = client.look()
        print(f"{status.state}  reference {status.reference:.4f}  measured {abs(status.measured):.4f}", flush=True)
        if status.state not in ("identify", "run"):
            break
        time.sleep(0.1)


def obey(client: Client, command: argparse.Namespace) -> None:
    """Does what the command line asks."""
    values = command.values
    if command.action == "start":
        client.start(*map(float, values[:2]))
        keep_running(client, float("inf"))
    elif command.action == "pattern":
        client.pattern(int(values[0]), *map(float, values[1:2]))
        keep_running(client, float("inf"))
    elif command.action == "shape":
        client.choose(int(values[0]))
    elif command.action == "upload":
        table = Path(values[0]).read_bytes()
        client.upload(with_drive_limit(table, float(values[1])) if len(values) > 1 else table)
    elif command.action == "sine":
        client.sine(float(values[0]), float(values[1]))
    elif command.action == "reference":
        client.reference(float(values[0]))
    elif command.action in ("stop", "clear"):
        getattr(client, command.action)()
    print(describe(client.look()))


WANTED = {
    "status": 0,
    "start": 0,
    "stop": 0,
    "clear": 0,
    "reference": 1,
    "sine": 2,
    "upload": 1,
    "pattern": 1,
    "shape": 1,
}


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m firmware.client",
        description=__doc__,
        epilog="example: python -m firmware.client /dev/ttyACM0 start 0.1",
    )
    parser.add_argument("port", help="serial port of the board")
    parser.add_argument("action", choices=WANTED)
    parser.add_argument(
        "values",
        nargs="*",
        help="start [REFERENCE [DETUNING_HZ]], reference LEVEL, sine HZ DEPTH, upload FILE [DRIVE_LIMIT]; "
        "six channels: pattern NUMBER [REFERENCE], shape NUMBER",
    )
    command = parser.parse_args(arguments)
    if len(command.values) < WANTED[command.action]:
        parser.error(f"{command.action} needs {WANTED[command.action]} value(s)")
    try:
        from serial import Serial, SerialException
    except ImportError:
        print("client: pyserial is not installed: pip install pyserial", file=sys.stderr)
        return 5
    try:
        with Serial(command.port, BAUD, timeout=0.02) as port:
            obey(Client(port), command)
    except (BoardError, SerialException, OSError, ValueError) as error:
        print(f"client: {error}", file=sys.stderr)
        return 3
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
