"""Rows and patches together: how far either and both confine the zone over frequency, and what detuning costs each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.layout import Design, Pillar
from pipeline.analysis.response import driven_hz
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.patched_plate import forced_plate
from pipeline.planning import calibration
from pipeline.planning.foresight import announce
from pipeline.planning.plan import HYBRID_POINTS, hybrid_step
from pipeline.quantity import frequency, frequency_with_bar, level_with_bar, with_bar
from pipeline.records.record import HybridMethod, HybridRecord, MeshRecord
from pipeline.units import UM
from solvers.driven.contrast import contrast_volts
from solvers.driven.error_bars import (
    Louder,
    Variation,
    frequency_error,
    frequency_errors,
    half_widths,
    is_known,
    sources,
)
from solvers.measures.levels import ratio_db
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.height import height_error
from solvers.piezo.peaks import near_hz
from solvers.threads import one_thread

DETUNING = 0.02
METHODS = ("neither", "rows", "patches", "both")
ALPHA = 0.3  # on the thesis' plate a tenth of the voltage for 0.3 dB less than the most


@dataclass(frozen=True)
class Plates:
    """The case's plate, the same without rows, and two with the pillars' resonances lower and higher by the detuning."""

    rows: ForcedPlate
    bare: ForcedPlate
    detuned: tuple[ForcedPlate, ...]

    @property
    def every(self) -> tuple[ForcedPlate, ...]:
        """All of them."""
        return (self.rows, self.bare, *self.detuned)

    def with_one(self, plate: ForcedPlate, other: ForcedPlate) -> Plates:
        """The same with another plate in the place of one."""
        rows, bare, *detuned = (other if each is plate else each for each in self.every)
        return Plates(rows, bare, tuple(detuned))


@dataclass(frozen=True)
class _Levels:
    """Of one method at one frequency."""

    db: float
    volts_per_um: float
    off_db: float
    rows_off_db: float | None

    @property
    def values(self) -> FloatArray:
        """The figures; NaN for what has no meaning."""
        off = np.nan if self.rows_off_db is None else self.rows_off_db
        return np.array([self.db, self.volts_per_um, self.off_db, off])


Level = Callable[[Plates, float], _Levels]


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
    tone, (low, high) = driven_hz(plates.rows), plates.rows.band_hz
    wanted = near_hz(plates.rows, tone) if tone and low <= tone <= high else None
    tones = np.union1d(np.linspace(low, high, points), [] if wanted is None else [wanted])
    errors = {id(plate): frequency_errors(plate) for plate in plates.every}
    with log.step(f"{len(tones)} frequencies, four methods each"):
        levels = {name: [_levels(plates, name, inner, float(f), alpha) for f in tones] for name in METHODS}
    with log.step("error bars"):
        methods = []
        for name, own in levels.items():

            def level(of: Plates, tone: float, name: str = name) -> _Levels:
                return _levels(of, name, inner, tone, alpha)

            bars = [
                _peak_bars(plates, level, each, f, errors)
                if wanted is not None and f == wanted
                else _slope_bars(plates, level, each, f, errors)
                for each, f in zip(own, tones.tolist(), strict=True)
            ]
            methods.append(_method(name, own, bars))
    patches, plate = case.patches, plates.rows.plate
    assert patches is not None
    record = HybridRecord(
        model=f"{plate.name} with {patches.count} patches",
        dof=sum(group.pencil.dof for group in plate.groups),
        inside=int(inner.sum()),
        behind=len(patches.drivers) - int(inner.sum()),
        detuning=DETUNING,
        alpha=alpha,
        wanted_hz=wanted,
        wanted_elsewhere_hz=None if wanted else tone,
        frequency_hz=tones.tolist(),
        methods=methods,
        wanted_error=None if wanted is None else frequency_error(plates.rows, wanted, errors[id(plates.rows)]),
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
    others |= {f"with pillars off by {d:+.0%}": _retuned(design, 1.0 + d) for d in (-DETUNING, DETUNING)}
    first = forced or forced_plate(case, log, band_hz, meshes, is_announced=True)
    solved = []
    for number, (name, each) in enumerate(others.items(), start=2):
        log.info(f"plate {number} of {1 + len(others)}: {name}")
        solved.append(forced_plate(replace(case, design=each), log, first.band_hz, meshes, is_announced=True))
    return Plates(first, solved[0], tuple(solved[1:]))


def _retuned(design: Design, factor: float) -> Design:
    """The plate with the pillars' own resonances at `factor` times theirs: by their stiffness."""

    def of(pillar: Pillar) -> Pillar:
        return replace(pillar, material=replace(pillar.material, young_pa=pillar.material.young_pa * factor**2))

    return replace(design, pillar=design.pillar and of(design.pillar), graded=tuple(map(of, design.graded)))


