"""Gmsh's files: groups by dimension and number, nodes in the format's order, text and binary alike."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from geometry.errors import MeshFileError
from geometry.formats.msh import TYPES, _gmsh_places, read_msh
from geometry.formats.neutral import DIMENSION, PLACES, RawMesh, family
from geometry.formats.reader import read_mesh
from geometry.mesh import Mesh, check_mesh
from tests.helpers.mesh_files import load

CUBE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
NAMES = '$PhysicalNames\n3\n1 1 "RIM"\n2 1 "TOUCH"\n3 1 "BODY"\n$EndPhysicalNames\n'
ENTITIES = {
    (1, 11): [1],
    (2, 21): [1],
    (3, 31): [1, 7],
    (2, 22): [],
}
# (entity's dimension and tag, gmsh's type, nodes)
ELEMENTS = [
    ((1, 11), 1, (1, 2)),
    ((2, 21), 3, (1, 2, 3, 4)),
    ((2, 22), 3, (5, 6, 7, 8)),
    ((3, 31), 5, (1, 2, 3, 4, 5, 6, 7, 8)),
]


def text_22(elements: list = ELEMENTS) -> bytes:
    rows = [(kind, group, nodes) for entity, kind, nodes in elements for group in ENTITIES[entity] or [0]]
    nodes = "".join(f"{10 * i} {x} {y} {z}\n" for i, (x, y, z) in enumerate(CUBE, 1))
    lines = "".join(
        f"{i} {kind} 2 {group} 1 {' '.join(str(10 * n) for n in nodes)}\n"
        for i, (kind, group, nodes) in enumerate(rows, 1)
    )
    return (
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n{NAMES}$Nodes\n8\n{nodes}$EndNodes\n"
        f"$Elements\n{len(rows)}\n{lines}$EndElements\n"
    ).encode()


def binary_22(order: str = "<") -> bytes:
    rows = [(kind, group, nodes) for entity, kind, nodes in ELEMENTS for group in ENTITIES[entity] or [0]]
    data = (
        b"$MeshFormat\n2.2 1 8\n"
        + struct.pack(f"{order}i", 1)
        + b"\n$EndMeshFormat\n"
        + NAMES.encode()
        + b"$Nodes\n8\n"
    )
    for i, at in enumerate(CUBE, 1):
        data += struct.pack(f"{order}i3d", 10 * i, *at)
    data += f"\n$EndNodes\n$Elements\n{len(rows)}\n".encode()
    for i, (kind, group, nodes) in enumerate(rows, 1):
        data += struct.pack(f"{order}3i", kind, 1, 2) + struct.pack(f"{order}3i", i, group, 1)
        data += struct.pack(f"{order}{len(nodes)}i", *(10 * n for n in nodes))
    return data + b"\n$EndElements\n"


def parts_41() -> list:
    """Numbers of a file of version 4.1: ("i", ints), ("u", sizes), ("d", floats), section by section."""
    entities = [("u", [0, 1, 2, 1])]
    for (dimension, tag), groups in sorted(ENTITIES.items()):
        entities += [
            ("i", [tag]),
            ("d", [0.0] * (6 if dimension else 3)),
            ("u", [len(groups)]),
            ("i", groups),
            ("u", [0]),
        ]
    nodes = [("u", [1, 8, 10, 80]), ("i", [3, 31, 0]), ("u", [8]), ("u", [10 * i for i in range(1, 9)])]
    nodes += [("d", list(at)) for at in CUBE]
    elements = [("u", [len(ELEMENTS), len(ELEMENTS), 1, len(ELEMENTS)])]
    for number, (entity, kind, cell) in enumerate(ELEMENTS, 1):
        elements += [("i", [*entity, kind]), ("u", [1]), ("u", [number, *(10 * n for n in cell)])]
    return [(b"Entities", entities), (b"Nodes", nodes), (b"Elements", elements)]


def text_41() -> bytes:
    data = f"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n{NAMES}".encode()
    for name, numbers in parts_41():
        lines = "\n".join(" ".join(map(str, values)) for _, values in numbers if values)
        data += b"$" + name + b"\n" + lines.encode() + b"\n$End" + name + b"\n"
    return data


def binary_41() -> bytes:
    data = b"$MeshFormat\n4.1 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n" + NAMES.encode()
    for name, numbers in parts_41():
        data += b"$" + name + b"\n"
        for kind, values in numbers:
            data += struct.pack(f"<{len(values)}{ {'i': 'i', 'u': 'Q', 'd': 'd'}[kind] }", *values)
        data += b"\n$End" + name + b"\n"
    return data


FILES = {
    "2.2": text_22(),
    "2.2 binary": binary_22(),
    "2.2 big-endian": binary_22(">"),
    "4.1": text_41(),
    "4.1 binary": binary_41(),
}


def read(data: bytes, tmp_path: Path) -> RawMesh:
    (tmp_path / "body.msh").write_bytes(data)
    return read_msh(tmp_path / "body.msh")


@pytest.mark.parametrize("data", FILES.values(), ids=list(FILES))
def test_a_group_is_a_dimension_and_a_number(data: bytes, tmp_path: Path) -> None:
    raw = read(data, tmp_path)
    assert raw.points.tolist() == [list(map(float, at)) for at in CUBE]
    assert raw.node_groups["RIM"].tolist() == [0, 1]
    kinds = [kind for kind, _ in raw.blocks]
    assert {kind: len(block) for kind, block in raw.blocks} == {"quad": 2, "hexahedron": 1}
    assert {
        name: {kinds[b]: cells.tolist() for b, cells in parts.items()} for name, parts in raw.cell_groups.items()
    } == {
        "TOUCH": {"quad": [0]},
        "BODY": {"hexahedron": [0]},
        "volume 7": {"hexahedron": [0]},
    }
    mesh = load(str(tmp_path / "body.msh"))
    assert isinstance(mesh, Mesh) and mesh.faces["TOUCH"].shape == (1, 4) and mesh.faces["RIM"].shape == (2, 1)


@pytest.mark.parametrize("kind", [kind for kind, name in TYPES.items() if DIMENSION[name] == 3])
def test_middle_nodes_stand_where_the_format_puts_them(kind: int, tmp_path: Path) -> None:
    """By the tables of Gmsh's reference manual, written here as the pairs of corners they list."""
    name = TYPES[kind]
    size = len(PLACES[name])
    manual = {
        "tetra10": [(0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3)],
        "hexahedron20": [
            (0, 1),
            (0, 3),
            (0, 4),
            (1, 2),
            (1, 5),
            (2, 3),
            (2, 6),
            (3, 7),
            (4, 5),
            (4, 7),
            (5, 6),
            (6, 7),
        ],
        "wedge15": [(0, 1), (0, 2), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 5), (4, 5)],
        "pyramid13": [(0, 1), (0, 3), (0, 4), (1, 2), (1, 4), (2, 3), (2, 4), (3, 4)],
    }
    manual["hexahedron27"] = [
        *manual["hexahedron20"], (0, 1, 2, 3), (0, 1, 4, 5), (0, 3, 4, 7), (1, 2, 5, 6), (2, 3, 6, 7), (4, 5, 6, 7),
        tuple(range(8)),
    ]  # fmt: skip
    manual["wedge18"] = [*manual["wedge15"], (0, 1, 3, 4), (0, 2, 3, 5), (1, 2, 4, 5)]
    manual["pyramid14"] = [*manual["pyramid13"], (0, 1, 2, 3)]
    corners = np.random.default_rng(3).normal(size=(len(PLACES[family(name)]), 3))
    points = [*corners, *(corners[list(place)].mean(axis=0) for place in manual.get(name, []))]
    assert len(points) == size
    lines = "".join(f"{i} {x!r} {y!r} {z!r}\n" for i, (x, y, z) in enumerate(np.array(points).tolist(), 1))
    element = f"1 {kind} 2 1 1 {' '.join(map(str, range(1, size + 1)))}\n"
    data = (
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{size}\n{lines}$EndNodes\n$Elements\n1\n{element}$EndElements\n"
    )
    raw = read(data.encode(), tmp_path)
    for node, place in zip(raw.blocks[0][1][0], PLACES[name], strict=True):
        assert raw.points[node] == pytest.approx(corners[list(place)].mean(axis=0))


