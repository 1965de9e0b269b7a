"""The board's page: what `watch` shows, in a browser with Web Serial and without Python."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from firmware import protocol
from firmware.client.client import ST_LINK
from firmware.wire import base_and_code

TEMPLATE = Path(__file__).parent / "watch.html"


def page() -> str:
    """Return the page, with numbers and layouts of this protocol version in it."""
    wire: dict[str, Any] = {
        "protocol": protocol.PROTOCOL,
        "baud": protocol.BAUD,
        "vendor": ST_LINK,
        "frame": protocol.FRAME_MAX,
        "reply": protocol.REPLY,
        "kinds": {kind.name: int(kind) for kind in protocol.Kind},
        "results": {int(result): text for result, text in protocol.RESULT_TEXT.items()},
        "states": protocol.STATES,
        "flags": {flag.name: int(flag) for flag in protocol.Flag},
        "faults": [
            {"bit": fault.bit_length() - 1, "name": protocol.fault_names(fault)[0], **text._asdict()}
            for fault, text in protocol.FAULTS.items()
        ],
        "layouts": [_layout("single", protocol.SingleStatus), _layout("six", protocol.SixStatus)],
    }
    return TEMPLATE.read_text(encoding="utf-8").replace("{{wire}}", json.dumps(wire).replace("<", "\\u003c"))


def write(file: Path) -> str:
    """Write the page and return what to do with it. Raises ValueError."""
    try:
        file.write_text(page(), encoding="utf-8")
    except OSError as error:
        raise ValueError(f"{file}: {error.strerror}") from None
    return f"{file}: open it in Chromium, Chrome or Edge, and choose the board's port"


def _layout(build: str, kind: type) -> dict[str, Any]:
    whole = protocol.layout(kind)
    members = []
    for name in whole.names or ():
        code, shape = base_and_code(whole[name])
        members.append([name, code, shape[0] if shape else 1])
    return {"build": build, "bytes": whole.itemsize, "members": members}
