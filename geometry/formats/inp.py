"""Input files of Abaqus and CalculiX: nodes, elements, sets and element surfaces by the format's own rules.

Keywords and parameters are read in any case. A line that begins with two asterisks is a comment wherever it stands. A set that
is given again is added to. Sets may name other sets, files may include files, parts may have instances, moved and turned.
Content that would change the modes but is not read (constraints, springs, masses, transformed coordinates) is reported.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from geometry.elements import FloatArray, IntArray, Rings
from geometry.errors import MeshFileError
from geometry.formats.neutral import DIMENSION, PLACES, RawMesh, family, order_of, require_file

MAX_DEPTH, MAX_BYTES = 8, 2_000_000_000  # of files in files, and of all together
FACE = re.compile(r"S\d{1,2}")
MAX_GENERATED = 50_000_000  # members of a set
# Endings of element names that change integration, not nodes.
VARIANTS = ("", "R", "H", "RH", "I", "IH", "M", "MH", "T", "RT", "HT", "MT", "MHT", "E", "S", "HS")
# cell types by their number of nodes
SOLIDS = {len(p): name for name, p in PLACES.items() if DIMENSION[name] == 3 and name not in ("wedge18", "pyramid14")}
FLAT = {len(p): name for name, p in PLACES.items() if DIMENSION[name] == 2}
FLAT_NAMES = ("S", "CPS", "CPE", "CAX", "M3D", "SFM3D", "STRI", "DS", "R3D", "CPEG")
LINE_NAMES = ("B2", "B3", "T2D", "T3D", "R2D", "RB", "M3D2", "LINE", "SAX", "MAX", "FRAME", "PIPE", "ELBOW")
# Corners of the faces S1, S2, ... of each solid.
FACES: dict[str, Rings] = {
    "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "hexahedron": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "pyramid": ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0)),
}
REFUSED = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "SUBSTRUCTURE", "IMPORT")
CHANGES_MODES = (
    "BOUNDARY", "MASS", "SPRING", "DASHPOT", "TIE", "MPC", "EQUATION", "COUPLING", "KINEMATIC", "DISTRIBUTING", "RIGID BODY",
    "ROTARY INERTIA", "CONTACT PAIR", "CONTACT", "TRANSFORM", "KINEMATIC COUPLING", "DISTRIBUTING COUPLING", "EMBEDDED ELEMENT",
)  # fmt: skip
T = TypeVar("T")
POINTLIKE = ("MASS", "ROTARYI", "SPRING", "DASHPOT", "GAP", "CONN", "DCOUP", "HEATCAP")


@dataclass
class _Keyword:
    """A keyword with its parameters (names in capitals) and its data lines, each a list of entries."""

    name: str
    parameters: dict[str, str]
    lines: list[list[str]]
    where: str

    def needs(self, parameter: str) -> str:
        """The value of a parameter that must be there."""
        if not self.parameters.get(parameter):
            raise MeshFileError(f"{self.where}: *{self.name} without {parameter}=")
        return self.parameters[parameter]

    def integers(self, entries: Iterable[str]) -> list[int]:
        """Whole numbers; MeshFileError for an entry that is none."""
        return self._read(int, (entry for entry in entries if entry))

    def floats(self, entries: Iterable[str]) -> list[float]:
        """Numbers, D for E allowed and nothing for 0; MeshFileError for an entry that is none."""
        return self._read(lambda entry: float(entry.upper().replace("D", "E") or 0.0), entries)

    def _read(self, number: Callable[[str], T], entries: Iterable[str]) -> list[T]:
        try:
            return [number(entry) for entry in entries]
        except ValueError as fault:
            raise MeshFileError(f"{self.where}: *{self.name}: {fault}") from fault


@dataclass
class _Part:
    """Nodes and elements by number, sets by name."""

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[int, tuple[str, tuple[int, ...]]] = field(default_factory=dict)
    sets: dict[str, dict[str, list[int]]] = field(default_factory=lambda: {"NSET": {}, "ELSET": {}})
    surfaces: dict[str, list[tuple[int, int]]] = field(default_factory=dict)  # element and face, from 0


@dataclass
class _Reading:
    """The assembly, the parts by name, and what was left out."""

    model: _Part = field(default_factory=_Part)
    parts: dict[str, _Part] = field(default_factory=dict)
    instances: dict[str, dict[str, dict[int, int]]] = field(default_factory=dict)  # name -> numbers in the model
    part: _Part | None = None  # the open part
    left_out: dict[str, None] = field(default_factory=dict)

    @property
    def here(self) -> _Part:
        return self.part if self.part is not None else self.model


def read_inp(file: Path) -> RawMesh:
    """Read nodes, elements of any solid kind, sets and surfaces.

    Sets of elements and element surfaces become groups of cells, sets of nodes groups of nodes. Nodes stand in VTK's
    order.

    Parameters
    ----------
    file : Path
        Input file of Abaqus or CalculiX.

    Returns
    -------
    RawMesh
        The mesh in the unit of the file.

    Raises
    ------
    MeshFileError
        For invalid content, and for content that is not read: generated nodes, other elements, coordinate systems.
    """
    reading = _Reading()
    for keyword in _keywords(file, [0], ()):
        if keyword.name in REFUSED:
            raise MeshFileError(f"{keyword.where}: *{keyword.name} is not read: write nodes and elements out")
        if keyword.name in CHANGES_MODES:
            reading.left_out[f"*{keyword.name}"] = None
        elif keyword.name in HANDLERS:
            HANDLERS[keyword.name](reading, keyword)
    return _raw_mesh(reading, str(file))


def _keywords(file: Path, size: list[int], inside: tuple[Path, ...]) -> Iterator[_Keyword]:
    """Keywords in their order, those of included files at their places."""
    current: _Keyword | None = None
    for where, line in _lines(file, size):
        if not line.startswith("*"):
            if current is not None and line:
                current.lines.append([entry.strip() for entry in line.split(",")])
            continue
        keyword = _keyword(line, where)
        if keyword.name == "INCLUDE":
            other, around = file.parent / keyword.needs("INPUT"), (*inside, file.resolve())
            if other.resolve() in around or len(around) > MAX_DEPTH:
                raise MeshFileError(f"{where}: *INCLUDE: {other} includes itself, or files go deeper than {MAX_DEPTH}")
            for included in _keywords(other, size, around):
                if included.name == "":  # data lines in front of the first keyword go on with the open block
                    if current is not None:
                        current.lines += included.lines
                    continue
                if current is not None:
                    yield current
                current = included
            continue
        if current is not None:
            yield current
        current = keyword
    if current is not None:
        yield current


def _lines(file: Path, size: list[int]) -> Iterator[tuple[str, str]]:
    """Lines without comments, a keyword's lines that end in a comma joined; first an empty keyword for included data."""
    require_file(file)
    size[0] += file.stat().st_size
    if size[0] > MAX_BYTES:
        raise MeshFileError(f"{file}: more than {MAX_BYTES} bytes with its included files")
    yield str(file), "*"
    head = ""
    with file.open(encoding="utf-8", errors="replace") as lines:
        for number, text in enumerate(lines, 1):
            line = text.strip()
            if line.startswith("**") or (head and not line):
                continue
            line, head = head + line, ""
            if line.startswith("*") and line.endswith(","):
                head = line
                continue
            yield f"{file}:{number}", line
    if head:
        yield f"{file}:end", head.rstrip(",")


