"""A part of a case as a Code_Aster study: MED mesh, command file, export file, and a note of what differs."""

from __future__ import annotations

from math import ceil
from pathlib import Path

import numpy as np

from geometry.formats.med import write_med
from geometry.formats.neutral import FACET, VOLUME, RawMesh, local_nodes
from geometry.materials import Material
from pipeline.case.model import Case
from pipeline.exchange.part_mesh import CLAMP, Exchange, exchange, modes_below
from pipeline.logs import Log
from pipeline.records.outputs import delivered, write_file

ENDINGS = (".med", ".comm", ".export", "_README.txt")
MODES_A_BAND = 40  # one Lanczos subspace each: keeps its vectors and its orthogonalisation small
ABOVE_RIGID_HZ = 1.0  # a free body's band must not hold its rigid-body modes
NODES = "N_"  # before the name of a face group: the group of its nodes
MESH_NAME_LENGTH = 24
UNITS = {".med": ("mmed", "D", 20), ".comm": ("comm", "D", 1)}
RESULTS = {".mess": ("mess", 6), ".resu": ("resu", 8), ".rmed": ("rmed", 80)}


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
    materials = {volume: f"MAT_{volume}" for volume in part_mesh.volumes}
    blocks = [
        _head(part_mesh),
        'DEBUT(LANG="EN")',
        f'MESH = LIRE_MAILLAGE(FORMAT="MED", UNITE=20, NOM_MED="{mesh_name(part_mesh)}", VERI_MAIL=_F(VERIF="OUI"))',
        _model(part_mesh),
        *(_material(name, part_mesh.materials[volume]) for volume, name in materials.items()),
        _affected(materials),
        *(_clamp() if part_mesh.clamped else ()),
        _matrices(part_mesh.clamped),
        *_modes(part_mesh, bounds),
        'MODES = NORM_MODE(reuse=MODES, MODE=MODES, NORME="MASS_GENE")',
        'IMPR_RESU(FORMAT="MED", UNITE=80, RESU=_F(RESULTAT=MODES, NOM_CHAM="DEPL"))',
        'FREQS = RECU_TABLE(CO=MODES, NOM_PARA=("FREQ", "MASS_GENE", "RIGI_GENE"))',
        'IMPR_TABLE(TABLE=FREQS, UNITE=8, FORMAT="TABLEAU", FORMAT_R="E20.13", SEPARATEUR=" ; ")',
        "FIN()",
    ]
    return "\n\n".join(blocks) + "\n"


def _head(part_mesh: Exchange) -> str:
    mesh = part_mesh.mesh
    return (
        f"# {part_mesh.name}: the whole {part_mesh.part}, {len(mesh.cells)} {VOLUME[mesh.kind, mesh.order]}, "
        f"{mesh.dof} degrees of freedom.\n# Units: m, Pa, kg/m3, Hz. Mesh sha256 {mesh.sha256}. Written by antinode."
    )


def _model(part_mesh: Exchange) -> str:
    return (
        f"MODEL = AFFE_MODELE(MAILLAGE=MESH, AFFE=_F(GROUP_MA={_names(part_mesh.volumes)}, "
        'PHENOMENE="MECANIQUE", MODELISATION="3D"))'
    )


def _names(names: dict[str, object] | dict[str, np.ndarray]) -> str:
    return "(" + ", ".join(f'"{name}"' for name in names) + ",)"


def _material(name: str, material: Material) -> str:
    return (
        f"# {material.name}\n{name} = DEFI_MATERIAU(ELAS=_F(E={material.young_pa!r}, NU={material.poisson!r}, "
        f"RHO={material.density_kg_m3!r}))"
    )


def _affected(materials: dict[str, str]) -> str:
    lines = [f'_F(GROUP_MA="{volume}", MATER={name})' for volume, name in materials.items()]
    return "CHMAT = AFFE_MATERIAU(MAILLAGE=MESH, AFFE=(\n    " + ",\n    ".join(lines) + ",\n))"


def _clamp() -> tuple[str]:
    return (f'CLAMPED = AFFE_CHAR_MECA(MODELE=MODEL, DDL_IMPO=_F(GROUP_MA="{CLAMP}", DX=0.0, DY=0.0, DZ=0.0))',)


