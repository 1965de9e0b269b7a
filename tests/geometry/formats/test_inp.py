"""Abaqus and CalculiX files: what the format allows is read as it says, or refused by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from geometry.errors import MeshFileError
from geometry.formats.inp import read_inp
from geometry.formats.neutral import PLACES, RawMesh
from geometry.formats.reader import read_mesh

NODES = """*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 1, 1, 0
4, 0, 1, 0
5, 0, 0, 1
6, 1, 0, 1
7, 1, 1, 1
8, 0, 1, 1
9, 2, 0, 0
10, 2, 1, 0
11, 2, 0, 1
12, 2, 1, 1
"""
ELEMENTS = """*ELEMENT, TYPE=C3D8, ELSET=BODY
1, 1, 2, 3, 4, 5, 6, 7, 8
2, 2, 9, 10, 3, 6, 11, 12, 7
"""
SETS = """*NSET, NSET=CLAMP
1, 4,
5, 8
*ELSET, ELSET=PILLAR
2
"""
PLAIN = NODES + ELEMENTS + SETS


def read(text: str, tmp_path: Path, **others: str) -> RawMesh:
    for name, content in others.items():
        (tmp_path / f"{name}.inc").write_text(content)
    (tmp_path / "body.inp").write_text(text)
    return read_inp(tmp_path / "body.inp")


def assert_same(one: RawMesh, two: RawMesh) -> None:
    assert np.array_equal(one.points, two.points)
    assert [kind for kind, _ in one.blocks] == [kind for kind, _ in two.blocks]
    assert all(np.array_equal(a, b) for (_, a), (_, b) in zip(one.blocks, two.blocks, strict=True))
    for ours, theirs in ((one.node_groups, two.node_groups), (one.cell_groups, two.cell_groups)):
        assert {name.upper() for name in ours} == {name.upper() for name in theirs}
    upper = {name.upper(): nodes for name, nodes in two.node_groups.items()}
    assert all(np.array_equal(nodes, upper[name.upper()]) for name, nodes in one.node_groups.items())
    cells = {name.upper(): parts for name, parts in two.cell_groups.items()}
    for name, parts in one.cell_groups.items():
        assert parts.keys() == cells[name.upper()].keys()
        assert all(np.array_equal(parts[block], cells[name.upper()][block]) for block in parts)


SPELLINGS: dict[str, Callable[[str], str]] = {
    "comments anywhere": lambda text: "".join(f"{line}\n** a comment, 1, 2\n" for line in text.splitlines()),
    "lower case": str.lower,
    "blanks": lambda text: text.replace(",", " , ").replace("=", " = "),
    "a comma at the end of data": lambda text: "".join(
        f"{line}{'' if line.startswith('*') or line.endswith(',') else ','}\n" for line in text.splitlines()
    ),
    "several node blocks": lambda text: text.replace("7, 1, 1, 1\n", "*NODE\n7, 1, 1, 1\n"),
    "elements over two lines": lambda text: text.replace("3, 4, 5, 6, 7, 8", "3, 4,\n5, 6, 7, 8"),
    "a set in two parts": lambda text: text.replace("1, 4,\n5, 8", "1, 4\n*NSET, NSET=Clamp\n5, 8, 1"),
    "generated": lambda text: text.replace("1, 4,\n5, 8", "1, 4\n5, 8").replace(
        "*NSET, NSET=CLAMP\n1, 4\n5, 8", "*NSET, NSET=CLAMP, GENERATE\n1, 5, 4\n4, 8, 4"
    ),
    "increment left out": lambda text: text.replace("*ELSET, ELSET=PILLAR\n2", "*ELSET, ELSET=PILLAR, GENERATE\n2, 2"),
    "a keyword over two lines": lambda text: text.replace("*ELEMENT, TYPE=C3D8,", "*ELEMENT,\nTYPE=C3D8,"),
    "heading and material": lambda text: (
        f"*HEADING\na bar, 5\n*MATERIAL, NAME=M\n*ELASTIC\n70e3, 0.3\n{text}*STEP\n*END STEP\n"
    ),
    "windows": lambda text: text.replace("\n", "\r\n"),
    "powers of ten": lambda text: text.replace("9, 2, 0, 0", "9, 2.0D0, 0.E+00,"),
}


@pytest.mark.parametrize("respelled", SPELLINGS.values(), ids=list(SPELLINGS))
def test_a_change_of_spelling_changes_nothing(respelled: Callable[[str], str], tmp_path: Path) -> None:
    changed = respelled(PLAIN)
    assert changed != PLAIN
    assert_same(read(PLAIN, tmp_path), read(changed, tmp_path))


def test_included_files_stand_where_they_are_named(tmp_path: Path) -> None:
    text = "*INCLUDE, INPUT=nodes.inc\n" + ELEMENTS + "*NSET, NSET=CLAMP\n1, 4,\n*INCLUDE, INPUT=rest.inc\n"
    rest = "5, 8\n" + SETS.split("5, 8\n")[1]
    assert_same(read(PLAIN, tmp_path), read(text, tmp_path, nodes=NODES, rest=rest))


def test_sets_name_sets(tmp_path: Path) -> None:
    text = PLAIN + "*ELSET, ELSET=ALL\nBODY, PILLAR\n*NSET, NSET=MORE\nclamp, 9\n*NSET, NSET=OF, ELSET=PILLAR\n"
    raw = read(text, tmp_path)
    assert raw.cell_groups["ALL"][0].tolist() == [0, 1]
    assert raw.node_groups["MORE"].tolist() == [0, 3, 4, 7, 8]
    assert raw.node_groups["OF"].tolist() == [1, 2, 5, 6, 8, 9, 10, 11]


def test_nodes_of_a_set_given_with_them(tmp_path: Path) -> None:
    raw = read(PLAIN + "*NODE, NSET=REF\n99, 5, 5, 5\n", tmp_path)
    assert raw.node_groups["REF"].tolist() == [12]
    assert read_mesh(str(tmp_path / "body.inp")).unused == 1


@pytest.mark.parametrize(("face", "corners"), [("S1", {1, 2, 3, 4}), ("S2", {5, 6, 7, 8}), ("S6", {1, 4, 5, 8})])
def test_a_surface_of_elements_is_a_group_of_faces(face: str, corners: set[int], tmp_path: Path) -> None:
    raw = read(PLAIN + f"*SURFACE, NAME=FOOT, TYPE=ELEMENT\n1, {face}\n", tmp_path)
    (block,) = raw.cell_groups["FOOT"]
    assert {int(node) + 1 for node in raw.blocks[block][1].ravel()} == corners
    assert set(read_mesh(str(tmp_path / "body.inp")).mesh.faces) == {"CLAMP", "FOOT"}


def test_parts_are_copied_moved_and_turned_as_their_instances_say(tmp_path: Path) -> None:
    text = f"""*PART, NAME=Cube
{NODES}*ELEMENT, TYPE=C3D8, ELSET=BODY
1, 1, 2, 3, 4, 5, 6, 7, 8
*NSET, NSET=FOOT
1, 2, 3, 4
*END PART
*ASSEMBLY, NAME=A
*INSTANCE, NAME=one, PART=cube
*END INSTANCE
*INSTANCE, NAME=two, PART=Cube
0, 0, 3
0, 0, 0, 0, 0, 1, 90
*END INSTANCE
*NSET, NSET=TOP, INSTANCE=two
5, 6, 7, 8
*NSET, NSET=BOTH
one.5, two.5
*END ASSEMBLY
"""
    raw = read(text, tmp_path)
    assert [len(block) for _, block in raw.blocks] == [2]
    assert raw.points[raw.blocks[0][1][1]][:, 2].tolist() == [3.0] * 4 + [4.0] * 4
    assert raw.points[raw.blocks[0][1][1, 1]] == pytest.approx([0.0, 1.0, 3.0], abs=1e-12)  # (1, 0, 3) by 90 degrees
    assert len(raw.node_groups["FOOT"]) == 8 and len(raw.node_groups["two.FOOT"]) == 4
    assert raw.points[raw.node_groups["TOP"]][:, 2].tolist() == [4.0] * 4
    assert sorted(raw.points[raw.node_groups["BOTH"]][:, 2].tolist()) == [1.0, 4.0]
    assert read_mesh(str(tmp_path / "body.inp")).parts == 2


def test_faces_and_lines_only_carry_names(tmp_path: Path) -> None:
    text = (
        PLAIN + "*ELEMENT, TYPE=S4R, ELSET=FOOT\n10, 1, 2, 3, 4\n*ELEMENT, TYPE=T3D2, ELSET=RIM\n20, 1, 2\n21, 2, 3\n"
    )
    raw = read(text, tmp_path)
    assert raw.node_groups["RIM"].tolist() == [0, 1, 2]
    assert [kind for kind, _ in raw.blocks] == ["hexahedron", "quad"]
    assert read_mesh(str(tmp_path / "body.inp")).mesh.faces["FOOT"].shape == (1, 4)


def test_what_would_change_the_modes_and_is_not_read_is_named(tmp_path: Path) -> None:
    extra = "*BOUNDARY\nCLAMP, 1, 3\n*ELEMENT, TYPE=MASS, ELSET=M\n30, 7\n*MASS, ELSET=M\n2.0\n*SPRING, ELSET=S\n\n5\n"
    assert read(PLAIN + extra, tmp_path).left_out == ("*BOUNDARY", "*ELEMENT, TYPE=MASS", "*MASS", "*SPRING")


BAD = {
    "generated nodes": (PLAIN + "*NGEN, NSET=A\n1, 9, 1\n", r"\*NGEN is not read"),
    "cylindrical": (PLAIN.replace("*NODE", "*NODE, SYSTEM=C"), "SYSTEM=C is not read"),
    "a shell of volume": (PLAIN.replace("C3D8", "SC8R"), "SC8R is not read"),
    "no type": (PLAIN.replace("TYPE=C3D8, ", ""), r"\*ELEMENT without TYPE="),
    "a row too short": (PLAIN.replace(", 7, 8\n2", ", 7\n2"), "do not form rows of 9"),
    "a word for a number": (PLAIN.replace("1, 4,", "1, four,"), "set 'four' is not defined"),
    "a node that is not there": (
        PLAIN.replace("5, 8\n*ELSET", "5, 88\n*ELSET"),
        "group CLAMP: node 88 is not in the file",
    ),
    "an element's node that is not there": (PLAIN.replace("11, 12, 7", "11, 77, 7"), "element 2: node 77"),
    "an element twice": (PLAIN.replace("2, 2, 9", "1, 2, 9"), "element 1 is given twice"),
    "a range backwards": (PLAIN + "*NSET, NSET=A, GENERATE\n9, 1, 1\n", "is not a range"),
    "an endless range": (PLAIN + "*NSET, NSET=A, GENERATE\n1, 999999999999, 1\n", "is not a range"),
    "a missing file": (PLAIN + "*INCLUDE, INPUT=none.inc\n", "none.inc: no such mesh file"),
    "a device": (PLAIN + "*INCLUDE, INPUT=/dev/zero\n", "/dev/zero: not a regular file"),
    "itself": (PLAIN + "*INCLUDE, INPUT=body.inp\n", "includes itself"),
    "a face that is not there": (PLAIN + "*SURFACE, NAME=A\n1, S7\n", "face S7 of element 1"),
    "a part that is not there": ("*INSTANCE, NAME=a, PART=b\n" + PLAIN, "which is not defined above"),
    "two loose parts": (f"*PART, NAME=a\n{PLAIN}*END PART\n*PART, NAME=b\n{PLAIN}*END PART\n", "2 parts but no"),
}


@pytest.mark.parametrize(("text", "said"), BAD.values(), ids=list(BAD))
def test_what_is_not_read_is_refused_by_name(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(MeshFileError, match=said):
        read(text, tmp_path)


def test_twenty_seven_nodes_stand_where_the_format_puts_them(tmp_path: Path) -> None:
    """The middle of the body first, then those of the faces S1 to S6."""
    corners = np.array(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], dtype=float
    )
    edges = [corners[list(place)].mean(axis=0) for place in PLACES["hexahedron20"][8:]]
    faces = [(0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    points = [*corners, *edges, corners.mean(axis=0), *(corners[list(face)].mean(axis=0) for face in faces)]
    lines = "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(points, 1))
    numbers = ", ".join(map(str, range(1, 28)))
    raw = read(f"*NODE\n{lines}*ELEMENT, TYPE=C3D27\n1, {numbers}\n", tmp_path)
    ((kind, cells),) = raw.blocks
    assert kind == "hexahedron27"
    for node, place in zip(cells[0], PLACES[kind], strict=True):
        assert raw.points[node] == pytest.approx(corners[list(place)].mean(axis=0))
