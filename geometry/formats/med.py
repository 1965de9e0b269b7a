"""MED files (HDF5), as Code_Aster and SALOME read them; written against MED 4.0.

Every cell block carries its geometry number, every combination of groups one family (below zero for cells, above for
nodes), and volumes stand in MED's own node order, which is VTK's seen in a mirror.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geometry.elements import IntArray
from geometry.errors import MeshFileError
from geometry.files import written_whole
from geometry.formats.neutral import HEX_EDGES, PLACES, Places, RawMesh

VERSION = {"MAJ": 4, "MIN": 0, "REL": 1}
NO_STEP = "-0000000000000000001-0000000000000000001"
NO_PROFILE = "MED_NO_PROFILE_INTERNAL"
NAME_BYTES = 80
DIMENSION = 3
MAX_STRETCH = 1000  # of a dataset in memory over the same in the file: deflate packs no mesh tighter

_FACES = ((0, 1, 2, 3), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0), (4, 7, 6, 5))
_TET, _HEX = (0, 2, 1, 3), (0, 3, 2, 1, 4, 7, 6, 5)


@dataclass(frozen=True)
class _Kind:
    """MED's name and number of a cell type, its corners as VTK counts them, and the corners behind each MED node."""

    code: str
    number: int
    corners: tuple[int, ...] = ()
    places: Places = ()


def _volume(code: str, number: int, corners: tuple[int, ...], *middles: tuple[int, ...]) -> _Kind:
    return _Kind(code, number, corners, (*((i,) for i in range(len(corners))), *middles))


