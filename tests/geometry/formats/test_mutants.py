"""Mesh files changed at random: spelling changes nothing, any other change is refused or read as a second reader reads it."""

from __future__ import annotations

import io
import random
import re
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NoReturn

import meshio
import pytest

from geometry.errors import MeshFileError
from geometry.formats.inp import read_inp
from geometry.formats.msh import read_msh
from geometry.formats.neutral import RawMesh, family
from tests.geometry.formats import test_inp, test_msh

SECONDS, BYTES = 10, 1_000_000_000  # a file may take
VOLUMES = ("tetra", "pyramid", "wedge", "hexahedron")
Counts = tuple[int, int, dict[str, int]]


def counts(raw: RawMesh) -> Counts:
    """Nodes, volume elements, and nodes of each group of nodes."""
    volumes = sum(len(block) for kind, block in raw.blocks if family(kind) in VOLUMES)
    return len(raw.points), volumes, {name.upper(): len(nodes) for name, nodes in raw.node_groups.items()}


# ---- spelling -------------------------------------------------------------------------------------------------------


def respelled_inp(text: str, draw: random.Random) -> str:
    """Comments, case, blanks, wraps and blank ends drawn for every line."""
    lines = []
    for line in text.splitlines():
        if draw.random() < 0.2:
            lines.append(draw.choice(["** 1, 2, 3", "**", "** *NODE", "  ** indented"]))
        if line.startswith("*"):
            line = draw.choice([str.lower, str.upper, str.title, str])(line)
            line = line.replace(",", draw.choice([",", " ,", ", ", ",  "])).replace(
                "=", draw.choice(["=", " = ", "= "])
            )
            if ", " in line and draw.random() < 0.2:
                line = line.replace(", ", ",\n", 1)
        else:
            line = line.replace(",", draw.choice([",", ", ", " ,", ",\t"]))
            line += draw.choice(["", "", " ", "," if not line.rstrip().endswith(",") else ""])
        lines.append(draw.choice(["", "", " "]) + line)
    return draw.choice(["\n", "\r\n"]).join(lines) + "\n"


def renumbered_inp(text: str, draw: random.Random) -> str:
    """Every node and element under another number."""
    step, nodes = draw.randint(1, 99), draw.randint(0, 10_000)
    out, block = [], ""
    for line in text.splitlines():
        if line.startswith("*"):
            block = line.split(",")[0].strip().upper()
            out.append(line)
            continue
        words = [word.strip() for word in line.split(",") if word.strip()]
        if block == "*NODE":
            words[0] = str(nodes + step * int(words[0]))
        elif block == "*ELEMENT":
            words[1:] = [str(nodes + step * int(word)) for word in words[1:]]
        elif block == "*NSET":
            words = [str(nodes + step * int(word)) for word in words]
        out.append(", ".join(words))
    return "\n".join(out) + "\n"


def respelled_msh(text: str, draw: random.Random) -> str:
    """Other sections, blank lines and blanks."""
    comment = "$Comments\nanything 1 2 3\n$EndComments\n"
    head, _, rest = text.partition("$EndMeshFormat\n")
    text = f"{head}$EndMeshFormat\n{comment * draw.randint(0, 2)}{rest}{comment * draw.randint(0, 1)}"
    if draw.random() < 0.5:
        text = re.sub(r"(?m)^(\d+ .*)$", lambda found: found[1].replace(" ", draw.choice([" ", "  ", "\t"])), text)
    return text.replace("\n", draw.choice(["\n", "\r\n"]))


@pytest.mark.parametrize("change", [respelled_inp, renumbered_inp], ids=["spelling", "numbers"])
def test_an_input_file_is_the_same_however_it_is_spelled(
    change: Callable[[str, random.Random], str], tmp_path: Path
) -> None:
    plain = test_inp.read(test_inp.PLAIN, tmp_path)
    for seed in range(60):
        changed = change(test_inp.PLAIN, random.Random(seed))
        (tmp_path / "other.inp").write_text(changed)
        test_inp.assert_same(plain, read_inp(tmp_path / "other.inp"))


@pytest.mark.parametrize("text", [test_msh.text_22(), test_msh.text_41()], ids=["2.2", "4.1"])
def test_a_gmsh_file_is_the_same_however_it_is_spelled(text: bytes, tmp_path: Path) -> None:
    plain = test_msh.read(text, tmp_path)
    for seed in range(60):
        (tmp_path / "other.msh").write_text(respelled_msh(text.decode(), random.Random(seed)))
        test_inp.assert_same(plain, read_msh(tmp_path / "other.msh"))


# ---- any change -----------------------------------------------------------------------------------------------------


