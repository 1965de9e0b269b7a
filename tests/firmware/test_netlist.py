"""The netlist: as the script writes it, whole, and on the pins that the images set up for it."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

from firmware.emulate.plant import Beam, measured_table
from firmware.mode_table import Mode, ModeTable, to_bytes
from studies import netlist, wiring

PORTS = {"A": 0x40020000, "B": 0x40020400, "C": 0x40020800}
OUTPUT, ALTERNATE, ANALOG = 1, 2, 3
TIM1, TIM8 = 1, 3  # alternate functions


@pytest.mark.parametrize("name", netlist.FILES)
def test_the_committed_file_is_what_the_script_writes(name: str) -> None:
    assert (netlist.FOLDER / name).read_text() == netlist.FILES[name](), "run `python -m studies.netlist`"


@pytest.mark.parametrize("build", netlist.BUILDS)
def test_each_pin_of_a_part_is_on_one_net_and_each_net_joins_parts(build: str) -> None:
    nets = netlist.nets(build)
    nodes = Counter(node for each in nets.values() for node in each)
    assert set(nodes.values()) == {1}, [node for node, count in nodes.items() if count > 1]
    assert all(len(each) > 1 for each in nets.values()), [net for net, each in nets.items() if len(each) < 2]
    parts = {node.partition(".")[0] for node in nodes}
    assert {netlist.kind(part) for part in parts} <= set(netlist.PARTS)
    two_ended = [part for part in parts if re.match(r"[RCL]", part)]
    assert all({f"{part}.1", f"{part}.2"} <= set(nodes) for part in two_ended)


def test_every_part_is_used_and_every_drawn_value_is_listed() -> None:
    used = {
        netlist.kind(node.partition(".")[0])
        for build in netlist.BUILDS
        for each in netlist.nets(build).values()
        for node in each
    }
    assert set(netlist.PARTS) <= used
    values = " ".join(value for value, _ in netlist.PARTS.values())
    for name in ("wiring-sensor", "wiring-drive", "wiring-bridge"):
        drawn = re.findall(r">\s*([\d.]+ (?:kΩ|MΩ|nF|pF))\s*<", (wiring.FOLDER / f"{name}.svg").read_text())
        assert drawn and all(value in values for value in drawn), name


@pytest.mark.parametrize("build", netlist.BUILDS)
def test_the_netlist_has_what_the_page_on_high_voltage_orders(build: str) -> None:
    """Resistors across the driven patches; drivers with supply and bootstrap; gates that rise slowly and fall at once."""
    net_of = {node: net for net, each in netlist.nets(build).items() for node in each}
    page = Path(netlist.FOLDER / "high-voltage.md").read_text()
    assert "1 MΩ across each patch" in page and netlist.PARTS["RW"][0].startswith("1 MΩ")
    for patch in [node.partition(".")[0] for node in net_of if re.fullmatch(r"PZ\d\.1", node)]:
        assert all(net_of[f"{patch}.{end}"] == net_of[f"RW{patch[-1]}.{end}"] for end in (1, 2))
    for n in range(1, 7 if build == "six" else 1):
        assert net_of[f"DR{n}.vcc"] == net_of[f"CV{n}.1"] == net_of[f"DB{n}.a"] == net_of["J2.1"] != net_of["J1.1"]
        assert net_of[f"DR{n}.vb"] == net_of[f"DB{n}.k"] == net_of[f"CB{n}.1"]
        assert net_of[f"CB{n}.2"] == net_of[f"DR{n}.vs"] == net_of[f"QH{n}.s"]
        for out, gate, resistor, diode in (("ho", "QH", "RA", "DA"), ("lo", "QL", "RE", "DE")):
            assert net_of[f"DR{n}.{out}"] == net_of[f"{resistor}{n}.1"] == net_of[f"{diode}{n}.k"]
            assert net_of[f"{gate}{n}.g"] == net_of[f"{resistor}{n}.2"] == net_of[f"{diode}{n}.a"]


def roles(build: str) -> dict[str, str]:
    """Net of each pin of the chip."""
    return {
        node.partition(".")[2]: net
        for net, each in netlist.nets(build).items()
        for node in each
        if node.startswith("MCU.P")
    }


@pytest.mark.slow
@pytest.mark.parametrize("build", netlist.BUILDS)
def test_the_image_sets_up_the_pins_of_the_netlist(build: str, make_image) -> None:
    """Modes and alternate functions as the registers of the booted image have them (RM0390, data sheet's table 11)."""
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    from firmware.emulate.images import EmulatedSingle, EmulatedSix
    from firmware.emulate.plant import Plate, Resonance

    if build == "single":
        table = to_bytes(ModeTable(250e3, bytes(16), (Mode(31404.5, 0.003),)))
        board = EmulatedSingle(make_image(table).elf, Plate((Resonance(31404.5, 3e-3, 0.5),)))
    else:
        board = EmulatedSix(make_image(measured_table(Beam()), "six").elf, Beam())
    board.run(2e-3)
    found = {}
    for port, base in PORTS.items():
        modes = board.word(base).value
        functions = board.word(base + 0x20).value | board.word(base + 0x24).value << 32
        for pin in range(16):
            found[f"P{port}{pin}"] = (modes >> 2 * pin & 3, functions >> 4 * pin & 15)
    for pin, net in roles(build).items():
        mode, function = found[pin]
        if net == "ENABLE":
            assert mode == OUTPUT, pin
        elif net.startswith(("SENSOR", "DAC")):
            assert mode == ANALOG, pin
        else:
            number = int(net[-1])
            first = number == 1 if net.startswith("BREAK") else number <= 3
            assert (mode, function) == (ALTERNATE, TIM1 if first else TIM8), (pin, net)
    line = {"PA2", "PA3"}
    busy = (
        {pin for pin, (mode, _) in found.items() if mode in (OUTPUT, ALTERNATE)}
        - line
        - {"PA13", "PA14", "PA15", "PB3", "PB4"}
    )
    assert busy <= set(roles(build)) | {"PA5"}, busy - set(roles(build))


def test_the_page_offers_the_files() -> None:
    page = Path(netlist.FOLDER / "wiring.md").read_text()
    assert all(f"({name})" in page for name in netlist.FILES)
