"""Bands as phonopy's band.yaml: frequencies in THz, lengths in Angstrom, wavevectors in units of the reciprocal lattice."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.case.model import Case
from pipeline.logs import Log

ANGSTROM_M, THZ_HZ = 1e-10, 1e12


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
    corners = [index for index, point in enumerate(points) if point["label"]]
    return "\n".join([*_head(sides / ANGSTROM_M, points, corners), *_phonon(sides[:2], points, corners)]) + "\n"


def _head(sides: Any, points: list[dict[str, Any]], corners: list[int]) -> Iterator[str]:
    bands = len(points[0]["frequencies_hz"])
    lengths = [end - start + 1 for start, end in pairwise(corners)]
    yield f"nqpoint: {sum(lengths)}\nnpath: {len(lengths)}\nsegment_nqpoint:"
    yield from (f"- {length}" for length in lengths)
    yield "labels:"
    yield from (f"- ['{points[start]['label']}', '{points[end]['label']}']" for start, end in pairwise(corners))
    yield "reciprocal_lattice:"
    yield from _matrix(1.0 / sides)
    yield f"natom: {max(1, bands // 3)}  # readers that count three bands an atom; there are no atoms\nlattice:"
    yield from _matrix(sides)
    yield "frequency_unit: THz  # phonopy-bandplot --factor 1e9 shows kHz"


def _matrix(diagonal: Any) -> Iterator[str]:
    for row in np.diag(diagonal):
        yield "- [ " + ", ".join(f"{value:.12e}" for value in row) + " ]"


def _phonon(sides: Any, points: list[dict[str, Any]], corners: list[int]) -> Iterator[str]:
    wave = np.array([(point["kx_per_m"], point["ky_per_m"]) for point in points]) / (2.0 * np.pi)
    steps = np.linalg.norm(np.diff(wave, axis=0), axis=1) * ANGSTROM_M
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    yield "phonon:"
    for start, end in pairwise(corners):
        for index in range(start, end + 1):
            reduced = wave[index] * sides
            yield f"- q-position: [ {reduced[0]:.12e}, {reduced[1]:.12e}, {0.0:.12e} ]"
            yield f"  distance: {distance[index]:.12e}\n  band:"
            for number, frequency in enumerate(points[index]["frequencies_hz"], 1):
                yield f"  - # {number}\n    frequency: {frequency / THZ_HZ:.12e}"