def test_a_strongly_curved_hexahedron_keeps_the_order_of_its_file(tmp_path: Path) -> None:
    """A slice of a cylinder whose face middles lie nearer to other edges than to their own: a guess would mix them up."""
    points, places = [], {}
    for place in PLACES["hexahedron27"]:
        u, v, w = (np.mean([CUBE[corner][axis] for corner in place]) for axis in range(3))
        radius, angle = 1.0 + 4.0 * u, np.pi * 0.9 * v
        points.append((radius * np.cos(angle), radius * np.sin(angle), 0.2 * w))
        places[frozenset(place)] = len(points)
    order = [places[frozenset(place)] for place in _gmsh_places("hexahedron27")]
    lines = "".join(f"{i} {x!r} {y!r} {z!r}\n" for i, (x, y, z) in enumerate(np.array(points).tolist(), 1))
    element = f"1 12 2 1 1 {' '.join(map(str, order))}\n"
    data = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n27\n{lines}$EndNodes\n$Elements\n1\n{element}$EndElements\n"
    (tmp_path / "body.msh").write_bytes(data.encode())
    mesh = load(str(tmp_path / "body.msh"))
    assert isinstance(mesh, Mesh)
    # in the plane: the parabola through three points of the unit circle, u from 1 to 5
    half = 0.9 * np.pi / 2.0
    assert check_mesh(mesh).volume_m3 == pytest.approx(
        24.0 * 0.2 * np.sin(half) * (4.0 - np.cos(half)) / 3.0, rel=1e-12
    )


