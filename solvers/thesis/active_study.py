"""Active pillars on a free-free strip: confinement by velocity feedback, the forces it takes, and whether it is stable."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf, isfinite, isinf, isnan, nan, pi
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.materials import MATERIALS, Material
from solvers.errors import SolverError
from solvers.thesis import active_beam
from solvers.thesis.active_beam import Confinement, ForcedBeam, FreeBeam, Layout, antinodes_m, strip

STEPS = 1500  # of x


@dataclass(frozen=True)
class ActiveBeamData:
    """The thesis states no beam; ours is the steel strip of its later experiments, free at both ends, driven in its middle.

    Lengths m, frequencies Hz, gains K' N/m, force N. apart_m: two points of a pair, one patch apart. quality_factor:
    1/(omega theta) at the first frequency, inf without losses. delays_s: one sample at 250 and at 40 kHz. left_m: middle of
    the loops on the left; None takes the antinode nearest to a quarter of the length at the first frequency.
    """

    length_m: float = 0.150
    width_m: float = 0.020
    thickness_m: float = 1e-3
    material: Material = MATERIALS["steel"]
    frequencies_hz: tuple[float, ...] = (3000.0, 5000.0)
    gains_n_m: tuple[float, ...] = (1e7, 1e8)
    force_n: float = 1.0
    apart_m: float = 0.012
    quality_factor: float = 300.0
    left_m: float | None = None
    delays_s: tuple[float, ...] = (4e-6, 25e-6)

    @property
    def beam(self) -> FreeBeam:
        """The strip with its losses."""
        viscosity = (
            0.0 if isinf(self.quality_factor) else 1.0 / (self.quality_factor * 2.0 * pi * self.frequencies_hz[0])
        )
        return strip(self.length_m, self.width_m, self.thickness_m, self.material, viscosity)

    @property
    def place_m(self) -> float:
        """Middle of the left loops, m."""
        if self.left_m is not None:
            return self.left_m
        antinodes = antinodes_m(self.beam, self.length_m / 2.0, 2.0 * pi * self.frequencies_hz[0])
        room = (antinodes > self.apart_m) & (antinodes < self.length_m / 2.0 - self.apart_m)
        if not room.any():
            raise SolverError("no antinode lies between an end and the middle of the beam: state where the loops stand")
        return float(antinodes[room][np.argmin(np.abs(antinodes[room] - self.length_m / 4.0))])


@dataclass(frozen=True)
class Case:
    """One layout at one frequency and gain: strength K'/(4 EI beta^3), the steady state, amplitudes without and with loops.

    largest_force_n: of a point in the steady state; switch_on_force_n: K' times the largest loop signal before the loops close.
    """

    layout: str
    frequency_hz: float
    gain_n_m: float
    strength: float
    steady: ForcedBeam
    before: Confinement
    after: Confinement
    largest_force_n: float
    switch_on_force_n: float

    @property
    def outside_reduced_by(self) -> float:
        """rms beyond the loops, without over with them."""
        return self.before.outside_rms / self.after.outside_rms


@dataclass(frozen=True)
class LoopStability:
    """One layout: growth of the slowest pole at each gain, 1/s (above 0 unstable); the gain K' that makes a pole grow.

    delay_margin_s at each gain, None where the loop is unstable without delay; gain_limits K' for each delay of the data,
    for demodulation over one period as the last. Hz: the frequency that sets each.
    """

    layout: str
    dual: bool
    growth_per_s: tuple[float, ...]
    unstable_from_n_m: float
    delay_margin_s: tuple[float | None, ...]
    gain_limits_n_m: tuple[float, ...]
    gain_limits_hz: tuple[float, ...]


@dataclass(frozen=True)
class ActiveBeamStudy:
    """Figures 3.5 to 3.8 computed, with what they leave out: forces, stability, sensitivity to gain and place.

    open_m (frequencies, n): |w| without loops at x_m; sweeps hold rms inside over rms outside per layout.
    """

    data: ActiveBeamData
    left_m: float
    x_m: FloatArray
    open_m: FloatArray
    cases: tuple[Case, ...]
    stability: tuple[LoopStability, ...]
    sweep_gains_n_m: FloatArray
    gain_sweep: dict[str, FloatArray]
    sweep_places_m: FloatArray
    place_sweep: dict[str, FloatArray] = field(repr=False)

    def case(self, layout: str, frequency_hz: float, gain_n_m: float) -> Case:
        """The case of these three. SolverError when it was not computed."""
        for one in self.cases:
            if (one.layout, one.frequency_hz, one.gain_n_m) == (layout, frequency_hz, gain_n_m):
                return one
        raise SolverError(f"no case {layout} at {frequency_hz:g} Hz and K' = {gain_n_m:g} N/m")

    def to_dict(self) -> dict[str, Any]:
        """Beam, places, stability and sweeps in SI."""
        data, beam = self.data, self.data.beam
        kept = ("length_m", "width_m", "thickness_m", "apart_m", "force_n", "quality_factor")
        return {
            "beam": {
                **{key: getattr(data, key) for key in kept},
                "material": data.material.name,
                "bending_n_m2": beam.bending_n_m2,
                "mass_kg_m": beam.mass_kg_m,
                "left_m": self.left_m,
                "natural_hz": beam.natural_rad_s(9)[2:] / (2.0 * pi),
            },
            "point_stiffness_n_m": [beam.point_stiffness_n_m(2.0 * pi * f) for f in data.frequencies_hz],
            # where beta h = 1: beyond it shear and rotary inertia count and the beam's theory does not hold
            "thin_beam_limit_hz": (beam.bending_n_m2 / beam.mass_kg_m) ** 0.5 / data.thickness_m**2 / (2.0 * pi),
            **{key: getattr(data, key) for key in ("frequencies_hz", "gains_n_m", "delays_s")},
            "stability": self.stability,
            "gain_sweep": {"gains_n_m": self.sweep_gains_n_m, **self.gain_sweep},
            "place_sweep": {"places_m": self.sweep_places_m, **self.place_sweep},
        }


def active_beam_study(data: ActiveBeamData | None = None) -> ActiveBeamStudy:
    """Closed-loop shapes, forces, stability and sensitivity of active pillars on a free-free strip.

    SolverError for a zero gain, a frequency not above 0, a lossless resonance hit exactly.
    """
    data = ActiveBeamData() if data is None else data
    _check(data)
    beam, left = data.beam, data.place_m
    x = np.linspace(0.0, data.length_m, STEPS + 1)
    layouts = active_beam.layouts(left, data.apart_m, data.length_m)
    cases = [
        _case(data, layout, frequency, gain, x)
        for frequency in data.frequencies_hz
        for layout in layouts
        for gain in data.gains_n_m
    ]
    opened = [
        data.force_n * np.abs(beam.receptance(x, data.length_m / 2.0, 2j * pi * f)[:, 0]) for f in data.frequencies_hz
    ]
    gains = np.geomspace(1e-3, 1e3, 61) * beam.point_stiffness_n_m(2.0 * pi * data.frequencies_hz[0])
    places = np.linspace(1.5 * data.apart_m, data.length_m / 2.0 - data.apart_m, 61)
    first, coarse = data.frequencies_hz[0], x[::5]
    return ActiveBeamStudy(
        data=data,
        left_m=left,
        x_m=x,
        open_m=np.stack(opened),
        cases=tuple(cases),
        stability=tuple(_stability(data, layout) for layout in layouts),
        sweep_gains_n_m=gains,
        gain_sweep={
            layout.name: np.array([_case(data, layout, first, gain, coarse).after.ratio for gain in gains])
            for layout in layouts
        },
        sweep_places_m=places,
        place_sweep=_place_sweep(data, places, coarse),
    )


def _place_sweep(data: ActiveBeamData, places: FloatArray, x: FloatArray) -> dict[str, FloatArray]:
    """rms ratio of the three dual layouts over the place of the loops, each frequency, the last gain."""
    moved = [active_beam.layouts(at, data.apart_m, data.length_m)[:3] for at in places]
    return {
        f"{dual[0].name} at {frequency:g} Hz": np.array(
            [_case(data, layout, frequency, data.gains_n_m[-1], x).after.ratio for layout in dual]
        )
        for dual in zip(*moved, strict=True)
        for frequency in data.frequencies_hz
    }


def _check(data: ActiveBeamData) -> None:
    if not data.gains_n_m or not all(isfinite(gain) and gain > 0.0 for gain in data.gains_n_m):
        raise SolverError(f"gains K' = {data.gains_n_m} N/m: must be finite and above 0 (0 leaves the loops open)")
    if not data.frequencies_hz or not all(isfinite(f) and f > 0.0 for f in data.frequencies_hz):
        raise SolverError(f"frequencies {data.frequencies_hz} Hz: must be finite and above 0")
    if isnan(data.quality_factor) or data.quality_factor <= 0.0 or not (isfinite(data.force_n) and data.force_n > 0.0):
        raise SolverError("quality factor and excitation force must be above 0")
    if not all(isfinite(delay) and delay >= 0.0 for delay in data.delays_s):
        raise SolverError(f"delays {data.delays_s} s: must be finite, 0 or more")


def _case(data: ActiveBeamData, layout: Layout, frequency_hz: float, gain: float, x: FloatArray) -> Case:
    beam, omega, middle = data.beam, 2.0 * pi * frequency_hz, data.length_m / 2.0
    before = active_beam.forced(beam, layout, 0.0, omega, x, middle)
    after = active_beam.forced(beam, layout, gain, omega, x, middle)
    signals = layout.pick @ beam.receptance(layout.points_m, middle, 1j * omega)
    return Case(
        layout=layout.name,
        frequency_hz=frequency_hz,
        gain_n_m=float(gain),
        strength=float(gain) / beam.point_stiffness_n_m(omega),
        steady=after,
        before=active_beam.confinement(x, data.force_n * before.deflection, layout.region_m),
        after=active_beam.confinement(x, data.force_n * after.deflection, layout.region_m),
        largest_force_n=data.force_n * float(np.max(np.abs(after.forces))),
        switch_on_force_n=data.force_n * float(gain) * float(np.max(np.abs(signals))),
    )


def _stability(data: ActiveBeamData, layout: Layout) -> LoopStability:
    beam, omega = data.beam, 2.0 * pi * data.frequencies_hz[0]
    growth = tuple(active_beam.growth_per_s(beam, layout, gain / omega) for gain in data.gains_n_m)
    highest = 10.0 * max(data.gains_n_m) / omega
    unstable = inf if layout.dual else active_beam.instability_gain_n_s_m(beam, layout, highest)
    stable = [gain / omega < unstable for gain in data.gains_n_m]
    filters = [active_beam.delayed(delay) for delay in data.delays_s]
    filters.append(active_beam.demodulated(omega, 1.0 / data.frequencies_hz[0]))
    margins: list[float | None]
    if beam.viscosity_s == 0.0:  # endlessly many modes without losses: any delay drives some of them at any gain
        limits, margins = [(0.0, nan)] * len(filters), [0.0 if holds else None for holds in stable]
    else:
        loci = active_beam.characteristic_loci(beam, layout, active_beam.highest_hz(beam, layout, highest))
        limits = [active_beam.gain_limit_n_s_m(loci, one) for one in filters]
        margins = [
            active_beam.delay_margin_s(loci, gain / omega) if holds else None
            for gain, holds in zip(data.gains_n_m, stable, strict=True)
        ]
    return LoopStability(
        layout=layout.name,
        dual=layout.dual,
        growth_per_s=growth,
        unstable_from_n_m=unstable * omega,
        delay_margin_s=tuple(margins),
        gain_limits_n_m=tuple(limit * omega for limit, _ in limits),
        gain_limits_hz=tuple(hz for _, hz in limits),
    )
