"""Plates whose pillars differ, as printed ones do."""

from __future__ import annotations

from collections.abc import Callable

from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan
from pipeline.records.record import Record, SpreadRecord, ToleranceRecord
from pipeline.records.tables import Column, figures_of


def _compute(work: Work) -> None:
    from pipeline.analysis import tolerance

    result = tolerance.solve(work.case, work.log)
    work.keep(arrays=result.arrays(), tolerance=result.record)


_peak = figures_of(lambda r: r.tolerance.peak_hz if r.tolerance else None)
_level = figures_of(lambda r: r.tolerance.confinement_db if r.tolerance else None)
_deviation = _level(lambda s: s.deviation)


def _of_spread(spread: Callable[[ToleranceRecord], SpreadRecord | None]) -> Callable[[Record], float | None]:
    """Bar of the spread of a tolerance study's samples."""

    def bar(record: Record) -> float | None:
        found = spread(record.tolerance) if record.tolerance else None
        return found.spread_error(record.tolerance.counted) if found and record.tolerance else None

    return bar


COLUMNS = (
    Column(
        "tolerance_peak_hz", "peak, pillars unlike: mean", _peak(lambda s: s.mean), "Hz", _peak(lambda s: s.relative)
    ),
    Column(
        "tolerance_peak_spread_hz",
        "its spread",
        _peak(lambda s: s.deviation),
        "Hz",
        _of_spread(lambda t: t.peak_hz),
        is_difference=True,
    ),
    Column("tolerance_db", "confinement, pillars unlike: mean", _level(lambda s: s.mean), "dB", _deviation),
    Column("tolerance_spread_db", "its spread", _deviation, "dB", _of_spread(lambda t: t.confinement_db)),
    Column("tolerance_worst_db", "the worst", _level(lambda s: s.lowest), "dB", _deviation),
)

TOLERANCE = Measure(
    "tolerance",
    plan=plan.tolerance_step,
    compute=_compute,
    needs=("tolerance",),
    drives=True,
    columns=COLUMNS,
    pictures=("plots.response.tolerance",),
)