@pytest.mark.parametrize(
    ("data", "said"),
    {
        "no header": (b"$Nothing\n", "must begin with"),
        "version 1": (b"$MeshFormat\n1.0 0 8\n$EndMeshFormat\n", "MSH version 1.0 is not read"),
        "version 4.0": (b"$MeshFormat\n4.0 0 8\n$EndMeshFormat\n", "version 4.1 or 2.2"),
        "partitions": (text_41().replace(b"$Entities", b"$PartitionedEntities"), "without partitions"),
        "order 3": (text_22().replace(b"4 5 2", b"4 92 2"), "type 92 are not read"),
        "a node short": (text_22().replace(b"$Nodes\n8\n", b"$Nodes\n9\n"), "9 nodes were announced"),
        "an element short": (text_22().replace(b"$Elements\n5", b"$Elements\n6"), "6 elements were announced"),
        "an unknown node": (text_22().replace(b"70 80\n", b"70 81\n"), "node 81 is not in the file"),
        "a node twice": (text_22().replace(b"\n20 1 0 0", b"\n10 1 0 0"), "node 10 is given twice"),
        "a letter": (text_22().replace(b"\n20 1 0 0", b"\n20 x 0 0"), "not readable"),
        "torn text": (text_41()[:-80], "truncated|announced"),
        "torn bytes": (binary_41()[:-60], "truncated"),
        "a huge count": (binary_22().replace(b"$Nodes\n8\n", b"$Nodes\n800000000\n"), "truncated"),
    }.values(),
)
def test_what_is_not_read_is_refused_by_name(data: bytes, said: str, tmp_path: Path) -> None:
    with pytest.raises(MeshFileError, match=said):
        read(data, tmp_path)


def test_bodies_that_touch_without_sharing_nodes_are_counted_and_merged(tmp_path: Path) -> None:
    second = [(x + 1, y, z) for x, y, z in CUBE]
    nodes = "".join(f"{i} {x} {y} {z}\n" for i, (x, y, z) in enumerate([*CUBE, *second], 1))
    rows = "1 5 2 1 1 1 2 3 4 5 6 7 8\n2 5 2 1 1 9 10 11 12 13 14 15 16\n"
    data = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n16\n{nodes}$EndNodes\n$Elements\n2\n{rows}$EndElements\n"
    (tmp_path / "body.msh").write_text(data)
    apart, joined = read_mesh(str(tmp_path / "body.msh")), read_mesh(str(tmp_path / "body.msh"), merge=1e-6)
    assert (apart.parts, apart.coincident, apart.mesh.dof) == (2, 8, 48)
    assert (joined.parts, joined.coincident, joined.mesh.dof) == (1, 0, 36)
