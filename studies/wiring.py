"""The wiring pictures of docs/board/wiring.md: `python -m studies.wiring` (needs schemdraw: pip install schemdraw)."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"
SINGLE, SIX, BOTH = "#9cc8f0", "#f3c28b", "#a9d69a"


@dataclass(frozen=True)
class Pin:
    """A pin of the chip: where it is on a NUCLEO-F446RE, and its use in each build (None: unused)."""

    name: str
    connector: str  # ST morpho: CN7 or CN10
    number: int
    arduino: str | None
    single: str | None
    six: str | None


PINS = (
    Pin("PA0", "CN7", 28, "A0", "sensor", "sensor 1"),
    Pin("PA1", "CN7", 30, "A1", None, "sensor 2"),
    Pin("PA4", "CN7", 32, "A2", "drive", "sensor 3"),
    Pin("PC0", "CN7", 38, "A5", None, "sensor 4"),
    Pin("PC1", "CN7", 36, "A4", None, "sensor 5"),
    Pin("PC2", "CN7", 35, None, None, "sensor 6"),
    Pin("PA5", "CN10", 11, "D13", "inverted drive", None),
    Pin("PA8", "CN10", 23, "D7", None, "bridge 1 high"),
    Pin("PB13", "CN10", 30, None, None, "bridge 1 low"),
    Pin("PA9", "CN10", 21, "D8", None, "bridge 2 high"),
    Pin("PB14", "CN10", 28, None, None, "bridge 2 low"),
    Pin("PA10", "CN10", 33, "D2", None, "bridge 3 high"),
    Pin("PB15", "CN10", 26, None, None, "bridge 3 low"),
    Pin("PC6", "CN10", 4, None, None, "bridge 4 high"),
    Pin("PA7", "CN10", 15, "D11", None, "bridge 4 low"),
    Pin("PC7", "CN10", 19, "D9", None, "bridge 5 high"),
    Pin("PB0", "CN7", 34, "A3", "amplifier enable", "bridge 5 low"),
    Pin("PC8", "CN10", 2, None, None, "bridge 6 high"),
    Pin("PB1", "CN10", 24, None, None, "bridge 6 low"),
    Pin("PB12", "CN10", 16, None, None, "break, bridges 1 to 3"),
    Pin("PA6", "CN10", 13, "D12", None, "break, bridges 4 to 6"),
    Pin("PC13", "CN7", 23, None, "button B1", "button B1"),
    Pin("PA2", "CN10", 35, "D1", "line to the host", "line to the host"),
    Pin("PA3", "CN10", 37, "D0", "line from the host", "line from the host"),
)


def conditioner(drawing: Any, elm: Any) -> None:
    """A sensor patch brought to 1.65 V and clamped, for each sensor pin of both builds."""
    patch = drawing.add(elm.Crystal().down().label("sensor\npatch", loc="top").at((0, 0)))
    drawing.add(elm.Ground().at(patch.end))
    drawing.add(elm.Line().right(2).at(patch.start))
    shunt = drawing.add(elm.Capacitor().down().label("Cs", loc="bottom"))
    drawing.add(elm.Ground().at(shunt.end))
    drawing.add(elm.Resistor().right().at(shunt.start).label("1 kΩ"))
    clamp = drawing.add(elm.Dot())
    high = drawing.add(elm.Schottky().up().at(clamp.center))
    drawing.add(elm.Vdd().at(high.end).label("3.3 V"))
    low = drawing.add(elm.Schottky().down().reverse().at(clamp.center))
    drawing.add(elm.Ground().at(low.end))
    drawing.add(elm.Line().right(2).at(clamp.center))
    bias = drawing.add(elm.Dot())
    drawing.add(elm.Resistor().down().at(bias.center).label("1 MΩ", loc="bottom"))
    drawing.add(elm.Vss().label("1.65 V"))
    drawing.add(elm.Line().right(1.5).at(bias.center))
    follower = drawing.add(elm.Opamp(leads=True).anchor("in2"))
    drawing.add(elm.Line().up(1.2).at(follower.in1))
    drawing.add(elm.Line().tox(follower.out))
    drawing.add(elm.Line().toy(follower.out))
    drawing.add(elm.Line().right(1).at(follower.out))
    drawing.add(elm.Tag(width=2.6).right().label("sensor pin"))


def drive(drawing: Any, elm: Any) -> None:
    """The DAC's output smoothed, freed of its rest level and amplified, for PA4 and PA5 of the one-mode build."""
    drawing.add(elm.Tag(width=3).left().label("PA4 or PA5").at((0, 0)))
    drawing.add(elm.Resistor().right().at((0, 0)).label("5.6 kΩ"))
    _shunted(drawing, elm, elm.Capacitor(), "470 pF")
    drawing.add(elm.Resistor().right().label("56 kΩ"))
    _shunted(drawing, elm, elm.Capacitor(), "47 pF")
    drawing.add(elm.Capacitor().right().label("10 nF"))
    _shunted(drawing, elm, elm.Resistor(), "1 MΩ")
    drawing.add(elm.Line().right(1.5))
    pins = [elm.IcPin("in", side="left"), elm.IcPin("out", side="right"), elm.IcPin("enable", side="bottom")]
    amplifier = drawing.add(elm.Ic(pins=pins, size=(3.4, 2.4)).label("amplifier", loc="top").anchor("in"))
    enable = drawing.add(elm.Dot().at(amplifier.enable))
    drawing.add(elm.Resistor().down().at(enable.center).label("10 kΩ", loc="bottom"))
    drawing.add(elm.Ground())
    drawing.add(elm.Line().left(1.5).at(enable.center))
    drawing.add(elm.Tag(width=1.8).left().label("PB0"))
    drawing.add(elm.Line().right(1.5).at(amplifier.out))
    drawing.add(elm.Crystal().down().label("driving\npatches", loc="top"))
    drawing.add(elm.Ground())


