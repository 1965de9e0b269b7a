"""Netlist and bill of materials of both builds, docs/board/netlist.csv and parts.csv: `python -m studies.netlist`."""

from __future__ import annotations

import csv
import io
from collections import Counter
from pathlib import Path

from studies.wiring import PINS

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "board"
BUILDS = ("single", "six")

# Circuits, as net -> nodes "part.pin"; {n} is the channel, {pin} the pin of the chip, GND and supplies are shared nets.
CONDITIONER = {
    "SENSE{n}": "PZS{n}.1 CS{n}.1 RS{n}.1",
    "CLAMP{n}": "RS{n}.2 D{n}.3 RB{n}.1 U{n}.in+",
    "SENSOR{n}": "U{n}.out U{n}.in- MCU.{pin}",
    "GND": "PZS{n}.2 CS{n}.2 D{n}.1 U{n}.v-",
    "3V3": "D{n}.2 U{n}.v+",
    "1V65": "RB{n}.2",
}
DRIVE = {
    "DAC{n}": "MCU.{pin} RF{n}.1",
    "LOWPASS{n}": "RF{n}.2 CF{n}.1 RG{n}.1",
    "SMOOTH{n}": "RG{n}.2 CG{n}.1 CC{n}.1",
    "INPUT{n}": "CC{n}.2 RC{n}.1 AMP{n}.in",
    "PATCH{n}": "AMP{n}.out PZ{n}.1 RW{n}.1",
    "ENABLE": "AMP{n}.enable",
    "GND": "CF{n}.2 CG{n}.2 RC{n}.2 PZ{n}.2 RW{n}.2 AMP{n}.gnd",
    "SUPPLY": "AMP{n}.v+",
}
BRIDGE = {
    "HIGH{n}": "MCU.{pin} RH{n}.1 DR{n}.high",
    "LOW{n}": "MCU.{low} RL{n}.1 DR{n}.low",
    "OUTH{n}": "DR{n}.ho RA{n}.1 DA{n}.k",
    "GATEH{n}": "RA{n}.2 DA{n}.a QH{n}.g",
    "OUTL{n}": "DR{n}.lo RE{n}.1 DE{n}.k",
    "GATEL{n}": "RE{n}.2 DE{n}.a QL{n}.g",
    "DRIVERS": "DR{n}.vcc CV{n}.1 DB{n}.a",
    "BOOT{n}": "DB{n}.k CB{n}.1 DR{n}.vb",
    "MIDDLE{n}": "QH{n}.s QL{n}.d DR{n}.vs CB{n}.2 L{n}.1",
    "COIL{n}": "L{n}.2 RM{n}.1",
    "PATCH{n}": "RM{n}.2 CX{n}.1 PZ{n}.1 RW{n}.1",
    "SUPPLY": "QH{n}.d",
    "SHUNT{k}": "QL{n}.s",
    "GND": "RH{n}.2 RL{n}.2 CX{n}.2 PZ{n}.2 RW{n}.2 CV{n}.2 DR{n}.gnd",
}
BREAK = {
    "SHUNT{n}": "RZ{n}.1 UC{n}.in+",
    "BREAK{n}": "UC{n}.out RP{n}.1 MCU.{pin}",
    "3V3": "RP{n}.2 UC{n}.v+",
    "LIMIT": "UC{n}.in-",
    "GND": "RZ{n}.2 UC{n}.v-",
}
REFERENCE = {"3V3": "MCU.3V3 R1.1", "1V65": "R1.2 R2.1 C1.1", "GND": "MCU.GND R2.2 C1.2"}
LIMIT = {"3V3": "R3.1", "LIMIT": "R3.2 R4.1", "GND": "R4.2"}
ENABLE = {"ENABLE": "MCU.{pin} R5.1", "GND": "R5.2"}
SUPPLY = {"SUPPLY": "J1.1", "GND": "J1.2"}
DRIVERS = {"DRIVERS": "J2.1", "GND": "J2.2"}

