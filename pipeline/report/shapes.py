"""Animated parts of pages and notebooks: mode shapes, and dispersion diagrams with wave shapes, as packed surfaces."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.decimation import coarse, with_sides
from geometry.lattice import Lattice
from pipeline import quantity
from pipeline.plots.fields import FloatArray, IntArray, skin_faces
from pipeline.quantity import frequency, level
from pipeline.questions.bands import MARKS, PILLAR, BandPoint, BandsResult
from pipeline.questions.modes import ModesResult
from pipeline.questions.response import ResponseResult
from pipeline.records.store import canonical_json
from pipeline.records.study import StoredCase, StoredStudy
from pipeline.records.tables import axis_label
from pipeline.report.html import deflated, render, script_data, vendored

MAX_SHAPES = 16  # largest number of plates in a page
MIN_OF_BEST = 4
IN_NOTEBOOK = 6  # modes in a notebook's frame, nearest to the target mode, which comes first
FRAME_PX = {"modes": 680, "bands": 740}
MAX_POINTS = 9000  # limit for a transmitted surface; only a quarter is sent if the others are its mirror images
FULL = 32767
REACH = 0.4  # largest displacement of a plate as first drawn, relative to its height
NO_CELLS: dict[str, Any] = {"cells": [], "shapes": []}
WHOLE = {"flip": [1, 1, 1], "parity": 1}
QUARTER = ((1, 1), (-1, 1), (1, -1), (-1, -1))


@dataclass
class Gallery:
    """Surfaces and their displacement shapes, in the format of the page's script."""

    bodies: list[dict[str, Any]] = field(default_factory=list)
    shapes: list[dict[str, Any]] = field(default_factory=list)

    def add_body(self, points: FloatArray, facets: IntArray, reach_m: float) -> int:
        """Add a surface and the largest displacement with which it is first drawn, m; return its number."""
        low, span = points.min(axis=0), np.maximum(np.ptp(points, axis=0), 1e-12)
        small = len(points) <= 0xFFFF
        self.bodies.append(
            {
                "low": _short(low),
                "span": _short(span),
                "points": packed(np.round((points - low) / span * 0xFFFF), "<u2"),
                "corners": int(facets.shape[1]),
                "wide": not small,
                "facets": packed(np.diff(facets.astype(np.int64), axis=0, prepend=0), "<u2" if small else "<u4"),
                "reach": float(f"{reach_m:.4g}"),
            }
        )
        return len(self.bodies) - 1

    def add_shape(self, body: int, shape: NDArray[Any], words: dict[str, Any], copies: list[dict[str, Any]]) -> int:
        """Add a displacement (p, 3), real or complex, of a surface's points; return its number."""
        peak = max(float(np.abs(shape).max()), 1e-300)
        parts = {"re": shape.real} | ({"im": shape.imag} if np.iscomplexobj(shape) and np.any(shape.imag) else {})
        normal = max(float(np.abs(shape[:, 2]).max()), 1e-6 * peak)
        self.shapes.append(
            {
                **words,
                "body": body,
                "normal": float(f"{normal / peak:.4g}"),
                "copies": copies,
                **{name: packed(np.round(part / peak * FULL), "<i2") for name, part in parts.items()},
            }
        )
        return len(self.shapes) - 1


def packed(values: NDArray[Any], kind: str) -> str:
    """Return rows of integers as deflated text: component by component, low bytes first."""
    flat = np.ascontiguousarray(np.asarray(values).T).astype(kind).ravel()
    return deflated(flat.view(np.uint8).reshape(flat.size, -1).T.tobytes())


def _short(values: Iterable[float]) -> list[float]:
    return [float(f"{value:.7g}") for value in values]


def plates(cases: Sequence[StoredCase], best: StoredCase | None, stills: dict[str, str]) -> dict[str, Any]:
    """Return shapes of the best confined case and target modes of the others; `stills` has a picture id per case."""
    gallery = Gallery()
    ordered = sorted(cases, key=lambda case: best is None or case.case_id != best.case_id)
    for place, case in enumerate(ordered):
        left = MAX_SHAPES - len(gallery.shapes)
        if left < 1:
            break
        others = len(ordered) - 1 - place
        most = max(MIN_OF_BEST, left - others) if place == 0 else 1
        _add_plate(gallery, case, most, stills.get(case.case_id, ""))
    return vars(gallery)


