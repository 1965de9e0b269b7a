"""Seeded damage to everything a user hands in: the outcome is success or one of the project's own faults, one line each.

Never another exception, never a warning taken for a result, never more than a bound of work for an input.
"""

from __future__ import annotations

import json
import random
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry.errors import MeshFileError
from geometry.formats.med import write_med
from geometry.formats.neutral import RawMesh
from geometry.layout import Design
from geometry.materials import MATERIALS
from geometry.pillar_shapes import SHAPES
from pipeline.case.limits import parse_band, parse_frequency
from pipeline.case.model import load_case
from pipeline.case.schema import SIZE_KEYS, known_keys
from pipeline.errors import CommandError, InputError
from pipeline.measured.files import read_field, read_sweep
from pipeline.planning.model_choice import cell_model_choice
from pipeline.questions.predesign import sized
from pipeline.records import store
from tests.helpers.mesh_files import load

CASE = (Path(__file__).parents[3] / "studies" / "three-rows.toml").read_text()
MAX_DURATION_S = (
    10.0  # of processor time for one input: a hundred times what any takes, below the squares that once took minutes
)
# a law's twenty keys only where the case has its material: of three owners they would be half of all, nearly always refused
KEYS = [key for key in known_keys() if not key.startswith("pillar.material.")]
ODD = [
    "0", "-0.0", "1", "-1", "1e308", "-1e308", "1e-308", "5e-324", "1e-60", "3e-8", "nan", "inf", "-inf", "true", "9" * 400,
    "0.001", "1e4", "1e-3", "2e-3", "1000", "0.5", "2.0000001", "[]", "{}", "[[]]", '""', '"\\u0000"', '"\\n"', "'x'",
    "[0, 1e300]", "[1e-320, 2e-320]", "[[0, 0]]", "[[0, 0], [0, 0]]", "[1e308, 1e308, 1e308]", "[0.001, 0.001, 0.001]",
    "{young_GPa = 1e-9, density_kg_m3 = 1, poisson = 0.4}", "1979-05-27", "0x10", *SHAPES, "antinodes", "steel",
    "[" * 30 + "]" * 30, "{a.b.c.d.e.f.g.h.i = 1}", '"' + "s" * 5000 + '"',
]  # fmt: skip
SIZES = [
    key for key in KEYS if key.endswith(("_mm", "young_GPa", "kg_m3", "quality_factor", "near_kHz")) and "." in key
]
QUANTITIES = ["30", "31.5", "4e1", "0", "1e308", "1e-308", "-1", "nan", "inf", "", ":", "3e999", "1e-9", "٣", "30:34"]
DESIGN = Design(60e-3, 20e-3, 2e-3, 4, MATERIALS["aluminium"], None, float("nan"), float("nan"), 0, 12e-3)
SWEEP = "# a note\nfrequency_Hz,amplitude_m_per_s,phase_deg\n" + "".join(
    f"{30e3 + i},{1 + i},{10 * i}\n" for i in range(12)
)
FIELD = "x_mm,y_mm,real,imag\n" + "".join(f"{i - 6},{i},{i * 1e-3},0\n" for i in range(12))
INP = "*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n5,1,1,1\n*ELEMENT, TYPE=C3D4\n1,1,2,3,4\n2,2,3,4,5\n*NSET, NSET=N\n1,2\n"
MSH = (
    "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n1 0 0 0\n2 1 0 0\n3 0 1 0\n4 0 0 1\n5 1 1 1\n$EndNodes\n"
    "$Elements\n2\n1 4 2 1 1 1 2 3 4\n2 4 2 1 1 2 3 4 5\n$EndElements\n"
)
NUMBERS = ["0", "-1", "1e308", "-1e308", "nan", "inf", "", "x", "1e-320", "99999999999999999999", "6", "2.5", "9" * 300]


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