KINDS = {
    "vertex": _Kind("PO1", 1),
    "line": _Kind("SE2", 102),
    "line3": _Kind("SE3", 103),
    "triangle": _Kind("TR3", 203),
    "triangle6": _Kind("TR6", 206),
    "quad": _Kind("QU4", 204),
    "quad8": _Kind("QU8", 208),
    "quad9": _Kind("QU9", 209),
    "tetra": _volume("TE4", 304, _TET),
    "tetra10": _volume("T10", 310, _TET, (0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron": _volume("HE8", 308, _HEX),
    "hexahedron20": _volume("H20", 320, _HEX, *HEX_EDGES),
    "hexahedron27": _volume("H27", 327, _HEX, *HEX_EDGES, *_FACES, tuple(range(8))),
    "pyramid": _Kind("PY5", 305),
    "pyramid13": _Kind("P13", 313),
    "wedge": _Kind("PE6", 306),
    "wedge15": _Kind("P15", 315),
    "wedge18": _Kind("P18", 318),
}
BY_CODE = {kind.code: name for name, kind in KINDS.items()}


def from_vtk(cell_type: str) -> IntArray:
    """Place in VTK's order of each node in MED's order (medcoupling 9.15, Code_Aster's lrmtyp.F90). Source: med41."""
    kind = KINDS[cell_type]
    if not kind.places:
        return np.arange(len(PLACES[cell_type]))
    named = [frozenset(place) for place in PLACES[cell_type]]
    return np.array([named.index(frozenset(kind.corners[c] for c in place)) for place in kind.places])


def write_med(raw: RawMesh, path: str | os.PathLike[str], name: str) -> None:
    """Write a mesh in m with its groups of cells and nodes; the file appears whole or not at all.

    Raises ModuleNotFoundError without h5py.
    """
    import h5py

    with written_whole(path) as temporary, h5py.File(temporary, "w") as file:
        _attributes(file.create_group("INFOS_GENERALES"), VERSION)
        step = _mesh_group(file, name)
        cell_families, node_families = _families(raw)
        nodes = step.create_group("NOE")
        _attributes(nodes, {"CGT": 1, "CGS": 1, "PFL": NO_PROFILE})
        _data(nodes, "COO", raw.points.T.ravel(), len(raw.points))
        _data(nodes, "FAM", node_families.of[0], len(raw.points))
        cells = step.create_group("MAI", track_order=True)
        _attributes(cells, {"CGT": 1})
        for (cell_type, block), family in zip(raw.blocks, cell_families.of, strict=True):
            _write_block(cells, cell_type, block, family)
        _write_families(file, name, cell_families, node_families)


def _mesh_group(file: Any, name: str) -> Any:
    """The mesh and its only time step."""
    mesh = file.create_group(f"ENS_MAA/{name}")
    words = {"DES": " ", "NOM": "".join(a.ljust(16) for a in "xyz"), "UNI": "m".ljust(16) * DIMENSION, "UNT": " "}
    numbers = {"DIM": DIMENSION, "ESP": DIMENSION, "REP": 0, "SRT": 0, "TYP": 0, "NXI": -1, "NXT": -1}
    _attributes(mesh, words | numbers)
    step = mesh.create_group(NO_STEP)
    _attributes(step, {"CGT": 1, "NDT": -1, "NOR": -1, "NXI": -1, "NXT": -1, "PDT": 0.0, "PVI": -1, "PVT": -1})
    return step


def _write_block(cells: Any, cell_type: str, block: IntArray, family: IntArray) -> None:
    kind = KINDS[cell_type]
    group = cells.create_group(kind.code)
    _attributes(group, {"CGT": 1, "CGS": 1, "PFL": NO_PROFILE, "GEO": kind.number})
    _data(group, "NOD", block[:, from_vtk(cell_type)].T.ravel() + 1, len(block))
    _data(group, "FAM", family, len(block))


def _attributes(group: Any, values: Mapping[str, Any]) -> None:
    for name, value in values.items():
        group.attrs[name] = np.bytes_(value) if isinstance(value, str) else value


def _data(group: Any, name: str, values: Any, count: int) -> None:
    _attributes(group.create_dataset(name, data=values), {"CGT": 1, "NBR": count})


@dataclass(frozen=True)
class _Families:
    """Family numbers per block, and the group names behind each number."""

    of: list[IntArray]
    groups: dict[int, tuple[str, ...]]


def _families(raw: RawMesh) -> tuple[_Families, _Families]:
    sizes = [len(block) for _, block in raw.blocks]
    cells = _numbered(sizes, raw.cell_groups, -1)
    return cells, _numbered([len(raw.points)], {name: {0: nodes} for name, nodes in raw.node_groups.items()}, 1)


def _numbered(sizes: list[int], groups: Mapping[str, Mapping[int, IntArray]], sign: int) -> _Families:
    """One family per combination of groups that occurs; 0 stands for none."""
    names = sorted(groups)
    if not names:
        return _Families([np.zeros(size, dtype=np.int64) for size in sizes], {})
    member = np.zeros((sum(sizes), len(names)), dtype=bool)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    for column, name in enumerate(names):
        for block, chosen in groups[name].items():
            member[starts[block] + chosen, column] = True
    combinations, inverse = np.unique(member, axis=0, return_inverse=True)
    number = np.zeros(len(combinations), dtype=np.int64)
    inside = combinations.any(axis=1)
    number[inside] = sign * np.arange(1, inside.sum() + 1)
    behind = {
        int(n): tuple(name for name, on in zip(names, row, strict=True) if on)
        for n, row in zip(number, combinations, strict=True)
        if n
    }
    return _Families(np.split(number[inverse.ravel()], starts[1:-1]), behind)


def _write_families(file: Any, name: str, cells: _Families, nodes: _Families) -> None:
    place = file.create_group(f"FAS/{name}")
    _attributes(place.create_group("FAMILLE_ZERO"), {"NUM": 0})
    for title, families in (("ELEME", cells), ("NOEUD", nodes)):
        if not families.groups:
            continue
        branch = place.create_group(title, track_order=True)
        for number, names in families.groups.items():
            family = branch.create_group(f"FAM_{number}")
            _attributes(family, {"NUM": number})
            group = family.create_group("GRO")
            _attributes(group, {"NBR": len(names)})
            letters = np.array([list(n.encode().ljust(NAME_BYTES)) for n in names], dtype=np.int8)
            group.create_dataset("NOM", (len(names),), dtype=np.dtype((np.int8, (NAME_BYTES,))))[...] = letters


def read_med(path: str | os.PathLike[str]) -> RawMesh:
    """The one mesh of a MED file.

    MeshFileError when the file is not MED or holds no mesh, several, or one with a wrong index.
    """
    import h5py

    file = Path(path)
    try:
        with h5py.File(file, "r") as opened:
            return _read(opened, file)
    except MeshFileError:
        raise
    except Exception as fault:  # h5py raises whatever the damaged bytes lead it to, RuntimeError and TypeError included
        reason = " ".join(str(fault).split())
        raise MeshFileError(f"{file}: not a readable MED file ({type(fault).__name__}: {reason[:120]})") from fault


def _read(opened: Any, file: Path) -> RawMesh:
    names = list(opened["ENS_MAA"]) if "ENS_MAA" in opened else []
    if len(names) != 1:
        raise MeshFileError(
            f"{file}: holds {len(names)} MED meshes ({', '.join(names) or 'none'}), must be exactly one"
        )
    steps = opened["ENS_MAA"][names[0]]
    if len(steps) != 1:
        raise MeshFileError(f"{file}: the mesh {names[0]} has {len(steps)} time steps, must have exactly one")
    step = steps[next(iter(steps))]
    coordinates = step["NOE/COO"]
    count = int(coordinates.attrs["NBR"])
    points = _columns(coordinates, count, DIMENSION, file).astype(float)
    blocks, families = [], []
    for code, group in step["MAI"].items():
        size = int(group["NOD"].attrs["NBR"])
        name = BY_CODE.get(code, code)
        nodes = _columns(group["NOD"], size, len(PLACES[name]) if name in PLACES else None, file).astype(np.int64)
        blocks.append(_block(name, nodes - 1))
        families.append(_family(group, size, file))
    cells, nodes_named = _names(opened, names[0], "ELEME", file), _names(opened, names[0], "NOEUD", file)
    node_groups = _grouped([_family(step["NOE"], count, file)], nodes_named)
    return RawMesh(points, blocks, _grouped(families, cells), {name: at[0] for name, at in node_groups.items()})


def _columns(data: Any, count: int, width: int | None, file: Path) -> Any:
    """A dataset that holds `width` values of each of `count` things, all firsts before all seconds, as (count, width)."""
    size = int(np.prod(data.shape))
    if data.dtype.kind not in "if" or count < 0 or (size % count if count else size):
        raise MeshFileError(
            f"{file}: {data.name}: {size} values of type {data.dtype}, must be numbers of {count} (NBR)"
        )
    if count and width is not None and size != count * width:
        raise MeshFileError(f"{file}: {data.name}: {size // count} values of each of {count}, must be {width}")
    _check_size(data, file)
    return np.asarray(data[...]).reshape(-1, max(count, 1)).T[:count].copy()


def _check_size(data: Any, file: Path) -> None:
    """MeshFileError for a dataset that claims to hold far more than it stores."""
    claimed = int(np.prod(data.shape)) * data.dtype.itemsize
    if claimed > MAX_STRETCH * max(data.id.get_storage_size(), 1):
        raise MeshFileError(f"{file}: {data.name}: says to hold {claimed} bytes, but stores almost none of them")


def _block(name: str, med: IntArray) -> tuple[str, IntArray]:
    if name not in PLACES:
        return name, med
    block = np.empty_like(med)
    block[:, from_vtk(name)] = med
    return name, block


def _family(group: Any, count: int, file: Path) -> IntArray:
    if "FAM" not in group:
        return np.zeros(count, dtype=np.int64)
    return np.asarray(_columns(group["FAM"], count, 1, file)[:, 0], dtype=np.int64)


def _names(opened: Any, mesh: str, title: str, file: Path) -> dict[int, list[str]]:
    """Group names behind each family number."""
    names_of: dict[int, list[str]] = {}
    branch = opened.get(f"FAS/{mesh}/{title}")
    for family in branch.values() if branch is not None else ():
        if "GRO" in family:
            _check_size(family["GRO/NOM"], file)
            letters = np.asarray(family["GRO/NOM"][...], dtype=np.int8)
            names_of[int(family.attrs["NUM"])] = [
                row.tobytes().decode("utf-8", "replace").strip(" \0") for row in letters.reshape(len(letters), -1)
            ]
    return names_of


def _grouped(families: list[IntArray], names: dict[int, list[str]]) -> dict[str, dict[int, IntArray]]:
    groups: dict[str, dict[int, IntArray]] = {}
    for block, numbers in enumerate(families):
        for name in sorted({name for number in np.unique(numbers) for name in names.get(int(number), [])}):
            inside = [number for number, behind in names.items() if name in behind]
            groups.setdefault(name, {})[block] = np.flatnonzero(np.isin(numbers, inside))
    return groups
