"""CMSIS-SVD description of the registers in firmware/board/f446/registers.h, for debuggers.

The manufacturer's complete description has a licence that does not permit redistribution here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.etree import ElementTree

STRUCT = re.compile(r"typedef struct \{(.*?)\}\s*(\w+);", re.S)
INSTANCE = re.compile(r"#define (\w+) \(\((\w+) \*\)(0x[0-9a-fA-F]+)u\)")
BYTES = {"reg": 4, "volatile uint32_t": 4, "uint32_t": 4, "volatile uint8_t": 1}

Register = tuple[str, int, int]  # name, offset, bytes


def structs(header: str) -> dict[str, list[Register]]:
    """Return the registers of each struct type in a C header, with nested arrays and structs expanded.

    Raises
    ------
    ValueError
        If a member has an unknown type.
    """
    result: dict[str, list[Register]] = {}
    for body, name in STRUCT.findall(re.sub(r"/\*.*?\*/", "", header, flags=re.S)):
        result[name] = list(_members(body, result))
    return result


def _members(body: str, known: dict[str, list[Register]]) -> Iterator[Register]:
    at = 0
    for line in filter(None, (part.strip() for part in body.split(";"))):
        kind, _, names = re.sub(r"\s*,\s*", ",", " ".join(line.split())).rpartition(" ")
        for name, count in re.findall(r"(\w+)(?:\[(\d+)\])?", names):
            for index in range(int(count or 1)):
                inside = _inside(kind, known)
                label = f"{name}{index}" if count else name
                yield from ((label + ("_" + own if own else ""), at + offset, size) for own, offset, size in inside)
                at += max(offset + size for _, offset, size in inside)


def _inside(kind: str, known: dict[str, list[Register]]) -> list[Register]:
    if kind in BYTES:
        return [("", 0, BYTES[kind])]
    if kind in known:
        return known[kind]
    raise ValueError(f"a register of the unknown type {kind!r}")


def svd_text(header: str) -> str:
    """Return the description as XML, without unused registers. Raises ValueError for an unknown type."""
    types = structs(header)
    device = ElementTree.Element("device", schemaVersion="1.3")
    about = {"name": "STM32F446", "version": "1.0", "description": "Registers that Antinode's firmware touches"}
    _texts(device, about | {"addressUnitBits": "8", "width": "32", "size": "32", "access": "read-write"})
    peripherals = ElementTree.SubElement(device, "peripherals")
    for name, kind, address in INSTANCE.findall(header):
        if kind not in types:
            raise ValueError(f"{name} is of the unknown type {kind!r}")
        _peripheral(peripherals, name, int(address, 16), types[kind])
    ElementTree.indent(device)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(device, encoding="unicode") + "\n"


def _peripheral(parent: ElementTree.Element, name: str, address: int, registers: list[Register]) -> None:
    own = ElementTree.SubElement(parent, "peripheral")
    _texts(own, {"name": name, "baseAddress": f"0x{address:08X}"})
    size = max(offset + size for _, offset, size in registers)
    _texts(ElementTree.SubElement(own, "addressBlock"), {"offset": "0", "size": f"0x{size:X}", "usage": "registers"})
    listed = ElementTree.SubElement(own, "registers")
    for label, offset, width in registers:
        if not label.startswith(("unused", "reserved")):
            one = ElementTree.SubElement(listed, "register")
            _texts(one, {"name": label, "addressOffset": f"0x{offset:X}", "size": str(8 * width)})


def _texts(parent: ElementTree.Element, values: dict[str, str]) -> None:
    for name, value in values.items():
        ElementTree.SubElement(parent, name).text = value
