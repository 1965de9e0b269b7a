"""Plates whose pillars differ, as printed ones do."""

from __future__ import annotations

from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan
from pipeline.records.tables import Column, figures_of


def _compute(work: Work) -> None:
    from pipeline.analysis import tolerance

    result = tolerance.solve(work.case, work.log)
    work.keep(arrays=result.arrays(), tolerance=result.record)


_peak = figures_of(lambda r: r.tolerance.peak_hz if r.tolerance else None)
_level = figures_of(lambda r: r.tolerance.confinement_db if r.tolerance else None)
COLUMNS = (
    Column("tolerance_peak_hz", "peak, pillars unlike: mean", _peak(lambda s: s.mean), ".1f", "Hz"),
    Column("tolerance_peak_spread_hz", "its spread", _peak(lambda s: s.deviation), ".1f", "Hz"),
    Column("tolerance_db", "confinement, pillars unlike: mean", _level(lambda s: s.mean), ".2f", "dB"),
    Column("tolerance_spread_db", "its spread", _level(lambda s: s.deviation), ".2f", "dB"),
    Column("tolerance_worst_db", "the worst", _level(lambda s: s.lowest), ".2f", "dB"),
)

TOLERANCE = Measure(
    "tolerance",
    plan=plan.tolerance_step,
    compute=_compute,
    needs=("tolerance",),
    drives=True,
    columns=COLUMNS,
    pictures=("response.tolerance",),
)