def _levels(plates: Plates, method: str, inner: FloatArray, frequency_hz: float, alpha: float) -> _Levels:
    """Voltages made for the plate as computed; off: every resonance, or the pillars' alone, elsewhere by the detuning."""
    own = plates.rows if method in ("rows", "both") else plates.bare
    shaped = contrast_volts(own, frequency_hz, alpha) if method in ("patches", "both") else None
    volts: ComplexArray = np.asarray(plates.rows.signs * inner, dtype=complex) if shaped is None else shaped

    def level(plate: ForcedPlate, tone: float) -> tuple[float, float]:
        curve = plate.driven_by(volts).curve(np.array([tone]))
        assert curve.passive_rms_m_per_v is not None
        zone = float(curve.zone_rms_m_per_v[0])
        return float(ratio_db(zone, curve.passive_rms_m_per_v[0])), zone

    db, zone = level(own, frequency_hz)
    off = min(level(own, frequency_hz / (1.0 + sign * DETUNING))[0] for sign in (-1.0, 1.0))
    rows_off = min(level(plate, frequency_hz)[0] for plate in plates.detuned) if own is plates.rows else None
    return _Levels(db, UM * float(np.abs(volts).max()) / zone, off, rows_off)


def _peak_bars(
    plates: Plates, level: Level, own: _Levels, tone: float, errors: dict[int, list[FloatArray]]
) -> FloatArray:
    """Half-widths at the wanted mode's peak, which follows the plate with rows; each plate errs by itself."""
    share, squares = calibration.mixing(), np.zeros(4)
    for plate in plates.every:
        if share is None or not is_known(errors[id(plate)]):
            return np.full(4, np.nan)
        follows, load = plate is plates.rows, height_error(plate, tone)

        def again(each: Variation | Louder, plate: ForcedPlate = plate, follows: bool = follows) -> FloatArray:
            return level(plates.with_one(plate, each.of(plate)), tone * each.own if follows else tone).values

        squares += half_widths(own.values, sources(plate, errors[id(plate)], tone, share, load), again) ** 2
    return np.asarray(np.sqrt(squares))


def _slope_bars(
    plates: Plates, level: Level, own: _Levels, tone: float, errors: dict[int, list[FloatArray]]
) -> FloatArray:
    """Half-widths away from that peak: the worst over the frequency's bar, that of the worst known resonance about."""
    every = np.concatenate([each for plate in plates.every for each in errors[id(plate)]])
    worst = float(every.max()) if np.isfinite(every).all() else np.nan
    if not np.isfinite(worst):
        return np.full(4, np.nan)
    ends = [level(plates, tone * (1.0 + sign * worst)).values for sign in (-1.0, 1.0)]
    return np.asarray(np.max(np.abs(np.array(ends) - own.values), axis=0))


def _method(name: str, levels: list[_Levels], bars: list[FloatArray]) -> HybridMethod:
    rows_off = [each.rows_off_db for each in levels if each.rows_off_db is not None]
    columns = [[None if np.isnan(each) else float(each) for each in column] for column in np.array(bars).T]
    return HybridMethod(
        method=name,  # type: ignore[arg-type]
        confinement_db=[each.db for each in levels],
        volts_per_um=[each.volts_per_um for each in levels],
        off_db=[each.off_db for each in levels],
        rows_off_db=rows_off or None,
        confinement_error_db=columns[0],
        volts_error_per_um=columns[1],
        off_error_db=columns[2],
        rows_off_error_db=columns[3] if rows_off else None,
    )


def lines(record: HybridRecord) -> list[str]:
    """The result in words."""
    return [f"{record.inside} patches drive inside the zone, {record.behind} beyond it", *_at_wanted(record)]


def _at_wanted(record: HybridRecord) -> Iterator[str]:
    place = record.wanted_place
    if place is None or record.wanted_hz is None:
        elsewhere = record.wanted_elsewhere_hz
        where = "no mode of the plate has its shape" if elsewhere is None else f"it lies at {frequency(elsewhere)}"
        yield f"the band does not hold the wanted mode, {where}: the levels over frequency stand alone"
        return
    yield f"at the wanted mode's peak, {frequency_with_bar(record.wanted_hz, record.wanted_error)}:"
    for method in record.methods:
        level, volts, off, rows_off = (_at(place, *each) for each in _pairs(method))
        alone = "" if method.rows_off_db is None else f", {level_with_bar(*rows_off)} with the pillars' alone"
        yield (
            f"{method.method}: {level_with_bar(*level)}, {with_bar(*volts, 'V')} for 1 um rms in the zone; "
            f"{level_with_bar(*off)} with every resonance off by {record.detuning:.0%}{alone}"
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