def _shunted(drawing: Any, elm: Any, element: Any, label: str) -> None:
    """An element from here to ground; drawing goes on from here."""
    node = drawing.add(elm.Dot())
    drawing.add(element.down().at(node.center).label(label, loc="bottom"))
    drawing.add(elm.Ground())
    drawing.add(elm.Line().right(0.3).at(node.center))


def bridge(drawing: Any, elm: Any) -> None:
    """One of six half-bridges with its driver, filter, patch, and the comparator that holds the break input."""
    driver = _driver(drawing, elm)
    for pin, name in ((driver.high, "bridge high"), (driver.low, "bridge low")):
        drawing.add(elm.Line().left(1.2).at(pin))
        node = drawing.add(elm.Dot())
        drawing.add(elm.Resistor().down(1.6).at(node.center).label("10 kΩ", loc="bottom"))
        drawing.add(elm.Ground())
        drawing.add(elm.Line().left(1.4).at(node.center))
        drawing.add(elm.Tag(width=3).left().label(name))
    upper = drawing.add(elm.NFet().anchor("gate").at((driver.HO.x + 1.5, driver.HO.y)).theta(0).reverse())
    lower = drawing.add(elm.NFet().anchor("gate").at((driver.LO.x + 1.5, driver.LO.y)).theta(0).reverse())
    drawing.add(elm.Line().at(driver.HO).to(upper.gate))
    drawing.add(elm.Line().at(driver.LO).to(lower.gate))
    drawing.add(elm.Line().at(upper.drain).up(0.5))
    drawing.add(elm.Vdd().label("supply"))
    drawing.add(elm.Line().at(upper.source).to(lower.drain))
    _filter_and_patch(drawing, elm, ((upper.source.x + lower.drain.x) / 2, (upper.source.y + lower.drain.y) / 2))
    _overcurrent(drawing, elm, lower.source)


def _driver(drawing: Any, elm: Any) -> Any:
    sides = {"low": ("left", "1/2"), "high": ("left", "2/2"), "LO": ("right", "1/2"), "HO": ("right", "2/2")}
    pins = [elm.IcPin(name, side=side, slot=slot) for name, (side, slot) in sides.items()]
    return drawing.add(elm.Ic(pins=pins, size=(3, 4)).label("half-bridge driver", loc="top"))


def _filter_and_patch(drawing: Any, elm: Any, middle: tuple[float, float]) -> None:
    drawing.add(elm.Dot().at(middle))
    drawing.add(elm.Inductor2().right().at(middle).label("L"))
    drawing.add(elm.Resistor().right().label("R"))
    out = drawing.add(elm.Dot())
    drawing.add(elm.Capacitor().down().at(out.center).label("Cx", loc="bottom"))
    foot = drawing.add(elm.Dot())
    drawing.add(elm.Line().right(2.2).at(out.center))
    patch = drawing.add(elm.Crystal().down().label("patch", loc="bottom"))
    drawing.add(elm.Line().at(patch.end).to(foot.center))
    drawing.add(elm.Ground().at(foot.center))


