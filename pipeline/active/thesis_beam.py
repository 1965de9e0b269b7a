"""The thesis' statements on active pillars beside what the study computes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from solvers.control.comparison import Entry, agreement

if TYPE_CHECKING:
    from solvers.active_beam.study import ActiveBeamStudy, Case

CONFINED = 2.0  # rms inside over rms outside from which a shape counts as confined here
UM = 1e6


def entries(study: ActiveBeamStudy) -> list[Entry]:
    """Equal forces, opposed forces, the two gains, the higher frequency, forces and delay; first and last of the data."""
    return [_equal(study), _couples(study), _opposed(study), _gain(study), _higher(study), _force(study), _delay(study)]


def _first(study: ActiveBeamStudy, layout: str) -> Case:
    return study.case(layout, study.data.frequencies_hz[0], study.data.gains_n_m[-1])


def _where(case: Case) -> str:
    return f"{case.frequency_hz / 1e3:g} kHz, K' = {case.gain_n_m:g} N/m"


def _equal(study: ActiveBeamStudy) -> Entry:
    case, pair = _first(study, "point"), _first(study, "pair")
    ours = f"rms inside / beyond {case.after.ratio:.2f}; two points a side {pair.after.ratio:.2f} ({_amplitudes(pair)})"
    return Entry(
        f"equal forces, {_where(case)}", "/3 beyond the control points", ours, agreement(case.after.ratio, 3.0)
    )


def _amplitudes(case: Case) -> str:
    return (
        f"largest inside {case.before.inside_max * UM:.2f} -> {case.after.inside_max * UM:.2f} um, "
        f"inside / beyond {case.after.inside_max / case.after.outside_max:.2f}"
    )


def _couples(study: ActiveBeamStudy) -> Entry:
    case = _first(study, "couple")
    gain = case.after.inside_max / case.before.inside_max
    verdict = f"{agreement(gain, 3.0)} in the amplitude inside"
    if case.after.ratio < CONFINED:
        at, best = _best_place(study, "couple")
        verdict += f"; an antinode has no slope to hold: {at * 1e3:.0f} mm from an end a couple gives {best:.1f}"
    return Entry(
        f"couples on relative velocity, {_where(case)}", "2 -> 6 um inside, factor 6", _amplitudes(case), verdict
    )


def _best_place(study: ActiveBeamStudy, layout: str) -> tuple[float, float]:
    ratios = study.place_sweep[f"{layout} at {study.data.frequencies_hz[0]:g} Hz"]
    best = int(ratios.argmax())
    return float(study.sweep_places_m[best]), float(ratios[best])


def _opposed(study: ActiveBeamStudy) -> Entry:
    case = _first(study, "opposed")
    loop = next(one for one in study.stability if one.layout == "opposed")
    gain = case.after.inside_max / case.before.inside_max
    verdict = f"{agreement(gain, 3.0)} in the amplitude inside; "
    if max(loop.growth_per_s) > 0.0:
        verdict += (
            f"but half of its loops drive what they sense: poles grow from K' = {loop.unstable_from_n_m:.0f} N/m on"
        )
    else:
        verdict += "stable"
    return Entry(
        f"opposed forces, each of its own velocity, {_where(case)}",
        "2 -> 6 um inside, factor 6",
        _amplitudes(case),
        verdict,
    )


def _gain(study: ActiveBeamStudy) -> Entry:
    gains = sorted(set(study.data.gains_n_m))
    cases = [study.case("point", study.data.frequencies_hz[0], gain) for gain in dict.fromkeys((gains[0], gains[-1]))]
    ours = ", ".join(
        f"K' = {case.gain_n_m:g}: {case.strength:.1f} x 4EIb3, rms ratio {case.after.ratio:.2f}" for case in cases
    )
    if len(cases) == 1:
        verdict = "not compared: one gain was given, the contrast takes two"
    elif len({case.after.ratio >= CONFINED for case in cases}) == 1:
        verdict = "differs: on this strip both gains lie on the same side of 4EI beta^3; their contrast asks for a stiffer beam"
    else:
        verdict = "agrees: the two gains lie on both sides of 4EI beta^3"
    return Entry("the larger gain confines, the smaller does not", "1e8 works, 1e7 does not", ours, verdict)


def _higher(study: ActiveBeamStudy) -> Entry:
    tones = sorted(set(study.data.frequencies_hz))
    cases = {name: study.case(name, tones[-1], study.data.gains_n_m[-1]) for name in ("point", "pair")}
    ours = ", ".join(f"{name} {case.after.ratio:.2f}" for name, case in cases.items())
    fails = [name for name, case in cases.items() if case.after.ratio < CONFINED]
    if len(tones) == 1:
        verdict = "not compared: one frequency was given, the contrast takes two"
    elif fails:
        verdict = f"agrees for {' and '.join(fails)}: the loops stand near nodes now"
    else:
        verdict = "differs: it is confined here"
    if len(tones) > 1 and len(fails) == 1:
        verdict += "; a second point within half a wavelength holds what the first one misses"
    return Entry(f"the same at {_where(cases['point'])}", "fails", f"rms ratio: {ours}", verdict)


def _force(study: ActiveBeamStudy) -> Entry:
    case = _first(study, "point")
    ours = f"{case.force_n:.2f} N steady, {case.switch_on_n:.0f} N when the loops close on the moving beam"
    verdict = "agrees for the transient only" if case.switch_on_n >= 100.0 > case.force_n else "differs"
    return Entry(f"force, {_where(case)}", "may exceed 100 N", ours, verdict)


def _delay(study: ActiveBeamStudy) -> Entry:
    loop = next(one for one in study.stability if one.layout == "point")
    limits = ", ".join(
        f"{_limit(limit)} with {delay * 1e6:g} us"
        for limit, delay in zip(loop.gain_limits_n_m, study.data.delays_s, strict=False)
    )
    reach = max(loop.gain_limits_n_m[: len(study.data.delays_s)], default=0.0)
    verdict = (
        "the gains asked for cannot be had" if reach < min(study.data.gains_n_m) else "part of the gains can be had"
    )
    ours = f"{limits}, {_limit(loop.gain_limits_n_m[-1])} demodulated over one period"
    return Entry("stability with delay", "not treated", ours, verdict)


def _limit(gain: float) -> str:
    return f"K' < {gain:.2g} N/m" if gain > 0.0 else "no gain"
