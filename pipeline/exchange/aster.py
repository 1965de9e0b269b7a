"""A part of a case as a Code_Aster study: MED mesh, command file, export file, and a note of what differs."""

from __future__ import annotations

from math import ceil
from pathlib import Path

import numpy as np

from geometry.formats.med import write_med
from geometry.formats.neutral import FACET, VOLUME, RawMesh, local_nodes
from pipeline.case.model import Case
from pipeline.exchange.part_mesh import CLAMP, Exchange, exchange, modes_below, rendered
from pipeline.logs import Log
from pipeline.records.outputs import delivered, write_file

ENDINGS = (".med", ".comm", ".export", "_README.txt")
MODES_A_BAND = 40  # one Lanczos subspace each: keeps its vectors and its orthogonalisation small
ABOVE_RIGID_HZ = 1.0  # a free body's band must not hold its rigid-body modes
NODES = "N_"  # before the name of a face group: the group of its nodes
MESH_NAME_LENGTH = 24


def write(case: Case, part: str, output: Path, log: Log) -> list[Path]:
    """Write NAME.med, NAME.comm, NAME.export and NAME_README.txt; `output` gives folder and name."""
    part_mesh = exchange(case, part, log)
    med, comm, export, note = places(output)
    stem = med.with_suffix("")
    with log.step("write MED"), delivered(med) as temporary:
        write_med(raw_mesh(part_mesh), temporary, mesh_name(part_mesh))
    bounds = _bounds(case, part_mesh, log)
    write_file(comm, commands(part_mesh, bounds).encode())
    write_file(export, export_file(stem.name).encode())
    write_file(note, _note(part_mesh, stem.name).encode())
    log.info(f"run it with: run_aster {export.name}")
    return [med, comm, export, note]


def places(output: Path) -> list[Path]:
    """Where the study goes: NAME.med, NAME.comm, NAME.export, NAME_README.txt."""
    name = output.stem if output.suffix in ENDINGS else output.name
    return [output.with_name(name + ending) for ending in ENDINGS]


def mesh_name(part_mesh: Exchange) -> str:
    """The mesh's name in the MED file."""
    return part_mesh.part.upper()[:MESH_NAME_LENGTH]


def raw_mesh(part_mesh: Exchange) -> RawMesh:
    """Volume cells, the facets of named faces, volume groups, face groups, and their nodes as N_..."""
    mesh = part_mesh.mesh
    kind = (mesh.kind, mesh.order)
    named = np.unique(np.concatenate(list(part_mesh.faces.values())))
    place = np.full(len(part_mesh.facets.nodes), -1)
    place[named] = np.arange(len(named))
    blocks = [
        (VOLUME[kind], mesh.cells[:, local_nodes(*kind)]),
        (FACET[kind], part_mesh.facets.nodes[named]),
    ]
    groups = {name: {0: cells} for name, cells in part_mesh.volumes.items()}
    groups |= {name: {1: place[facets]} for name, facets in part_mesh.faces.items()}
    return RawMesh(mesh.nodes, blocks, groups, {NODES + name: part_mesh.nodes_of(name) for name in part_mesh.faces})


def _bounds(case: Case, part_mesh: Exchange, log: Log) -> tuple[float, ...]:
    """Ends of the sub-bands, Hz: as many as the modes in the band need; none when no band is asked for."""
    if part_mesh.search.band_hz is None:
        return ()
    low, high = part_mesh.search.band_hz
    low = max(low, ABOVE_RIGID_HZ)
    below_low, below_high = modes_below(case, part_mesh.part, (low, high), log)
    count = below_high - below_low
    parts = max(1, ceil(count / MODES_A_BAND))
    log.info(f"about {count} modes from {low:g} to {high:g} Hz: {parts} sub-band(s)")
    return tuple(float(f) for f in np.linspace(low, high, parts + 1))


def commands(part_mesh: Exchange, bounds: tuple[float, ...]) -> str:
    """The command file: mesh, model, materials, clamps, matrices, count of modes, modes, results."""
    about = {
        "element": VOLUME[part_mesh.mesh.kind, part_mesh.mesh.order],
        "mesh_name": mesh_name(part_mesh),
        "clamp": CLAMP,
    }
    return rendered("aster.comm.j2", part=part_mesh, bounds=bounds, **about)


def export_file(name: str) -> str:
    """What run_aster reads: parameters, files in (D) and results (R) with their units; paths beside this file."""
    return rendered("aster.export.j2", name=name)


def _note(part_mesh: Exchange, name: str) -> str:
    search = part_mesh.search
    window = f"--band {search.band_hz[0]:g}Hz:{search.band_hz[1]:g}Hz" if search.band_hz else f"--count {search.count}"
    window = f"--near {search.near_hz:g}Hz {window}" if search.near_hz and not search.band_hz else window
    about = {"element": VOLUME[part_mesh.mesh.kind, part_mesh.mesh.order], "clamp": CLAMP, "nodes": NODES}
    return rendered("aster_README.txt.j2", part=part_mesh, name=name, window=window, **about)