def _add_plate(gallery: Gallery, case: StoredCase, most: int, still: str) -> None:
    arrays, design = case.arrays(), case.record.design
    if design is None or "surface_u" not in arrays:
        return
    tones = arrays.get("surface_frequency_hz", np.full(len(arrays["surface_u"]), np.nan))
    words = [_words(case, float(tone), number == 0) | {"still": still} for number, tone in enumerate(tones[:most])]
    _add_body(gallery, arrays, design.thickness_m, words)


def _add_body(
    gallery: Gallery, arrays: dict[str, Any], thickness_m: float | None, words: Sequence[dict[str, str]]
) -> None:
    """Add a body in the first of its modes, one for each entry of `words`; thickness_m: of a plate, whose sides are closed."""
    facets = skin_faces(arrays, "surface")
    if facets is None:
        return
    points, facets, u, copies = quarter(arrays, facets, len(words))
    body, kept = _coarse_body(gallery, points, facets, thickness_m)
    for shape, images, each in zip(u, copies, words, strict=True):
        gallery.add_shape(body, shape[kept], each, images)


def _coarse_body(
    gallery: Gallery, points: FloatArray, facets: IntArray, thickness_m: float | None
) -> tuple[int, IntArray]:
    """Add a surface, made coarser, the sides of a plate closed; its number, and the points that it keeps."""
    closed = facets if thickness_m is None else with_sides(points, facets, thickness_m)
    kept, small = coarse(points, closed, MAX_POINTS)
    return gallery.add_body(points[kept], small, REACH * float(np.ptp(points[:, 2]))), kept


def _words(case: StoredCase, frequency_hz: float, target: bool) -> dict[str, str]:
    record, tone = case.record, "frequency not stored"
    if np.isfinite(frequency_hz):
        tone = frequency(frequency_hz, record.error_at(frequency_hz))
    return _spoken("target mode" if target else "neighbour", case.case_id, tone, record.target if target else None)


def _spoken(which: str, of: str, tone: str, target: Any = None) -> dict[str, str]:
    """Describe a shape: its group, its name in a list, its sentence, with the level of the target mode."""
    more = ""
    if target is not None and target.confinement_db is not None:
        more = f", {level(target.confinement_db, target.confinement_error_db)} from zone to passive face"
    name, about = f"{of}: {tone}, {which}", f"{which.capitalize()} of {of} at {tone}{more}"
    return {"group": of, "name": name, "about": about, "still": ""}


def quarter(
    arrays: dict[str, Any], facets: IntArray, most: int
) -> tuple[FloatArray, IntArray, FloatArray, list[list[dict[str, Any]]]]:
    """Return the quarter of an unfolded surface, its first shapes, and the copies that complete each of them.

    A copy has its mirroring and the sign of its displacement. A surface without mirrors is its own copy.
    """
    points, u = (np.asarray(arrays[f"surface_{name}"], dtype=float) for name in ("points", "u"))
    u, symmetries = u[:most], arrays.get("surface_symmetry", [""] * most)[:most]
    if not all(symmetries):
        return points, facets, u, [[WHOLE]] * len(u)
    count = len(points) // 4
    return points[:count], facets[(facets < count).all(axis=1)], u[:, :count], list(map(_images, symmetries))


def _images(symmetry: str) -> list[dict[str, Any]]:
    """Return the four copies of a quarter mirrored in x and y: u_z is symmetric (S) or antisymmetric (A) under each."""
    odd = [letter == "A" for letter in symmetry]
    return [
        {"flip": [*flip, 1], "parity": -1 if (odd[0] and flip[0] < 0) != (odd[1] and flip[1] < 0) else 1}
        for flip in QUARTER
    ]


def modes_in_frame(result: ModesResult) -> str:
    """Return a notebook's frame in which the target mode and its neighbours move; empty without solved shapes."""
    if result.solved is None or not len(result):
        return ""
    from pipeline.models.mode_fields import nearest_rows, plate_arrays

    at, case = (result.target.index if result.target else None), result.case
    shown = nearest_rows(result.solved, at or 0)[:IN_NOTEBOOK]
    others = "neighbour" if at is not None else "mode"
    tones = [frequency(result[row].frequency_hz, result[row].error) for row in shown]
    words = [
        _spoken(*("target mode", result.part, tone, result.target) if row == at else (others, result.part, tone))
        for row, tone in zip(shown, tones, strict=True)
    ]
    gallery, thickness_m = Gallery(), case.design.thickness_m if result.part == "plate" else None
    _add_body(gallery, plate_arrays(result.solved, shown), thickness_m, words)
    return _frame(f"Mode shapes of the {result.part}, animated", FRAME_PX["modes"], vars(gallery))


