"""Fingertip on the driven plate: target mode, amplitude, friction, drive of the loop, power, map of positions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from pipeline.case.features import LARGER, PLACES, STRESS, SUPPORTS
from pipeline.models.answer_parts import LoadedModeRecord, LoopRecord, TouchMapRecord, TouchStateRecord
from pipeline.quantity import MM, UM, frequency, frequency_with_bar, level_with_bar, several, signed, with_bar
from pipeline.quantity import figure as in_digits
from pipeline.questions.late import Axes, Case, Plan, ReportFigure, fields, np, plans, simplifications, style
from pipeline.questions.question import Pair, Question, Run, hz, option
from pipeline.questions.result import Result, figure_at, scaled
from pipeline.records.part import column


class TouchResult(Result, table="states", axes=("state",)):
    """Fingertip on the driven plate: amplitudes in m, powers in W, friction relative to rest; one row per state.

    >>> import antinode
    >>> [name for name, about in antinode.Touch.declared.items() if about.unit == "m"]
    ['at_m', 'radius_m', 'gap_m']
    """

    model: str = column("model of the plate and its element order, and the number of patches")
    dof: int = column("degrees of freedom that were solved for")
    fingertip: str = column("name of the fingertip impedance")
    source: str = column("source of its values")
    at_m: list[float] = column("centre of the contact", "m")
    radius_m: float = column("radius of the contact", "m")
    impedance_N_s_m: list[float] = column("impedance at the target mode, real and imaginary", "N s/m")
    force_N: float | None = column("normal force of the finger; None if not given", "N")
    gap_m: list[float] | None = column("smallest and largest air gap; None if not given", "m")
    quality_factor_given: float = column(
        "quality factor of the free plate that the case, or the loss of its materials, gives"
    )
    mode: LoadedModeRecord | None = column("target mode under the finger; None if none is left")
    states: list[TouchStateRecord] = column("one entry per way of driving; impossible ones are omitted")
    loop: LoopRecord | None = column("drive of the closed loop; None without a sensor")
    map: TouchMapRecord | None = column("finger at every position of the touch face; None if not requested")
    unknown: list[str] = column("reasons for missing figures, one sentence each")

    def state(self, name: str) -> TouchStateRecord | None:
        """Return a state by name.

        Parameters
        ----------
        name : {'free', 'touched', 'retuned', 'held', 'shaped'}
            Name of the state.

        Returns
        -------
        TouchStateRecord or None
            Amplitudes, powers and voltages; None for an impossible state.
        """
        return self.by_state.get(name)

    @property
    def by_state(self) -> dict[str, TouchStateRecord]:
        """States by name."""
        return {state.state: state for state in self.states}

    touch_shift_hz = figure_at("mode.shift_hz", "detuning by the finger", "Hz", is_difference=True, is_signed=True)
    touch_quality_factor = figure_at("mode.quality_factor", "quality factor under the finger")
    touch_share = figure_at("mode.share", "fraction of the target mode under the finger")
    free_um = figure_at("by_state.free.finger_m", "amplitude at the finger, free", "um", scale=UM)
    free_db = figure_at("by_state.free.confinement_db", "confinement, free", "dB")
    free_mw_at_1um = figure_at("by_state.free.drawn_mW_at_1um", "power at 1 um, free", "mW")
    free_v_at_1um = figure_at("by_state.free.drive_V_at_1um", "drive at 1 um, free", "V")
    touched_um = figure_at("by_state.touched.finger_m", "amplitude at the finger, touched", "um", scale=UM)
    touched_db = figure_at("by_state.touched.confinement_db", "confinement, touched", "dB")
    touched_mw_at_1um = figure_at("by_state.touched.drawn_mW_at_1um", "power at 1 um, touched", "mW")
    touched_v_at_1um = figure_at("by_state.touched.drive_V_at_1um", "drive at 1 um, touched", "V")
    shaped_um = figure_at("by_state.shaped.finger_m", "amplitude at the finger, shaped", "um", scale=UM)
    shaped_db = figure_at("by_state.shaped.confinement_db", "confinement, shaped", "dB")
    shaped_mw_at_1um = figure_at("by_state.shaped.drawn_mW_at_1um", "power at 1 um, shaped", "mW")
    shaped_v_at_1um = figure_at("by_state.shaped.drive_V_at_1um", "drive at 1 um, shaped", "V")
    touch_friction_low = figure_at("by_state.touched.friction_low", "friction at the low gap, relative to rest", "")
    touch_friction_high = figure_at("by_state.touched.friction_high", "friction at the high gap, relative to rest", "")
    touch_needed_v = figure_at("loop.needed_V", "drive to hold the sensor amplitude", "V")

    # -- words

    def lines(self) -> Iterator[str]:
        """Yield the finger, the mode under it, each state, the drive of the loop, and reasons for missing figures."""
        real, imaginary = self.impedance_N_s_m
        place = ", ".join(in_digits(each / MM, 0.0) for each in self.at_m)
        yield (
            f"fingertip {self.fingertip}: {in_digits(real)} {'-' if imaginary < 0.0 else '+'} "
            f"{in_digits(abs(imaginary))}i N s/m on a radius of {self.radius_m / MM:g} mm at ({place}) mm"
        )
        if self.mode:
            yield _mode_in_words(self.mode, self.quality_factor_given)
        yield from map(_state_in_words, self.states)
        if self.loop:
            yield _loop_in_words(self.loop)
        yield from self.unknown

    def __repr__(self) -> str:
        amplitudes = [f"{s.state} {in_digits(s.finger_m / UM, scaled(s.finger_error_m, UM))} um" for s in self.states]
        return f"<antinode.Touch: {', '.join(amplitudes)}>"

    # -- pictures

    def draw(self, ax: Axes) -> None:
        """Draw the amplitude at each position of the finger and the nodal lines; without a map the states."""
        if self.map is None:
            sizes = [state.finger_m / UM for state in self.states]
            ax.barh([state.state for state in self.states], sizes, color=style.BLUE)
            ax.set(xlabel="amplitude at the finger (µm)")
            return
        x_m, y_m, touched = self.map.x_m, self.map.y_m, np.array(self.map.touched_m) / UM
        title = f"Finger at each position, {_tone(self.map)}; lines: nodal lines of the free plate"
        fields.field(ax, x_m, y_m, touched, "amplitude (µm)", title)
        if len(x_m) > 1 and len(y_m) > 1:
            grid = np.array(x_m) / MM, np.array(y_m) / MM, np.array(self.map.displacement_m).T
            ax.contour(*grid, levels=[0.0], colors="white", linewidths=0.8)
        ax.plot(self.at_m[0] / MM, self.at_m[1] / MM, "+", color=style.VERMILION, ms=9)

    def pictures(self) -> list[ReportFigure]:
        """Return the pictures of amplitude, friction and drive over the finger's position; without a map the states."""
        if self.map is None:
            return super().pictures()
        count = 1 + (self.map.friction is not None) + (self.map.needed_V is not None)
        drawn, panels = fields.panels(count, self.plate_design and self.plate_design.width_m)
        self.draw(panels[0])
        more = {
            "friction relative to rest": ("Friction, where an estimate exists", self.map.friction),
            "drive (V)": ("Drive to hold the sensor amplitude", self.map.needed_V),
        }
        known = [(label, *each) for label, each in more.items() if each[1] is not None]
        for axes, (label, title, values) in zip(panels[1:], known, strict=True):
            fields.field(axes, self.map.x_m, self.map.y_m, values, label, title)
        return [style.ReportFigure("tactile", "Tactile map", self._alt(self.map), drawn)]

    def _alt(self, places: TouchMapRecord) -> str:
        touched = np.array(places.touched_m) / UM
        i, j = np.unravel_index(int(np.argmax(touched)), touched.shape)
        there = f"({in_digits(places.x_m[i] / MM)}, {in_digits(places.y_m[j] / MM)}) mm"
        half, here = places.touched_error_m, ""
        if state := self.state("touched"):
            bar = scaled(state.finger_error_m, UM)
            here = f"; {with_bar(state.finger_m / UM, bar, 'µm')} at the finger position of the case"
        return (
            f"Amplitude under {self.fingertip} at {touched.size} positions on the touch face, {_tone(places)}: "
            f"at most {with_bar(touched[i, j], None if half is None else half[i][j] / UM, 'µm')}, at {there}{here}"
        )


