"""Rows and patches together: how far either and both confine the zone over frequency, and what detuning costs each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.layout import Design, Pillar
from pipeline.analysis.response import driven_hz
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.patched_plate import forced_plate
from pipeline.planning.foresight import announce
from pipeline.planning.plan import HYBRID_POINTS, hybrid_step
from pipeline.records.record import HybridMethod, HybridRecord, MeshRecord
from pipeline.units import KHZ, UM
from solvers.driven.contrast import contrast_volts
from solvers.measures.levels import ratio_db
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.peaks import near_hz
from solvers.threads import one_thread

DETUNING = 0.02
ALPHA = 0.3  # on the thesis' plate a tenth of the voltage for 0.3 dB less than the most


@dataclass(frozen=True)
class Plates:
    """The case's plate, the same without rows, and two with the pillars' resonances lower and higher by the detuning."""

    rows: ForcedPlate
    bare: ForcedPlate
    detuned: tuple[ForcedPlate, ...]


@dataclass(frozen=True)
class _Levels:
    """Of one method at one frequency."""

    db: float
    volts_per_um: float
    off_db: float
    rows_off_db: float | None


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
    with log.step(f"{len(tones)} frequencies, four methods each"):
        methods = [
            _method(name, [_levels(plates, name, inner, float(f), alpha) for f in tones])
            for name in ("neither", "rows", "patches", "both")
        ]
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


def _method(name: str, levels: list[_Levels]) -> HybridMethod:
    rows_off = [each.rows_off_db for each in levels if each.rows_off_db is not None]
    return HybridMethod(
        method=name,  # type: ignore[arg-type]
        confinement_db=[each.db for each in levels],
        volts_per_um=[each.volts_per_um for each in levels],
        off_db=[each.off_db for each in levels],
        rows_off_db=rows_off or None,
    )


def lines(record: HybridRecord) -> list[str]:
    """The result in words."""
    return [f"{record.inside} patches drive inside the zone, {record.behind} beyond it", *_at_wanted(record)]


def _at_wanted(record: HybridRecord) -> Iterator[str]:
    place = record.wanted_place
    if place is None or record.wanted_hz is None:
        elsewhere = record.wanted_elsewhere_hz
        where = "no mode of the plate has its shape" if elsewhere is None else f"it lies at {elsewhere / KHZ:.3f} kHz"
        yield f"the band does not hold the wanted mode, {where}: the levels over frequency stand alone"
        return
    yield f"at the wanted mode's peak, {record.wanted_hz / KHZ:.3f} kHz:"
    for method in record.methods:
        off = "" if method.rows_off_db is None else f", {method.rows_off_db[place]:.1f} with the pillars' alone"
        yield (
            f"{method.method}: {method.confinement_db[place]:.1f} dB, {method.volts_per_um[place]:.3g} V for 1 um rms in "
            f"the zone; "
            f"{method.off_db[place]:.1f} dB with every resonance off by {record.detuning:.0%}{off}"
        )
