"""Replies of a board on the serial line, through the client."""

from __future__ import annotations

import random
from typing import Any

from firmware.client import client
from firmware.client.client import Client, describe, describe_health, describe_identity
from firmware.mode_table import Mode, ModeTable, to_bytes
from firmware.protocol import PAYLOAD_MAX, REPLY, Kind, Message, encode
from tests.fuzz.damage import damaged
from tests.helpers.fake_board import RECORD, SIX_STATUS, STATUS, FakePort, log_frame, sound

TABLE = to_bytes(ModeTable(250e3, bytes(16), (Mode(31250.0, 3e-3),)))
REQUESTS = (
    lambda talk: describe(talk.status()),
    lambda talk: describe_identity(talk.identity()),
    lambda talk: describe_health(talk.health()),
    lambda talk: talk.shape(),
    lambda talk: talk.start(0.1),
    lambda talk: talk.samples([0.5]),
    lambda talk: talk.upload(TABLE),
    lambda talk: talk.captured(0),
    lambda talk: talk.take_records(),
)
ASKED = (Kind.STATUS, Kind.IDENTITY, Kind.HEALTH, Kind.STATUS, Kind.START, Kind.SAMPLES, Kind.UPLOAD_END, Kind.CAPTURED)


class Line(FakePort):
    """A board that answers each request with the same bytes: as the payload of a sound frame, or as they are."""

    def __init__(self, framed: bool, data: bytes) -> None:
        super().__init__()
        self.framed, self.data = framed, data

    def write(self, request: bytes) -> int:
        sequence, kind = self.sequence_and_kind(request)
        payload = self.data[:PAYLOAD_MAX]
        self.outward += encode(Message(kind | REPLY, sequence, payload)) if self.framed else self.data
        return len(request)

    @staticmethod
    def sequence_and_kind(request: bytes) -> tuple[int, int]:
        from firmware.protocol import decode

        message = decode(request.rstrip(b"\0"))
        assert message is not None
        return message.sequence, message.kind


def draw_reply(draw: random.Random) -> bytes:
    """Which request, whether framed, and bytes near those of a sound reply."""
    which, framed = draw.randrange(len(REQUESTS)), draw.random() < 0.7
    if which < len(ASKED):
        whole = sound(Message(ASKED[which], 1, b""), draw.choice((STATUS, SIX_STATUS)))
        data = damaged(whole.payload if framed else encode(whole), draw)
    else:
        framed, data = False, damaged(log_frame(RECORD * 4) * draw.randint(1, 3), draw)
    if draw.random() < 0.2:
        data = bytes(draw.randrange(256) for _ in range(draw.randint(0, 200)))
    return bytes([which, framed]) + data


def read_reply(data: bytes) -> Any:
    port = Line(bool(data[1]), data[2:])
    port.outward = data[2:] if data[0] >= len(ASKED) else b""
    client.BUSY_S = 0.05
    return REQUESTS[data[0]](Client(port, attempts=1, reads=3))
