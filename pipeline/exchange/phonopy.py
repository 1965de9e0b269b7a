"""Bands as phonopy's band.yaml: frequencies in THz, lengths in Angstrom, wavevectors in units of the reciprocal lattice."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.case.model import Case
from pipeline.exchange.part_mesh import rendered
from pipeline.logs import Log

ANGSTROM_M = 1e-10


def write(case: Case, path: Path, log: Log) -> Path:
    """Compute the bands of a case's unit cell and write them."""
    from pipeline.questions.bands import Bands
    from pipeline.questions.question import ask
    from pipeline.records import outputs

    outputs.write_file(path, text(ask(case, Bands(), log).to_dict()).encode())
    return path


def text(document: dict[str, Any]) -> str:
    """The file's text from a document of bands; every segment has both its ends, as phonopy writes them."""
    design, points = document["with_defaults"]["design"], document["points"]
    rows = 1 + design.get("stagger", False)
    sides = np.array([design["pitch_x_m"], rows * design["pitch_y_m"], design["thickness_m"]])
    wave = np.array([(point["kx_per_m"], point["ky_per_m"], 0.0) for point in points]) / (2.0 * np.pi)
    arc = np.cumsum([0.0, *np.linalg.norm(np.diff(wave, axis=0), axis=1) * ANGSTROM_M])
    own = [
        point | {"reduced": k * sides, "distance": distance}
        for point, k, distance in zip(points, wave, arc, strict=True)
    ]
    corners = [index for index, point in enumerate(points) if point["label"]]
    segments = [own[start : end + 1] for start, end in pairwise(corners)]
    lengths, atoms = sides / ANGSTROM_M, max(1, len(points[0]["frequencies_hz"]) // 3)
    cell = {"lattice": np.diag(lengths), "reciprocal": np.diag(1.0 / lengths), "atoms": atoms}
    return rendered("phonopy.yaml.j2", segments=segments, **cell)
