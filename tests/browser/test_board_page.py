"""The board's page in headless Chromium, joined to the emulated board through a bridge in place of Web Serial."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware.client.actions import level
from firmware.client.client import Client
from firmware.client.command_line import main
from firmware.emulate.plant import Plate, Resonance
from firmware.mode_table import Mode, ModeTable, hold, to_bytes
from firmware.protocol import (
    FAULTS,
    PROTOCOL,
    REPLY,
    Fault,
    Message,
    Result,
    SingleStatus,
    SixStatus,
    decode,
    encode,
    layout,
    parse_status,
)
from tests.firmware.conftest import core, make_image  # noqa: F401  (fixtures)

TRUE, GAIN, QUALITY = 31437.3, 0.8, 300.0
TAU = QUALITY / math.pi / TRUE
PLATE = Plate((Resonance(TRUE, TAU, GAIN),), delay_s=7.3e-6, noise=1e-3)
MODE = Mode(TRUE, TAU, -1j * GAIN * abs(hold(TRUE, 250e3)), 9.3e-6, frequency_identified=True)
SERIAL = """
Object.defineProperty(navigator, "serial", {value: {requestPort: async (asked) => {
  window.asked = asked;
  return {
    open: async (options) => { window.baud = options.baudRate; },
    close: async () => {},
    readable: new ReadableStream({pull: async (line) => {
      await new Promise((later) => setTimeout(later, 5));
      line.enqueue(new Uint8Array(await fromBoard()));
    }}),
    writable: new WritableStream({write: async (bytes) => toBoard([...bytes])}),
  };
}}});
"""


@pytest.fixture
def seen(browser: Any, tmp_path: Path) -> Any:
    """Opens the page with a port whose bytes go through two functions."""
    contexts = []

    def open_page(port: Any) -> Any:
        file = tmp_path / f"watch-{len(contexts)}.html"
        assert main(["page", str(file)]) == 0
        context = browser.new_context(viewport={"width": 760, "height": 900})
        contexts.append(context)
        shown = context.new_page()
        if port is not None:
            shown.expose_function("toBoard", lambda data: port.write(bytes(data)) and None)
            shown.expose_function("fromBoard", lambda: list(port.read(256)))
            shown.add_init_script(SERIAL)
        shown.goto(file.as_uri())
        return shown

    yield open_page
    for context in contexts:
        context.close()


@pytest.fixture
def board(make_image: Callable[..., Any], core: Any) -> Any:  # noqa: F811
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    from firmware.emulate.images import EmulatedSingle

    made = EmulatedSingle(make_image(to_bytes(ModeTable(250e3, bytes(16), (MODE,)))).elf, PLATE)
    made.run(2e-3)
    return made


@pytest.mark.slow
def test_the_page_shows_the_emulated_board_and_stops_it(seen: Any, board: Any) -> None:
    from firmware.emulate.images import EmulatedPort

    port = EmulatedPort(board)
    client = Client(port)
    client.start(0.05)
    board.run(60e-3)
    shown = seen(port)
    shown.click("#connect")
    shown.wait_for_selector("#state:text-matches('^run')")
    assert shown.evaluate("[asked.filters[0].usbVendorId, baud]") == [0x0483, 921600]
    rows = dict(row.split("\t") for row in shown.inner_text("#values").splitlines())
    assert float(rows["frequency"].removesuffix(" Hz")) == pytest.approx(TRUE, abs=3.0)
    assert float(rows["quality factor"]) == pytest.approx(QUALITY, rel=0.05)
    bars = shown.inner_text("#bars").split("\n")
    measured = float(bars[bars.index("measured") + 1].removesuffix(" %"))
    assert measured == pytest.approx(5.0, rel=0.05)
    widths = shown.eval_on_selector_all(".bar b", "(bars) => bars.map((bar) => parseFloat(bar.style.width))")
    assert widths[0] == pytest.approx(100.0 * level(0.05), abs=0.1)
    shown.click("#clear")
    shown.wait_for_selector("#said:text('refused in the present state')")
    shown.wait_for_function("document.querySelector('polyline').points.length > 3")
    shown.click("#stop")
    shown.wait_for_selector("#state:text-matches('^idle')")
    assert board.state == 0 and board.dac.value & 0xFFF == 2048


@pytest.mark.slow
def test_faults_are_named_with_what_to_check_and_cleared(seen: Any, board: Any) -> None:
    from firmware.emulate.images import EmulatedPort

    board.app.fast.faults |= Fault.MISMATCH
    board.run(2e-3)
    shown = seen(EmulatedPort(board))
    shown.click("#connect")
    shown.wait_for_selector("#state:text-matches('^fault')")
    said = shown.inner_text("#faults")
    assert "mismatch (first)" in said and FAULTS[Fault.MISMATCH].check in said
    shown.click("#clear")
    shown.wait_for_selector("#state:text-matches('^idle')")
    assert shown.inner_text("#faults") == ""


def layouts() -> list[tuple[type, dict[str, Any]]]:
    """A status of either build, every member another value."""
    found = []
    for kind in (SingleStatus, SixStatus):
        row = np.zeros(1, layout(kind))
        for number, name in enumerate(row.dtype.names or (), start=1):
            row[name] = number * (3 + 4j) if row[name].dtype.kind == "c" else number
        row["state_number"] = 2
        found.append((kind, row))
    return found


@pytest.mark.parametrize(("kind", "row"), layouts(), ids=["single", "six"])
def test_the_page_reads_a_status_as_the_client_does(seen: Any, kind: type, row: Any) -> None:
    """Frames, too: with a zero, a long run without one and a wrong sum."""
    shown = seen(None)
    theirs = shown.evaluate("(bytes) => parse(bytes)", list(row.tobytes()))
    ours = parse_status(row.tobytes())
    assert type(ours) is kind
    for name in row.dtype.names:
        mine = getattr(ours, name)
        mine = [abs(one) if isinstance(one, complex) else one for one in mine] if isinstance(mine, list) else mine
        assert theirs[name] == pytest.approx(abs(mine) if isinstance(mine, complex) else mine, rel=1e-6), name
    for payload in (b"", b"\0\0", bytes(range(120)), bytes([7] * 120)):
        frame = encode(Message(0x82, 5, payload))
        read = shown.evaluate("(frame) => decode(frame)", list(frame[:-1]))
        assert read == {"kind": 0x82, "sequence": 5, "payload": list(payload)}
        assert shown.evaluate("(frame) => decode(frame)", [*frame[:-2], frame[-2] ^ 1]) is None
    sent = bytes(shown.evaluate("() => [...encode(2, 200)]"))
    assert sent == encode(Message(2, 200))
    with pytest.raises(Exception, match="different versions"):
        shown.evaluate("(bytes) => parse(bytes)", [0] * 7)


def test_a_browser_without_a_serial_line_is_told_so(seen: Any) -> None:
    shown = seen(None)
    shown.add_init_script("Object.defineProperty(Navigator.prototype, 'serial', {value: undefined});")
    shown.reload()
    assert "Chromium, Chrome or Edge" in shown.inner_text("#said") and shown.is_disabled("#connect")


@pytest.mark.slow
def test_another_protocol_and_a_silent_board_are_told(seen: Any) -> None:
    shown = seen(Answering(bytes([Result.OK, PROTOCOL + 1, 1, 2, 1]) + bytes(16)))
    shown.click("#connect")
    shown.wait_for_selector(f"#said:text('speaks protocol {PROTOCOL + 1}, this page {PROTOCOL}')")
    shown = seen(Answering(None))
    shown.click("#connect")
    shown.wait_for_selector("#said:text('does not answer')")
    assert not shown.is_disabled("#connect")


class Answering:
    """A port that gives every request the same answer, or none."""

    def __init__(self, answer: bytes | None) -> None:
        self.answer, self.bytes = answer, b""

    def write(self, data: bytes) -> None:
        asked = decode(data[:-1])
        if asked and self.answer is not None:
            self.bytes += encode(Message(asked.kind | REPLY, asked.sequence, self.answer))

    def read(self, size: int = 1) -> bytes:
        taken, self.bytes = self.bytes[:size], self.bytes[size:]
        return taken
