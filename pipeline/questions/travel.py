"""Travelling wave from two modes of the zone a quarter period apart: wave, power, table for the board."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import pi
from typing import Any

from pipeline.errors import InputError
from pipeline.models.answer_parts import PatternMode, PlayedPattern, PlayFault, ShearRecord
from pipeline.quantity import MM, UM, frequency, frequency_with_bar, level_with_bar, percent, with_bar
from pipeline.quantity import figure as in_digits
from pipeline.questions.late import Axes, Case, ComplexArray, Plan, ReportFigure, fields, np, plans, style
from pipeline.questions.question import Pair, Question, Run, hz, option
from pipeline.questions.result import Result, figure, figure_at, scaled
from pipeline.records.part import bar, column


class TravelResult(Result, axes=("x_m",)):
    """Travelling wave inside the zone: two modes a quarter period apart; fields and powers for 1 um rms there.

    `plate.travel()` computes one; powers are means over a period, amplitudes peaks.

    >>> import antinode
    >>> antinode.Travel.declared["twr"].about
    'travelling-wave ratio within window_m: 1 travels, 0 stands'
    """

    model: str = column("model of the plate and its element order, and the number of patches")
    dof: int = column("degrees of freedom that were solved for")
    frequency_hz: float = column("frequency of the wave, between those of its modes", "Hz", error="frequency_error")
    modes: list[PatternMode] = column("the two excited modes")
    others: float = column("weight of suppressing all other modes, relative to 1 for the two modes")
    twr: float = column("travelling-wave ratio within window_m: 1 travels, 0 stands", error="twr_error")
    alone_twr: float = column("travelling-wave ratio of the two shapes only", error="alone_twr_error")
    best_twr: float = column("best travelling-wave ratio with any voltages", error="best_twr_error")
    wavenumber_per_m: float = column("wavenumber of the wave", "rad/m", error="wavenumber_error_per_m")
    window_m: list[float] = column("interval along x over which the ratio is evaluated", "m")
    confinement_db: float | None = column(
        "rms of u_z on the active touch face relative to the passive one; None without one", "dB",
        error="confinement_error_db",
    )  # fmt: skip
    drive_V_at_1um: float = column("largest voltage for 1 um rms in the zone", "V", error="drive_error_V_at_1um")
    drivers: list[int] = column("numbers of the driven patches, from 0")
    volts: list[list[float]] = column("voltages of the drivers, real and imaginary, the largest 1 V", "V")
    x_m: list[float] = column("positions along the centre line of the zone", "m", along="x_m")
    field_m: list[list[float]] = column(
        "u_z along the centre line of the zone, real and imaginary", "m", along="x_m", parts=("re_m", "im_m"),
        error="field_error_m",
    )  # fmt: skip
    patches_W: list[float] = column(
        "power fed in by each patch, negative if it absorbs", "W", along="patch", error="patches_error_W"
    )
    lost_W: float = column("power dissipated in the plate", "W", error="lost_error_W")
    flow_x_m: list[float] = column("sections at which the power flow is evaluated", "m", along="flow_x_m")
    flow_W: list[float] = column(
        "power flow towards +x through the sections", "W", along="flow_x_m", error="flow_error_W"
    )
    standing_flow_W: list[float] = column(
        "the same with all drivers in phase with the target mode", "W", along="flow_x_m", error="standing_flow_error_W"
    )
    inner_sections: int | None = column(
        "number of sections between the plate's ends, where the flow is zero", default=None
    )
    frequency_error: float | None = bar("frequency_hz, relative")
    twr_error: float | None = bar("twr")
    alone_twr_error: float | None = bar("alone_twr")
    best_twr_error: float | None = bar("best_twr")
    wavenumber_error_per_m: float | None = bar("wavenumber_per_m", "rad/m")
    confinement_error_db: float | None = bar("confinement_db", "dB")
    drive_error_V_at_1um: float | None = bar("drive_V_at_1um", "V")
    lost_error_W: float | None = bar("lost_W", "W")
    flow_error_W: list[float | None] | None = bar("flow_W", "W", along="flow_x_m")
    patches_error_W: list[float | None] | None = bar("patches_W", "W", along="patch")
    standing_flow_error_W: list[float | None] | None = bar("standing_flow_W", "W", along="flow_x_m")
    field_error_m: list[float | None] | None = bar("magnitude of field_m", "m", along="x_m", name="size_error_m")
    shear: ShearRecord | None = column("effect of the wave on a finger at rest; None without a finger", default=None)
    board: list[PlayedPattern] | PlayFault | None = column(
        "result of the table on the emulated board; None if it was not run", default=None
    )
    tables: list[str] = column("files of the table for the six-channel board", default_factory=list)

    @property
    def field(self) -> ComplexArray:
        """u_z along the centre line of the zone, complex (points,) in m."""
        return np.asarray(np.array(self.field_m) @ np.array([1.0, 1j]))

    @property
    def largest_flow_W(self) -> tuple[float, float | None, float]:
        """Largest power flow (signed), its error bar (half-width), and its position along x."""
        errors = self.flow_error_W or [None] * len(self.flow_W)
        return max(zip(self.flow_W, errors, self.flow_x_m, strict=True), key=lambda each: abs(each[0]))

    travel_hz = figure_at("frequency_hz", "travelling wave", "Hz")
    travel_twr = figure_at("twr", "travelling-wave ratio")
    travel_best_twr = figure_at("best_twr", "best ratio with any voltages")
    travel_db = figure_at("confinement_db", "confinement, travelling", "dB")
    travel_v_per_um = figure_at("drive_V_at_1um", "drive for 1 um, travelling", "V")

    @figure("power along the zone for 1 um", "mW", error=lambda wave: scaled(wave.largest_flow_W[1], 1e-3))
    def travel_mw(self) -> float | None:
        """Largest power flow; None if patches straddle every section."""
        return None if self.inner_sections == 0 else 1e3 * self.largest_flow_W[0]

    travel_crest_mm_s = figure_at(
        "shear.fastest_m_s", "crests under the finger", "mm/s", scale=MM,
        error=lambda wave: wave.shear and scaled(wave.shear.fastest_error_m_s, 1e-3),
    )  # fmt: skip

    def to_rows(self) -> list[dict[str, Any]]:
        """Return one row per position on the centre line: u_z real, imaginary, magnitude and its error bar."""
        sizes = [{"size_m": abs(complex(*each))} for each in self.field_m]
        return [row | size for row, size in zip(super().to_rows(), sizes, strict=True)]

    # -- words

    def lines(self) -> Iterator[str]:
        """Yield the modes, the ratios, drive and power, the finger, and the result on the board."""
        modes = [f"(0, {m.nodal_lines}) at {frequency_with_bar(m.frequency_hz, m.frequency_error)}" for m in self.modes]
        tone = frequency_with_bar(self.frequency_hz, self.frequency_error)
        yield f"modes {' and '.join(modes)}, held a quarter period apart at {tone}"
        level = ""
        if self.confinement_db is not None:
            level = f"; {level_with_bar(self.confinement_db, self.confinement_error_db)} above the passive face"
        half = pi / abs(self.wavenumber_per_m) / MM
        wave = with_bar(half, scaled(self.wavenumber_error_per_m, abs(self.wavenumber_per_m) / half), "mm")
        first, last = (in_digits(end / MM) for end in self.window_m)
        yield (
            f"travelling-wave ratio {with_bar(self.twr, self.twr_error)} from {first} to {last} mm, "
            f"{with_bar(self.alone_twr, self.alone_twr_error)} for the two shapes only, "
            f"{with_bar(self.best_twr, self.best_twr_error)} at best with any voltages; half-wavelength {wave}{level}"
        )
        flow = "the flow along the zone is unknown: patches straddle every section between the plate's ends"
        if self.inner_sections:
            most, error, x_m = self.largest_flow_W
            flow = f"{with_bar(1e3 * most, scaled(error, 1e-3), 'mW')} flow through x = {in_digits(x_m / MM)} mm"
        drive = with_bar(self.drive_V_at_1um, self.drive_error_V_at_1um, "V")
        lost = with_bar(1e3 * self.lost_W, scaled(self.lost_error_W, 1e-3), "mW")
        yield f"{drive} for 1 um rms in the zone; then {lost} are dissipated in the plate, {flow}"
        if self.shear:
            yield _of_shear(self.shear)
        for each in self.board if isinstance(self.board, list) else ():
            yield (
                f"emulated board, {each.name}: travelling-wave ratio {in_digits(each.twr, self.twr_error)} where "
                f"{in_digits(each.twr_target, self.twr_error)} is requested, error of the drives {percent(each.error)}"
            )

    def __repr__(self) -> str:
        return f"<antinode.Travel: {self._tone}, travelling-wave ratio {in_digits(self.twr, self.twr_error)}>"

    @property
    def _tone(self) -> str:
        return frequency(self.frequency_hz, self.frequency_error)

    # -- pictures

    def draw(self, ax: Axes) -> None:
        """Draw u_z along the centre line at six instants of a period, the envelope, and the window shaded."""
        x, field = np.array(self.x_m) / MM, self.field / UM
        for step in range(6):
            ax.plot(x, (field * np.exp(1j * np.pi * step / 3.0)).real, color=style.SKY, lw=0.7)
        for sign in (1.0, -1.0):
            ax.plot(x, sign * np.abs(field), color=style.BLUE)
        first, last = self.window_m
        ax.axvspan(first / MM, last / MM, color=style.GREY, alpha=0.1, lw=0)
        ax.set(ylabel="u_z (µm)", xlabel="x (mm)")
        ax.set_title(f"{self._tone}, travelling-wave ratio {in_digits(self.twr, self.twr_error)} where shaded")

    def pictures(self) -> list[ReportFigure]:
        """Return the pictures of the wave with its power flow and that of in-phase patches, and of the finger on it."""
        drawn, (wave, flow) = style.panels(5.4, 2, 1, sharex=True)
        self.draw(wave)
        powers = {"held a quarter period apart": self.flow_W, "all patches in phase": self.standing_flow_W}
        curves = {name: 1e3 * np.array(watts) for name, watts in powers.items()}
        style.draw_lines(flow.plot, np.array(self.flow_x_m) / MM, curves, marker="o", ms=3)
        flow.axhline(0.0, color=style.GREY, lw=0.8)
        flow.set(ylabel="power towards +x (mW)", xlabel="x (mm)", title="Sections without a patch across them")
        flow.legend(fontsize=9)
        title = "Travelling wave inside the zone"
        shown = [style.ReportFigure("travelling", title, self._alt(), drawn, vector=True)]
        return [
            *shown,
            *([_drawn_shear(self.shear, self.plate_design and self.plate_design.width_m)] if self.shear else []),
        ]

    def _alt(self) -> str:
        modes = " and ".join(f"(0, {mode.nodal_lines})" for mode in self.modes)
        flow = f"at most {in_digits(1e3 * self.largest_flow_W[0])} mW flow along the zone for 1 um rms"
        if self.inner_sections == 0:
            flow = "patches straddle every section between the plate's ends, so the flow is unknown"
        ratio = in_digits(self.twr, self.twr_error)
        return f"Modes {modes} held a quarter period apart at {self._tone}: travelling-wave ratio {ratio}, {flow}"


def _of_shear(shear: ShearRecord) -> str:
    """Return the finger on the wave in words."""
    ends = [
        (max((abs(each) for row in values for each in row if each is not None), default=None), error)
        for values, error in ((shear.shear_low, shear.shear_low_error), (shear.shear_high, shear.shear_high_error))
        if values
    ]
    limits = [with_bar(each, error) for each, error in ends if each is not None]
    drag = f"; its drag is at most {' to '.join(limits)} of the friction at rest" if limits else "; its drag is unknown"
    crests = with_bar(1e3 * shear.fastest_m_s, scaled(shear.fastest_error_m_s, 1e-3), "mm/s")
    return f"a finger ({shear.fingertip}) at rest meets crests of {crests} along x{drag}"


def _drawn_shear(shear: ShearRecord, width_m: float | None) -> ReportFigure:
    """Draw the crest speed under a finger over its position, and the bounds of the net shear."""
    shown: dict[str, Any] = {"crests along x (mm/s)": 1e3 * np.array(shear.crest_m_s)}
    for name, values in (("at least", shear.shear_low), ("at most", shear.shear_high)):
        if values is not None:
            shown[f"net shear / friction at rest, {name}"] = values
    drawn, panels = fields.panels(len(shown), width_m)
    for axes, (label, values) in zip(panels, shown.items(), strict=True):
        fields.field(axes, shear.x_m, shear.y_m, values, label.partition(",")[0], label.capitalize())
    fastest = with_bar(1e3 * shear.fastest_m_s, scaled(shear.fastest_error_m_s, 1e-3), "mm/s")
    alt = f"Crests under {shear.fingertip} on the travelling wave: at most {fastest} along x"
    return style.ReportFigure("shear", "Finger on the travelling wave", alt, drawn)


class Travel(
    Question[TravelResult],
    needs=("patches",),
    drives=True,
    example="travel examples/36-travelling.toml --out wave",
):
    """Drive two modes of the zone a quarter period apart: travelling wave (m), its power, six-channel table.

    The band must contain both modes. Two or more patches must drive, and one or more must be sensors.

    >>> from antinode import Patches, load
    >>> patches = Patches(size_mm=(8.0, 3.0, 0.3), sensors=(2,))
    >>> wave = load("examples/small.toml", accuracy=0.1, patches=patches).travel((28.0, 36.0))
    >>> round(wave.twr, 1), sorted(mode.nodal_lines for mode in wave.modes)
    (0.8, [3, 4])
    """

    band_kHz: Pair | None = option(
        default=None, unit="kHz", at_least=0.0, kw_only=False, help="frequency band that contains both modes"
    )
    others: float = option(
        default=0.0, at_least=0.0, at_most=1.0, metavar="W",
        help="weight of suppressing all other modes, relative to 1 for the two modes",
    )  # fmt: skip

    def check(self, case: Case) -> None:
        """Raise InputError for a case with no sensor patch, one actuator or fewer than two nodal lines."""
        super().check(case)
        patches, lines = case.patches, case.design.nodal_lines
        assert patches is not None
        said = []
        if lines < 2:
            said.append(f"zone.nodal_lines = {lines}: must be 2 or more; rigid shapes cannot form a travelling wave")
        if patches.circuit != "short":
            said.append(
                f"patches.circuit = {patches.circuit!r}: must be 'short'; the method drives patches with voltages"
            )
        if len(patches.drivers) < 2 or not patches.sensors:
            what = f"{len(patches.drivers)} drive and {len(patches.sensors)} are sensors"
            said.append(f"patches.sensors: {what}; two or more must drive and one or more must be sensors")
        if said:
            raise InputError(f"{case.source or case.name}: {text}" for text in said)
        case.one_quality_factor("travelling")

    def plan(self, case: Case) -> Plan:
        step, lines = plans.response_step(case, hz(self.band_kHz), 1), case.design.nodal_lines
        looks = f"the modes (0, {lines}) and (0, {lines - 1}) or (0, {lines + 1}), driven at a frequency between theirs"
        looks += ", and a finger at positions along the wave" if case.touch else ""
        return plans.plan_of(case, replace(step, measure="travel", name="travelling wave in the zone", looks_for=looks))

    def compute(self, case: Case, plan: Plan, run: Run) -> TravelResult:
        return self._computed(case, run, is_played=False)

    def _computed(self, case: Case, run: Run, is_played: bool) -> TravelResult:
        from pipeline.board import six_channels
        from pipeline.models import travelling

        values, wave = travelling.solve_travelling(case, run, hz(self.band_kHz), self.others, run.meshes)
        outcome = six_channels.board_outcome(wave, run, run.folder, is_played)
        result = TravelResult(**values, **outcome, others=self.others)
        run.report(result)
        return result


class PlayedTravel(Travel, instead_of="travel", by="board"):
    """Drive two modes of the zone a quarter period apart, and run the table on the emulated six-channel board.

    `board` has the frequencies in Hz and the ratios that the firmware reaches. This takes a minute.

    >>> from antinode import load
    >>> from pipeline.questions.travel import PlayedTravel
    >>> [step.name for step in PlayedTravel().plan(load("examples/36-travelling.toml").case).steps]
    ['travelling wave in the zone', 'the six-channel image on the emulated board']
    """

    board: bool = option(default=False, help="run the table on the emulated six-channel board (takes a minute)")

    def plan(self, case: Case) -> Plan:
        whole = super().plan(case)
        board = plans.plain_step(self.name, "the six-channel image on the emulated board", "the firmware's image")
        return replace(whole, steps=(*whole.steps, board))

    def compute(self, case: Case, plan: Plan, run: Run) -> TravelResult:
        return self._computed(case, run, is_played=True)
