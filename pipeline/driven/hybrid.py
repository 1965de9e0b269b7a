"""Rows and patches together: how far either and both confine the zone over frequency, and what detuning costs each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.layout import Design, Pillar
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.patched_plate import forced_plate
from pipeline.planning import calibration
from pipeline.planning.foresight import announce
from pipeline.planning.plan import HYBRID_POINTS, hybrid_step
from pipeline.quantity import frequency_with_bar, level_with_bar, with_bar
from pipeline.records.record import HybridMethod, HybridRecord, MeshRecord
from pipeline.units import UM
from solvers.driven.contrast import best_volts
from solvers.driven.curve_bars import Change, Doubts, changes, doubts, half_widths, in_parts
from solvers.driven.error_bars import frequency_error, frequency_errors
from solvers.driven.forms import Forms, face_grams, forms
from solvers.measures.levels import ratio_db
from solvers.piezo.circuit import driven_hz
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.peaks import near_hz
from solvers.threads import one_thread

DETUNING = 0.02
METHODS = ("neither", "rows", "patches", "both")
ALPHA = 0.3  # on the thesis' plate a tenth of the voltage for 0.3 dB less than the most


@dataclass(frozen=True, eq=False)
class _Plate:
    """A plate and what may be wrong about it: its forms at any tones."""

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
    """The case's plate, the same without rows, and two with the pillars' resonances lower and higher by the detuning."""

    rows: _Plate
    bare: _Plate
    detuned: tuple[_Plate, ...]


@dataclass(frozen=True, eq=False)
class _Method:
    """A method on its own plate, its figures (level, V per um, off, rows off) and their bars over tones.

    fixed (d,): the drivers' voltages; None where they are shaped for each tone, for the plate as it is. detuned: plates of the
    last figure.
    """

    own: _Plate
    fixed: ComplexArray | None
    detuned: tuple[_Plate, ...]
    alpha: float

    def with_bars(self, tones: FloatArray, still: int | None = None) -> FloatArray:
        """Figures and half-widths of their bars, (2, 4, t); NaN where one means nothing or is not known.

        still: mode of its own plate that stays where it is.
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
        """The same (2, 4) at a peak that follows its mode on the plate with rows."""
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
        """Of the drivers, (t, m, s, d), made for a plate's S (2, t, m, s, d, d); 1 for all where they are fixed."""
        return (
            best_volts(squares[0], squares[1], self.alpha)
            if self.fixed is None
            else np.ones((1, 1, 1, 1), dtype=complex)
        )

    def _at(self, volts: ComplexArray, count: int) -> ComplexArray:
        """Of the drivers, (t, d)."""
        return volts[:, 0, 0] if self.fixed is None else np.broadcast_to(self.fixed, (count, len(self.fixed)))


def _off(tones: FloatArray) -> list[FloatArray]:
    """The tones, and those at which every resonance is off as much the other way round."""
    return [tones / (1.0 + sign * DETUNING) for sign in (0.0, -1.0, 1.0)]


def _plain(each: Forms) -> ComplexArray:
    """S (k, t, 1, 1, d, d) of a plate as computed."""
    return each.squares[:, :, None, None]


def _figures(volts: ComplexArray, own: Sequence[ComplexArray], detuned: Sequence[ComplexArray]) -> FloatArray:
    """The four figures (4, t, m, s) of voltages (t, m, s, d), from S of the plate at its tones and off, and of detuned ones."""
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


@one_thread()
def solve(
    case: Case, log: Log, band_hz: tuple[float, float] | None = None, points: int = HYBRID_POINTS, alpha: float = ALPHA,
    forced: ForcedPlate | None = None, meshes: list[MeshRecord] | None = None,
) -> HybridRecord:  # fmt: skip
    """Confinement by rows alone, by patches alone on a plate without rows, by both, and by neither.

    InputError for a case without rows, patches inside the zone, two drivers fed by voltages, or a passive face.
    """
    inner = _checked(case)
    kept: list[MeshRecord] = [] if meshes is None else meshes
    step = hybrid_step(case, band_hz, points, 3 if forced else 4)
    assert step.demand
    announce(step.name, step.demand, log)
    plates = _plates(case, log, band_hz, forced, kept)
    rows, own = plates.rows, plates.rows.forced
    tone, (low, high) = driven_hz(own), own.band_hz
    wanted = near_hz(own, tone) if tone and low <= tone <= high else None
    tones = np.union1d(np.linspace(low, high, points), [] if wanted is None else [wanted])
    alone = (own.signs * inner)[own.drivers].astype(complex)
    with log.step(f"{len(tones)} frequencies, four methods each, and their error bars"):
        methods = []
        for name in METHODS:
            plate, others = (rows, plates.detuned) if name in ("rows", "both") else (plates.bare, ())
            method = _Method(plate, None if name in ("patches", "both") else alone, others, alpha)
            figures = in_parts(method.with_bars, tones)
            if wanted is not None:
                figures[..., tones == wanted] = method.at_peak(wanted, rows)[..., None]
            methods.append(_method(name, *figures))
    patches = case.patches
    assert patches is not None
    known = tone is not None and own.wanted_place() is not None
    error = frequency_error(own, tone, frequency_errors(own)) if tone and known else None
    record = HybridRecord(
        model=f"{own.plate.name} with {patches.count} patches",
        dof=sum(len(group.loads) for group in own.plate.groups),
        inside=int(inner.sum()),
        behind=len(patches.drivers) - int(inner.sum()),
        detuning=DETUNING,
        alpha=alpha,
        wanted_hz=wanted,
        wanted_elsewhere_hz=None if wanted else tone,
        frequency_hz=tones.tolist(),
        methods=methods,
        wanted_error=error if wanted else None,
        wanted_elsewhere_error=None if wanted else error,
    )
    for line in lines(record):
        log.info(line)
    return record