class Mutants:
    """One function a kind of input: each makes one damaged input and reads it."""

    def __init__(self, folder: Path, sizes: bool) -> None:
        self.folder, self.sizes = folder, sizes
        nodes = np.vstack([np.zeros(3), np.eye(3), np.ones(3)])
        groups = {"A": {0: np.array([0])}}
        block = ("tetra", np.array([[0, 1, 2, 3], [1, 2, 3, 4]]))
        write_med(RawMesh(nodes, [block], groups, {"N": np.array([0, 1])}), folder / "whole.med", "M")
        self.med = (folder / "whole.med").read_bytes()
        (folder / "case.toml").write_text(CASE)

    def write(self, name: str, content: bytes) -> str:
        path = self.folder / name
        path.write_bytes(content)
        return str(path)

    def shape(self, draw: random.Random) -> Any:
        """A pillar's shape with its own sizes, each ordinary or of any magnitude, now and then one of another shape."""
        shape = SHAPES[draw.choice([*SHAPES])]
        keys = {*shape.keys, draw.choice([*shape.keys, *SIZE_KEYS, "height_mm", "fillet_mm"])}
        sizes = {key: draw.choice((draw.uniform(0.3, 3.0), 10.0 ** draw.uniform(-4.0, 5.0))) for key in sorted(keys)}
        case = load_case(
            self.folder / "case.toml",
            [f"pillar.shape={shape.name}", *(f"pillar.{key}={size!r}" for key, size in sizes.items())],
        )
        return (
            json.dumps(sized(case.design).values(), allow_nan=False) if self.sizes else (case, cell_model_choice(case))
        )

    def override(self, draw: random.Random) -> Any:
        given = [f"{draw.choice(KEYS)}={draw.choice(ODD)}" for _ in range(draw.randint(1, 3))]
        return load_case(self.folder / "case.toml", given)

    def text_of_override(self, draw: random.Random) -> Any:
        text = damaged(f"{draw.choice(KEYS)}={draw.choice(ODD)}".encode(), draw).decode("latin-1")
        return load_case(self.folder / "case.toml", [text])

    def case(self, draw: random.Random) -> Any:
        lines = CASE.splitlines()
        at = draw.choice([i for i, line in enumerate(lines) if "=" in line])
        lines[at] = f"{lines[at].partition('=')[0]}= {draw.choice(ODD)}"
        result = "\n".join(lines).encode() if draw.random() < 0.4 else damaged(CASE.encode(), draw)
        return load_case(self.write("damaged.toml", result))

    def number(self, draw: random.Random) -> Any:
        """One number of the plate between the odd and the ordinary; the slow run sizes what can be built as well."""
        case = load_case(self.folder / "case.toml", [f"{draw.choice(SIZES)}={10.0 ** draw.uniform(-4.0, 5.0)!r}"])
        return json.dumps(sized(case.design).values(), allow_nan=False) if self.sizes else case

    def quantity(self, draw: random.Random) -> Any:
        ends = [draw.choice(QUANTITIES) + draw.choice(["", "Hz", "kHz", "MHz", "k"]) for _ in range(2)]
        return parse_band(":".join(ends), "--band") if draw.random() < 0.5 else parse_frequency(ends[0], "--near")

    def sweep(self, draw: random.Random) -> Any:
        result = renumbered(SWEEP, draw) if draw.random() < 0.6 else damaged(SWEEP.encode(), draw)
        return read_sweep(self.write("sweep.csv", result))

    def field(self, draw: random.Random) -> Any:
        result = renumbered(FIELD, draw) if draw.random() < 0.6 else damaged(FIELD.encode(), draw)
        return read_field(self.write("field.csv", result), DESIGN)

    def mesh(self, draw: random.Random) -> Any:
        name, text = draw.choice((("m.inp", INP), ("m.msh", MSH)))
        result = renumbered(text, draw) if draw.random() < 0.6 else damaged(text.encode(), draw)
        return load(self.write(name, result))

    def binary_mesh(self, draw: random.Random) -> Any:
        data = bytearray(self.med)
        for _ in range(draw.randint(1, 20)):
            data[draw.randrange(len(data))] = draw.choice((0, 255, draw.randrange(256)))
        return load(self.write("m.med", bytes(data)))

    def record(self, draw: random.Random) -> Any:
        record = {
            "schema": store.SCHEMA,
            "case_id": "base",
            "status": "OK",
            "target": {"frequency_hz": 3.5e4},
            "cases": [1, 2.0, None],
        }
        self.write(store.RECORD, damaged(json.dumps(record).encode(), draw))
        return store.read_record(self.folder)


SHARES = {
    "override": 16,
    "shape": 6,
    "number": 6,
    "text_of_override": 10,
    "case": 20,
    "quantity": 6,
    "sweep": 8,
    "field": 8,
}
SHARES |= {"mesh": 8, "binary_mesh": 8, "record": 4}


MOSTLY_REFUSED = ("text_of_override", "record")


def outcome(read: Callable[[random.Random], Any], seed: int) -> str:
    """What came of one input: 'read' or 'refused'; anything else fails with the seed that makes it again."""
    draw, start = random.Random(seed), time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of readers of other people's; what they lead to is what counts
            read(draw)
        text = "read"
    except CommandError as fault:
        wrong = fault.exit_code == 2 or isinstance(fault, store.StoreError)
        assert wrong and fault.lines and not isinstance(fault, NotImplementedError), seed
        assert all(line.isprintable() and len(line) < 2200 for line in fault.lines), (seed, fault.lines)
        text = "refused"
    except MeshFileError as fault:  # the command tells its lines with exit code 2
        assert all(len(line) < 2200 for line in str(fault).splitlines()), seed
        text = "refused"
    except Exception as fault:
        raise AssertionError(f"{read.__name__}, seed {seed}: {type(fault).__name__}: {fault}") from fault
    assert time.process_time() - start < MAX_DURATION_S, f"{read.__name__}, seed {seed}"
    return text


def run(folder: Path, count: int, first: int, sizes: bool = False) -> dict[str, dict[str, int]]:
    """How many inputs of each kind were read and refused; seeds count from `first`."""
    mutants = Mutants(folder, sizes)
    total = sum(SHARES.values())
    result: dict[str, dict[str, int]] = {}
    for name, share in SHARES.items():
        outcomes = [outcome(getattr(mutants, name), first + i) for i in range(-(-count * share // total))]
        result[name] = {text: outcomes.count(text) for text in ("read", "refused")}
    return result


def test_five_hundred_damaged_inputs_are_read_or_refused_in_one_line_each(tmp_path: Path, capfd: Any) -> None:
    result = run(tmp_path, 500, 1)
    assert sum(sum(text.values()) for text in result.values()) >= 500
    assert all(text["refused"] > 0 for text in result.values())
    assert all(text["read"] > 0 for name, text in result.items() if name not in MOSTLY_REFUSED), result
    assert "Traceback" not in "".join(capfd.readouterr())


@pytest.mark.slow
def test_fifty_thousand_damaged_inputs(tmp_path: Path) -> None:
    result = run(tmp_path, 50_000, 1_000_000, sizes=True)
    assert sum(sum(text.values()) for text in result.values()) >= 50_000


def test_a_reader_that_lets_an_exception_through_is_caught_by_this_test(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=r"fails, seed 7: TypeError"):

        def fails(draw: random.Random) -> None:
            raise TypeError("unhashable")

        outcome(fails, 7)
    assert outcome(lambda draw: (_ for _ in ()).throw(InputError("one line")), 7) == "refused"