def _keyword(line: str, where: str) -> _Keyword:
    name, *parameters = line[1:].split(",")
    pairs = (parameter.partition("=") for parameter in parameters)
    values = {"".join(key.split()).upper(): _unquoted(value) for key, _, value in pairs if key.strip()}
    return _Keyword(" ".join(name.split()).upper(), values, [], where)


def _unquoted(text: str) -> str:
    return text.strip().strip('"').strip("'")


def _named(sets: dict[str, list], name: str) -> str:
    """The spelling under which a set is known; labels are the same in any case."""
    return next((known for known in sets if known.casefold() == name.casefold()), name)


def _add(sets: dict[str, list[int]], name: str, members: Iterable[int]) -> None:
    """A set that is given again is added to."""
    sets.setdefault(_named(sets, name), []).extend(members)


def _node(reading: _Reading, keyword: _Keyword) -> None:
    if keyword.parameters.get("SYSTEM", "R").upper() != "R":
        raise MeshFileError(f"{keyword.where}: *NODE, SYSTEM={keyword.parameters['SYSTEM']} is not read: use x, y, z")
    if "INPUT" in keyword.parameters:
        raise MeshFileError(f"{keyword.where}: *NODE, INPUT= is not read: use *INCLUDE")
    here, numbers = reading.here, []
    for line in keyword.lines:
        (number,), at = keyword.integers(line[:1]) or [0], keyword.floats(line[1:4])
        x, y, z = [*at, 0.0, 0.0, 0.0][:3]
        here.nodes[number] = (x, y, z)
        numbers.append(number)
    if name := keyword.parameters.get("NSET"):
        _add(here.sets["NSET"], name, numbers)


