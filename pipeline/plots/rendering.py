"""Shaded images of surfaces by PyVista, off-screen, in a separate process: geometry, the moving plate and meshes.

A missing EGL library ends the process with a segmentation fault, which no exception handler catches. A child process
therefore draws, and the parent checks the image. The child is reused, since loading VTK takes longer than a picture.
Without it, NumPy makes a plain projection.
"""

from __future__ import annotations

import os
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import floor, log10
from multiprocessing.util import Finalize
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geometry.decimation import with_sides
from pipeline.plots import style
from pipeline.plots.fields import KINDS, FloatArray, IntArray, mode_at, moving_design, skin_faces, zone_peak
from pipeline.plots.style import ReportFigure
from pipeline.quantity import GRAM, MM, UM, percentage
from pipeline.quantity import figure as figure_text
from pipeline.records.record import DesignRecord
from pipeline.records.study import StoredCase
from pipeline.workers import LocalWorkers, WorkerLost

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TIMEOUT_S = 120.0
SIZE = (1500, 940)
MARGIN = 12
MIN_INK, MAX_INK = 0.005, 0.995  # smallest fraction of pixels that are not background
PLAIN_COLOUR = "#AEB8C2"
_faults: list[str] = []  # reason for a failure in this process; rendering is not tried again


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
    colours: str = style.QUALITY


def render(surfaces: Sequence[Surface]) -> tuple[list[NDArray[np.uint8]], str]:
    """Return cropped images (h, w, 3) of the surfaces, and '' or why they are plain projections."""
    if not surfaces:
        return [], ""
    if not _faults:
        images, fault = drawn_apart(_draw_all, list(surfaces))
        if not fault:
            return [_crop(image) for image in images], ""
        _faults.append(fault)
    return [_crop(_by_hand(surface)) for surface in surfaces], _faults[0]


def drawn_apart(draw: Callable[..., list[NDArray[np.uint8]]], *given: Any) -> tuple[list[NDArray[np.uint8]], str]:
    """Return images that a function draws in the child, and '' or why they are unusable."""
    images: list[NDArray[np.uint8]] = []
    with tempfile.NamedTemporaryFile(prefix="antinode-render-") as said:
        try:
            images = _child().submit(_draw_quietly, Path(said.name), draw, *given).result(TIMEOUT_S)
            return images, next((fault for image in images if (fault := image_fault(image))), "")
        except TimeoutError:
            _end_child()
            return [], f"rendering took longer than {TIMEOUT_S:g} s"
        except WorkerLost as error:
            lines = said.read().decode(errors="replace").strip().splitlines()
            return [], f"rendering failed: {error}" + (f" ({lines[-1][:120]})" if lines else "")
        except Exception as error:
            return [], f"rendering failed ({type(error).__name__}: {str(error)[:120]})"
        except BaseException:  # an interruption waits for no picture
            _end_child()
            raise


def _end_child() -> None:
    _child().kill()
    _child.cache_clear()


@lru_cache(maxsize=1)
def _child() -> LocalWorkers:
    """Return the drawing process, which ends before this one."""
    workers = LocalWorkers(1, 1)
    Finalize(None, workers.kill, exitpriority=1)
    return workers


def _draw_quietly(said: Path, draw: Callable[..., Any], *given: Any) -> Any:
    """Draw in the child: messages of graphics libraries go to a file; without a display VTK uses EGL."""
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    with said.open("ab") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    return draw(*given)


def _draw_all(surfaces: Sequence[Surface]) -> list[NDArray[np.uint8]]:
    return [_draw_with_pyvista(surface) for surface in surfaces]


