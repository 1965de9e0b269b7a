"""A finger on the driven plate, and the same finger at every place of the touch face."""

from __future__ import annotations

from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan
from pipeline.records.record import TouchRecord, TouchStateRecord
from pipeline.records.tables import Column, figures_of
from pipeline.units import UM


def _compute(work: Work) -> None:
    from pipeline.analysis import touch

    meshes = [] if "forced" in work.solved else work.meshes
    work.keep(touch=touch.solve(work.case, work.log, forced=work.solved.get("forced"), meshes=meshes))


def _state(name: str) -> list[Column]:
    """Columns of a state."""

    def of(touch: TouchRecord | None) -> TouchStateRecord | None:
        return touch.state(name) if touch else None

    figure = figures_of(lambda record: of(record.touch))
    return [
        Column(
            f"{name}_um",
            f"amplitude at the finger, {name}",
            figure(lambda s: s.finger_m / UM),
            "um",
            figure(lambda s: None if s.finger_error_m is None else s.finger_error_m / UM),
        ),
        Column(
            f"{name}_db",
            f"confinement, {name}",
            figure(lambda s: s.confinement_db),
            "dB",
            figure(lambda s: s.confinement_error_db),
        ),
        Column(
            f"{name}_mw_at_1um",
            f"power at 1 um, {name}",
            figure(lambda s: s.drawn_mW_at_1um),
            "mW",
            figure(lambda s: s.drawn_error_mW_at_1um),
        ),
        Column(
            f"{name}_v_at_1um",
            f"drive at 1 um, {name}",
            figure(lambda s: s.drive_V_at_1um),
            "V",
            figure(lambda s: s.drive_error_V_at_1um),
        ),
    ]


_mode = figures_of(lambda r: r.touch.mode if r.touch else None)
_loop = figures_of(lambda r: r.touch.loop if r.touch else None)
_touched = figures_of(lambda r: r.touch.state("touched") if r.touch else None)
COLUMNS = (
    Column(
        "touch_shift_hz",
        "detuning by the finger",
        _mode(lambda m: m.shift_hz),
        "Hz",
        _mode(lambda m: m.shift_error_hz),
        is_difference=True,
        is_signed=True,
    ),
    Column(
        "touch_quality_factor",
        "quality factor under the finger",
        _mode(lambda m: m.quality_factor),
        "",
        _mode(lambda m: m.quality_error),
    ),
    Column(
        "touch_share",
        "share of the wanted mode under the finger",
        _mode(lambda m: m.share),
        "",
        _mode(lambda m: m.share_error),
    ),
    *(column for name in ("free", "touched", "shaped") for column in _state(name)),
    Column(
        "touch_friction_low",
        "friction at the low gap over that at rest",
        _touched(lambda s: s.friction_low),
        "",
        _touched(lambda s: s.friction_low_error),
    ),
    Column(
        "touch_friction_high",
        "friction at the high gap over that at rest",
        _touched(lambda s: s.friction_high),
        "",
        _touched(lambda s: s.friction_high_error),
    ),
    Column(
        "touch_needed_v",
        "drive that holds the sensor's amplitude",
        _loop(lambda p: p.needed_V),
        "V",
        _loop(lambda p: p.needed_error_V),
    ),
)

TOUCH = Measure(
    "touch",
    plan=plan.touch_step,
    compute=_compute,
    needs=("patches", "touch"),
    drives=True,
    columns=COLUMNS,
    pictures=("plots.touch.tactile",),
)