def _element(reading: _Reading, keyword: _Keyword) -> None:
    if "INPUT" in keyword.parameters:
        raise MeshFileError(f"{keyword.where}: *ELEMENT, INPUT= is not read: use *INCLUDE")
    kind = keyword.needs("TYPE").upper()
    cell_type = _cell_type(kind, keyword.where)
    if cell_type == "point":
        reading.left_out[f"*ELEMENT, TYPE={kind}"] = None
        return
    here, numbers = reading.here, []
    size = len(PLACES[cell_type]) if cell_type != "line" else max((len(line) - 1 for line in keyword.lines), default=2)
    width = 1 + size
    entries = keyword.integers(entry for line in keyword.lines for entry in line)
    if len(entries) % width:
        raise MeshFileError(
            f"{keyword.where}: *ELEMENT, TYPE={kind}: {len(entries)} numbers do not form rows of {width}"
        )
    for begin in range(0, len(entries), width):
        number, *nodes = entries[begin : begin + width]
        if number in here.elements:
            raise MeshFileError(f"{keyword.where}: element {number} is given twice")
        here.elements[number] = (cell_type, tuple(nodes))
        numbers.append(number)
    if name := keyword.parameters.get("ELSET"):
        _add(here.sets["ELSET"], name, numbers)


def _cell_type(kind: str, where: str) -> str:
    """The cell type of an element by its name: solids, faces and lines, which only carry names, and "point" for the rest."""
    for begin in ("C3D", "DC3D", "AC3D"):
        digits = kind.removeprefix(begin)
        count = digits[: len(digits) - len(digits.lstrip("0123456789"))]
        if kind.startswith(begin) and count and int(count) in SOLIDS and digits[len(count) :] in VARIANTS:
            return SOLIDS[int(count)]
    if kind.startswith(POINTLIKE):
        return "point"
    if kind.startswith(LINE_NAMES):
        return "line"
    for begin in FLAT_NAMES:
        count = kind.removeprefix(begin)[:1]
        if kind.startswith(begin) and count.isdigit() and int(count) in FLAT:
            return FLAT[int(count)]
    raise MeshFileError(f"{where}: element type {kind} is not read; must be a solid such as C3D10, C3D15 or C3D20")


def _set(reading: _Reading, keyword: _Keyword) -> None:
    """*NSET or *ELSET."""
    which, here = keyword.name, reading.here
    name, instance = keyword.needs(which), keyword.parameters.get("INSTANCE", "")
    numbers = reading.instances.get(instance.casefold(), {}).get(which)
    if instance and numbers is None:
        raise MeshFileError(f"{keyword.where}: no instance {instance}")
    found: list[int] = []
    for line in keyword.lines:
        members = (
            _generated(keyword, line) if "GENERATE" in keyword.parameters else _members(keyword, line, reading, which)
        )
        if numbers is not None:
            strange = [member for member in members if member not in numbers]
            if strange:
                raise MeshFileError(f"{keyword.where}: *{which}: the instance has no number {strange[0]}")
            members = [numbers[member] for member in members]
        found += members
    if which == "NSET" and "ELSET" in keyword.parameters:
        elements = here.sets["ELSET"]
        inside = elements.get(_named(elements, keyword.parameters["ELSET"]), [])
        found += [node for element in inside for node in here.elements[element][1]]
    _add(here.sets[which], name, found)


def _generated(keyword: _Keyword, line: list[str]) -> list[int]:
    """First, last and increment, which is 1 where nothing is said."""
    first, last, *step = keyword.integers(line)
    increment = step[0] if step else 1
    if increment < 1 or last < first or (last - first) // increment >= MAX_GENERATED:
        raise MeshFileError(f"{keyword.where}: *{keyword.name}, GENERATE: {first}, {last}, {increment} is not a range")
    return list(range(first, last + 1, increment))