# Value, or what to look for, and use of a part, by the letters of its name.
PARTS = {
    "MCU": ("NUCLEO-F446RE", "board"),
    "PZS": ("sensor patch", "plate"),
    "PZ": ("driving patches", "plate"),
    "CS": ("by the largest motion: V/1.3 V = 1 + Cs/Cp", "divider with the patch"),
    "RS": ("1 kΩ", "series resistor of the clamp"),
    "D": ("BAT54S", "clamp to 3.3 V and ground"),
    "RB": ("1 MΩ", "bias to 1.65 V"),
    "U": ("MCP6022 or another rail-to-rail amplifier of 10 MHz", "follower"),
    "RF": ("5.6 kΩ", "low-pass, 60 kHz"),
    "CF": ("470 pF C0G", "low-pass, 60 kHz"),
    "RG": ("56 kΩ", "low-pass, 60 kHz"),
    "CG": ("47 pF C0G", "low-pass, 60 kHz"),
    "CC": ("10 nF", "coupling"),
    "RC": ("1 MΩ", "rest level of the amplifier's input"),
    "AMP": ("amplifier for the patches, with an enable input", "drive"),
    "RH": ("10 kΩ", "pull-down of a gate signal"),
    "RL": ("10 kΩ", "pull-down of a gate signal"),
    "DR": ("half-bridge driver with 3.3 V inputs, dead time of 0.3 us or more", "bridge"),
    "RA": ("10 Ω, more until the dead time holds", "rise of a high gate"),
    "RE": ("10 Ω, more until the dead time holds", "rise of a low gate"),
    "DA": ("1N4148", "fall of a high gate"),
    "DE": ("1N4148", "fall of a low gate"),
    "DB": ("fast recovery, the supply's voltage and 12 V", "bootstrap"),
    "CB": ("100 nF, 25 V X7R: drops 0.2 V at a gate charge of 20 nC", "bootstrap"),
    "CV": ("1 uF, 25 V X7R", "supply of a driver"),
    "QH": ("MOSFET, twice the supply's voltage, off within 0.3 us", "bridge"),
    "QL": ("MOSFET, twice the supply's voltage, off within 0.3 us", "bridge"),
    "L": ("16 mH for 10 nF and 4 kHz", "filter"),
    "RM": ("1.8 kΩ for 10 nF and 4 kHz", "filter"),
    "CX": ("10 nF less the patch", "filter"),
    "RW": ("1 MΩ, for the patch's voltage", "discharge of a patch"),
    "RZ": ("0.1 V over the largest supply current", "shunt of three bridges"),
    "UC": ("LM393", "comparator, open collector"),
    "RP": ("4.7 kΩ", "pull-up of a break line"),
    "R1": ("1 kΩ", "1.65 V"),
    "R2": ("1 kΩ", "1.65 V"),
    "C1": ("1 uF", "1.65 V"),
    "R3": ("33 kΩ", "comparators' threshold of 0.1 V"),
    "R4": ("1 kΩ", "comparators' threshold of 0.1 V"),
    "R5": ("10 kΩ", "pull-down of the amplifier's enable line"),
    "J1": ("supply of the power stage, fused, with an emergency stop", "supply"),
    "J2": ("12 V, 0.1 A", "supply of the bridges' drivers"),
}


def circuits(build: str) -> list[tuple[dict[str, str], dict[str, object]]]:
    """Return the circuits of a build, each with what replaces its fields."""
    roles = {role: pin.name for pin in PINS if (role := getattr(pin, build))}
    found: list[tuple[dict[str, str], dict[str, object]]] = [(REFERENCE, {}), (SUPPLY, {})]
    if build == "single":
        found += [(CONDITIONER, {"n": 1, "pin": roles["sensor"]}), (ENABLE, {"pin": roles["amplifier enable"]})]
        drives = (roles["drive"], roles["inverted drive"])
        return found + [(DRIVE, {"n": n, "pin": pin}) for n, pin in enumerate(drives, 1)]
    for n in range(1, 7):
        found.append((CONDITIONER, {"n": n, "pin": roles[f"sensor {n}"]}))
        pins = {"pin": roles[f"bridge {n} high"], "low": roles[f"bridge {n} low"]}
        found.append((BRIDGE, {"n": n, "k": (n + 2) // 3, **pins}))
    breaks = (roles["break, bridges 1 to 3"], roles["break, bridges 4 to 6"])
    return [*found, (DRIVERS, {}), (LIMIT, {}), *((BREAK, {"n": n, "pin": pin}) for n, pin in enumerate(breaks, 1))]


def nets(build: str) -> dict[str, list[str]]:
    """Return the nodes "part.pin" of each net of a build."""
    found: dict[str, list[str]] = {}
    for circuit, fields in circuits(build):
        for net, nodes in circuit.items():
            found.setdefault(net.format(**fields), []).extend(nodes.format(**fields).split())
    return found


def kind(part: str) -> str:
    """Return the key of a part in PARTS."""
    return part if part in PARTS else part.rstrip("0123456789")


def netlist_text() -> str:
    """Return netlist.csv."""
    rows = [(build, net, " ".join(nodes)) for build in BUILDS for net, nodes in nets(build).items()]
    return _csv([("build", "net", "nodes"), *rows])


def parts_text() -> str:
    """Return parts.csv."""
    rows = []
    for build in BUILDS:
        used = dict.fromkeys(node.partition(".")[0] for nodes in nets(build).values() for node in nodes)
        counts = Counter(map(kind, used))
        for each, count in counts.items():
            which = " ".join(part for part in used if kind(part) == each)
            rows.append((build, which, str(count), *PARTS[each]))
    return _csv([("build", "parts", "count", "value", "use"), *rows])


def _csv(rows: list[tuple[str, ...]]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


FILES = {"netlist.csv": netlist_text, "parts.csv": parts_text}

if __name__ == "__main__":
    for name, text in FILES.items():
        (FOLDER / name).write_text(text())
        print(FOLDER / name)
