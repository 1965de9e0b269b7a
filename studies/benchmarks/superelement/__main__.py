"""The computed cell beside the full solves of the same cell mesh: time, memory, error and reductions, cold, in one process.

`python -m studies.benchmarks.superelement` prints every figure; the full plate is solved last.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from geometry.hex.boxes import cell_boxes, hex_mesh, plate_boxes
from geometry.hex.scenes import HexSettings
from geometry.lattice import path_through
from geometry.layout import Design
from geometry.tiling import lattice_panel
from pipeline.batch import peak_memory
from pipeline.models.parts import PartModel
from pipeline.planning import mesh_rules
from solvers.fem.assembly import Scale, assemble
from solvers.fem.eigen import Modes, modes_in_band
from solvers.fem.solid import CLASSES, SolidModel
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import Lattice
from solvers.waves.bloch import BlochCell
from studies import ladder
from studies.benchmarks.superelement import modal_overlap

ACCURACY = 0.003
PLATE_ACCURACY = 0.01  # finer cells make a solid plate that no 8 GB hold
TONES_HZ = np.linspace(30.5e3, 33.5e3, 601)  # inside the band, where modes left out hardly reach
BAND_HZ = (30e3, 34e3)


class Cache:
    """Cells kept in memory between the plates of one process."""

    def __init__(self) -> None:
        self.kept: dict[str, Any] = {}

    def get(self, key: str) -> Any:
        """A cell, or None."""
        return self.kept.get(key)

    def put(self, key: str, cell: Any) -> None:
        """Keep a cell."""
        self.kept[key] = cell


def reductions(design: Design, reduction: Any, cache: Cache | None = None) -> Reductions:
    """Reductions that never look at the disk."""
    return Reductions(design.thickness_m, design.material, design.pillar, reduction, cache)


def bands() -> dict[str, Any]:
    """25 intervals a segment, 10 bands: reduction and wavevectors, against sparse Bloch solves of the same mesh."""
    design = ladder.design()
    start = time.perf_counter()
    lattice = Lattice(reductions(design, mesh_rules.lattice_reduction(design, ACCURACY)).cell(lattice_panel(design)))
    reduced = time.perf_counter() - start
    path = path_through("GXMG", 25, design.pitch_x_m, design.pitch_y_m)
    start = time.perf_counter()
    measured = np.array([lattice.frequencies(k, 10) for k in path.wavevectors])
    swept = time.perf_counter() - start
    settings = mesh_rules.cell_settings(design, ACCURACY)
    start = time.perf_counter()
    full = BlochCell(assemble(hex_mesh(cell_boxes(design, settings), settings.order), ladder.materials()), 4e-3, 4e-3)
    assembled = time.perf_counter() - start
    sampled = [0, 12, 25, 37, 50, 62]
    start = time.perf_counter()
    exact = np.array([full.frequencies(path.wavevectors[i], 10) for i in sampled])
    each = (time.perf_counter() - start) / len(sampled)
    whole = assembled + each * len(path.wavevectors)
    some = exact > 1.0
    return {
        "wavevectors": len(path.wavevectors),
        "reduction_s": reduced,
        "per_wavevector_ms": 1e3 * swept / len(path.wavevectors),
        "reduced_total_s": reduced + swept,
        "full_dof": full.dof,
        "full_per_wavevector_s": each,
        "full_total_s": whole,
        "ratio": whole / (reduced + swept),
        "largest_difference": float(np.abs(measured[sampled][some] / exact[some] - 1.0).max()),
    }


def degrees() -> list[tuple[Any, ...]]:
    """Error of the ten lowest bands at Gamma, X and M over q, r and fixed-interface modes, against the same mesh in full."""
    design = ladder.design()
    coarse = HexSettings(3, 2.0 * design.thickness_m, 0, 0.2, 3.15e-3)
    system = assemble(hex_mesh(cell_boxes(design, coarse), 3), ladder.materials())
    full = BlochCell(system, design.pitch_x_m, design.pitch_y_m)
    exact = np.array([full.frequencies(k, 10) for k in ladder.points().values()])
    some, rows = exact > 1.0, []
    for q in (1, 2, 3, 4, 6):
        for r in (1, 2, 3):
            for top_hz in (250e3, 500e3, 1000e3):
                reduction = ReductionSettings(Interface(q, r), top_hz, coarse)
                lattice = Lattice(reductions(design, reduction).cell(lattice_panel(design)))
                measured = np.array([lattice.frequencies(k, 10) for k in ladder.points().values()])
                error = np.where(some, measured / np.where(some, exact, 1.0) - 1.0, 0.0)
                rows.append(
                    (q, r, len(lattice.cell.fixed_hz), lattice.dof, np.abs(error[:, :6]).max(), np.abs(error).max())
                )
    return rows


def plates(with_solid: bool = True) -> dict[str, Any]:
    """One row and 5 mm joined against the solid of the same cell mesh; three rows and 25 mm; what a change costs."""
    design, entry = ladder.plate_design(), {}
    reduction = mesh_rules.plate_reduction(design, PLATE_ACCURACY, BAND_HZ[1])
    cache = Cache()
    peak_memory.restart()
    before, start = peak_memory.resident_bytes(), time.perf_counter()
    assembled = PlateModel(design, reductions(design, reduction, cache))
    measured = _all_classes(assembled)
    entry["one row + 5 mm (s)"] = time.perf_counter() - start
    entry["one row + 5 mm (MB)"] = (peak_memory.peak_bytes() - before) / 1e6
    entry["one row + 5 mm, modes"] = sum(len(modes.frequency_hz) for modes in measured.values())
    three = ladder.design()
    peak_memory.restart()
    before, start = peak_memory.resident_bytes(), time.perf_counter()
    modes = _all_classes(
        PlateModel(three, reductions(three, mesh_rules.plate_reduction(three, PLATE_ACCURACY, BAND_HZ[1])))
    )
    entry["three rows + 25 mm, cold (s)"] = time.perf_counter() - start
    entry["three rows + 25 mm (MB)"] = (peak_memory.peak_bytes() - before) / 1e6
    entry["three rows + 25 mm, modes"] = sum(len(each.frequency_hz) for each in modes.values())
    for name, changed in (
        ("one row more", replace(design, rows=2)),
        ("extension 25 mm", replace(design, extension_m=25e-3)),
        ("width 24 mm", replace(design, width_m=24e-3)),
        ("pitch 5 mm", replace(design, pitch_x_m=5e-3, pitch_y_m=5e-3)),
    ):
        counted = reductions(changed, reduction, cache)
        PlateModel(changed, counted)
        entry[f"new reductions: {name}"] = counted.fresh
    return entry | (_solid(design, assembled, measured, entry["one row + 5 mm (s)"]) if with_solid else {})


def _all_classes(model: PartModel) -> dict[str, Modes]:
    return {symmetry: modes_in_band(model.pencil(symmetry), *BAND_HZ) for symmetry in CLASSES}


def _solid(design: Design, model: PlateModel, assembled: dict[str, Modes], assembled_s: float) -> dict[str, Any]:
    settings = mesh_rules.cell_settings(design, PLATE_ACCURACY)
    peak_memory.restart()
    before, start = peak_memory.resident_bytes(), time.perf_counter()
    mesh = hex_mesh(plate_boxes(design, settings), settings.order)
    full = SolidModel(mesh, ladder.materials(), (), True)
    solid = _all_classes(full)
    spent = time.perf_counter() - start
    entry: dict[str, Any] = {
        "solid dof": 3 * len(mesh.nodes),
        "solid (s)": spent,
        "solid (MB)": (peak_memory.peak_bytes() - before) / 1e6,
        "ratio": spent / assembled_s,
    }
    half = (design.length_m / 2.0, design.half_span_m)
    cell = next(iter(model.cells.values()))
    units = (_unit_kg(cell.scale), 4.0 * _unit_kg(full.system.scale))  # a solid's vectors belong to its quarter
    for symmetry in CLASSES:
        ours, theirs = assembled[symmetry], solid[symmetry]
        entry[f"counts {symmetry} (joined, solid)"] = (len(ours.frequency_hz), len(theirs.frequency_hz))
        if len(ours.frequency_hz) != len(theirs.frequency_hz):
            continue
        entry[f"largest difference {symmetry}"] = float(np.abs(ours.frequency_hz / theirs.frequency_hz - 1.0).max())
        pair = [
            modal_overlap.fields(modes.frequency_hz, each.touch(symmetry, modes.vectors), symmetry, half, mass_kg)
            for each, modes, mass_kg in ((model, ours, units[0]), (full, theirs, units[1]))
        ]
        for first_hz, count, angle in modal_overlap.cluster_angles(*pair):
            entry[f"angle {symmetry}, {count} from {first_hz:.0f} Hz (degrees)"] = angle
        if symmetry == "SS":
            entry |= _receptances(*pair)
    return entry


def _unit_kg(scale: Scale) -> float:
    """The unit of mass in which a model's vectors are normalised."""
    return scale.density_kg_m3 * scale.length_m**3