def _checked(case: Case) -> FloatArray:
    """Which patches drive the zone itself, 1 or 0, (patches,)."""
    case.require_plate(command="hybrid")
    case.require("patches", command="hybrid")
    patches, design = case.patches, case.design
    assert patches is not None
    drives = np.array([i in patches.drivers for i in range(patches.count)])
    inner = drives & (np.abs(np.array(patches.centres_m)[:, 1]) < design.width_m / 2.0)
    said = []
    if not design.rows:
        said.append("array.rows = 0: must be 1 or more, hybrid compares rows with patches")
    if patches.circuit != "short":
        said.append(f"patches.circuit = {patches.circuit!r}: must be 'short', shaped patches are fed by voltages")
    if not inner.any():
        said.append("patches.centres_mm: no driving patch stands inside the zone, at least one must")
    elif drives.sum() < 2:
        said.append("patches: one drives, shaping takes two or more")
    if said:
        raise InputError(f"{case.source or case.name}: {text}" for text in said)
    return inner.astype(float)


def _plates(
    case: Case, log: Log, band_hz: tuple[float, float] | None, forced: ForcedPlate | None, meshes: list[MeshRecord]
) -> Plates:
    design = case.design
    outside = design.half_span_m - design.width_m / 2.0
    bare = replace(design, rows=0, extension_m=outside, graded=(), graded_pitches_m=())
    others = {"without rows": bare}
    others |= {f"with pillars off by {100.0 * d:+g}%": _retuned(design, 1.0 + d) for d in (-DETUNING, DETUNING)}
    rows = _Plate.of(forced or forced_plate(case, log, band_hz, meshes, is_announced=True))
    if forced is None:
        rows.forced.wanted_hz()  # searched for while the matrices are at hand
        rows.forced.let_go()
    solved = []
    for number, (name, each) in enumerate(others.items(), start=2):
        log.info(f"plate {number} of {1 + len(others)}: {name}")
        plate = forced_plate(replace(case, design=each), log, rows.forced.band_hz, meshes, is_announced=True)
        solved.append(_Plate.of(plate))
        plate.let_go()
    return Plates(rows, solved[0], tuple(solved[1:]))


def _retuned(design: Design, factor: float) -> Design:
    """The plate with the pillars' own resonances at `factor` times theirs: by their stiffness."""

    def of(pillar: Pillar) -> Pillar:
        return replace(pillar, material=replace(pillar.material, young_pa=pillar.material.young_pa * factor**2))

    return replace(design, pillar=design.pillar and of(design.pillar), graded=tuple(map(of, design.graded)))


def _method(name: str, figures: FloatArray, bars: FloatArray) -> HybridMethod:
    """From figures and bars, (4, t) each."""
    db, per_um, off, rows_off = figures.tolist()
    errors = [[None if np.isnan(each) else each for each in column] for column in bars.tolist()]
    has_rows = bool(np.isfinite(figures[3]).all())
    return HybridMethod(
        method=name,  # type: ignore[arg-type]
        confinement_db=db,
        volts_per_um=per_um,
        off_db=off,
        rows_off_db=rows_off if has_rows else None,
        confinement_error_db=errors[0],
        volts_error_per_um=errors[1],
        off_error_db=errors[2],
        rows_off_error_db=errors[3] if has_rows else None,
    )


def lines(record: HybridRecord) -> list[str]:
    """The result in words."""
    return [f"{record.inside} patches drive inside the zone, {record.behind} beyond it", *_at_wanted(record)]


def _at_wanted(record: HybridRecord) -> Iterator[str]:
    place = record.wanted_place
    if place is None or record.wanted_hz is None:
        elsewhere = record.wanted_elsewhere_hz
        tone = frequency_with_bar(elsewhere, record.wanted_elsewhere_error)
        where = "no mode of the plate has its shape" if elsewhere is None else f"it lies at {tone}"
        yield f"the band does not hold the wanted mode, {where}: the levels over frequency stand alone"
        return
    yield f"at the wanted mode's peak, {frequency_with_bar(record.wanted_hz, record.wanted_error)}:"
    for method in record.methods:
        level, volts, off, rows_off = (_at(place, *each) for each in _pairs(method))
        alone = "" if method.rows_off_db is None else f", {level_with_bar(*rows_off)} with the pillars' alone"
        yield (
            f"{method.method}: {level_with_bar(*level)}, {with_bar(*volts, 'V')} for 1 um rms in the zone; "
            f"{level_with_bar(*off)} with every resonance off by {100.0 * record.detuning:g}%{alone}"
        )


def _pairs(method: HybridMethod) -> list[tuple[list[float] | None, list[float | None] | None]]:
    return [
        (method.confinement_db, method.confinement_error_db),
        (method.volts_per_um, method.volts_error_per_um),
        (method.off_db, method.off_error_db),
        (method.rows_off_db, method.rows_off_error_db),
    ]


def _at(place: int, values: list[float] | None, errors: list[float | None] | None) -> tuple[float, float | None]:
    return (values[place] if values else np.nan), (errors[place] if errors else None)
