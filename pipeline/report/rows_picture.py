"""The complex bands of a study's case, its wanted mode marked."""

from __future__ import annotations

from typing import Any

from pipeline.plots.style import ReportFigure
from pipeline.questions.attenuation import AttenuationResult
from pipeline.records.study import StoredCase


def attenuation(case: StoredCase, arrays: dict[str, Any]) -> ReportFigure | None:
    """Draw decay per row, wavenumbers across the rows and the power that passes them."""
    answer, wanted = case.record.of(AttenuationResult), case.record.wanted
    return answer.complex_bands(wanted.frequency_hz if wanted else None) if answer else None