def _members(keyword: _Keyword, line: list[str], reading: _Reading, which: str) -> list[int]:
    """Numbers, names of sets, and numbers of an instance's own such as plate-1.12."""
    found: list[int] = []
    sets = reading.here.sets[which]
    for entry in filter(None, line):
        if entry.lstrip("+-").isdigit():
            found.append(int(entry))
            continue
        name = _named(sets, _unquoted(entry))
        instance, _, number = _unquoted(entry).rpartition(".")
        numbers = reading.instances.get(instance.casefold(), {}).get(which, {})
        if name in sets:
            found += sets[name]
        elif number.isdigit() and int(number) in numbers:
            found.append(numbers[int(number)])
        else:
            raise MeshFileError(f"{keyword.where}: *{keyword.name}: set {entry!r} is not defined above")
    return found


def _surface(reading: _Reading, keyword: _Keyword) -> None:
    """*SURFACE of elements' faces becomes a group of faces, one of nodes a set of nodes."""
    here, name, kind = reading.here, keyword.needs("NAME"), keyword.parameters.get("TYPE", "ELEMENT").upper()
    if kind == "NODE":
        entries = [entry for line in keyword.lines for entry in line[:1]]
        _add(here.sets["NSET"], name, _members(keyword, entries, reading, "NSET"))
        return
    if kind != "ELEMENT" or not all(len(line) > 1 and FACE.fullmatch(line[1].upper()) for line in keyword.lines):
        reading.left_out[f"*SURFACE, NAME={name}"] = None
        return
    faces = here.surfaces.setdefault(_named(here.surfaces, name), [])
    for entry, face, *_ in keyword.lines:
        for element in _members(keyword, [entry], reading, "ELSET"):
            faces.append((element, int(face[1:]) - 1))


def _part(reading: _Reading, keyword: _Keyword) -> None:
    """*PART or *END PART."""
    is_open = keyword.name == "PART"
    reading.part = reading.parts.setdefault(keyword.needs("NAME").casefold(), _Part()) if is_open else None


def _instance(reading: _Reading, keyword: _Keyword) -> None:
    """A copy of a part in the model, moved, then turned about an axis."""
    name, part = keyword.needs("NAME"), keyword.needs("PART")
    if part.casefold() not in reading.parts:
        raise MeshFileError(f"{keyword.where}: *INSTANCE of part {part}, which is not defined above")
    own = reading.parts[part.casefold()]
    moved = _moved(np.array(list(own.nodes.values()), dtype=float).reshape(-1, 3), keyword)
    model, nodes, elements = reading.model, {}, {}
    for number, at in zip(own.nodes, moved.tolist(), strict=True):
        nodes[number] = 1 + max(model.nodes, default=0) if number in model.nodes else number
        model.nodes[nodes[number]] = (at[0], at[1], at[2])
    for number, (cell_type, cell) in own.elements.items():
        elements[number] = 1 + max(model.elements, default=0) if number in model.elements else number
        model.elements[elements[number]] = (cell_type, tuple(nodes.get(node, -1) for node in cell))
    reading.instances[name.casefold()] = {"NSET": nodes, "ELSET": elements}
    for which, numbers in reading.instances[name.casefold()].items():
        for label, members in own.sets[which].items():
            there = [numbers[member] for member in members if member in numbers]
            _add(model.sets[which], label, there)
            model.sets[which].setdefault(f"{name}.{label}", []).extend(there)
    for label, faces in own.surfaces.items():
        known = model.surfaces.setdefault(label, [])
        known.extend((elements[element], face) for element, face in faces if element in elements)


def _moved(points: FloatArray, keyword: _Keyword) -> FloatArray:
    """Points translated by the first line, then turned by the second: two points of an axis and an angle in degrees."""
    lines = [keyword.floats(line) for line in keyword.lines]
    if lines:
        points = points + [*lines[0], 0.0, 0.0, 0.0][:3]
    if len(lines) > 1:
        from scipy.spatial.transform import Rotation

        first, second, angle = np.array(lines[1][:3]), np.array(lines[1][3:6]), lines[1][6]
        axis = (second - first) / np.linalg.norm(second - first)
        points = first + Rotation.from_rotvec(np.deg2rad(angle) * axis).apply(points - first)
    return np.asarray(points)