def _matrices(clamped: bool) -> str:
    load = "CHARGE=CLAMPED, " if clamped else ""
    return (
        f'ASSEMBLAGE(MODELE=MODEL, CHAM_MATER=CHMAT, {load}NUME_DDL=CO("NDDL"), MATR_ASSE=(\n'
        '    _F(MATRICE=CO("RIGI"), OPTION="RIGI_MECA"),\n    _F(MATRICE=CO("MASS"), OPTION="MASS_MECA"),\n))'
    )


def _modes(part_mesh: Exchange, bounds: tuple[float, ...]) -> list[str]:
    """INFO_MODE and CALC_MODES of a band, or CALC_MODES nearest to a frequency; both checked by Sturm's count."""
    check = 'VERI_MODE=_F(STURM="OUI", STOP_ERREUR="OUI")'
    matrices = "MATR_RIGI=RIGI, MATR_MASS=MASS"
    if bounds:
        ends = "(" + ", ".join(repr(f) for f in bounds) + ")"
        return [
            f"COUNT = INFO_MODE({matrices}, FREQ={ends})",
            'IMPR_TABLE(TABLE=COUNT, UNITE=8, FORMAT="TABLEAU", SEPARATEUR=" ; ")',
            f'MODES = CALC_MODES({matrices}, OPTION="BANDE", CALC_FREQ=_F(FREQ={ends}), {check})',
        ]
    near, count = part_mesh.search.near_hz or 0.0, part_mesh.search.count
    if near:
        option, where = "CENTRE", f"FREQ={near!r}, NMAX_FREQ={count}"
    else:
        option, where = "PLUS_PETITE", f"NMAX_FREQ={count if part_mesh.clamped else (count or 0) + 6}"
    return [f'MODES = CALC_MODES({matrices}, OPTION="{option}", CALC_FREQ=_F({where}), {check})']


def export_file(name: str, memory_mb: int = 8192, seconds: int = 7200) -> str:
    """What run_aster reads: parameters, files in (D) and results (R) with their units; paths beside this file."""
    lines = ["P actions make_etude", f"P time_limit {seconds}", f"P memory_limit {memory_mb}"]
    lines += ["P ncpus 2", "P mpi_nbcpu 1"]
    lines += [f"F {kind} {name}{ending} {choice} {unit}" for ending, (kind, choice, unit) in UNITS.items()]
    lines += [f"F {kind} {name}{ending} R {unit}" for ending, (kind, unit) in RESULTS.items()]
    return "\n".join(lines) + "\n"


def _note(part_mesh: Exchange, name: str) -> str:
    mesh = part_mesh.mesh
    search = part_mesh.search
    window = f"--band {search.band_hz[0]:g}Hz:{search.band_hz[1]:g}Hz" if search.band_hz else f"--count {search.count}"
    window = f"--near {search.near_hz:g}Hz {window}" if search.near_hz and not search.band_hz else window
    clamp = f" --clamp {CLAMP}" if part_mesh.clamped else ""
    clamped = (
        f"the faces of group {CLAMP} are clamped"
        if part_mesh.clamped
        else "the body is free: its rigid-body modes lie below the band"
    )
    return f"""{part_mesh.name} for Code_Aster 15 or later

Run:      run_aster {name}.export
Read:     {name}.resu (frequencies), {name}.rmed (mode shapes, for SALOME or ParaVis), {name}.mess (log)
Compare:  antinode modes CASE --mesh-file {name}.med {window}{clamp}
          solves the same elements on the same mesh: frequencies must agree to rounding.

The mesh is the whole {part_mesh.part}: {len(mesh.cells)} {VOLUME[mesh.kind, mesh.order]}, {len(mesh.nodes)} nodes, in metres.
Cell groups: {", ".join(part_mesh.volumes)} (volumes, one material each); {", ".join(part_mesh.faces)} (faces).
Node groups: the same faces with {NODES} before the name.

What differs from `antinode modes CASE`:
- one body of quadratic elements here; antinode joins reduced cells (plates of boxes) or takes elements of higher order on a
  half or quarter. The coarser mesh here is stiffer: its frequencies lie higher by its own mesh error. A finer one:
  --set solve.accuracy=0.001 (the limit of degrees of freedom stays).
- no symmetry classes: every mode of the body comes, in ascending order.
- piezoelectric patches and damping are left out: free vibration of the elastic body.
- {clamped}.
- modes are scaled to unit generalised mass (NORME='MASS_GENE').
The mesh and the commands were checked by independent readers and against the command catalogue of version 16; no
Code_Aster was at hand to run them when this exporter was written.
"""