def response_in_frame(result: ResponseResult) -> str:
    """Return a notebook's frame in which the plate moves as driven at the target mode's peak; empty without either."""
    peak = result.target_peak
    if result.forced is None or peak is None:
        return ""
    skin, gallery = result.forced.skin(peak.frequency_hz), Gallery()
    body, kept = _coarse_body(gallery, skin.points, skin.facets, result.forced.design.thickness_m)
    words = _spoken("target mode's peak", "the driven plate", frequency(peak.frequency_hz, peak.frequency_error))
    gallery.add_shape(body, skin.displacement[0][kept], words, [WHOLE])
    return _frame("The driven plate, animated", FRAME_PX["modes"], vars(gallery))


def bands_in_frame(result: BandsResult) -> str:
    """Return a notebook's frame with the interactive dispersion diagram."""
    return _frame("Dispersion diagram", FRAME_PX["bands"], {"shapes": []}, {"cells": [_cell("", result)], "shapes": []})


def _frame(title: str, height_px: int, plates: dict[str, Any], diagrams: dict[str, Any] = NO_CELLS) -> str:
    page = render("frame.html.j2", title=title, **parts(plates, diagrams))
    style = f"width: 100%; height: {height_px}px; border: 0"
    return f'<iframe title="{title}" style="{style}" srcdoc="{escape(page)}"></iframe>'


def parts(plates: dict[str, Any], diagrams: dict[str, Any]) -> dict[str, Any]:
    """Return the values of moving.html.j2: shapes and diagrams as JSON text, with the viewer where something moves."""
    return {
        "shapes": script_data(plates) if plates["shapes"] else "",
        "bands": [cell["name"] for cell in diagrams["cells"]],
        "bands_data": script_data(diagrams),
        "three": vendored("three.min.js") if plates["shapes"] or diagrams["shapes"] else "",
    }


MAX_CELLS = 12
MAX_WITH_SHAPES = 3
CELL_POINTS = 1200
TILES = 2  # cells shown along each axis, to make the phase from cell to cell visible
SPREAD = 0.12  # largest displacement as first drawn, relative to the cell's height
KINDS = tuple(MARKS)


def diagrams(study: StoredStudy, best: StoredCase | None) -> dict[str, Any]:
    """Return the data of the page's diagram: {"cells", "bodies", "shapes"}; the cell of the best case first."""
    groups: dict[str, list[StoredCase]] = {}
    for case in sorted(study.cases, key=lambda case: best is None or case.case_id != best.case_id):
        bands = case.record.of(BandsResult)
        if bands and bands.points:
            groups.setdefault(same_bands(bands), []).append(case)
    gallery = Gallery()
    cells: list[dict[str, Any]] = []
    for members in list(groups.values())[:MAX_CELLS]:
        bands = members[0].record.of(BandsResult)
        assert bands
        visible = next((case for case in members if best and case.case_id == best.case_id), members[0])
        cell = _cell(_name(members), bands, visible.record.target)
        if sum("shapes" in other for other in cells) < MAX_WITH_SHAPES:
            cell |= _shapes(gallery, members)
        cells.append(cell)
    return {"cells": cells, "left": max(0, len(groups) - MAX_CELLS), **vars(gallery)}


def same_bands(bands: BandsResult) -> str:
    """Common key of cases with the same bands, which share one diagram."""
    visible = [[p.kx_per_m, p.ky_per_m, p.frequencies_hz] for p in bands.points]
    return hashlib.sha256(canonical_json(visible).encode()).hexdigest()


