"""The decay per row in a study, and what it predicts of the finite plate."""

from __future__ import annotations

from pipeline.measures.asked import of_question
from pipeline.measures.measure import Measure, Work
from pipeline.questions.attenuation import Attenuation, prediction
from pipeline.records.tables import Column, figures_of

POINTS = 101  # of a study; the command asks for more
ASKED = of_question(Attenuation(points=POINTS))


def _compute(work: Work) -> None:
    ASKED.compute(work)
    if wanted := work.wanted:
        level = wanted.extension_db, wanted.extension_error_db
        work.keep(prediction=prediction(work.record["attenuation"], wanted.frequency_hz, *level))


_rows = figures_of(lambda r: r.prediction)
_error = _rows(lambda p: p.db_error)
COLUMNS = (
    Column("db_per_row", "decay per row", _rows(lambda p: p.db_per_row), "dB", _error),
    Column("db_error", "expected error of the decay", _error, "dB", _error),
    Column("rows_db", "predicted by the rows", _rows(lambda p: p.rows_db), "dB", _rows(lambda p: p.rows_error_db)),
    Column("rows_needed", "rows needed, endless ones", _rows(lambda p: p.rows_needed), ""),
)
ATTENUATION = Measure("attenuation", plan=ASKED.plan, compute=_compute, columns=COLUMNS, pictures=ASKED.pictures)