def _tone(places: TouchMapRecord) -> str:
    return frequency(places.frequency_hz, places.frequency_error)


def _mode_in_words(mode: LoadedModeRecord, quality_given: float) -> str:
    before = frequency_with_bar(mode.free_hz, mode.free_error)
    under = frequency_with_bar(mode.frequency_hz, mode.frequency_error)
    shift = signed(with_bar(mode.shift_hz, mode.shift_error_hz, "Hz"))
    quality = "none" if mode.quality_factor is None else with_bar(mode.quality_factor, mode.quality_error)
    share = with_bar(100.0 * mode.share, scaled(mode.share_error, 0.01), "%")
    mixed = " and is mixed with its neighbours" if mode.share < 0.5 else ""
    return (
        f"target mode from {before} to {under} ({shift}), quality factor from {quality_given:g} to "
        f"{quality}, by its complex eigenvalue f^2 (1 + i/Q); it keeps {share} of its shape{mixed}"
    )


def _state_in_words(state: TouchStateRecord) -> str:
    level = ""
    if state.confinement_db is not None:
        level = f", {level_with_bar(state.confinement_db, state.confinement_error_db)} above the passive face"
    ends = ((state.friction_low, state.friction_low_error), (state.friction_high, state.friction_high_error))
    ratios = ["unknown" if each is None else with_bar(each, error) for each, error in ends]
    friction = f"; friction {' to '.join(ratios)} of that at rest" if set(ratios) != {"unknown"} else ""
    drawn = ""
    if state.drawn_mW_at_1um is not None and state.drive_V_at_1um is not None:
        power = with_bar(state.drawn_mW_at_1um, state.drawn_error_mW_at_1um, "mW")
        drawn = f"; {power} and {with_bar(state.drive_V_at_1um, state.drive_error_V_at_1um, 'V')} at 1 um"
    tone = frequency_with_bar(state.frequency_hz, state.frequency_error)
    drive = with_bar(state.drive_V, state.drive_error_V if state.state == "held" else None, "V")
    motion = with_bar(state.finger_m / UM, scaled(state.finger_error_m, UM), "um")
    return f"{state.state} at {tone} and {drive}: {motion} at the finger{level}{friction}{drawn}"


