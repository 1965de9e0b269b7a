"""Measured errors of meshes on the reference parts: the committed table that planner and error bars read.

`python -m studies.accuracy` writes `calibration.csv` from the stored accuracy study: the largest relative error of each part
by element, order, graded layers and share of the planner's own element size, or tetrahedra across; of the zone's hexahedra at
higher modes too; that of a theory's first frequency; how much of what may move a confinement at most does move it. Other
scenes than those of the study are given SAFETY times as much.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, fields
from functools import lru_cache
from itertools import accumulate, pairwise
from math import log
from pathlib import Path

TABLE = Path(__file__).with_name("calibration.csv")
FIELDS = ("part", "kind", "order", "layers", "factor", "share", "through", "across", "growth", "error")
HEX, TET, TET_ORDER = "hex", "tet", 2
PLATE, MIXING = "plate", "mixing"
# of the study's parts: thickness over half-wavelength, side over height
SLENDER = {"zone": 8 * 2.0 / 115.5, "pillar": 2.0 / 6.3}
# tests/verification/test_error_bars.py counts how often the bar holds on other scenes; tetrahedra differ from run to run
SAFETY = {HEX: 1.5, TET: 2.0, PLATE: 1.25}  # a plate's modes lie far below the highest bands computed for a cell


@dataclass(frozen=True)
class MeshLevel:
    """One calibrated mesh: order, layers graded towards singular edges and their factor, element size over the part's
    own.

    The size is that in the plate; of an isolated pillar, whose section takes two elements, that along it.
    """

    order: int
    layers: int
    factor: float
    share: float = 1.0
    through: int = 1


@dataclass(frozen=True)
class Measured:
    """Largest relative error that one mesh made on a reference part.

    Of hexahedra: layers, their factor, share of the planner's element size and how many through a plate; of tetrahedra: how
    many across the smallest dimension. `growth`: the frequency over that up to which the planner calls the mesh good.
    """

    part: str
    kind: str
    order: int
    layers: int
    factor: float
    share: float
    through: int
    across: float
    growth: float
    error: float

    @property
    def mesh_level(self) -> MeshLevel:
        """The mesh of hexahedra."""
        return MeshLevel(self.order, self.layers, self.factor, self.share, self.through)


@lru_cache(maxsize=1)
def table() -> tuple[Measured, ...]:
    """Read the committed calibration."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    kinds = {field.name: {"str": str, "int": int, "float": float}[str(field.type)] for field in fields(Measured)}
    return tuple(Measured(**{name: kind(row[name]) for name, kind in kinds.items()}) for row in rows)


def by_hexahedra(part: str, mesh_level: MeshLevel, kind: str = HEX, growth: float = 1.0) -> float | None:
    """Look up the expected error of graded hexahedra, with the safety factor of their kind.

    At `growth` times the frequency that the planner calls the mesh good for, bending waves are sqrt(growth) shorter. Between
    two measured modes the straight line over logarithms, which no sum of powers exceeds; beyond the last h^(2 order).

    Parameters
    ----------
    part : str
        Reference part.
    mesh_level : MeshLevel
        Order, layers and element size.
    kind : str, optional
        Kind of safety factor.
    growth : float, optional
        Factor on the frequency, at least 1.

    Returns
    -------
    float or None
        Relative error of a frequency; None where the mesh was not measured.

    Raises
    ------
    ValueError
        If growth is below 1.
    """
    if growth < 1.0:
        raise ValueError(f"growth = {growth}: must be 1 or more")
    rows = [row for row in table() if (row.part, row.kind, row.mesh_level) == (part, HEX, mesh_level)]
    return SAFETY[kind] * _grown(sorted(rows, key=lambda row: row.growth), growth) if rows else None


def _grown(rows: list[Measured], growth: float) -> float:
    """Interpolate the error at a growth of the frequency from one mesh's errors in ascending order; it never falls."""
    points = list(zip((row.growth for row in rows), accumulate((row.error for row in rows), max), strict=True))
    if growth <= points[0][0]:
        return points[0][1]
    for (low, least), (high, most) in pairwise(points):
        if growth <= high:
            return least * (most / least) ** (log(growth / low) / log(high / low))
    last, error = points[-1]
    return error * max(growth / last, 1.0) ** rows[0].order  # h^2 goes as the frequency


def by_tetrahedra(part: str, across: float) -> float | None:
    """Look up the expected error of quadratic tetrahedra.

    Parameters
    ----------
    part : str
        Reference part.
    across : float
        Number of tetrahedra across the smallest dimension.

    Returns
    -------
    float or None
        Relative error of a frequency; None below the coarsest measured mesh.
    """
    rows = [row for row in table() if (row.part, row.kind, row.order) == (part, TET, TET_ORDER)]
    return _least(TET, [row for row in rows if row.across <= across * 1.01])


def by_theory(part: str, theory: str, slender: float) -> float | None:
    """Look up the expected error of an analytic frequency.

    Effects that beam and plate theories neglect (shear, rotary inertia, Poisson strain at a foot) grow as the ratio squared.

    Parameters
    ----------
    part : str
        Reference part.
    theory : str
        Name of the theory.
    slender : float
        Ratio of the part's sides, dimensionless.

    Returns
    -------
    float or None
        Relative error; None for a theory that was not measured.
    """
    rows = [row.error for row in table() if (row.part, row.kind) == (part, theory)]
    return SAFETY[HEX] * rows[0] * max(1.0, slender / SLENDER[part]) ** 2 if rows else None


def mixing() -> float | None:
    """Look up the expected change of a confinement, as a fraction of the bound by `mode_mixing`.

    Returns
    -------
    float or None
        Dimensionless; None without a measurement.
    """
    return _least(HEX, [row for row in table() if (row.part, row.kind) == (PLATE, MIXING)])


def _least(kind: str, rows: list[Measured]) -> float | None:
    return SAFETY[kind] * min(row.error for row in rows) if rows else None