def image_fault(image: NDArray[np.uint8]) -> str:
    """Return '' or why an image shows nothing."""
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
    """Draw a shaded parallel projection with matplotlib; edges and values as in a rendering."""
    from matplotlib import colormaps
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    x, y, z = np.asarray(surface.direction) / np.linalg.norm(surface.direction)
    colours = PLAIN_COLOUR if surface.values is None else colormaps[surface.colours](surface.values)
    figure = style.new_figure(SIZE[0] / 100, SIZE[1] / 100)
    figure.set_layout_engine("none")
    axes: Any = figure.add_axes((0, 0, 1, 1), projection="3d", proj_type="ortho")
    look = {"edgecolors": "#33333388" if surface.edges else None, "linewidths": 0.25, "shade": surface.values is None}
    axes.add_collection3d(Poly3DCollection(surface.points[surface.faces], facecolors=colours, **look))
    low, high = surface.points.min(axis=0), surface.points.max(axis=0)
    size = np.maximum(high - low, 1e-3 * np.max(high - low))
    axes.set(**dict(zip(("xlim", "ylim", "zlim"), zip(low, low + size, strict=True), strict=True)))
    axes.set_box_aspect(size)
    above = abs(z) > 0.99  # then x points to the right
    axes.view_init(elev=np.degrees(np.arcsin(z)), azim=-90.0 if above else np.degrees(np.arctan2(y, x)))
    axes.set_axis_off()
    figure.set_dpi(100)
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[:, :, :3].copy()  # type: ignore[attr-defined]


def _draw_with_pyvista(surface: Surface) -> NDArray[np.uint8]:
    import pyvista as pv

    mesh = pv.PolyData.from_regular_faces(surface.points / MM, surface.faces)  # type: ignore[arg-type]
    plotter = pv.Plotter(off_screen=True, window_size=list(SIZE))
    plotter.set_background("white")  # type: ignore[arg-type]
    looks: dict[str, Any] = {"show_edges": surface.edges, "edge_color": "#333333", "line_width": 1, "ambient": 0.25}
    if surface.values is None:
        looks["color"] = PLAIN_COLOUR
    else:
        looks |= {"ambient": 0.75, "diffuse": 0.3}  # shading must not be mistaken for a value
        mesh.cell_data["value"] = surface.values
        looks |= {"scalars": "value", "cmap": surface.colours, "clim": (0.0, 1.0), "show_scalar_bar": False}
    plotter.add_mesh(mesh, **looks)
    plotter.enable_parallel_projection()  # type: ignore[call-arg]
    up = (0, 0, 1) if abs(surface.direction[2]) < 0.99 * np.linalg.norm(surface.direction) else (0, 1, 0)
    plotter.view_vector(surface.direction, viewup=up)
    plotter.camera.zoom(1.25)
    plotter.enable_anti_aliasing("ssaa")
    image = np.asarray(plotter.screenshot(None, return_img=True))
    plotter.close()
    return image


DRAWN_SHARE = 0.3  # largest displacement in the picture of a mode, relative to a pillar's height
CORNER_M = 0.022
CAPTION = 100  # characters per line
PLATE_PREFIXES = ("mesh", "tet")
MIXED = "panels with a pillar: tetrahedra,\nbare panels: hexahedra"
TITLES = {"plate": "Meshes of the plate, one corner", "cell": "Meshes of the unit cell"}


def report_figures(case: StoredCase, arrays: dict[str, Any]) -> list[ReportFigure]:
    """Return geometry, moving plate, pillars from above, and the meshes of plate and cell, rendered together."""
    factor = _drawn_factor(case, arrays)
    visible = {name: surface for name, surface in _surfaces(case, arrays, factor).items() if surface is not None}
    images, fault = render(list(visible.values()))
    picture = dict(zip(visible, images, strict=True))
    images_of_parts = [
        _geometry(case, picture, fault),
        _moving(case, arrays, picture, factor, fault),
        _in_plane(case, arrays, picture, fault),
        _meshes(case, visible, picture, "plate", fault),
        _meshes(case, visible, picture, "cell", fault),
    ]
    return [report_figure for report_figure in images_of_parts if report_figure]


