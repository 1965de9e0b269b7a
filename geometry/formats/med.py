"""MED files (HDF5), as Code_Aster and SALOME read them; written against MED 4.0.

Every cell block carries its geometry number, every combination of groups one family (below zero for cells, above for
nodes), and volumes stand in MED's own node order, which is VTK's seen in a mirror.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from geometry.elements import IntArray
from geometry.errors import MeshFileError
from geometry.files import written_whole
from geometry.formats.neutral import DIMENSION, PLACES, PROGRAMS, RawMesh, mirrored, order_of

VERSION = {"MAJ": 4, "MIN": 0, "REL": 1}
NO_STEP = "-0000000000000000001-0000000000000000001"
NO_PROFILE = "MED_NO_PROFILE_INTERNAL"
NAME_BYTES = 80
MAX_STRETCH = 1000  # of a dataset in memory over the same in the file: deflate packs no mesh tighter

# faces of a hexahedron as MED counts them: corners of the 21st node to the 26th
_FACES = ((0, 1, 2, 3), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0), (4, 7, 6, 5))
BY_CODE = {code: name for name, (_, code) in PROGRAMS.items() if code}


def _to_vtk(cell_type: str) -> IntArray:
    """MED's local node at each of VTK's places (medcoupling 9.15, Code_Aster's lrmtyp.F90). Source: med41."""
    places = PLACES[cell_type]
    if cell_type == "hexahedron27":
        places = (*places[:20], *_FACES, places[26])
    return order_of(cell_type, mirrored(cell_type, places) if cell_type.startswith(("tetra", "hexa")) else places)


def write_med(raw: RawMesh, path: str | os.PathLike[str], name: str) -> None:
    """Write a mesh with its groups of cells and nodes atomically.

    Parameters
    ----------
    raw : RawMesh
        The mesh in m.
    path : str or Path
        File to write.
    name : str
        Name of the mesh in the file.

    Raises
    ------
    ModuleNotFoundError
        Without h5py.
    """
    import h5py

    with written_whole(path) as temporary, h5py.File(temporary, "w") as file:
        _attributes(file.create_group("INFOS_GENERALES"), VERSION)
        step = _mesh_group(file, name)
        cell_families = _families([len(block) for _, block in raw.blocks], raw.cell_groups, -1)
        node_families = _families([len(raw.points)], {name: {0: nodes} for name, nodes in raw.node_groups.items()}, 1)
        nodes = step.create_group("NOE")
        _attributes(nodes, {"CGT": 1, "CGS": 1, "PFL": NO_PROFILE})
        _data(nodes, "COO", raw.points.T.ravel(), len(raw.points))
        _data(nodes, "FAM", node_families[0][0], len(raw.points))
        cells = step.create_group("MAI", track_order=True)
        _attributes(cells, {"CGT": 1})
        for (cell_type, block), family in zip(raw.blocks, cell_families[0], strict=True):
            _write_block(cells, cell_type, block, family)
        _write_families(file, name, cell_families, node_families)


def _mesh_group(file: Any, name: str) -> Any:
    """The mesh and its only time step."""
    mesh = file.create_group(f"ENS_MAA/{name}")
    words = {"DES": " ", "NOM": "".join(a.ljust(16) for a in "xyz"), "UNI": "m".ljust(16) * 3, "UNT": " "}
    numbers = {"DIM": 3, "ESP": 3, "REP": 0, "SRT": 0, "TYP": 0, "NXI": -1, "NXT": -1}
    _attributes(mesh, words | numbers)
    step = mesh.create_group(NO_STEP)
    _attributes(step, {"CGT": 1, "NDT": -1, "NOR": -1, "NXI": -1, "NXT": -1, "PDT": 0.0, "PVI": -1, "PVT": -1})
    return step


def _write_block(cells: Any, cell_type: str, block: IntArray, family: IntArray) -> None:
    group = cells.create_group(PROGRAMS[cell_type][1])
    number = 100 * DIMENSION[cell_type] + len(PLACES[cell_type])
    _attributes(group, {"CGT": 1, "CGS": 1, "PFL": NO_PROFILE, "GEO": number})
    _data(group, "NOD", block[:, np.argsort(_to_vtk(cell_type))].T.ravel() + 1, len(block))
    _data(group, "FAM", family, len(block))


def _attributes(group: Any, values: Mapping[str, Any]) -> None:
    for name, value in values.items():
        group.attrs[name] = np.bytes_(value) if isinstance(value, str) else value


def _data(group: Any, name: str, values: Any, count: int) -> None:
    _attributes(group.create_dataset(name, data=values), {"CGT": 1, "NBR": count})


Families = tuple[list[IntArray], dict[int, list[str]]]


def _families(sizes: list[int], groups: Mapping[str, Mapping[int, IntArray]], sign: int) -> Families:
    """Family numbers of each block and the groups behind each: one for every combination that occurs; 0 stands for none."""
    names, starts = sorted(groups), np.cumsum([0, *sizes])
    if not names:
        return [np.zeros(size, dtype=np.int64) for size in sizes], {}
    member = np.zeros((starts[-1], len(names)), dtype=bool)
    for column, name in enumerate(names):
        for block, chosen in groups[name].items():
            member[starts[block] + chosen, column] = True
    combinations, inverse = np.unique(member, axis=0, return_inverse=True)
    inside = combinations.any(axis=1)
    number = sign * np.cumsum(inside) * inside
    behind = {int(n): [names[i] for i in np.flatnonzero(row)] for n, row in zip(number, combinations, strict=True) if n}
    return np.split(number[inverse.ravel()], starts[1:-1]), behind


def _write_families(file: Any, name: str, cells: Families, nodes: Families) -> None:
    place = file.create_group(f"FAS/{name}")
    _attributes(place.create_group("FAMILLE_ZERO"), {"NUM": 0})
    for title, (_, groups) in (("ELEME", cells), ("NOEUD", nodes)):
        for number, names in groups.items():
            family = place.create_group(f"{title}/FAM_{number}")
            _attributes(family, {"NUM": number})
            group = family.create_group("GRO")
            _attributes(group, {"NBR": len(names)})
            letters = np.array([list(n.encode().ljust(NAME_BYTES)) for n in names], dtype=np.int8)
            group.create_dataset("NOM", (len(names),), dtype=np.dtype((np.int8, (NAME_BYTES,))))[...] = letters


def read_med(path: str | os.PathLike[str]) -> RawMesh:
    """Read the only mesh of a MED file.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    RawMesh
        The mesh in the unit of the file.

    Raises
    ------
    MeshFileError
        If the file is not MED, or does not hold exactly one mesh with valid indices.
    """
    import h5py

    file = Path(path)
    try:
        with h5py.File(file, "r") as opened:
            return _read(opened, file)
    except MeshFileError:
        raise
    except Exception as fault:  # damaged bytes make h5py raise almost anything, RuntimeError and TypeError included
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
    points = _columns(coordinates, count, 3, file).astype(float)
    blocks, families = [], []
    for code, group in step["MAI"].items():
        size = int(group["NOD"].attrs["NBR"])
        name = BY_CODE.get(code, code)
        nodes = _columns(group["NOD"], size, len(PLACES[name]) if name in PLACES else None, file).astype(np.int64)
        blocks.append((name, nodes[:, _to_vtk(name)] - 1 if name in PLACES else nodes - 1))
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
    """Raise MeshFileError for a dataset that claims far more bytes than it stores."""
    claimed = int(np.prod(data.shape)) * data.dtype.itemsize
    if claimed > MAX_STRETCH * max(data.id.get_storage_size(), 1):
        raise MeshFileError(f"{file}: {data.name}: claims {claimed} bytes, but stores almost none of them")


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