def _overcurrent(drawing: Any, elm: Any, source: Any) -> None:
    drawing.add(elm.Line().at(source).down(3.2))
    shunt = drawing.add(elm.Dot())
    drawing.add(elm.Resistor().down().at(shunt.center).label("shunt", loc="top"))
    drawing.add(elm.Ground())
    drawing.add(elm.Line().right(2).at(shunt.center))
    name = "comparator,\nopen drain"
    comparator = drawing.add(elm.Opamp(leads=True).anchor("in2").label(name, loc="top", fontsize=9))
    drawing.add(elm.Line().left(0.4).at(comparator.in1))
    drawing.add(elm.Vss().label("limit"))
    drawing.add(elm.Line().right(1.5).at(comparator.out))
    pulled = drawing.add(elm.Dot())
    drawing.add(elm.Resistor().up(1.8).at(pulled.center).label("4.7 kΩ", loc="bottom"))
    drawing.add(elm.Vdd().label("3.3 V"))
    drawing.add(elm.Line().right(0.5).at(pulled.center))
    drawing.add(elm.Tag(width=1.8).right().label("break"))


def headers(drawing: Any, elm: Any) -> None:
    """The two long connectors of the board, seen from above with the USB socket at the top, with the pins of each build."""
    for left, connector in ((0.0, "CN7"), (16.0, "CN10")):
        drawing.add(elm.Rect(corner1=(left - 0.4, 0.4), corner2=(left + 1.2, 0.4 - 19 * 0.8)).at((0, 0)))
        drawing.add(elm.Label().at((left + 0.4, 0.9)).label(connector))
        used = {pin.number: pin for pin in PINS if pin.connector == connector}
        for number in range(1, 39):
            odd = number % 2
            at = (left + (0.0 if odd else 0.8), -0.8 * ((number - 1) // 2))
            _pin(drawing, elm, at, -1 if odd else 1, used.get(number))
    for row, (colour, text) in enumerate(
        ((SINGLE, "one mode alone"), (SIX, "six channels alone"), (BOTH, "both builds"))
    ):
        drawing.add(elm.Dot(radius=0.22).at((6.5, -11.8 - 0.9 * row)).fill(colour))
        drawing.add(_text(elm, (7.0, -11.8 - 0.9 * row), "left", text))


def _pin(drawing: Any, elm: Any, at: tuple[float, float], side: int, pin: Pin | None) -> None:
    if pin is None:
        drawing.add(elm.Dot(radius=0.12).at(at).fill("white"))
        return
    colour = BOTH if pin.single and pin.six else SINGLE if pin.single else SIX
    drawing.add(elm.Dot(radius=0.22).at(at).fill(colour))
    roles = " / ".join(dict.fromkeys(role for role in (pin.single, pin.six) if role))
    place = f"{pin.name}, {pin.arduino}" if pin.arduino else pin.name
    align = "right" if side < 0 else "left"
    drawing.add(_text(elm, (at[0] + 0.7 * side, at[1]), align, f"{pin.number}  {place}: {roles}"))


def _text(elm: Any, at: tuple[float, float], align: str, text: str) -> Any:
    return elm.Label().at(at).label(text, halign=align, valign="center", ofst=(0, 0), fontsize=10, loc="center")


PICTURES: dict[str, Callable[[Any, Any], None]] = {
    "wiring-pins": headers,
    "wiring-sensor": conditioner,
    "wiring-drive": drive,
    "wiring-bridge": bridge,
}


def picture(name: str) -> bytes:
    """A picture as SVG. Raises ImportError without schemdraw."""
    import schemdraw
    from schemdraw import elements

    schemdraw.use("svg")
    drawing = schemdraw.Drawing(show=False)
    drawing.config(fontsize=11, lw=1.4, margin=0.6)
    PICTURES[name](drawing, elements)
    return _on_white(drawing.get_imagedata("svg").decode()).encode()


def _on_white(svg: str) -> str:
    """The picture on a white ground, so that a dark page does not swallow its lines."""
    head, end, body = svg.partition(">")
    left, top, width, height = re.search(r'viewBox="(\S+) (\S+) (\S+) (\S+)"', head).groups()  # type: ignore[union-attr]
    return f'{head}{end}<rect x="{left}" y="{top}" width="{width}" height="{height}" fill="white"/>{body}'


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m studies.wiring", description=__doc__)
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="DIR", help="where to put them")
    text = parser.parse_args(arguments)
    try:
        made = {name: picture(name) for name in PICTURES}
    except ImportError:
        print("wiring: schemdraw is not installed: pip install schemdraw", file=sys.stderr)
        return 5
    for name, content in made.items():
        (text.out / f"{name}.svg").write_bytes(content)
        print(text.out / f"{name}.svg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