def _surfaces(case: StoredCase, arrays: dict[str, Any], factor: float) -> dict[str, Surface | None]:
    """Return the rendered surfaces by name: plate, target mode, and each mesh coloured by the quality of its faces."""
    design, faces = case.record.design, skin_faces(arrays, "surface")
    shown: dict[str, Surface | None] = {}
    if design and faces is not None and "surface_points" in arrays:
        points = arrays["surface_points"]
        faces = with_sides(points, faces, design.thickness_m)
        shown["geometry"] = Surface(points, faces)
        if factor:
            shown |= _of_mode(arrays, design, points, faces, factor)
    skins = {"plate hex": "mesh", "plate tet": "tet", "cell hex": "cell", "cell tet": "cell_tet"}
    return shown | {name: _mesh_surface(arrays, prefix, design) for name, prefix in skins.items()}


def _drawn_factor(case: StoredCase, arrays: dict[str, Any]) -> float:
    """Return the exaggeration of the target mode for 1 um at the zone's maximum; 0 if none is stored."""
    design = moving_design(case, arrays)
    if design is None or "surface_u" not in arrays:
        return 0.0
    tallest = design.pillar.top_m if design.pillar else design.thickness_m
    largest = float(np.max(np.abs(arrays["surface_u"][0]))) / zone_peak(arrays, design) * UM
    return nice_below(DRAWN_SHARE * tallest / max(1e-30, largest))


