"""The firmware's view of protocol and mode table: `python -m firmware.wire` writes core/an_wire.h and the docs' tables.

Definitions are the classes of firmware.protocol and the layouts of firmware.mode_table. Every member of a layout lies at
a multiple of its own size, so that a C structure has the same layout.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np

from firmware import mode_table, protocol
from firmware.protocol import FAULTS, REQUESTS, Range, layout

HEADER = Path(__file__).parent / "core" / "an_wire.h"
PAGE = Path(__file__).parent.parent / "docs" / "reference" / "board.md"
MARK, END = "<!-- python -m firmware.wire -->\n", "<!-- end -->\n"
TYPES = {"u1": "uint8_t", "u2": "uint16_t", "u4": "uint32_t", "f4": "float", "c8": "an_complex"}
WORDS = {"u1": "8 bits", "u2": "16 bits", "u4": "32 bits", "f4": "float", "c8": "complex"}
UNITS = {"hz": "Hz", "s": "s", "cycles": "cycles", "metres": "m", "volts": "V", "volt": "m/V", "bytes": "bytes"}
REPLIES = (
    protocol.Status,
    protocol.SingleStatus,
    protocol.SixStatus,
    protocol.Column,
    protocol.Identity,
    protocol.Health,
    protocol.Record,
)
ROWS = {"header": mode_table.HEADER, "mode": mode_table.MODE, "shape": mode_table.SHAPE}


def snake(name: str) -> str:
    """Write a class name in lower case, with underscores."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def request_name(kind: type) -> str:
    """Return the name of the C structure of a request."""
    return f"an_{snake(kind.__name__).removesuffix('_request')}_request"


def first_line(kind: type) -> str:
    """Return the first line of a docstring."""
    return (kind.__doc__ or "").splitlines()[0]


def base_and_code(kind: np.dtype[Any]) -> tuple[str, tuple[int, ...]]:
    """Return the code of an element's type, as in TYPES, and the lengths of the arrays around it; bytes are u1."""
    element, shape = kind.subdtype or (kind, ())
    if element.kind == "V":
        return "u1", (*shape, element.itemsize)
    return element.str.lstrip("<|"), shape


def structure(name: str, members: dict[str, np.dtype[Any]], text: str, base: str = "") -> str:
    """Write a C structure and its size; base: structure of its first members, which become its member `head`."""
    lines = [f"    {base} head;"] if base else []
    for member, kind in members.items():
        code, shape = base_and_code(kind)
        lines.append(f"    {TYPES[code]} {member}{''.join(f'[{count}]' for count in shape)};")
    size = sum(kind.itemsize for kind in members.values())
    total = f"sizeof({base}) + {size}u" if base else f"{size}u"
    body = "\n".join(lines)
    return (
        f'/* {text} */\ntypedef struct {{\n{body}\n}} {name};\n_Static_assert(sizeof({name}) == {total}, "packed");\n'
    )


def reply_structure(kind: type) -> str:
    """Write the C structure of a reply."""
    whole, base = layout(kind), kind.__base__
    inherited = set(layout(base).names or ()) if base not in (None, object) else set()
    members = {name: whole[name] for name in whole.names or () if name not in inherited}
    return structure(f"an_{snake(kind.__name__)}", members, first_line(kind), "an_status" if inherited else "")


def enumeration(name: str, members: dict[str, int | str], texts: dict[str, str] | None = None) -> str:
    """Write a C enumeration, with a comment for each member that has a text."""
    lines = [
        f"    AN_{key} = {value}," + (f" /* {(texts or {})[key]} */" if texts else "") for key, value in members.items()
    ]
    return "typedef enum {\n" + "\n".join(lines) + f"\n}} {name};\n"


def bounds(name: str, row: np.dtype[Any]) -> str:
    """Write the macro that lists the allowed ranges of a row's single numbers."""
    entries = [
        f"    {{offsetof(an_{name}_row, {member}), {number(low)}, {number(high)}}}"
        for member, (low, high) in mode_table.ALLOWED.items()
        if member in (row.names or ()) and row[member] == np.dtype("<f4")
    ]
    return f"#define AN_{name.upper()}_BOUNDS \\\n" + ", \\\n".join(entries) + "\n"


