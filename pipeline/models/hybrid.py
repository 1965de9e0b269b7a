"""Confinement over frequency of a plate with or without rows, its patches in phase or shaped, with error bars."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geometry.elements import BoolArray, ComplexArray, FloatArray
from geometry.layout import Design, Pillar
from pipeline.case.model import Case
from pipeline.logs import Log
from pipeline.models.forced import forced_plate
from pipeline.quantity import UM
from pipeline.records.record import MeshRecord
from solvers.accuracy import calibration
from solvers.driven.curve_bars import Change, Doubts, changes, doubts, half_widths, in_parts
from solvers.driven.error_bars import frequency_error, frequency_errors
from solvers.driven.forms import Forms, best_volts, face_grams, forms
from solvers.measures.confinement import ratio_db
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.responses import driven_hz, near_hz
from solvers.threads import one_thread

DETUNING = 0.02
METHODS = ("neither", "rows", "patches", "both")


@dataclass(frozen=True, eq=False)
class _Plate:
    """A plate with its errors: quadratic forms at any excitation frequencies."""

    forced: ForcedPlate
    grams: FloatArray
    known: Doubts | None

    @classmethod
    def of(cls, forced: ForcedPlate) -> _Plate:
        return cls(forced, face_grams(forced), doubts(forced, calibration.mixing()))

    def forms(self, tones: FloatArray) -> Forms:
        return forms(self.forced, self.grams, tones)

    def eigenvalue(self, tones: FloatArray) -> FloatArray:
        return self.forced.plate.scale.eigenvalue(tones)

    def changes(self, own: Forms, tones: FloatArray, volts: ComplexArray, still: int | None = None) -> Iterator[Change]:
        assert self.known is not None
        return changes(self.known, own, self.eigenvalue(tones), volts, still)


@dataclass(frozen=True)
class Plates:
    """Plate of the case, its copy without rows, and two with the pillars' resonances lower and higher by the detuning."""

    rows: _Plate
    bare: _Plate
    detuned: tuple[_Plate, ...]


@dataclass(frozen=True, eq=False)
class _Method:
    """One method on its own plate: figures (level, V per um, detuned level, level with detuned rows) and errors over frequency.

    fixed (d,): voltages of the drivers, None if they are shaped at each frequency for the plate as it is; detuned: plates of
    the last figure.
    """

    own: _Plate
    fixed: ComplexArray | None
    detuned: tuple[_Plate, ...]
    alpha: float

    def with_bars(self, tones: FloatArray, still: int | None = None) -> FloatArray:
        """Figures and their errors, (2, 4, t); NaN where one is meaningless or unknown.

        still: mode of its own plate whose frequency does not vary.
        """
        own, others = [self.own.forms(each) for each in _off(tones)], [plate.forms(tones) for plate in self.detuned]
        plain = [_plain(self._fed(each)) for each in own], [_plain(self._fed(each)) for each in others]
        volts = self._volts(plain[0][0])
        nominal = _figures(volts, *plain)[..., 0, 0]
        if any(plate.known is None for plate in (self.own, *self.detuned)):
            return np.array([nominal, np.full_like(nominal, np.nan)])
        at = self._at(volts, len(tones))
        bars = [
            half_widths(
                nominal,
                self.own.changes(own[0], tones, at, still),
                [self._fed(each) for each in own],
                lambda *each: _figures(self._volts(each[0]), each, plain[1]),
            )
        ]
        for place, (plate, each) in enumerate(zip(self.detuned, others, strict=True)):

            def again(changed: ComplexArray, place: int = place) -> FloatArray:
                return _figures(volts, plain[0], [*plain[1][:place], changed, *plain[1][place + 1 :]])

            bars.append(half_widths(nominal, plate.changes(each, tones, at), [self._fed(each)], again))
        return np.array([nominal, np.linalg.norm(bars, axis=0)])

    def at_peak(self, tone: float, rows: _Plate) -> FloatArray:
        """Figures and their errors, (2, 4), at a peak that follows its mode on the plate with rows."""
        if rows.known is None:
            return self.with_bars(np.array([tone]))[..., 0]
        mode, ends = rows.known.ends(rows.eigenvalue(np.array([tone]))[0])
        nominal, half = self.with_bars(np.array([tone]), mode if self.own is rows else None)[..., 0]
        own = [self._fed(self.own.forms(each)) for each in _off(tone * ends)]
        change = rows.known.at_ends(mode)
        parts = [each.softened(change)[:, :, mode, None] if self.own is rows else _plain(each) for each in own]
        others = [_plain(self._fed(plate.forms(tone * ends))) for plate in self.detuned]
        ended = _figures(self._volts(parts[0]), parts, others)[..., 0, 0]
        return np.array([nominal, np.hypot(half, np.abs(ended - nominal[:, None]).max(axis=1))])

    def _fed(self, each: Forms) -> Forms:
        return each if self.fixed is None else each.fed(self._at(self.fixed, len(each.answers)))

    def _volts(self, squares: ComplexArray) -> ComplexArray:
        """Voltages of the drivers, (t, m, s, d), for a plate's S (2, t, m, s, d, d); 1 for all if they are fixed."""
        return (
            best_volts(squares[0], squares[1], self.alpha)
            if self.fixed is None
            else np.ones((1, 1, 1, 1), dtype=complex)
        )

    def _at(self, volts: ComplexArray, count: int) -> ComplexArray:
        """Voltages of the drivers, (t, d)."""
        return volts[:, 0, 0] if self.fixed is None else np.broadcast_to(self.fixed, (count, len(self.fixed)))