def _cell(name: str, bands: BandsResult, target: Any = None) -> dict[str, Any]:
    """Return one diagram: path, bands, labels of the waves if stored, gaps, the target mode's frequency."""
    points = bands.points
    return {
        "name": name,
        "arc": [_digits(s) for s in bands.distance_per_m],
        "labels": [point.label for point in points],
        "k": [[_digits(point.kx_per_m), _digits(point.ky_per_m)] for point in points],
        "hz": [[_digits(f) for f in point.frequencies_hz] for point in points],
        "shown": [list(map(quantity.frequency, point.frequencies_hz, _bars(point))) for point in points],
        "kind": _each(points, "plate_polarisation", lambda name: KINDS.index(name) if name in KINDS else -1),
        "pillar": _each(points, "polarisation", lambda name: int(name == PILLAR)),
        "speed": _each(points, "group_velocity_m_s", _speed),
        "gaps": [gap.to_dict() | {"shown": gap.interval} for gap in bands.gaps],
        "target_hz": target.frequency_hz if target else None,
        "target_shown": quantity.frequency(target.frequency_hz, target.frequency_error) if target else None,
    }


def _bars(point: BandPoint) -> list[float | None]:
    return point.error or [None] * len(point.frequencies_hz)


def _name(members: list[StoredCase]) -> str:
    """Describe the swept cases of a cell: common values and number, or their names without common values."""
    cases = [case for case in members if case.sweep]
    shared = (
        {key: value for key, value in cases[0].sweep.items() if all(c.sweep.get(key) == value for c in cases)}
        if cases
        else {}
    )
    if len(cases) > 1 and shared:
        return f"{', '.join(f'{axis_label(key)} = {value}' for key, value in shared.items())}, {len(cases)} plates"
    names = [case.case_id for case in members]
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def _digits(value: float) -> float:
    return float(f"{value:.7g}")


def _each(points: list[BandPoint], key: str, visible: Callable[[Any], Any]) -> list[list[Any]] | None:
    """Return a value of every wave, None if the full cell provides only frequencies."""
    rows = [getattr(point, key) for point in points]
    return [[visible(value) for value in row] for row in rows] if all(rows) else None


def _speed(pair: tuple[float, float] | None) -> float | None:
    """Return the group velocity, m/s, to four digits; below a millimetre per second it is round-off."""
    return None if pair is None else float(f"{np.round(np.hypot(*pair), 3):.4g}")


def _shapes(gallery: Gallery, members: list[StoredCase]) -> dict[str, Any]:
    """Return the numbers of the stored shapes by label and band; {} if no record has any."""
    for case in members:
        arrays = case.arrays()
        facets = skin_faces(arrays, "bands")
        if facets is not None and {"bands_points", "bands_labels", "bands_u"} <= arrays.keys():
            return {"shapes": _add(gallery, case, arrays, facets)}
    return {}


def _add(gallery: Gallery, case: StoredCase, arrays: dict[str, Any], facets: Any) -> dict[str, list[int]]:
    points = np.asarray(arrays["bands_points"], dtype=float)
    kept, small = coarse(points, facets, CELL_POINTS)
    body = gallery.add_body(points[kept], small, SPREAD * float(np.ptp(points[:, 2])))
    bands = case.record.of(BandsResult)
    assert case.record.design and bands
    lattice = case.record.design.lattice
    marked = bands.labelled
    places: dict[str, list[int]] = {}
    for label, waves in zip(arrays["bands_labels"].tolist(), arrays["bands_u"].astype(float), strict=True):
        point = marked[label]
        copies = _tiles(np.array([point.kx_per_m, point.ky_per_m]), lattice)
        places[label] = [
            gallery.add_shape(body, (wave[0] + 1j * wave[1])[kept], _wave_in_words(label, band, point), copies)
            for band, wave in enumerate(waves)
        ]
    return places


def _wave_in_words(label: str, band: int, point: BandPoint) -> dict[str, str]:
    tone = quantity.frequency(point.frequencies_hz[band], _bars(point)[band])
    name = {"G": "Γ"}.get(label, label)
    about = f"Wave of band {band + 1} at {name}, {tone}, on {TILES} x {TILES} cells"
    return {"group": name, "name": f"band {band + 1}, {tone}", "about": about, "still": ""}


def _tiles(k: Any, lattice: Lattice) -> list[dict[str, Any]]:
    """Return neighbouring cells: u(r + a) = u(r) exp(i k.a)."""
    return [
        {"flip": [1, 1, 1], "parity": 1, "offset": [*(_digits(v) for v in a), 0.0], "phase": _digits(float(k @ a))}
        for a in lattice.translations(TILES)
    ]
