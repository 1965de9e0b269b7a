"""Shaded images of surfaces by PyVista, off-screen, in a process of its own, and pictures of geometry and meshes by them.

A missing EGL library ends the process with a segmentation fault, which no exception handler sees: so a child draws, and
the parent looks at the image before believing it. The child is kept: loading VTK takes longer than a picture. Without it, NumPy
makes a plain projection.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import MutableMapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing.util import Finalize
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geometry.decimation import with_sides
from pipeline.paths import ROOT
from pipeline.plots import style
from pipeline.plots.fields import KINDS, FloatArray, IntArray, skin_faces
from pipeline.plots.style import ReportFigure
from pipeline.quantity import figure as figure_text
from pipeline.quantity import percentage
from pipeline.records.record import DesignRecord
from pipeline.records.study import StoredCase
from pipeline.units import GRAM, MM
from pipeline.workers import LocalWorkers, WorkerLost

TIMEOUT_S = 120.0
SAID = "said.txt"  # beside the requests
SIZE = (1500, 940)
MARGIN = 12
MIN_INK, MAX_INK = 0.005, 0.995  # share of pixels that are not background
PLAIN_COLOUR = "#AEB8C2"
_faults: list[str] = []  # why rendering failed in this process: not tried again


@dataclass(frozen=True)
class Surface:
    """A surface to show: points (n, 3), faces (m, 3 or 4), a value in 0..1 per face or None, edges drawn or not.

    `direction` points from the object to the eye.
    """

    points: NDArray[np.float64]
    faces: NDArray[np.int64]
    values: NDArray[np.float64] | None = None
    edges: bool = False
    direction: tuple[float, float, float] = (1.0, -1.6, 1.3)


def render(surfaces: Sequence[Surface]) -> tuple[list[NDArray[np.uint8]], str]:
    """Images (h, w, 3) of the surfaces, cropped, and '' or why they are plain projections instead of renderings."""
    if not surfaces:
        return [], ""
    if not _faults:
        images, fault = _by_pyvista(surfaces)
        if images:
            return [_crop(image) for image in images], ""
        _faults.append(fault)
    return [_crop(_by_hand(surface)) for surface in surfaces], _faults[0]


def _by_pyvista(surfaces: Sequence[Surface]) -> tuple[list[NDArray[np.uint8]], str]:
    with tempfile.TemporaryDirectory(prefix="antinode-render-") as name:
        folder = Path(name)
        for index, surface in enumerate(surfaces):
            _write(surface, folder / f"{index}.npz")
        fault = _drawn_apart(folder)
        images = [] if fault else [read_image(folder / f"{index}.png") for index in range(len(surfaces))]
    fault = fault or next((problem for image in images if (problem := image_fault(image))), "")
    return ([], fault) if fault else ([image for image in images if image is not None], "")


def _drawn_apart(folder: Path) -> str:
    """Draw what a folder asks for in the kept child; '' or what went wrong."""
    try:
        _child().submit(_draw_all, folder).result(TIMEOUT_S)
    except TimeoutError:
        _end_child()
        return f"rendering took longer than {TIMEOUT_S:g} s"
    except WorkerLost as error:
        return f"rendering failed: {error}{_last_words(folder)}"
    except Exception as error:
        return f"rendering failed ({type(error).__name__}: {str(error)[:120]})"
    except BaseException:  # an interruption waits for no picture
        _end_child()
        raise
    return ""


def _end_child() -> None:
    _child().kill()
    _child.cache_clear()


def _last_words(folder: Path) -> str:
    lines = (folder / SAID).read_text(errors="replace").strip().splitlines() if (folder / SAID).exists() else []
    return f" ({lines[-1][:120]})" if lines else ""


@lru_cache(maxsize=1)
def _child() -> LocalWorkers:
    """The process that draws, which ends before this one does."""
    workers = LocalWorkers(1, 1)
    Finalize(None, workers.kill, exitpriority=1)
    return workers


def _draw_all(folder: Path) -> None:
    """The child's part: an image beside each request; what graphics libraries say goes to a file, not to the terminal."""
    _prepare(os.environ)
    said = os.open(folder / SAID, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    for stream in (1, 2):
        os.dup2(said, stream)
    os.close(said)
    for request in sorted(folder.glob("*.npz")):
        _draw_with_pyvista(request)


def _prepare(environment: MutableMapping[str, str]) -> None:
    """Where there is no display, VTK draws by EGL."""
    if not environment.get("DISPLAY"):
        environment.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def _write(surface: Surface, path: Path) -> None:
    values = np.empty(0) if surface.values is None else surface.values
    look = {name: getattr(surface, name) for name in ("edges", "direction")}
    np.savez(path, points=surface.points, faces=surface.faces, values=values, look=np.array(json.dumps(look)))


def run_child(module: str, folder: Path) -> str:
    """Let a module draw what a folder asks for, in a process of its own; '' or what went wrong."""
    env = dict(os.environ)
    _prepare(env)
    command = [sys.executable, "-m", module, str(folder)]
    try:
        done = subprocess.run(command, env=env, cwd=ROOT, capture_output=True, timeout=TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        return f"rendering took longer than {TIMEOUT_S:g} s"
    except OSError as error:
        return f"rendering could not start ({error})"
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        return f"rendering ended with code {done.returncode}" + (f" ({lines[-1][:120]})" if lines else "")
    return ""


def read_image(path: Path) -> NDArray[np.uint8] | None:
    """Pixels (h, w, 3) of a PNG, None when it cannot be read."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            return np.asarray(image.convert("RGB"))
    except (OSError, SyntaxError):
        return None


def image_fault(image: NDArray[np.uint8] | None) -> str:
    """'' or why an image shows nothing."""
    if image is None:
        return "the image cannot be read"
    ink = float(np.mean(_inked(image)))
    if not MIN_INK < ink < MAX_INK:
        return f"the image is empty ({percentage(ink)} of it is not background)"
    return ""


def _inked(image: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return np.any(image < 250, axis=2)


def _crop(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    inked = _inked(image)
    rows, columns = np.flatnonzero(inked.any(axis=1)), np.flatnonzero(inked.any(axis=0))
    if not rows.size:
        return image
    top, left = max(0, rows[0] - MARGIN), max(0, columns[0] - MARGIN)
    return image[top : rows[-1] + MARGIN + 1, left : columns[-1] + MARGIN + 1]


def _by_hand(surface: Surface) -> NDArray[np.uint8]:
    """Parallel projection, faces painted from back to front and shaded by their slope."""
    from matplotlib import colormaps
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb

    eye = np.asarray(surface.direction, dtype=float) / np.linalg.norm(surface.direction)
    right = np.cross([0.0, 0.0, 1.0], eye)
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-9 else np.array([1.0, 0.0, 0.0])
    corners = surface.points[surface.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    light = 0.55 + 0.45 * np.abs(normal @ (0.8 * eye + 0.6 * np.array([0.0, 0.0, 1.0]))) / np.sqrt(1.6)
    colours = np.tile(to_rgb(PLAIN_COLOUR), (len(corners), 1))
    if surface.values is not None:
        colours = colormaps[style.QUALITY](surface.values)[:, :3]
    order = np.argsort(corners.mean(axis=1) @ eye)
    flat = corners @ np.column_stack([right, np.cross(eye, right)])
    figure = style.new_figure(SIZE[0] / 100, SIZE[1] / 100)
    axes = figure.subplots()
    shaded = np.clip(colours * light[:, None], 0, 1)[order]
    outline: Any = "#33333388" if surface.edges else shaded
    axes.add_collection(PolyCollection(flat[order], facecolors=shaded, edgecolors=outline, linewidths=0.25))
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_axis_off()
    figure.set_dpi(100)
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[:, :, :3].copy()  # type: ignore[attr-defined]


def _draw_with_pyvista(path: Path) -> None:
    import pyvista as pv

    with np.load(path) as file:
        points, faces, values, look = file["points"], file["faces"], file["values"], json.loads(str(file["look"]))
    counts = np.full((len(faces), 1), faces.shape[1])
    mesh = pv.PolyData(np.asarray(points, dtype=float) / MM, np.hstack([counts, faces]).ravel())
    plotter = pv.Plotter(off_screen=True, window_size=list(SIZE))
    plotter.set_background("white")  # type: ignore[arg-type]
    looks: dict[str, Any] = {"show_edges": look["edges"], "edge_color": "#333333", "line_width": 1, "ambient": 0.25}
    if values.size:
        looks |= {"ambient": 0.75, "diffuse": 0.3}  # shading must not be read as a value
        mesh.cell_data["value"] = values
        looks |= {"scalars": "value", "cmap": style.QUALITY, "clim": (0.0, 1.0), "show_scalar_bar": False}
    else:
        looks["color"] = PLAIN_COLOUR
    plotter.add_mesh(mesh, **looks)
    plotter.enable_parallel_projection()  # type: ignore[call-arg]
    up = (0, 0, 1) if abs(look["direction"][2]) < 0.99 * np.linalg.norm(look["direction"]) else (0, 1, 0)
    plotter.view_vector(look["direction"], viewup=up)
    plotter.camera.zoom(1.25)
    plotter.enable_anti_aliasing("ssaa")
    plotter.screenshot(str(path.with_suffix(".png")))
    plotter.close()


if TYPE_CHECKING:
    from matplotlib.axes import Axes

CORNER_M = 0.022
CAPTION = 100  # characters of a line
PLATE_PREFIXES = ("mesh", "tet")
MIXED = "panels with a pillar in tetrahedra,\nbare ones in hexahedra"
TITLES = {"plate": "Meshes of the plate, one corner", "cell": "Meshes of the unit cell"}


def report_figures(case: StoredCase, arrays: dict[str, Any]) -> list[ReportFigure]:
    """Geometry, the plate's meshes and the cell's, all rendered in one go."""
    visible = {name: surface for name, surface in _surfaces(case, arrays).items() if surface is not None}
    images, fault = render(list(visible.values()))
    picture = dict(zip(visible, images, strict=True))
    images_of_parts = [
        _geometry(case, picture, fault),
        _meshes(case, visible, picture, "plate", fault),
        _meshes(case, visible, picture, "cell", fault),
    ]
    return [report_figure for report_figure in images_of_parts if report_figure]


def _surfaces(case: StoredCase, arrays: dict[str, Any]) -> dict[str, Surface | None]:
    """What is rendered, by name: the whole plate, and each mesh's skin coloured by the quality of its faces."""
    design, faces = case.record.design, skin_faces(arrays, "surface")
    points, plain = arrays.get("surface_points"), None
    if design and faces is not None and points is not None:
        plain = Surface(points, with_sides(points, faces, design.thickness_m))
    skins = {"plate hex": "mesh", "plate tet": "tet", "cell hex": "cell", "cell tet": "cell_tet"}
    return {"geometry": plain, **{name: _mesh_surface(arrays, prefix, design) for name, prefix in skins.items()}}


def _mesh_surface(arrays: dict[str, Any], prefix: str, design: DesignRecord | None) -> Surface | None:
    faces = skin_faces(arrays, prefix)
    if faces is None:
        return None
    points = arrays[f"{prefix}_points"]
    if design and prefix in PLATE_PREFIXES:
        points, faces = _corner(points, with_sides(points, faces, design.thickness_m), design)
    return Surface(points, faces, face_quality(points, faces), edges=True, direction=(1.0, 1.6, 1.3))


def _corner(points: FloatArray, faces: IntArray, design: DesignRecord) -> tuple[FloatArray, IntArray]:
    """The corner of the plate at the largest x and y, from inside the zone's side on: elements large enough to be seen."""
    middles = points[faces].mean(axis=1)
    columns = np.unique(np.reshape(design.pillar_centres_m, (-1, 2))[:, 0])
    between = (columns[1:] + columns[:-1]) / 2  # cut no pillar
    start = design.length_m / 2 - CORNER_M
    visible = middles[:, 0] > (between[np.argmin(np.abs(between - start))] if between.size else start)
    visible &= middles[:, 1] > min(design.width_m / 2, design.half_span_m - CORNER_M)
    visible |= ~visible.any()  # a mesh that has no such corner is shown whole
    used, renumbered = np.unique(faces[visible], return_inverse=True)
    return points[used], renumbered.reshape(-1, faces.shape[1])


def _geometry(case: StoredCase, picture: dict[str, Any], fault: str) -> ReportFigure | None:
    """The whole plate from the pillars' side, dimensions beside."""
    design = case.record.design
    if design is None or "geometry" not in picture:
        return None
    image = picture["geometry"]
    figure, axes = style.panels(style.WIDTH_IN * image.shape[0] / image.shape[1] + 0.75)
    _show(axes, image)
    axes.set_title("The plate, seen from the pillars' side (the touch face is below)")
    figure.supxlabel(fill(_dimensions(design, case.record.held("geometry")), CAPTION), fontsize=8.5)
    alt = f"The plate of {case.case_id} in perspective, pillars up: {_dimensions(design, None)}.{_note(fault)}"
    return ReportFigure("geometry", "Geometry", alt, figure)


def _dimensions(design: DesignRecord, geometry: Any) -> str:
    plate = f"plate {design.length_m / MM:g} × {2 * design.half_span_m / MM:g} × {design.thickness_m / MM:g} mm"
    zones = len(design.zone_centres_m)
    words = [plate, f"{f'{zones} zones' if zones else 'zone'} {design.width_m / MM:g} mm wide"]
    pillar, pitch_m = design.pillar, design.pitch_x_m
    if pillar and pitch_m:
        rows = len({y for _, y in design.pillar_centres_m})
        columns = -(-len(design.pillar_centres_m) // max(1, rows))
        count = f"2 × {design.rows}" if rows == 2 * design.rows else f"{rows}"
        words.append(
            f"{count} rows of {columns} {pillar.shape} pillars {pillar.form.sizes_text}, "
            f"{', '.join(f'{each.height_m / MM:g}' for each in design.pillars)} mm high, {pitch_m / MM:g} mm apart"
            f"{', every other row shifted by half of that' if design.staggered else ''}"
        )
        if pillar.faces == 2:
            words.append("on both faces")
        if tip := pillar.heavy_tip:
            words.append(f"on each a tip {tip.side_m / MM:g} mm wide and {tip.height_m / MM:g} mm high")
    if geometry:
        words.append(f"{figure_text(geometry.mass_kg / GRAM)} g")
    return "; ".join(words)


def _note(fault: str) -> str:
    return f" Drawn as a plain projection: {fault}." if fault else ""


def _show(axes: Axes, image: Any) -> None:
    axes.imshow(image, interpolation="antialiased")
    axes.set_axis_off()


def face_quality(points: FloatArray, faces: IntArray) -> FloatArray:
    """Shape quality of triangles or quadrangles in 0..1, the same measure for both.

    Least over the corners of 2 |a x b| / (|a|^2 + |b|^2) with the two edges a, b of a corner, over its value for the
    regular polygon: 1 for a square or an equilateral triangle, 0 for a collapsed face. Shapes (n, 3), (m, 3 or 4) -> (m,).
    """
    corners = points[faces]
    a, b = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    area = np.linalg.norm(np.cross(a, b), axis=2)
    worst = np.min(2 * area / np.maximum(np.sum(a**2, axis=2) + np.sum(b**2, axis=2), 1e-300), axis=1)
    return np.asarray(np.minimum(1.0, worst / np.sin(np.pi * (1 - 2 / faces.shape[1]))))


def _meshes(
    case: StoredCase, visible: dict[str, Surface], picture: dict[str, Any], what: str, fault: str
) -> ReportFigure | None:
    """Meshes of the plate or of the unit cell side by side, coloured by the shape of the visible faces."""
    kinds = [kind for kind in KINDS if f"{what} {kind}" in picture]
    if not kinds:
        return None
    images = [picture[f"{what} {kind}"] for kind in kinds]
    tallest = max(image.shape[0] / image.shape[1] for image in images)
    figure, panels = style.panels(style.WIDTH_IN / 2 * tallest + 1.35, 1, len(images), squeeze=False)
    words = []
    for axes, image, kind in zip(panels[0], images, kinds, strict=True):
        _show(axes, image)
        of_triangles = visible[f"{what} {kind}"].faces.shape[1] == 3
        label = MIXED if kind == "hex" and of_triangles else _mesh_words(case, what, kind)
        axes.set_title(label)
        quality = visible[f"{what} {kind}"].values
        worst = ""
        if quality is not None and quality.size:
            worst = f", face quality {figure_text(quality.min())} to {figure_text(quality.max())}"
        words.append(label.replace("\n", ", ") + worst)
    _quality_bar(figure, panels[0])
    title = TITLES[what]
    alt = f"{title} of {case.case_id}: {'; '.join(words)}.{_note(fault)}"
    return ReportFigure(f"{what}_meshes", title, alt, figure)


def _mesh_words(case: StoredCase, what: str, kind: str) -> str:
    mesh = case.record.mesh(what, kind)
    if mesh is None:
        return KINDS[kind]
    cells, dof = (f"{count:,}".replace(",", "\u202f") for count in (mesh.cells, mesh.dof))
    return f"{KINDS[kind]}, order {mesh.order}\n{cells} cells, {dof} degrees of freedom"


def _quality_bar(figure: Any, panels: Any) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    label = "shape quality of the visible faces (no unit; 1: square or equilateral triangle)"
    look = {"orientation": "horizontal", "shrink": 0.6, "aspect": 40, "pad": 0.02, "label": label}
    figure.colorbar(ScalarMappable(Normalize(0, 1), style.QUALITY), ax=list(panels), **look)