def _loop_in_words(loop: LoopRecord) -> str:
    limit = "no limit is given" if loop.limit_V is None else f"the limit is {loop.limit_V:g} V"
    verdict = ": the amplifier saturates" if loop.saturates else ""
    needed = with_bar(loop.needed_V, loop.needed_error_V, "V")
    sensor = with_bar(loop.sensor_V, loop.sensor_error_V, "V")
    return f"closed loop: {needed} hold the sensor amplitude at {sensor}, {limit}{verdict}"


class Touch(
    Question[TouchResult],
    needs=("patches", "touch"),
    drives=True,
    honours=(LARGER, PLACES, SUPPORTS, STRESS),
    at_own_frequencies=True,
    example="touch examples/34-touch.toml --out touched",
):
    """Compute detuning (Hz), amplitude, friction and power with a finger on the driven plate (requires [touch]).

    >>> from antinode import Finger, Patches, load
    >>> plate = load("examples/small.toml", accuracy=0.1, patches=Patches(size_mm=(8.0, 3.0, 0.3)))
    >>> touched = plate.with_(touch=Finger(radius_mm=5.0)).touch((33.0, 36.0), mapped=False)
    >>> round(touched.mode.shift_hz, -2), round(touched.mode.quality_factor)
    (-300.0, 42)
    """

    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, kw_only=False, help="frequencies")
    mapped: bool = option(
        default=True, flag="map", help="also place the finger at every position on the touch face (--no-map to skip)"
    )

    def plan(self, case: Case) -> Plan:
        """Plan a finger on the driven plate, which excites every symmetry class."""
        step, touch = plans.response_step(case, hz(self.band_kHz), 1), case.touch
        assert touch is not None and case.patches is not None
        left_out = tuple(each for each in step.left_out if each.rule != "undriven_classes")
        places = ", and at every position of a map" * self.mapped
        looks = f"the target mode under {touch.tip.name} and free{places}; {several(case.patches.count, 'patch')}"
        classes = step.classes if step.classes == ("whole",) else simplifications.CLASSES
        about = {"measure": self.name, "name": "a finger on the plate", "classes": classes, "looks_for": looks}
        return plans.plan_of(case, replace(step, left_out=left_out, **about))  # type: ignore[arg-type]

    def compute(self, case: Case, plan: Plan, run: Run) -> TouchResult:
        from pipeline.models.touch import solve

        forced = run.solved.get("forced")
        meshes = [] if forced else run.meshes
        result = TouchResult(**solve(case, run, hz(self.band_kHz), self.mapped, forced, meshes))
        for line in result.lines():
            if line not in result.unknown:
                run.info(line)
        for reason in result.unknown:
            run.warning("NOT_TOLD", reason)
        return result