def nice_below(value: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten not above a positive value."""
    decade = 10.0 ** floor(log10(value))
    return next(step * decade for step in (5.0, 2.0, 1.0) if step * decade <= value * (1 + 1e-12))


def _of_mode(
    arrays: dict[str, Any], design: DesignRecord, points: FloatArray, faces: IntArray, factor: float
) -> dict[str, Surface]:
    """Return the displaced plate coloured by u_z, and the pillars from above coloured by displacement along x and y."""
    u = arrays["surface_u"][0] / zone_peak(arrays, design)
    shown = {"mode": Surface(points + factor * UM * u, faces, _signed(u[:, 2], faces, 1.0), colours=style.SIGNED)}
    if limit := in_plane_limit(arrays, design):
        for axis, name in enumerate("xy"):
            look: dict[str, Any] = {"direction": (0.0, 0.0, 1.0), "colours": style.SIGNED}
            shown[f"{name} above"] = Surface(points, faces, _signed(u[:, axis], faces, limit), **look)
    return shown


def _signed(values: FloatArray, faces: IntArray, limit: float) -> FloatArray:
    """Return a value per face in 0..1, one half for 0."""
    return np.asarray(np.clip(0.5 + 0.5 * values[faces].mean(axis=1) / limit, 0.0, 1.0))


def in_plane_limit(arrays: dict[str, Any], design: DesignRecord) -> float:
    """Return the pillars' largest displacement along x or y relative to the zone's maximum; 0 without pillars."""
    high = arrays["surface_points"][:, 2] > design.thickness_m * (1.0 + 1e-6)
    return float(np.max(np.abs(arrays["surface_u"][0][high, :2]), initial=0.0)) / zone_peak(arrays, design)


def _mesh_surface(arrays: dict[str, Any], prefix: str, design: DesignRecord | None) -> Surface | None:
    faces = skin_faces(arrays, prefix)
    if faces is None:
        return None
    points = arrays[f"{prefix}_points"]
    if design and prefix in PLATE_PREFIXES:
        points, faces = _corner(points, with_sides(points, faces, design.thickness_m), design)
    return Surface(points, faces, face_quality(points, faces), edges=True, direction=(1.0, 1.6, 1.3))


def _corner(points: FloatArray, faces: IntArray, design: DesignRecord) -> tuple[FloatArray, IntArray]:
    """Return the plate's corner at the largest x and y, from inside the zone outwards, to make elements visible."""
    middles = points[faces].mean(axis=1)
    columns = np.unique(np.reshape(design.pillar_centres_m, (-1, 2))[:, 0])
    between = (columns[1:] + columns[:-1]) / 2  # cut no pillar
    _, right, _, top = design.ends_m
    start = right - CORNER_M
    visible = middles[:, 0] > (between[np.argmin(np.abs(between - start))] if between.size else start)
    visible &= middles[:, 1] > min(design.centre_m[1] + design.width_m / 2, top - CORNER_M)
    visible |= ~visible.any()  # a mesh without such a corner is shown whole
    used, renumbered = np.unique(faces[visible], return_inverse=True)
    return points[used], renumbered.reshape(-1, faces.shape[1])


def _geometry(case: StoredCase, picture: dict[str, Any], fault: str) -> ReportFigure | None:
    """Draw the whole plate from the pillars' side, with dimensions."""
    design = case.record.design
    if design is None or "geometry" not in picture:
        return None
    image = picture["geometry"]
    figure, axes = style.panels(style.WIDTH_IN * image.shape[0] / image.shape[1] + 0.75)
    _show(axes, image)
    axes.set_title("The plate, seen from the pillars' side (the touch face is below)")
    figure.supxlabel(fill(_dimensions(design, case.record.held("geometry")), CAPTION), fontsize=9)
    alt = f"The plate of {case.case_id} in perspective, pillars up: {_dimensions(design, None)}.{_note(fault)}"
    return ReportFigure("geometry", "Geometry", alt, figure)


def _moving(
    case: StoredCase, arrays: dict[str, Any], picture: dict[str, Any], factor: float, fault: str
) -> ReportFigure | None:
    """Draw the target mode with displacements exaggerated by a stated factor."""
    if "mode" not in picture:
        return None
    image = picture["mode"]
    figure, axes = style.panels(style.WIDTH_IN * image.shape[0] / image.shape[1] + 1.0)
    _show(axes, image)
    _bar(figure, [axes], "u$_z$ / largest in the zone (no unit)", (-1.0, 1.0), style.SIGNED)
    times = f"{factor:,.0f}".replace(",", "\u202f")
    title = f"Target mode{mode_at(case, arrays)}, displacements enlarged {times} times"
    axes.set_title(f"{title}\n(maximum u$_z$ in the zone: 1 µm)")
    alt = (
        f"Plate and pillars of {case.case_id} in perspective in the target mode; displacements are exaggerated "
        f"{factor:.0f} times for a maximum normal displacement of 1 micrometre in the zone.{_note(fault)}"
    )
    return ReportFigure("moving_plate", title, alt, figure)


def _in_plane(case: StoredCase, arrays: dict[str, Any], picture: dict[str, Any], fault: str) -> ReportFigure | None:
    """Draw the in-plane displacement of the pillars relative to the zone's maximum normal displacement."""
    design = case.record.design
    if design is None or "x above" not in picture:
        return None
    height, width = picture["x above"].shape[:2]
    grid = (1, 2) if height > width / 3 else (2, 1)  # side by side unless the plate is slender
    figure, panels = style.panels(grid[0] * style.WIDTH_IN / grid[1] * height / width + 1.2, *grid, squeeze=False)
    panels = panels.ravel()
    for axes, name in zip(panels, "xy", strict=True):
        image = picture[f"{name} above"]
        axes.imshow(image, extent=_extent_mm(image, design), interpolation="antialiased")
        axes.set(title=f"Displacement along {name}, from above", xlabel="x (mm)", ylabel="y (mm)")
        axes.label_outer()
    limit = in_plane_limit(arrays, design)
    label = "displacement of the pillars / maximum u$_z$ in the zone (no unit)"
    _bar(figure, panels, label, (-limit, limit), style.SIGNED)
    alt = (
        f"Two maps of the pillars of {case.case_id} from above, coloured by their displacement along x and along y; the "
        f"largest is {figure_text(limit)} times the maximum normal displacement in the zone.{_note(fault)}"
    )
    return ReportFigure("pillars_in_plane", f"In-plane motion of the pillars{mode_at(case, arrays)}", alt, figure)


def _extent_mm(image: Any, design: DesignRecord) -> tuple[float, float, float, float]:
    """Return left, right, lower and upper edge, mm, of a cropped picture of the plate from above."""
    height, width = image.shape[:2]
    x0, x1, y0, y1 = np.array(design.ends_m) / MM
    beyond_x, beyond_y = (MARGIN * side / (size - 2 * MARGIN) for side, size in ((x1 - x0, width), (y1 - y0, height)))
    return x0 - beyond_x, x1 + beyond_x, y0 - beyond_y, y1 + beyond_y


def _dimensions(design: DesignRecord, geometry: Any) -> str:
    plate = (
        f"plate {2 * design.half_length_m / MM:g} × {2 * design.half_span_m / MM:g} × {design.thickness_m / MM:g} mm"
    )
    zones, long = len(design.zone_places_m), f"{design.length_m / MM:g} mm long and " if design.larger_m else ""
    words = [plate, f"{f'{zones} zones' if zones > 1 else 'zone'} {long}{design.width_m / MM:g} mm wide"]
    pillar, pitch_m = design.pillar, design.pitch_x_m
    if pillar and pitch_m and design.rows:
        words.append(
            f"{_counted(design)}{design.pillar_text}, {pitch_m / MM:g} mm apart"
            f"{', every other row shifted by half of that' if design.staggered else ''}"
        )
        if pillar.faces == 2:
            words.append("on both faces")
        words += design.section_texts
    words += [support.text for support in design.supports]
    if geometry:
        words.append(f"{figure_text(geometry.mass_kg / GRAM)} g")
    return "; ".join(words)


def _counted(design: DesignRecord) -> str:
    """Rows and the pillars of each; how many pillars there are where rows around a zone have different numbers of them."""
    across = [round(y, 9) for _, y in design.pillar_centres_m]
    rows = Counter(across)
    if max(rows.values(), default=0) - min(rows.values(), default=0) > 1:
        return f"{len(across)} "
    count = f"2 × {design.rows}" if len(rows) == 2 * design.rows else f"{len(rows)}"
    return f"{count} rows of {-(-len(across) // max(1, len(rows)))} "


def _note(fault: str) -> str:
    return f" Drawn as a plain projection: {fault}." if fault else ""


def _show(axes: Axes, image: Any) -> None:
    axes.imshow(image, interpolation="antialiased")
    axes.set_axis_off()


def face_quality(points: FloatArray, faces: IntArray) -> FloatArray:
    """Return the shape quality of triangles or quadrangles in 0..1, with a common measure.

    Minimum over the corners of 2 |a x b| / (|a|^2 + |b|^2) with the two edges a, b of a corner, over its value for the
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
    """Draw meshes of the plate or of the unit cell, coloured by the shape of the visible faces."""
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
        is_whole = len(kinds) == 1 and case.record.mesh(what, "tet") is not None  # not of panels
        shown = "tet" if of_triangles and is_whole else kind
        label = MIXED if of_triangles and shown == "hex" else _mesh_words(case, what, shown)
        axes.set_title(label)
        quality = visible[f"{what} {kind}"].values
        worst = ""
        if quality is not None and quality.size:
            worst = f", face quality {figure_text(quality.min())} to {figure_text(quality.max())}"
        words.append(label.replace("\n", ", ") + worst)
    label = "shape quality of the visible faces (1: square or equilateral triangle)"
    _bar(figure, panels[0], label, (0.0, 1.0), style.QUALITY)
    title = TITLES[what]
    alt = f"{title} of {case.case_id}: {'; '.join(words)}.{_note(fault)}"
    return ReportFigure(f"{what}_meshes", title, alt, figure)


def _mesh_words(case: StoredCase, what: str, kind: str) -> str:
    mesh = case.record.mesh(what, kind)
    if mesh is None:
        return KINDS[kind]
    cells, dof = (f"{count:,}".replace(",", "\u202f") for count in (mesh.cells, mesh.dof))
    return f"{KINDS[kind]}, order {mesh.order}\n{cells} cells, {dof} degrees of freedom"


def _bar(figure: Any, panels: Any, label: str, ends: tuple[float, float], colours: str) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    look = {"orientation": "horizontal", "shrink": 0.6, "aspect": 40, "pad": 0.02, "label": label}
    figure.colorbar(ScalarMappable(Normalize(*ends), colours), ax=list(panels), **look)