HANDLERS: dict[str, Callable[[_Reading, _Keyword], None]] = {
    "NODE": _node,
    "ELEMENT": _element,
    "NSET": _set,
    "ELSET": _set,
    "SURFACE": _surface,
    "PART": _part,
    "END PART": _part,
    "INSTANCE": _instance,
}


def _raw_mesh(reading: _Reading, file: str) -> RawMesh:
    model = reading.model
    for part in () if reading.instances else reading.parts.values():  # parts without an assembly are the model
        if len(reading.parts) > 1:
            raise MeshFileError(f"{file}: {len(reading.parts)} parts but no *INSTANCE: write the assembly to the file")
        model = part
    place = {number: i for i, number in enumerate(model.nodes)}
    points = np.array(list(model.nodes.values()), dtype=float).reshape(-1, 3)
    by_type: dict[str, list[int]] = {}
    for number, (cell_type, _) in model.elements.items():
        by_type.setdefault(cell_type, []).append(number)
    blocks: list[tuple[str, IntArray]] = []
    rows: dict[int, tuple[int, int]] = {}
    for cell_type, numbers in by_type.items():
        if cell_type == "line":
            continue
        cells = np.array([_found(place, model.elements[n][1], f"{file}: element {n}") for n in numbers])
        rows |= {number: (len(blocks), row) for row, number in enumerate(numbers)}
        blocks.append((cell_type, cells[:, order_of(cell_type, _places(cell_type))]))
    cell_groups = {name: _by_block(members, rows) for name, members in model.sets["ELSET"].items()}
    for name, faces in model.surfaces.items():
        group = cell_groups.setdefault(name, {})
        for cell_type, corners in _corners_of(faces, model, file).items():
            group[len(blocks)] = np.arange(len(corners))
            blocks.append((cell_type, np.array([[place[node] for node in each] for each in corners])))
    node_groups = {
        name: np.unique(_found(place, members, f"{file}: group {name}"))
        for name, members in model.sets["NSET"].items()
        if members
    }
    node_groups |= _line_groups(model, place)
    cell_groups = {name: parts for name, parts in cell_groups.items() if parts}
    return RawMesh(points, blocks, cell_groups, node_groups, tuple(reading.left_out))


def _places(cell_type: str) -> Rings:
    """Corners behind each node in the file's order, which differs from VTK's in the middles of faces alone."""
    places = PLACES[cell_type]
    return places if cell_type != "hexahedron27" else (*places[:20], places[26], *FACES["hexahedron"])


def _found(place: dict[int, int], numbers: Sequence[int], where: str) -> list[int]:
    missing = [number for number in numbers if number not in place]
    if missing:
        raise MeshFileError(f"{where}: node {missing[0]} is not in the file")
    return [place[number] for number in numbers]


def _line_groups(model: _Part, place: dict[int, int]) -> dict[str, IntArray]:
    """Nodes of the sets that hold lines alone."""
    found = {}
    for name, members in model.sets["ELSET"].items():
        cells = [model.elements[number] for number in members if number in model.elements]
        if cells and all(cell_type == "line" for cell_type, _ in cells):
            found[name] = np.unique([place[node] for _, nodes in cells for node in nodes if node in place])
    return found


def _by_block(members: list[int], rows: dict[int, tuple[int, int]]) -> dict[int, IntArray]:
    found: dict[int, set[int]] = {}
    for block, row in (rows[number] for number in members if number in rows):
        found.setdefault(block, set()).add(row)
    return {block: np.array(sorted(cells)) for block, cells in found.items()}


def _corners_of(faces: list[tuple[int, int]], model: _Part, file: str) -> dict[str, list[list[int]]]:
    """Nodes at the corners of elements' faces, triangles and squares apart."""
    found: dict[str, list[list[int]]] = {}
    for element, face in dict.fromkeys(faces):
        cell_type, nodes = model.elements.get(element, ("line", ()))
        if cell_type == "line":
            raise MeshFileError(f"{file}: a surface names element {element}, which is not in the file")
        of_kind = FACES.get(family(cell_type), ())
        if not 0 <= face < len(of_kind):
            raise MeshFileError(
                f"{file}: a surface names face S{face + 1} of element {element}, which it does not have"
            )
        corners = [nodes[corner] for corner in of_kind[face]]
        found.setdefault("triangle" if len(corners) == 3 else "quad", []).append(corners)
    return found