def mutant(data: bytes, draw: random.Random) -> bytes:
    """One to three changes: a byte, a line gone, twice or elsewhere, a number changed, an end cut off."""
    for _ in range(draw.randint(1, 3)):
        lines = data.splitlines(keepends=True)
        at, line = draw.randrange(max(len(data), 1)), draw.randrange(max(len(lines), 1))
        kind = draw.randrange(6)
        if kind == 0:
            data = data[:at] + bytes([draw.randrange(256)]) + data[at + 1 :]
        elif kind == 1:
            data = b"".join(lines[:line] + lines[line + 1 :])
        elif kind == 2:
            data = b"".join([*lines[: line + 1], *lines[line:]])
        elif kind == 3:
            data = b"".join(lines[:line] + lines[line + 1 :] + lines[line : line + 1])
        elif kind == 4:
            numbers = list(re.finditer(rb"\d+", data))
            if numbers:
                found = draw.choice(numbers)
                other = str(draw.choice([0, 1, 3, 7, 99, 10**9, 10**20, -1])).encode()
                data = data[: found.start()] + other + data[found.end() :]
        else:
            data = data[: draw.randrange(max(len(data), 1))]
    return data


def by_meshio(path: Path) -> Counts | None:
    """What meshio finds; None where it refuses the file or trips over it."""
    chatter = io.StringIO()
    try:
        with redirect_stdout(chatter), redirect_stderr(chatter):
            read = meshio.read(path)
        volumes = sum(len(block.data) for block in read.cells if family(block.type) in VOLUMES)
        return len(read.points), volumes, {}
    except (Exception, SystemExit):
        return None


@contextmanager
def limited() -> Iterator[None]:
    """TimeoutError after the seconds that a file may take."""

    def late(*_: object) -> NoReturn:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def disagreements(data: bytes, name: str, seeds: range, folder: Path) -> tuple[int, list[int]]:
    """Mutants that are read, and the seeds of those of which a second reader finds other nodes or elements."""
    reader = read_inp if name.endswith(".inp") else read_msh
    path, read, other = folder / name, 0, []
    for seed in seeds:
        path.write_bytes(mutant(data, random.Random(seed)))
        try:
            with limited():
                ours = counts(reader(path))
        except MeshFileError:
            continue
        read += 1
        theirs = by_meshio(path)
        if theirs is not None and theirs[:2] != ours[:2]:
            other.append(seed)
    return read, other


MUTATED = {
    "22.msh": test_msh.text_22(),
    "22-binary.msh": test_msh.binary_22(),
    "41.msh": test_msh.text_41(),
    "41-binary.msh": test_msh.binary_41(),
    "body.inp": test_inp.PLAIN.encode(),
}


def known(data: bytes, name: str, seed: int) -> bool:
    """Where meshio is the one that strays: it keeps elements twice, takes blocks as ended, or cuts what was announced."""
    changed = mutant(data, random.Random(seed))
    text = changed.decode("latin-1").upper()
    if name.endswith(
        ".inp"
    ):  # a lost keyword's data go on with the block before; a node given again is moved, not doubled
        heads = [line for line in text.splitlines() if line.startswith("*")]
        nodes = [line.split(",")[0].strip() for line in text.partition("*ELEMENT")[0].splitlines()]
        return len(heads) != text.count("*") or len(heads) != 4 or len(set(heads + nodes)) != len(heads + nodes)
    return "2.2" in text[:40] and name.startswith(
        "22"
    )  # version 2 repeats an element for each group: meshio counts each


@pytest.mark.parametrize("name", MUTATED)
def test_mutants_are_refused_or_read_as_a_second_reader_reads_them(name: str, tmp_path: Path) -> None:
    read, other = disagreements(MUTATED[name], name, range(150), tmp_path)
    assert read > 5
    assert [seed for seed in other if not known(MUTATED[name], name, seed)] == []


@pytest.mark.slow
def test_five_thousand_mutants_take_little_and_end_well(tmp_path: Path) -> None:
    """In a process whose memory is bounded."""
    words = "from tests.geometry.formats import test_mutants as t; t.main()"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, cwd=Path(__file__).parents[3])
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.count("ok") == len(MUTATED), done.stdout


def main() -> None:
    """A thousand mutants of each file."""
    import tempfile

    held = int(re.findall(r"VmSize:\s+(\d+)", Path("/proc/self/status").read_text())[0]) * 1024
    resource.setrlimit(resource.RLIMIT_AS, (held + BYTES, held + BYTES))
    with tempfile.TemporaryDirectory() as folder:
        for name, data in MUTATED.items():
            read, other = disagreements(data, name, range(1000), Path(folder))
            left = [seed for seed in other if not known(data, name, seed)]
            print(name, read, "read", left or "ok")
