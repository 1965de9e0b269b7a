"""A part of a case as a CalculiX input file: C3D10 elements, sets, surfaces, materials, one frequency step."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from geometry.elements import IntArray
from pipeline.case.model import Case
from pipeline.exchange.part_mesh import CLAMP, Exchange, exchange, modes_below, rendered
from pipeline.logs import Log
from pipeline.records.outputs import delivered, is_standard_output

PER_LINE = 12  # numbers on a line of a set; CalculiX allows 16
SPARE = 1.05  # more modes than were counted: the counting model differs a little from the mesh written
SPARE_MODES = 6


def write(case: Case, part: str, output: Path, log: Log) -> list[Path]:
    """Write NAME.inp with everything a run needs (ccx NAME)."""
    part_mesh = exchange(case, part, log, tetrahedra=True)
    count = _count(case, part_mesh, log)
    path = place(output)
    with log.step("write the input file"), delivered(path) as temporary:
        temporary.write_text(input_deck(part_mesh, count))
    log.info(f"run it with: ccx {path.stem}")
    return [path]


def place(output: Path) -> Path:
    """Where the input file goes: NAME.inp, or what stands there and is no regular file, such as standard output."""
    if is_standard_output(output) or output.suffix == ".inp" or (output.exists() and not output.is_file()):
        return output
    return output.with_name(output.name + ".inp")


def _count(case: Case, part_mesh: Exchange, log: Log) -> int:
    """Number of modes to ask for: CalculiX begins at the lowest one whatever the band, so that those below count too."""
    rigid = 0 if part_mesh.clamped else 6
    if part_mesh.search.band_hz is None:
        top = part_mesh.search.near_hz or 0.0
        below = modes_below(case, part_mesh.part, (top,), log)[0] if top else rigid
        return below + (part_mesh.search.count or 1)
    high = part_mesh.search.band_hz[1]
    below = modes_below(case, part_mesh.part, (high,), log)[0]
    log.info(f"about {below} modes below {high:g} Hz: CalculiX finds them all before it drops those below the band")
    return int(SPARE * below) + SPARE_MODES


def input_deck(part_mesh: Exchange, count: int) -> str:
    """The whole input file; `count` modes are asked for from the lowest up."""
    out = io.StringIO()
    out.write(f"*HEADING\n{part_mesh.name}: the whole {part_mesh.part}, SI units (m, kg, s, N), written by antinode\n")
    out.write(f"** mesh sha256 {part_mesh.mesh.sha256}\n** mesh: {part_mesh.error_text}\n")
    _nodes(out, part_mesh)
    _elements(out, part_mesh)
    for name, places in part_mesh.faces.items():
        _set(out, f"*NSET, NSET={name}", part_mesh.nodes_of(name) + 1)
        _surface(out, part_mesh, name, places)
    out.write(rendered("calculix_materials.inp.j2", part=part_mesh, clamp=CLAMP, count=count))
    return out.getvalue()


def _nodes(out: io.StringIO, part_mesh: Exchange) -> None:
    """CalculiX reads at most 20 characters a number."""
    out.write("*NODE, NSET=NALL\n")
    numbers = np.arange(1, len(part_mesh.mesh.nodes) + 1)
    np.savetxt(out, np.column_stack([numbers, part_mesh.mesh.nodes]), fmt="%d, %.12e, %.12e, %.12e")


def _elements(out: io.StringIO, part_mesh: Exchange) -> None:
    """Local nodes stand as in our tetrahedra: corners, then middles of 12, 23, 13, 14, 24, 34."""
    for name, cells in part_mesh.volumes.items():
        out.write(f"*ELEMENT, TYPE=C3D10, ELSET={name}\n")
        np.savetxt(out, np.column_stack([cells + 1, part_mesh.mesh.cells[cells] + 1]), fmt="%d", delimiter=", ")


def _set(out: io.StringIO, head: str, members: IntArray) -> None:
    out.write(head + "\n")
    for start in range(0, len(members), PER_LINE):
        out.write(", ".join(str(n) for n in members[start : start + PER_LINE]) + ",\n")


def _surface(out: io.StringIO, part_mesh: Exchange, name: str, places: IntArray) -> None:
    """Faces of elements: our four stand in CalculiX's order S1 to S4."""
    out.write(f"*SURFACE, NAME=S_{name}, TYPE=ELEMENT\n")
    facets = part_mesh.facets
    for cell, local in zip(facets.cells[places], facets.local[places], strict=True):
        out.write(f"{cell + 1}, S{local + 1}\n")
