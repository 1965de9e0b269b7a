"""Mode shapes that turn and move in the page: coarser surfaces and their displacements, packed as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.decimation import coarse, with_sides
from pipeline.plots.plate import FloatArray, IntArray, skin_faces
from pipeline.quantity import frequency, level
from pipeline.records.study import StoredCase
from pipeline.report.html import deflated

MAX_SHAPES = 16  # of plates in a page
MIN_OF_BEST = 4
MAX_POINTS = 9000  # of a surface as sent; a quarter is sent where the others are its mirror images
FULL = 32767
SAME = 1e-5  # of the largest: mirror images within rounding of the stored singles
QUARTER = ((1, 1), (-1, 1), (1, -1), (-1, -1))


@dataclass
class Gallery:
    """Surfaces and the shapes that move them, as the page's script reads them."""

    bodies: list[dict[str, Any]] = field(default_factory=list)
    shapes: list[dict[str, Any]] = field(default_factory=list)

    def add_body(self, points: FloatArray, facets: IntArray, reach_m: float) -> int:
        """A surface, and the largest displacement that it is first drawn with, m; returns its number."""
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
        """A displacement (p, 3), real or complex, of a surface's points; returns its number."""
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
    """Rows of integers as deflated text: one component after another, of each all low bytes before the higher ones."""
    flat = np.ascontiguousarray(np.asarray(values).T).astype(kind).ravel()
    return deflated(flat.view(np.uint8).reshape(flat.size, -1).T.tobytes())


def _short(values: Iterable[float]) -> list[float]:
    return [float(f"{value:.7g}") for value in values]


def plates(cases: Sequence[StoredCase], best: StoredCase | None, stills: dict[str, str]) -> Gallery:
    """Shapes of the best confined case, and the wanted ones of the others; `stills` holds a picture's id for each case."""
    gallery = Gallery()
    ordered = sorted(cases, key=lambda case: best is None or case.case_id != best.case_id)
    for place, case in enumerate(ordered):
        left = MAX_SHAPES - len(gallery.shapes)
        if left < 1:
            break
        others = len(ordered) - 1 - place
        most = max(MIN_OF_BEST, left - others) if place == 0 else 1
        _add_plate(gallery, case, most, stills.get(case.case_id, ""))
    return gallery


def _add_plate(gallery: Gallery, case: StoredCase, most: int, still: str) -> None:
    arrays, design = case.arrays(), case.record.design
    facets = skin_faces(arrays, "surface")
    if design is None or facets is None or "surface_u" not in arrays:
        return
    u = np.asarray(arrays["surface_u"][:most], dtype=float)
    points = np.asarray(arrays["surface_points"], dtype=float)
    points, facets, u, signs = quarter(points, facets, u)
    facets = with_sides(points, facets, design.thickness_m)
    kept, small = coarse(points, facets, MAX_POINTS)
    tallest = design.pillar.top_m if design.pillar else design.thickness_m
    body = gallery.add_body(points[kept], small, 0.4 * tallest)
    tones = arrays.get("surface_frequency_hz", np.full(len(u), np.nan))
    for number, (shape, sign) in enumerate(zip(u, signs, strict=True)):
        words = _words(case, float(tones[number]), number == 0) | {"still": still}
        gallery.add_shape(body, shape[kept], words, _images(sign))


def _words(case: StoredCase, frequency_hz: float, wanted: bool) -> dict[str, str]:
    record = case.record
    tone = (
        frequency(frequency_hz, record.error_at(frequency_hz)) if np.isfinite(frequency_hz) else "frequency not stored"
    )
    db = level(record.confinement_db, record.wanted.confinement_error_db if record.wanted else None)
    level_text = f", {db} from zone to passive face" if wanted and record.confinement_db is not None else ""
    which = "wanted mode" if wanted else "neighbour"
    return {
        "group": case.case_id,
        "name": f"{case.case_id}: {tone}, {which}",
        "about": f"{which.capitalize()} of {case.case_id} at {tone}{level_text}",
    }


def quarter(
    points: FloatArray, facets: IntArray, u: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray, list[tuple[int, int] | None]]:
    """The first quarter of an unfolded surface and each shape's signs under the mirrors of x and y; else all, None.

    points (p, 3), facets, u (k, p, 3). A mirrored shape is sign * flip(u): only what is so within rounding is left out.
    """
    count = len(points) // 4
    whole: list[tuple[int, int] | None] = [None] * len(u)
    first = facets[(facets < count).all(axis=1)]
    if len(points) != 4 * count or 4 * len(first) != len(facets):
        return points, facets, u, whole
    size = np.abs(points).max()
    for image, flip in enumerate(QUARTER):
        block = points[image * count : (image + 1) * count]
        if np.abs(block - points[:count] * (*flip, 1)).max() > SAME * size:
            return points, facets, u, whole
    signs = [_signs(shape, count) for shape in u]
    return (points, facets, u, whole) if None in signs else (points[:count], first, u[:, :count], signs)


def _signs(shape: FloatArray, count: int) -> tuple[int, int] | None:
    blocks, limit = shape.reshape(4, count, 3), SAME * np.abs(shape).max()
    for sign in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        images = [
            (sign[0] if flip[0] < 0 else 1) * (sign[1] if flip[1] < 0 else 1) * np.array([*flip, 1]) for flip in QUARTER
        ]
        if all(np.abs(block - image * blocks[0]).max() <= limit for block, image in zip(blocks, images, strict=True)):
            return sign
    return None


def _images(sign: tuple[int, int] | None) -> list[dict[str, Any]]:
    """The copies that make up the whole plate: how each is mirrored, and the sign of its displacement."""
    if sign is None:
        return [{"flip": [1, 1, 1], "parity": 1}]
    return [
        {"flip": [*flip, 1], "parity": (sign[0] if flip[0] < 0 else 1) * (sign[1] if flip[1] < 0 else 1)}
        for flip in QUARTER
    ]