def _off(tones: FloatArray) -> list[FloatArray]:
    """The frequencies, and those that are equivalent to resonances detuned downwards and upwards."""
    return [tones / (1.0 + sign * DETUNING) for sign in (0.0, -1.0, 1.0)]


def _plain(each: Forms) -> ComplexArray:
    """S (k, t, 1, 1, d, d) of a plate as computed."""
    return each.squares[:, :, None, None]


def _figures(volts: ComplexArray, own: Sequence[ComplexArray], detuned: Sequence[ComplexArray]) -> FloatArray:
    """Four figures (4, t, m, s) of voltages (t, m, s, d), from S of the plate, nominal and detuned, and of detuned plates."""
    squares = [_values(each, volts) for each in own]
    level, *off = [_level(each) for each in squares]
    per_um = UM * np.abs(volts).max(axis=-1) / np.sqrt(squares[0][0])
    rows_off = [_level(_values(each, volts)) for each in detuned] or [np.full_like(level, np.nan)]
    return np.array(
        np.broadcast_arrays(level, per_um, np.min(off, axis=0), np.minimum.reduce(np.broadcast_arrays(*rows_off)))
    )


def _values(squares: ComplexArray, volts: ComplexArray) -> FloatArray:
    """v^H S v, (k, t, m, s)."""
    return np.asarray(np.maximum((volts.conj() * (squares @ volts[..., None])[..., 0]).sum(axis=-1).real, 0.0))


def _level(squares: FloatArray) -> FloatArray:
    return ratio_db(*np.sqrt(squares))


@dataclass(frozen=True)
class SolvedHybrid:
    """Plate with rows, frequencies (t,) in Hz, and the driven target mode, in the band or elsewhere, with its error.

    methods: by name, figures (level in dB, V per um, detuned level, level with detuned pillars) and errors, (2, 4, t).
    """

    forced: ForcedPlate
    frequency_hz: FloatArray
    methods: dict[str, FloatArray]
    target_hz: float | None
    target_elsewhere_hz: float | None
    target_error: float | None
    target_elsewhere_error: float | None


@one_thread()
def solve(
    case: Case, log: Log, band_hz: tuple[float, float] | None, points: int, alpha: float,
    forced: ForcedPlate | None, meshes: list[MeshRecord],
) -> SolvedHybrid:  # fmt: skip
    """Drive the plate with rows and without, its patches in phase inside the zone or all shaped for contrast.

    alpha: penalty on voltages that move the plate little; forced: the plate, if it is solved already.
    """
    plates = _plates(case, log, band_hz, forced, meshes)
    rows, own = plates.rows, plates.rows.forced
    tone, (low, high) = driven_hz(own), own.band_hz
    target = near_hz(own, tone) if tone and low <= tone <= high else None
    tones = np.union1d(np.linspace(low, high, points), [] if target is None else [target])
    alone = (own.signs * driven_inside(case))[own.drivers].astype(complex)
    methods = {}
    with log.step(f"{len(tones)} frequencies, four methods each, and their error bars"):
        for name in METHODS:
            plate, others = (rows, plates.detuned) if name in ("rows", "both") else (plates.bare, ())
            method = _Method(plate, None if name in ("patches", "both") else alone, others, alpha)
            methods[name] = in_parts(method.with_bars, tones)
            if target is not None:
                methods[name][..., tones == target] = method.at_peak(target, rows)[..., None]
    known = tone is not None and own.target_place() is not None
    error = frequency_error(own, tone, frequency_errors(own)) if tone and known else None
    at, bar = ((target, None), (error, None)) if target else ((None, tone), (None, error))
    return SolvedHybrid(own, tones, methods, *at, *bar)


def driven_inside(case: Case) -> BoolArray:
    """Return the mask of the patches that drive the zone itself, (patches,)."""
    patches = case.patches
    assert patches is not None
    drives = np.isin(np.arange(patches.count), patches.drivers)
    return np.asarray(drives & (np.abs(np.array(patches.centres_m)[:, 1]) < case.design.width_m / 2.0))


def _plates(
    case: Case, log: Log, band_hz: tuple[float, float] | None, forced: ForcedPlate | None, meshes: list[MeshRecord]
) -> Plates:
    design = case.design
    outside = design.half_span_m - design.width_m / 2.0
    bare = replace(design, rows=0, extension_m=outside, graded=(), graded_pitches_m=())
    others = {"without rows": bare}
    others |= {f"with pillars detuned by {100.0 * d:+g}%": _retuned(design, 1.0 + d) for d in (-DETUNING, DETUNING)}
    rows = _Plate.of(forced or forced_plate(case, log, band_hz, meshes, is_announced=True))
    if forced is None:
        rows.forced.target_hz()  # searched while the matrices are in memory
        rows.forced.let_go()
    solved = []
    for number, (name, each) in enumerate(others.items(), start=2):
        log.info(f"plate {number} of {1 + len(others)}: {name}")
        plate = forced_plate(replace(case, design=each), log, rows.forced.band_hz, meshes, is_announced=True)
        solved.append(_Plate.of(plate))
        plate.let_go()
    return Plates(rows, solved[0], tuple(solved[1:]))


def _retuned(design: Design, factor: float) -> Design:
    """Plate whose pillars have `factor` times their own resonance frequencies, by a change of stiffness."""

    def of(pillar: Pillar) -> Pillar:
        return replace(pillar, material=pillar.material.scaled(factor**2))

    return replace(design, pillar=design.pillar and of(design.pillar), graded=tuple(map(of, design.graded)))
