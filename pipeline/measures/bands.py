"""Bloch bands of the unit cell and their gaps."""

from __future__ import annotations

from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan, simplifications
from pipeline.records.tables import Column, figures_of


def _compute(work: Work) -> None:
    from pipeline.analysis import bands

    result = bands.solve_bands(work.case, work.log, shapes=True, every_gap=False)
    work.keep(result.meshes, result.shapes, bands=result.record)
    work.solved["lattice"] = result.lattice


_gap = figures_of(lambda r: r.bands.widest_gap if r.bands else None)
_bending = figures_of(lambda r: (r.bands.bending_at_m_hz or None) if r.bands else None)
_bars = figures_of(lambda r: (r.bands.bending_errors or None) if r.bands else None)
COLUMNS = (
    Column("gap_lower_hz", "gap from", _gap(lambda gap: gap.lower_hz), "Hz", _gap(lambda gap: gap.lower_error)),
    Column("gap_upper_hz", "gap to", _gap(lambda gap: gap.upper_hz), "Hz", _gap(lambda gap: gap.upper_error)),
    Column("gap_lower_error", "expected error of gap from", _gap(lambda gap: gap.lower_error), "%"),
    Column("gap_upper_error", "expected error of gap to", _gap(lambda gap: gap.upper_error), "%"),
    Column(
        "bending_m_1_hz",
        "bending at M, first",
        _bending(lambda pair: pair[0]),
        "Hz",
        _bars(lambda bars: bars[0]),
    ),
    Column(
        "bending_m_2_hz",
        "bending at M, second",
        _bending(lambda pair: pair[1] if len(pair) > 1 else None),
        "Hz",
        _bars(lambda bars: bars[1] if len(bars) > 1 else None),
    ),
)

BANDS = Measure(
    "bands",
    plan=lambda case: simplifications.no_lattice(case.design, "bands") or plan.bands_step(case),
    compute=_compute,
    columns=COLUMNS,
    pictures=("bands.dispersion",),
)
