"""The band-reject filter on a bar of five cells: the confined mode is there with it and absent without it."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, pi, sqrt
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.materials import MATERIALS, Material
from solvers.errors import SolverError, check_above_zero
from solvers.measures.levels import ratio_db
from solvers.resonators.mason import Cell, Filter, Line, natural_frequencies_hz, nodal_response


@dataclass(frozen=True)
class MasonData:
    """Cell and filter data; the thesis states none, these are ours. Five equal cells, the middle one driven by 1 N.

    target_hz: the mode to confine between the joints 1 and 4. The middle cell pushes both ways, so only the even modes of
    three clamped cells answer: the target is their second, c/(3 l), which sets the cells' length. area_m2: 10 x 2 mm.
    mass_ratio: filter mass over cell mass. quality_factor: of cells and of the filter's own losses.
    """

    target_hz: float = 25_000.0
    material: Material = MATERIALS["aluminium"]
    area_m2: float = 20e-6
    mass_ratio: float = 0.2
    quality_factor: float = 500.0

    @property
    def cell(self) -> Cell:
        """One cell: l = c/(3 f), c = sqrt(E/rho)."""
        length = sqrt(self.material.young_pa / self.material.density_kg_m3) / (3.0 * self.target_hz)
        loss = 1.0 / self.quality_factor
        return Cell(length, self.area_m2, self.material.density_kg_m3, self.material.young_pa, loss)

    @property
    def filter(self) -> Filter:
        """L = mass_ratio cell masses, C = 1/((2 pi f)^2 L), R = 2 pi f L Q."""
        mass, omega = self.mass_ratio * self.cell.mass_kg, 2.0 * pi * self.target_hz
        return Filter(mass, 1.0 / (omega**2 * mass), omega * mass * self.quality_factor)


@dataclass(frozen=True)
class MasonStudy:
    """Joint velocities over n frequencies for 1 N, m/s: three cells clamped (n, 4), five free without and with filter (n, 6).

    *_modes_hz: lossless natural frequencies in the window. confinement_db: rms velocity of the inner joints 2, 3 over that
    of the outer ones 0, 1, 4, 5 at the target, without and with the filter.
    """

    data: MasonData
    frequencies_hz: FloatArray
    clamped: ComplexArray
    bare: ComplexArray
    filtered: ComplexArray
    filter_impedance: ComplexArray
    clamped_modes_hz: FloatArray
    bare_modes_hz: FloatArray
    filtered_modes_hz: FloatArray
    confinement_bare_db: float
    confinement_filtered_db: float

    @property
    def modes_hz(self) -> dict[str, FloatArray]:
        """Lossless natural frequencies in the window by line: clamped, bare, filtered."""
        return {"clamped": self.clamped_modes_hz, "bare": self.bare_modes_hz, "filtered": self.filtered_modes_hz}

    def to_dict(self) -> dict[str, Any]:
        """A plain document: cell and filter data in SI, velocities per newton as magnitudes, impedance in N s/m."""
        cell, one = self.data.cell, self.data.filter
        curves = ("clamped", "bare", "filtered", "filter_impedance")
        return {
            "schema": 1,
            "target_hz": self.data.target_hz,
            "quality_factor": self.data.quality_factor if isfinite(self.data.quality_factor) else None,
            "cell": {"length_m": cell.length_m, "area_m2": cell.area_m2, "material": self.data.material.name},
            "filter": {
                "inductance_kg": one.inductance_kg,
                "capacitance_m_n": one.capacitance_m_n,
                "resistance_n_s_m": one.resistance_n_s_m if isfinite(one.resistance_n_s_m) else None,
                "rejected_hz": one.rejected_hz,
            },
            "modes_hz": {name: modes.tolist() for name, modes in self.modes_hz.items()},
            "confinement_db": {"bare": self.confinement_bare_db, "filtered": self.confinement_filtered_db},
            "frequencies_hz": self.frequencies_hz.tolist(),
            **{f"{name}_abs": np.abs(getattr(self, name)).tolist() for name in curves},
        }


def mason_study(data: MasonData | None = None, frequencies_hz: FloatArray | None = None) -> MasonStudy:
    """Figures 1.24 to 1.27 computed; the window defaults to 1 kHz ... 1.6 times the target, wide enough to hold it."""
    data = MasonData() if data is None else data
    check_above_zero("target frequency in Hz", data.target_hz)
    if not (data.quality_factor > 0.0 and data.mass_ratio > 0.0):
        raise SolverError("quality factor and mass ratio must be above 0")
    if frequencies_hz is None:
        frequencies_hz = np.linspace(0.04, 1.6, 3121) * data.target_hz
    low, high = float(np.min(frequencies_hz)), float(np.max(frequencies_hz))
    three, bare, filtered = three_clamped(data), five_free(data, False), five_free(data, True)

    def currents(line: Line, frequencies: FloatArray | float) -> ComplexArray:
        return nodal_response(line, 2.0 * pi * frequencies).currents

    def modes(line: Line) -> FloatArray:
        return natural_frequencies_hz(line, low, high, data.target_hz / 5000.0)

    return MasonStudy(
        data=data,
        frequencies_hz=frequencies_hz,
        clamped=currents(three, frequencies_hz),
        bare=currents(bare, frequencies_hz),
        filtered=currents(filtered, frequencies_hz),
        filter_impedance=1.0 / data.filter.admittance(2.0 * pi * frequencies_hz),
        clamped_modes_hz=modes(three),
        bare_modes_hz=modes(bare),
        filtered_modes_hz=modes(filtered),
        confinement_bare_db=_confinement_db(currents(bare, data.target_hz)[0]),
        confinement_filtered_db=_confinement_db(currents(filtered, data.target_hz)[0]),
    )


def three_clamped(data: MasonData) -> Line:
    """Three cells, both ends clamped, the middle one driven."""
    return Line((data.cell,) * 3, "clamped", "clamped", (0.0, 1.0, 0.0))


def five_free(data: MasonData, filtered: bool) -> Line:
    """Five cells, both ends free, the middle one driven; filters at the joints 1 and 4 when asked."""
    filters = {1: data.filter, 4: data.filter} if filtered else {}
    return Line((data.cell,) * 5, "free", "free", (0.0, 0.0, 1.0, 0.0, 0.0), filters)


def _confinement_db(currents: ComplexArray) -> float:
    inner, outer = (np.sqrt(np.mean(np.abs(currents[part]) ** 2)) for part in ([2, 3], [0, 1, 4, 5]))
    return float(ratio_db(inner, outer))