def number(value: float) -> str:
    """Write a C literal of single precision."""
    text = f"{value:.9g}"
    return f"{text if '.' in text or 'e' in text else text + '.0'}f"


def header() -> str:
    """Return core/an_wire.h."""
    kinds: dict[str, int | str] = {kind.name: int(kind) for kind in protocol.Kind}
    faults = {f"FAULT_{fault.name}": text for fault, text in FAULTS.items()}
    table = mode_table
    parts = [
        enumeration("an_kind", kinds | {"REPLY": hex(protocol.REPLY), "LOG_RECORDS": hex(protocol.LOG_RECORDS)}),
        enumeration("an_result", {one.name: int(one) for one in protocol.Result}),
        _counted("an_table_result", "TABLE", protocol.TABLE_RESULTS),
        _counted("an_keep_state", "KEEP", protocol.KEEP_STATES),
        _counted("an_state", "STATE", {name.upper(): name for name in protocol.STATES}),
        enumeration(
            "an_fault",
            {f"FAULT_{fault.name}": f"1 << {fault.bit_length() - 1}" for fault in FAULTS},
            {name: text.meaning for name, text in faults.items()},
        ),
        enumeration("an_status_flag", {f"STATUS_{flag.name}": int(flag) for flag in protocol.Flag}),
        "enum {\n"
        + "".join(
            f"    AN_{name} = {value},\n"
            for name, value in {
                "FAULT_COUNT": len(FAULTS),
                "PROTOCOL": protocol.PROTOCOL,
                "PAYLOAD_MAX": protocol.PAYLOAD_MAX,
                "CHIRP_ROWS": protocol.CHIRP_ROWS,
                "TABLE_VERSION": table.VERSION,
                "CHANNELS": table.CHANNELS,
                "PATTERNS": table.PATTERNS,
                "TABLE_MODES": table.MAX_MODES,
                "TABLE_SHAPES": table.MAX_SHAPES,
                "NAME_BYTES": table.SHAPE["names"].base.itemsize,
                "TABLE_CRC_BYTES": table.CRC_BYTES,
                "TABLE_MAX_BYTES": table.MAX_BYTES,
                "GAIN_IDENTIFIED": table.GAIN_IDENTIFIED,
                "TAU_IDENTIFIED": table.TAU_IDENTIFIED,
                "FREQUENCY_IDENTIFIED": table.FREQUENCY_IDENTIFIED,
                "MATRIX_IDENTIFIED": table.MATRIX_IDENTIFIED,
                "SENSES_DISPLACEMENT": table.SENSES_DISPLACEMENT,
            }.items()
        )
        + "};\n",
        *(
            structure(request_name(one), _members(layout(one)), first_line(one))
            for one in dict.fromkeys(one for ones in REQUESTS.values() for one in ones)
        ),
        *map(reply_structure, REPLIES),
        *(structure(f"an_{name}_row", _members(row), f"Mode table: {name}.") for name, row in ROWS.items()),
        "/* Lengths of the payloads of requests; the others have none, or one of any length. */\n#define AN_REQUEST_BYTES \\\n"
        + ", \\\n".join(f"    [AN_{kind.name}] = sizeof({request_name(ones[0])})" for kind, ones in REQUESTS.items())
        + "\n",
        "/* Allowed ranges of single numbers: offset, lowest, highest. */\n"
        + "".join(bounds(name, row) for name, row in ROWS.items()),
        f"#define AN_FREQUENCY_LOW_HZ {number(table.FREQUENCY_LOW_HZ)}\n"
        f"#define AN_FREQUENCY_HIGH {number(table.FREQUENCY_HIGH)} /* of the sample rate */\n"
        f"#define AN_GAIN_LOW {number(table.GAIN[0])} /* larger of the parts */\n"
        f"#define AN_GAIN_HIGH {number(table.GAIN[1])}\n"
        f"#define AN_TAU_LOW_S {number(table.ALLOWED['tau_s'][0])}\n"
        f"#define AN_TAU_HIGH_S {number(table.ALLOWED['tau_s'][1])}\n"
        f"#define AN_DELAY_HIGH_S {number(table.ALLOWED['delay_s'][1])}\n"
        f"#define AN_WEIGHT_HIGH {number(table.WEIGHT_HIGH)}\n"
        f"#define AN_MATRIX_HIGH {number(table.MATRIX_HIGH)}\n"
        f"#define AN_DETUNING_MAX_HZ {number(protocol.limits(protocol.Start, 'detuning_hz').high)}\n",
    ]
    return (
        "/* Numbers and layouts shared with the host; written by `python -m firmware.wire`: do not edit. */\n"
        '#ifndef AN_WIRE_H\n#define AN_WIRE_H\n\n#include "an_types.h"\n\n' + "\n".join(parts) + "\n#endif\n"
    )


