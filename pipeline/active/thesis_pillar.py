"""The thesis' statements on the circuit and on one pillar beside what is computed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from solvers.control.comparison import Entry

if TYPE_CHECKING:
    from solvers.resonators.mason_study import MasonStudy
    from solvers.resonators.pillar_row import PillarFilter
    from solvers.resonators.point_load import PointForce

UNDRIVEN = 0.05  # of the loudest joint velocity: a mode below it does not answer
STOPS_DB = 1.0  # a row: from here on the computed cell's flexural wave counts as stopped


def mason_entries(study: MasonStudy) -> list[Entry]:
    """The mode that is confined, the bare beam without it, the filtered beam with it.

    The study has to hold the modes about its target: the default window of mason_study does, a band to show need not.
    """
    target, f = study.data.target_hz, study.frequencies_hz
    peak = np.abs(study.clamped).max()
    answers = [
        m for m in study.clamped_modes_hz if np.abs(study.clamped[np.argmin(np.abs(f - m))]).max() > UNDRIVEN * peak
    ]
    number = int(np.argmin(np.abs(study.clamped_modes_hz - target))) + 1
    nearest = _nearest(study.bare_modes_hz, target)
    added = _nearest(study.filtered_modes_hz, target)
    first = f"mode {number} of the three clamped cells; answering: {', '.join(f'{m / 1e3:.2f}' for m in answers)} kHz"
    odd = "differs in its number: a central source leaves the odd modes silent, and 25 kHz is beyond the stated sweep"
    odd = "agrees" if number == 1 else odd
    gained = study.confinement_filtered_db - study.confinement_bare_db
    return [
        Entry("mode to be confined", "first of three clamped cells, 25 kHz, in a sweep to 20 kHz", first, odd),
        Entry(
            f"five free cells near {target / 1e3:g} kHz without filter",
            "no mode matches",
            f"nearest mode {nearest / 1e3:.2f} kHz",
            "agrees" if abs(nearest / target - 1.0) > 0.02 else "differs: one is there",
        ),
        Entry(
            "the same with filters at joints 1 and 4",
            "one more mode, between the filters only",
            f"mode at {added / 1e3:.3f} kHz; inner over outer joints {study.confinement_filtered_db:.0f} dB, "
            f"{study.confinement_bare_db:.0f} dB without",
            "agrees" if abs(added / target - 1.0) < 1e-3 and gained > 20.0 else "differs",
        ),
    ]


def _nearest(modes: Any, target: float) -> float:
    return float(modes[np.argmin(np.abs(modes - target))])


def pillar_entries(pillar_row: PillarFilter, point: PointForce, cell: dict[str, Any] | None) -> list[Entry]:
    """Figure 3.2, the condition (3.21), the pillar against its clamped resonance, rows, and the computed cell."""
    damper, spring, printed = (point.of(name) for name in ("printed damper", "spring", "printed force"))
    ratio, above = (
        pillar_row.stopped_hz / pillar_row.clamped_hz,
        pillar_row.oscillator_stopped_hz / pillar_row.clamped_hz,
    )
    entries = [
        Entry(
            "force that stops a flexural wave, figure 3.2",
            "-4i EI b3 W_p, w(0) = -W_p",
            f"+4i EI b3 W_p, |t|2 = {spring.transmitted:.0e}; w(0) = -i W_p; printed sign: |t|2 = {printed.transmitted:g}",
            "differs in sign: the force is that of a spring, 4 EI b3, in phase with the displacement"
            if printed.transmitted > 1.0 > spring.transmitted
            else "agrees",
        ),
        Entry(
            "damped oscillator at resonance, (3.21)",
            "stops the wave",
            f"transmits {damper.transmitted:.2f}, reflects {damper.reflected:.2f}, absorbs {damper.absorbed:.2f} of the power",
            "differs: a force in phase with the velocity cannot reflect all" if damper.reflected < 0.99 else "agrees",
        ),
        Entry(
            "where one pillar stops the wave",
            "at its resonance; the confined mode is seen at 32 kHz, the pillar alone at 38 kHz (0.84)",
            f"{pillar_row.stopped_hz / 1e3:.2f} kHz, {ratio:.2f} of the clamped "
            f"{pillar_row.clamped_hz / 1e3:.2f} kHz by its moment; "
            f"a vertical oscillator {above:.2f}",
            "agrees in direction: a bending pillar stops below its resonance"
            if ratio < 1.0
            else "differs in direction",
        ),
        Entry(
            "half-power band of 1, 2, ... rows",
            "not given",
            "; ".join(map(_band, pillar_row.bands_hz)),
            "beyond the text",
        ),
        Entry("stop band of an endless row on a strip", "not given", _band(pillar_row.stop_hz), "beyond the text"),
    ]
    return [*entries, _cell_entry(pillar_row, cell)] if cell else entries


def _band(band: tuple[float, float] | None) -> str:
    return f"{band[0] / 1e3:.2f}-{band[1] / 1e3:.2f} kHz" if band else "none in the window"


def _cell_entry(pillar_row: PillarFilter, cell: dict[str, Any]) -> Entry:
    f = np.array(cell["frequencies_hz"])
    decay = np.array([np.nan if value is None else value for value in cell["db_per_row"]])
    stopped = f[np.nan_to_num(decay, nan=np.inf) > STOPS_DB]
    ours = f"{stopped.min() / 1e3:.2f}-{stopped.max() / 1e3:.2f} kHz" if stopped.size else "none in the window"
    verdict = "no stop band in one of the two"
    if stopped.size and pillar_row.stop_hz:
        low, high = stopped.min() / pillar_row.stop_hz[0] - 1.0, stopped.max() / pillar_row.stop_hz[1] - 1.0
        verdict = f"the cell's lower edge lies {100 * low:+.0f} %, its upper {100 * high:+.0f} % from the strip's"
    return Entry("stop band of the computed plate cell, normal incidence", "not given", ours, verdict)