def _receptances(ours: modal_overlap.Fields, theirs: modal_overlap.Fields) -> dict[str, Any]:
    """The peaks of both curves, and how far apart they are with the solid's frequencies put under both."""
    curves = [modal_overlap.receptance(ours, TONES_HZ), modal_overlap.receptance(theirs, TONES_HZ)]
    aligned = modal_overlap.receptance(modal_overlap.Fields(theirs.frequency_hz, ours.coefficients), TONES_HZ)
    tops = [(float(TONES_HZ[int(curve.argmax())]), float(curve.max() / curves[1].max())) for curve in curves]
    return {
        "receptance at the middle: highest peak, joined (Hz, share of the solid's)": tops[0],
        "receptance at the middle: highest peak, solid (Hz)": tops[1][0],
        "receptance: largest difference of the curves, shapes alone (share of the peak)": float(
            np.abs(aligned - curves[1]).max() / curves[1].max()
        ),
    }


def main() -> None:
    """Print it."""
    print("q  r  modes  degrees of freedom  error of bands 1-6  of bands 1-10")
    for row in degrees():
        print("{:d}  {:d}  {:5d}  {:8d}  {:18.1e}  {:13.1e}".format(*row), flush=True)
    for name, table in (("bands", bands), ("plates", plates)):
        for key, value in table().items():
            print(f"{name}: {key}: {value:.4g}" if isinstance(value, float) else f"{name}: {key}: {value}", flush=True)


if __name__ == "__main__":
    main()
