"""The dispersion diagrams of a page: the stored bands of every distinct unit cell, and the shapes of their waves."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np

from geometry.decimation import coarse
from pipeline import quantity
from pipeline.plots.plate import skin_faces
from pipeline.questions.bands import MARKS, PILLAR, BandPoint, BandsResult
from pipeline.records.fingerprint import canonical_json
from pipeline.records.study import StoredCase, StoredStudy
from pipeline.records.sweep_lines import axis_label
from pipeline.report.mode_shapes import Gallery

MAX_CELLS = 12
MAX_WITH_SHAPES = 3
MAX_POINTS = 1200
TILES = 2  # cells shown along each axis, so that the phase from cell to cell is seen
SPREAD = 0.12  # of the cell's height: the largest displacement as first drawn
KINDS = tuple(MARKS)


def diagrams(study: StoredStudy, best: StoredCase | None) -> dict[str, Any]:
    """What the page's diagram is drawn from: {"cells", "bodies", "shapes"}; the best case's cell first."""
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
        cell = _cell(members, bands, best)
        if sum("shapes" in other for other in cells) < MAX_WITH_SHAPES:
            cell |= _shapes(gallery, members)
        cells.append(cell)
    return {"cells": cells, "left": max(0, len(groups) - MAX_CELLS), **vars(gallery)}


def same_bands(bands: BandsResult) -> str:
    """What cases with the same bands, which show one diagram, have in common."""
    visible = [[p.kx_per_m, p.ky_per_m, p.frequencies_hz] for p in bands.points]
    return hashlib.sha256(canonical_json(visible).encode()).hexdigest()


def _cell(members: list[StoredCase], bands: BandsResult, best: StoredCase | None) -> dict[str, Any]:
    """One diagram: path, bands, labels of the waves where they are stored, gaps, the wanted mode's frequency."""
    points = bands.points
    visible = next((case for case in members if best and case.case_id == best.case_id), members[0])
    wanted = visible.record.wanted
    return {
        "name": _name(members),
        "arc": [_short(s) for s in bands.distance_per_m],
        "labels": [point.label for point in points],
        "k": [[_short(point.kx_per_m), _short(point.ky_per_m)] for point in points],
        "hz": [[_short(f) for f in point.frequencies_hz] for point in points],
        "shown": [list(map(quantity.frequency, point.frequencies_hz, _bars(point))) for point in points],
        "kind": _each(points, "plate_polarisation", lambda name: KINDS.index(name) if name in KINDS else -1),
        "pillar": _each(points, "polarisation", lambda name: int(name == PILLAR)),
        "speed": _each(points, "group_velocity_m_s", _speed),
        "gaps": [gap.to_dict() | {"shown": gap.interval} for gap in bands.gaps],
        "wanted_hz": wanted.frequency_hz if wanted else None,
        "wanted_shown": quantity.frequency(wanted.frequency_hz, wanted.frequency_error) if wanted else None,
    }


def _bars(point: BandPoint) -> list[float | None]:
    return point.error or [None] * len(point.frequencies_hz)


def _name(members: list[StoredCase]) -> str:
    """What the swept cases of a cell have in common and how many they are; their names where that is nothing."""
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


def _short(value: float) -> float:
    return float(f"{value:.7g}")


def _each(points: list[BandPoint], key: str, visible: Callable[[Any], Any]) -> list[list[Any]] | None:
    """A figure of every wave, None where the full cell told only frequencies."""
    rows = [getattr(point, key) for point in points]
    return [[visible(value) for value in row] for row in rows] if all(rows) else None


def _speed(pair: tuple[float, float] | None) -> float | None:
    """Group speed, m/s, to four digits; below a millimetre a second it is rounding."""
    return None if pair is None else float(f"{np.round(np.hypot(*pair), 3):.4g}")


def _shapes(gallery: Gallery, members: list[StoredCase]) -> dict[str, Any]:
    """Numbers of the stored shapes by label and band; {} when no member's record holds any."""
    for case in members:
        arrays = case.arrays()
        facets = skin_faces(arrays, "bands")
        if facets is not None and {"bands_points", "bands_labels", "bands_u"} <= arrays.keys():
            return {"shapes": _add(gallery, case, arrays, facets)}
    return {}


def _add(gallery: Gallery, case: StoredCase, arrays: dict[str, Any], facets: Any) -> dict[str, list[int]]:
    points = np.asarray(arrays["bands_points"], dtype=float)
    kept, small = coarse(points, facets, MAX_POINTS)
    body = gallery.add_body(points[kept], small, SPREAD * float(np.ptp(points[:, 2])))
    bands = case.record.of(BandsResult)
    assert case.record.design and bands
    pitch = np.array([case.record.design.pitch_x_m, case.record.design.pitch_y_m])
    marked = bands.labelled
    places: dict[str, list[int]] = {}
    for label, waves in zip(arrays["bands_labels"].tolist(), arrays["bands_u"].astype(float), strict=True):
        point = marked[label]
        copies = _tiles(np.array([point.kx_per_m, point.ky_per_m]), pitch)
        places[label] = [
            gallery.add_shape(body, (wave[0] + 1j * wave[1])[kept], _words(label, band, point), copies)
            for band, wave in enumerate(waves)
        ]
    return places


def _words(label: str, band: int, point: BandPoint) -> dict[str, str]:
    tone = quantity.frequency(point.frequencies_hz[band], _bars(point)[band])
    name = {"G": "Γ"}.get(label, label)
    about = f"Wave of band {band + 1} at {name}, {tone}, on {TILES} x {TILES} cells"
    return {"group": name, "name": f"band {band + 1}, {tone}", "about": about, "still": ""}


def _tiles(k: Any, pitch: Any) -> list[dict[str, Any]]:
    """Neighbouring cells: u(r + a) = u(r) exp(i k.a)."""
    return [
        {"flip": [1, 1, 1], "parity": 1, "offset": [*(_short(v) for v in a), 0.0], "phase": _short(float(k @ a))}
        for i in range(TILES)
        for j in range(TILES)
        for a in [(np.array([i, j]) - (TILES - 1) / 2) * pitch]
    ]
