"""The explorer as one file: the page, the reduced matrices, and a worker of the browser that answers as the program does."""

from __future__ import annotations

import base64
import gzip
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import legendre, polynomial

from geometry.elements import FloatArray
from geometry.layout import SHORT, Design
from geometry.materials import Isotropic
from pipeline.errors import InputError
from pipeline.explore.answer import (
    ALIKE,
    FINER,
    NARROW,
    NEAR,
    POINTS,
    PROFILE,
    STEEPEST_DB,
    STRAIGHT_DB,
    WIDE_M,
    WORDS,
    Explorer,
    Limit,
)
from pipeline.models import live_column
from pipeline.models.live_column import FACE, INNER, PANEL, boundary_error, end_layer, thin_error
from pipeline.models.parametric import CellModel, MeshTable
from pipeline.planning import mesh_rules
from pipeline.quantity import GRAM, MM, figure
from pipeline.search.terms import mass_kg
from solvers.analytic.beams import free_free_mode
from solvers.analytic.predesign import free_kx_per_m
from solvers.fem import surface
from solvers.measures import confinement, target_mode
from solvers.parametric import affine, bands, bare, block, finite
from solvers.parametric.affine import NAMES
from solvers.parametric.block import ReducedBlock, Sector
from solvers.parametric.cell import ParametricCell, lower
from solvers.superelement.cell import KNOWN, rigid_polynomials
from solvers.superelement.interface import Interface
from solvers.waves import branches, complex_bands, gaps

Plain = dict[str, Any]
PAGE = Path(__file__).with_name("page")
SCRIPTS = "figures.js", "explore.js"  # of the page
WORKER = "figures.js", "model.js", "worker.js"
SOLVER = Path(__file__).parent / "vendor" / "ml-matrix.min.js"
# constants of the target mode, and of its search
RULE = {
    "similar": target_mode.MIN_MAC, "clear": target_mode.MIN_MAC_SINGLE, "lead": target_mode.LEAD,
    "majority": target_mode.MAJORITY, "rival": target_mode.RIVAL, "named": target_mode.MAX_RIVALS,
    "past": target_mode.WINDOW_MARGIN, "step": target_mode.STEP, "steps": target_mode.STEPS, "rounds": target_mode.ROUNDS,
}  # fmt: skip
CONSTANTS = {
    "beside": block.BESIDE, "flat": bands.FLAT, "safety": bands.SAFETY, "smallest": gaps.SMALLEST,
    "negligible": confinement.NEGLIGIBLE, "short": SHORT, "wide_m": WIDE_M, "steepest_db": STEEPEST_DB,
    "propagating": complex_bands.PROPAGATING, "tiny": complex_bands.TINY, "felt": branches.FELT,
    "known": KNOWN,
}  # fmt: skip
LACKING = {
    "outside": affine.OUTSIDE,
    "narrow": "side = {side:g} mm: the zone must be at least two pillar sides wide",
    "middle": "the first row's cell reaches over the zone's middle: no live answer for the plate",
    "shifted": "array.stagger: a shifted row holds no pillar: zone.length_mm must be at least {least:g}",
    "cut": "an extension below {least} mm cuts through the last rows' cells: this page has no answer for such a plate "
    "without its program, antinode explore",
}
MAX_BYTES = 16_000_000
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' blob:; worker-src blob:; style-src 'unsafe-inline'; img-src data:"
)


class _Numbers:
    """Large arrays one after another in single precision; a place stands for each."""

    def __init__(self) -> None:
        self.parts: list[np.ndarray] = []
        self.length = 0

    def put(self, values: FloatArray) -> Plain:
        """The place of an array's numbers."""
        flat = np.asarray(values, dtype="<f4").ravel()
        self.parts.append(flat)
        self.length += len(flat)
        return {"at": self.length - len(flat), "length": len(flat)}

    def text(self) -> str:
        """All of them, bytes of like weight together (they compress better), as base64."""
        whole = np.concatenate(self.parts).view(np.uint8).reshape(-1, 4).T
        return base64.b64encode(gzip.compress(whole.tobytes(), 9, mtime=0)).decode()