def _counted(name: str, prefix: str, texts: dict[str, str]) -> str:
    return enumeration(name, {f"{prefix}_{key}": index for index, key in enumerate(texts)})


def _members(row: np.dtype[Any]) -> dict[str, np.dtype[Any]]:
    return {name: row[name] for name in row.names or ()}


def unit(name: str) -> str:
    """Return the unit that the last part of a name states, or an empty string."""
    return UNITS.get(name.rsplit("_", 1)[-1], "")


def type_text(kind: np.dtype[Any]) -> str:
    """Describe the type of a member."""
    code, shape = base_and_code(kind)
    return " x ".join([*map(str, shape), WORDS[code]]) if shape else WORDS[code]


def range_text(allowed: Range) -> str:
    """Describe an allowed range."""
    if allowed == protocol.ANY:
        return "any"
    return f"{allowed.low:g} to {allowed.high:.10g} {allowed.unit}".strip()


def page() -> str:
    """Return the tables of docs/reference/board.md."""
    lines = ["## Requests", "", "| request | number | payload |", "|---|---|---|"]
    for kind in protocol.Kind:
        given = " or ".join(
            ", ".join(f"{name} ({type_text(layout(one)[name])}: {range_text(limit)})" for name, limit in _ranges(one))
            for one in REQUESTS.get(kind, ())
        )
        lines.append(f"| {kind.name.lower().replace('_', ' ')} | {int(kind)} | {given} |")
    for reply in REPLIES:
        lines += ["", f"## Reply: {snake(reply.__name__).replace('_', ' ')}", "", first_line(reply), ""]
        lines += _table(layout(reply), {})
    for name, row in ROWS.items():
        lines += ["", f"## Mode table: {name}", "", *_table(row, mode_table.ALLOWED)]
    lines += ["", "## Faults", "", "| fault | bit | meaning | check |", "|---|---|---|---|"]
    for fault, text in FAULTS.items():
        lines.append(f"| {protocol.fault_names(fault)[0]} | {fault.bit_length() - 1} | {text.meaning} | {text.check} |")
    return "\n".join(lines) + "\n"


def _ranges(kind: type) -> list[tuple[str, Range]]:
    return [(name, protocol.limits(kind, name)) for name in get_type_hints(kind)]


def _table(row: np.dtype[Any], allowed: dict[str, tuple[float, float]]) -> list[str]:
    lines = [
        "| offset | member | type | unit |" + (" allowed |" if allowed else ""),
        "|---" * (5 if allowed else 4) + "|",
    ]
    fields: Any = row.fields
    for name in row.names or ():
        kind, offset = fields[name][:2]
        limit = f" {range_text(Range(*allowed[name]))} |" if name in allowed else " |"
        lines.append(f"| {offset} | `{name}` | {type_text(kind)} | {unit(name)} |" + (limit if allowed else ""))
    return lines


def with_tables(text: str) -> str:
    """Replace what lies between the marks of a page."""
    before, rest = text.split(MARK, 1)
    return before + MARK + "\n" + page() + rest[rest.index(END) :]


if __name__ == "__main__":
    HEADER.write_text(header())
    PAGE.write_text(with_tables(PAGE.read_text()))
