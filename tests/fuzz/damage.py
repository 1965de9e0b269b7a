"""Ways to damage a text, bytes and a parsed document."""

from __future__ import annotations

import random
from typing import Any

from geometry.pillar_shapes import SHAPES
from pipeline.case.schema import known_keys

# a law's twenty keys only where the case has its material: of three owners they would be half of all, nearly always refused
KEYS = [key for key in known_keys() if not key.startswith("pillar.material.")]
ODD = [
    "0", "-0.0", "1", "-1", "1e308", "-1e308", "1e-308", "5e-324", "1e-60", "3e-8", "nan", "inf", "-inf", "true", "9" * 400,
    "0.001", "1e4", "1e-3", "2e-3", "1000", "0.5", "2.0000001", "[]", "{}", "[[]]", '""', '"\\u0000"', '"\\n"', "'x'",
    "[0, 1e300]", "[1e-320, 2e-320]", "[[0, 0]]", "[[0, 0], [0, 0]]", "[1e308, 1e308, 1e308]", "[0.001, 0.001, 0.001]",
    "{young_GPa = 1e-9, density_kg_m3 = 1, poisson = 0.4}", "1979-05-27", "0x10", *SHAPES, "antinodes", "steel",
    "[" * 30 + "]" * 30, "{a.b.c.d.e.f.g.h.i = 1}", '"' + "s" * 5000 + '"',
]  # fmt: skip
NUMBERS = ["0", "-1", "1e308", "-1e308", "nan", "inf", "", "x", "1e-320", "99999999999999999999", "6", "2.5", "9" * 300]
VALUES = [
    None,
    True,
    0,
    -1,
    1e308,
    -1e-308,
    10**400,
    "",
    "x",
    "\ud800",
    "s" * 5000,
    [],
    {},
    [[]],
    {"": None},
    [1e300, None],
]


def damaged(content: bytes, draw: random.Random) -> bytes:
    """A few bytes flipped, cut, doubled or replaced."""
    data = bytearray(content)
    for _ in range(draw.randint(1, 3)):
        at, kind = draw.randrange(len(data) or 1), draw.randrange(4)
        if kind == 0 and data:
            data[at] ^= 1 << draw.randrange(8)
        elif kind == 1:
            del data[at : at + draw.choice((1, 3, 40, len(data) // 2))]
        elif kind == 2:
            data[at:at] = data[at : at + draw.choice((1, 8, 60))]
        else:
            data[at : at + 1] = draw.choice((b"\x00", b"\xff", b"\n", b"[", b"=", b"9", b",", b'"', b"."))
    return bytes(data)


def renumbered(text: str, draw: random.Random) -> bytes:
    """One of the comma- or space-parted words of a text replaced by an odd number."""
    lines = text.split("\n")
    at = draw.randrange(len(lines))
    mark = "," if "," in lines[at] else " "
    words = lines[at].split(mark)
    words[draw.randrange(len(words))] = draw.choice(NUMBERS)
    lines[at] = mark.join(words)
    return "\n".join(lines).encode()


def of_value(text: str, draw: random.Random) -> bytes:
    """One value of a TOML file replaced by an odd one."""
    lines = text.splitlines()
    at = draw.choice([i for i, line in enumerate(lines) if "=" in line])
    lines[at] = f"{lines[at].partition('=')[0]}= {draw.choice(ODD)}"
    return "\n".join(lines).encode()


def of_document(value: Any, draw: random.Random) -> Any:
    """A parsed JSON document with one value, at any depth, replaced, removed or added."""
    if isinstance(value, dict) and value and draw.random() < 0.9:
        key = draw.choice(sorted(value))
        changed = dict(value)
        kind = draw.random()
        if kind < 0.1:
            del changed[key]
        elif kind < 0.15:
            changed[draw.choice(["", "x", "\ud800", key + "s"])] = draw.choice(VALUES)
        else:
            changed[key] = of_document(value[key], draw)
        return changed
    if isinstance(value, list) and value and draw.random() < 0.8:
        at = draw.randrange(len(value))
        return [*value[:at], of_document(value[at], draw), *value[at + 1 :]]
    return draw.choice(VALUES)