def page(explorer: Explorer) -> str:
    """The page's HTML, to be opened from a file. InputError where it would be larger than MAX_BYTES."""
    numbers = _Numbers()
    document = model_document(explorer, numbers)
    files = {path.name: path.read_text(encoding="utf-8") for path in PAGE.iterdir()}
    data = json.dumps(document, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    scripts = [
        f'<script type="application/json" id="model">{data}</script>',
        f'<script type="text/plain" id="numbers-of-model">{numbers.text()}</script>',
        f'<script type="text/plain" id="worker">{worker()}</script>',
        *(f"<script>{files[name]}</script>" for name in SCRIPTS),
    ]
    html = files["index.html"].replace(
        "\n".join(f'<script src="{name}"></script>' for name in SCRIPTS), "\n".join(scripts)
    )
    style = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n<style>{files["explore.css"]}</style>'
    html = html.replace('<link rel="stylesheet" href="explore.css">', style)
    if len(html.encode()) > MAX_BYTES:
        size, most = len(html.encode()) / 1e6, MAX_BYTES / 1e6
        raise InputError(f"the explorer's page would have {figure(size)} MB, more than {most:g} MB")
    return html


def worker() -> str:
    """Return the text of the worker that answers in the browser."""
    return "\n".join(path.read_text(encoding="utf-8") for path in [SOLVER, *(PAGE / name for name in WORKER)])


def model_document(explorer: Explorer, numbers: _Numbers) -> Plain:
    """Everything that the worker needs, large arrays as places among the numbers."""
    scene, model = explorer.scene, explorer.model
    case, cell = scene.case, model.cell
    design, box = case.design, cell.box
    return scene.document() | {
        "case_template": scene.template(),
        "cloud": [given | {"mass_g": mass_kg(scene.at(given).design) / GRAM} for given in explorer.cloud_designs],
        "constants": CONSTANTS,
        "words": WORDS | LACKING | {"tight": box.tight},
        "zone_length": design.length_m,
        "reference": cell.reference,
        "angular": cell.scale.angular,
        "following": scene.following,
        "foot": {name: getattr(box.foot, name) for name in ("reach", "widest", "footprint")},
        "box": {"names": NAMES, "low": box.low, "high": box.high, "clearance": box.clearance_m, "panel": box.panel}
        | {name: getattr(box, name) for name in ("narrow", "panels", "is_alike")},
        "blocks": [_block(cell, block, numbers) for block in cell.blocks],
        "touch_m": cell.touch_m.tolist(),
        "touch_weights": cell.touch_weights.tolist(),
        "turned": cell.turned.tolist() if box.is_alike else [],
        "bands_inner": vars(bands.INNER),
        "face_inner": vars(INNER),
        "face": _face(FACE),
        "lines": _matrix(branches.line_gram(FACE, box.panel)),
        "bare": _bare(design.stack.material.as_isotropic),
        "zone_width": design.width_m,
        "kx": case.target_kx_per_m,
        "half_wave": design.half_wavelength_m or design.width_m,
        "plate_density": design.stack.material.density_kg_m3,
        "windows": _windows(design, scene.limits["thickness"]),
        "panel": PANEL,
        "reach": finite.REACH,
        "finite": _finite(design),
        "rule": RULE,
        "profile": PROFILE,
        "decay": {
            "points": POINTS, "finer": FINER, "narrow": NARROW, "straight": STRAIGHT_DB, "alike": ALIKE,
        },
        "mesh": _mesh(model.mesh) if model.mesh else None,
    } | _bands(model, numbers)  # fmt: skip


def _windows(design: Design, limit: Limit) -> Plain:
    """The target window by its parts: ends that thin-plate theory has, and where a search begins, Hz/m, for they go with the
    thickness; the zone between clamped sides, Hz, at every step of the thickness, m.
    """
    thicknesses = MM * np.linspace(limit.low, limit.high, round((limit.high - limit.low) / limit.step) + 1)
    clamped = [mesh_rules.clamped_hz(replace(design, thickness_m=float(thickness))) for thickness in thicknesses]
    ends = {"low": mesh_rules.target_window_hz(design)[0], "first": mesh_rules.search_window_hz(design)[0]}
    ends["high"] = mesh_rules.WINDOW[1] / mesh_rules.WINDOW[0] * ends["low"]
    slopes = {name: end / design.thickness_m for name, end in ends.items()}
    return {"thicknesses": thicknesses.tolist(), "clamped": clamped} | slopes


def _finite(design: Design) -> Plain:
    """What the finite plate and its bars are made with; sides goes with a thickness' square in m2, layer with the thickness."""
    thickness, wavenumbers = design.thickness_m, finite.wavenumbers(design).tolist()
    thin, tried = thin_error(design.nodal_lines), live_column.tried_up_to_hz(design, (0.0, 1.0))
    return {
        "lines": design.nodal_lines, "kappa": free_free_mode(design.nodal_lines).kappa, "free_kx": free_kx_per_m(design),
        "wavenumbers": wavenumbers, "tried": list(map(tried, wavenumbers)), "known": live_column.TRIED,
        "independent": finite.INDEPENDENT, "still": finite.STILL, "tied": live_column.TIED,
        "changes": live_column.CHANGES, "sharing": live_column.SHARING,
        "waves": thin, "sides": (boundary_error(design) - thin) / thickness**2,
        "layer": end_layer(design) / thickness, "near": NEAR,
    }  # fmt: skip


def _mesh(table: MeshTable) -> Plain:
    return {"corners": np.log(table.corners).tolist(), "margin": table.margin, "high": np.log(table.high).tolist()}


def _bands(model: CellModel, numbers: _Numbers) -> Plain:
    bases = model.bases
    return {
        "fractions": bases.fractions.tolist(), "labels": bases.labels, "count": bases.count, "floor": bases.floor,
        "sectors": [_sector(sector, numbers) for sector in bases.sectors],
        "rich": [_sector(sector, numbers) for sector in bases.rich],
    }  # fmt: skip


def _sector(sector: Sector, numbers: _Numbers) -> Plain:
    _, rows, width = sector.bases.shape
    return {
        "points": sector.points.tolist(), "classes": sector.classes, "rows": rows, "width": width,
        "bases": numbers.put(sector.bases),
    }  # fmt: skip


def _block(cell: ParametricCell, block: ReducedBlock, numbers: _Numbers) -> Plain:
    n = block.stiffness.shape[1]
    upper = np.triu_indices(n)
    out, whole = bands.line_forms(cell.interface, block.parity, cell.box.panel)
    return {
        "stiffness_exponents": block.stiffness_exponents.tolist(), "mass_exponents": block.mass_exponents.tolist(),
        "signs": block.signs.tolist(), "size": n, "functions": block.functions, "shares": block.shares.tolist(),
        "parity_count": block.coordinates.shape[2],
        "stiffness": numbers.put(block.stiffness[:, *upper]), "mass": numbers.put(block.mass[:, *upper]),
        "coordinates": numbers.put(block.coordinates), "touch": numbers.put(block.touch),
        "whole": _use(cell, block, cell.interface), "low": _use(cell, block, FACE),
        "lines": {"out": numbers.put(out), "whole": numbers.put(whole)},
    }  # fmt: skip


def _use(cell: ParametricCell, block: ReducedBlock, face: Interface) -> Plain:
    """Which polynomials a use of the class has, their parity among the cell's, and its rigid-body modes there."""
    parity, kept = lower(block.parity, cell.interface, face)
    panel, thin = cell.box.panel, cell.box.narrow
    still = parity.T @ rigid_polynomials(face, (*panel, 0.0))
    thick = (parity.T @ rigid_polynomials(face, (*panel, thin)) - still) / thin  # no turn moves the thickness farthest
    rigid = {"still": still.tolist(), "thick": thick.tolist()}
    return {"kept": kept.tolist(), "rigid": rigid, "parity": _matrix(parity) if face == FACE else None}


def _matrix(matrix: FloatArray) -> Plain:
    return {"n": len(matrix), "m": matrix.shape[1], "a": matrix.ravel().tolist()}


def _face(face: Interface) -> Plain:
    odd = face.mirror(0)[1] < 0.0
    return {
        "count": face.count, "layers": face.layers, "edge": face.vertex_block + face.side_block,
        "vertex": [face.vertex(index).tolist() for index in range(4)],
        "side": [face.side(index).tolist() for index in range(4)],
        "diagonal": face.diagonal().tolist(),
        "vertexOdd": odd[face.vertex(0)].tolist(), "acrossOdd": odd[face.side(2)].tolist(),
        "besideOdd": odd[face.side(0)].tolist(),
    }  # fmt: skip


def _bare(law: Isotropic) -> Plain:
    """Lame's constants over Young's modulus, and the polynomials that bare panels are made of, by rising powers."""
    gauss, weights = legendre.leggauss(surface.COUNT)
    values = bare.line_values(gauss, False)
    along, through = (polynomial.polyfit(gauss, own, own.shape[1] - 1).T.tolist() for own in values)
    return {
        "lambda": law.lame_pa / law.young_pa, "mu": law.shear_pa / law.young_pa,
        "functions": bare.functions(FACE).tolist(), "along": along, "through": through,
        "gauss": gauss.tolist(), "weights": weights.tolist(),
    }  # fmt: skip
