"""Pictures of the geometry and of the meshes."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.decimation import with_sides
from pipeline.plots import rendering, style
from pipeline.plots.plate import KINDS, FloatArray, IntArray, skin_faces
from pipeline.plots.rendering import Surface
from pipeline.plots.style import ReportFigure
from pipeline.quantity import figure as figure_text
from pipeline.records.record import DesignRecord
from pipeline.records.study import StoredCase
from pipeline.units import GRAM, MM

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
    images, fault = rendering.render(list(visible.values()))
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
