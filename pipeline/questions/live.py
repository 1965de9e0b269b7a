"""The explorer's answer for a design, in tenths of a second once its materials' reduced bases are cached."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import nan
from typing import Any, Self

from pipeline.errors import InputError
from pipeline.quantity import frequency, level_with_bar
from pipeline.questions.late import Case, Plan, np, simplifications
from pipeline.questions.question import Question, Run
from pipeline.questions.result import Result, figure_at
from pipeline.records.part import bar, column

RENAMED = {"zone_to_extension_db": "extension_db", "zone_to_extension_error_db": "extension_error_db"}


class LiveResult(Result, axes=()):
    """Answer of the explorer: target mode of a column of cells, widest complete gap, attenuation per row there."""

    frequency_hz: float | None = column(
        "frequency of the column's target mode", "Hz", error="frequency_error", default=None
    )
    frequency_error: float | None = column(
        "relative error bar: approximation by a column, and its cells' mesh", default=None
    )
    confinement_db: float | None = column(
        "confinement of the column's target mode", "dB", error="confinement_error_db", default=None
    )
    confinement_error_db: float | None = column("error bar: approximation by a column", "dB", default=None)
    zone_to_extension_db: float | None = column(
        "rms on the zone of the column relative to that beyond the rows",
        "dB",
        error="zone_to_extension_error_db",
        default=None,
    )
    zone_to_extension_error_db: float | None = bar("zone_to_extension_db", "dB")
    mac: float | None = column("modal assurance criterion with the target shape", default=None)
    gap_hz: list[float] | None = column("both edges of the widest complete gap", "Hz", error="gap_error", table=False)
    gap_error: float | None = column(
        "relative error bar of the gap's edges (half-width); None without an estimate for the mesh"
    )
    db_per_row: float | None = column("attenuation per row at the target mode", "dB", error="db_error")
    db_error: float | None = column(
        "change of the attenuation per row within the error bar of the mode's frequency; None without an attenuation",
        "dB",
        default=None,
    )
    why_not: str = column("why the column has no target mode", default="")
    warnings: list[str] = column("reasons why a column does not represent this design")

    live_target_hz = figure_at("frequency_hz", "target mode, live", "Hz")
    live_error = figure_at("frequency_error", "its expected error, live", "%")
    live_confinement_db = figure_at("confinement_db", "confinement, live", "dB")
    live_confinement_error_db = figure_at(
        "confinement_error_db", "its expected error, live", "dB", error="confinement_error_db"
    )
    live_db_per_row = figure_at("db_per_row", "attenuation per row, live", "dB")

    @classmethod
    def of_answer(cls, answer: Mapping[str, Any]) -> Self:
        """Return the figures of the explorer's document."""
        plate = answer["plate"]
        widest = max(answer["bands"]["gaps"], key=lambda gap: gap["upper_hz"] - gap["lower_hz"], default=None)
        known = {name: plate[RENAMED.get(name, name)] for name in cls.declared if RENAMED.get(name, name) in plate}
        decay, error = _decay(answer["rows"], known.get("frequency_hz"), known.get("frequency_error"))
        return cls(
            **known,
            gap_hz=widest and [widest["lower_hz"], widest["upper_hz"]],
            gap_error=widest and widest["error"],
            db_per_row=decay,
            db_error=error,
            warnings=answer["warnings"],
        )

    def lines(self) -> Iterator[str]:
        """Yield the column's target mode, or the reason why there is none."""
        if self.frequency_hz is None:
            yield f"no target mode in a column of cells: {self.why_not}"
            return
        level = level_with_bar(self.confinement_db, self.confinement_error_db)
        yield f"target mode of a column of cells: {frequency(self.frequency_hz, self.frequency_error)}, {level}"


def _decay(rows: Mapping[str, Any], at_hz: float | None, error: float | None) -> tuple[float | None, float | None]:
    """Return the attenuation per row at a frequency and its change within the error bar of the frequency, dB."""
    known = [(hz, db) for hz, db in zip(rows["frequency_hz"], rows["db_per_row"], strict=True) if db is not None]
    if not at_hz or not known:
        return None, None
    tones, levels = np.array(known).T
    decay = float(np.interp(at_hz, tones, levels, left=nan, right=nan))
    if error is None:
        return decay, None
    ends = at_hz * (1.0 - error), at_hz * (1.0 + error)
    near = levels[(tones > ends[0]) & (tones < ends[1])]
    within = np.append(np.interp(ends, tones, levels, left=nan, right=nan), near)
    return decay, float(np.abs(within - decay).max())


class Live(Question[LiveResult], in_studies_only=True):
    """Answer from the explorer's reduced bases, which represent a plate by one column of its cells."""

    step = ("answer of the explorer", "parametric cell, and a column of such cells")

    @classmethod
    def spared(cls, case: Case) -> simplifications.Simplification | None:
        from pipeline.models import parametric

        try:
            case.require("pillar", "zone", command="the measure live")
            box = parametric.require_box(case)
        except InputError as fault:
            lacking = "; ".join(fault.lines)
        else:
            lacking = "; ".join(box.faults(parametric.sizes_of(case.design)))
        return simplifications.Simplification("no_live", "live", lacking) if lacking else None

    def compute(self, case: Case, plan: Plan, run: Run) -> LiveResult:
        """Answer from the reduced bases, which are computed once per pair of materials."""
        from pipeline.explore.answer import Explorer, Scene
        from pipeline.models.parametric import cell_model

        explorer = Explorer(Scene(case, {}, ()), cell_model(case, run.log))
        with run.step("answer from the reduced bases"):
            live = LiveResult.of_answer(explorer.document(case, {}))
        for text in (*live.warnings, *([live.why_not] if live.why_not else [])):
            run.log.warning("LIVE", text)
        return live
