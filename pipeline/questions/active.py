"""Analogy and control models of the thesis: circuit, pillar on a strip, active beam, beams with patches."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, Any

from pipeline.case.features import OF_A_PLATE
from pipeline.case.limits import QUALITY
from pipeline.errors import InputError
from pipeline.quantity import KHZ, MM, several
from pipeline.questions.question import Pair, Question, Run, hz, option
from pipeline.questions.result import Result
from pipeline.records.part import Part, column, live

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pipeline.case.model import Case
    from pipeline.planning.plan import Plan
    from pipeline.plots.style import ReportFigure
    from solvers.thesis.active_beam import Case as LoopedBeam
    from solvers.thesis.circuit import MasonStudy

# relative to the mode to confine; for the default the wavelength of 5/3 cells is then 2 mm, the thickness of the bar
MASON_HIGHEST = 100
GAIN_N_M = (1e-3, 1e12)  # from a millionth of any strip's stiffness to more than that of solid metal blocks
COMPARED = "statements of the thesis next to the values computed here"
CURVES = "frequencies of the curves"


class Compared(Part):
    """A statement of the thesis, the value computed here, and their agreement."""

    quantity: str = column("quantity")
    thesis: str = column("value in the thesis")
    ours: str = column("computed value")
    agreement: str = column("agreement, or the reason for the difference")


def compared(model: str, computed: Iterable[Any]) -> list[Compared]:
    """Return the thesis' statements on a model with the computed values."""
    from pipeline.active.thesis import beside

    return [Compared(**entry) for entry in beside(model, computed)]


class Modelled(Result, axes=()):
    """Result of a model, with the study from which its pictures are drawn."""

    study: Any = live("study from which the pictures are drawn; None if read from a file")

    def compared(self) -> Iterator[str]:
        """Yield one block per statement: the thesis' value, ours, and their agreement."""
        for one in self.comparison:  # type: ignore[attr-defined]
            yield f"{one.quantity}\n  thesis: {one.thesis}\n  ours:   {one.ours}\n  {one.agreement}"

    def as_figure(self) -> Any:
        """Return the first picture, or what `plot` draws for a result read from a file."""
        return self.pictures()[0].figure if self.study else super().as_figure()


@contextmanager
def asked(model: str) -> Iterator[None]:
    """Turn a SolverError into an InputError: these models have no meshes, so only their input can make them fail."""
    from solvers.errors import SolverError

    try:
        yield
    except SolverError as error:
        raise InputError(f"active {model}: {' '.join(str(error).split())}") from error


def quality_option(of: str) -> Any:
    """Declare the option --quality-factor."""
    return option(
        default=None, at_least=QUALITY[0], at_most=QUALITY[1], or_infinite=True, metavar="Q",
        help=f"quality factor of {of} (inf: no losses)",
    )  # fmt: skip


# -- circuit -----------------------------------------------------------------------------------------------------------


class MasonResult(Modelled, table="comparison", axes=("quantity",)):
    """Five cells of a bar as a circuit, with and without a filter that confines a mode in the middle ones."""

    target_hz: float = column("mode to confine: the middle mode of three cells between fixed ends", "Hz")
    quality_factor: float | None = column("quality factor of cells and filter; None without losses")
    cell: dict[str, Any] = column("one cell of the bar: length_m, cross-section area_m2, material")
    filter: dict[str, float | None] = column(
        "the filter at two joints as a mechanical circuit: inductance_kg, capacitance_m_n in m/N, resistance_n_s_m (None "
        "without losses), and rejected_hz, the frequency that it blocks completely"
    )
    modes_hz: dict[str, list[float]] = column(
        "lossless frequencies in the band: three cells between fixed ends (clamped), five free cells without the "
        "filter (bare) and with it (filtered)"
    )
    confinement_db: dict[str, float] = column(
        "rms velocity of the two inner joints divided by that of the outer joints at target_hz: bare and filtered", "dB"
    )
    frequencies_hz: list[float] = column(CURVES, "Hz", along="frequency")
    clamped_abs: list[list[float]] = column(
        "velocity of each joint of the three cells for 1 N on the middle cell", "m/s", along=("frequency", "joint")
    )
    bare_abs: list[list[float]] = column(
        "velocity of each joint of the five cells without the filter", "m/s", along=("frequency", "joint")
    )
    filtered_abs: list[list[float]] = column(
        "velocity of each joint of the five cells with the filter", "m/s", along=("frequency", "joint")
    )
    filter_impedance_abs: list[float] = column("magnitude of the filter's impedance, N s/m", along="frequency")
    comparison: list[Compared] = column(COMPARED)

    def lines(self) -> Iterator[str]:
        """Yield bar, filter, modes and the comparison."""
        from pipeline.quantity import figure, frequency

        cell, one = self.cell, self.filter
        yield (
            f"five cells of {cell['material']}, each {figure(cell['length_m'] / MM)} mm long, section "
            f"{cell['area_m2'] / MM**2:g} mm2, quality factor {self.quality_factor or inf:g}; 1 N on the middle cell"
        )
        yield (
            f"filter: L = {figure(one['inductance_kg'])} kg, C = {figure(one['capacitance_m_n'])} m/N, "
            f"rejects {frequency(one['rejected_hz'])}"  # type: ignore[arg-type]
        )
        for name, modes in self.modes_hz.items():
            yield f"modes, {name}: {', '.join(map(figure, modes)) + ' Hz' if modes else 'none in the band'}"
        yield from self.compared()

    def draw(self, ax: Axes) -> None:
        """Draw the velocity of the middle joint with and without the filter."""
        khz = [each / KHZ for each in self.frequencies_hz]
        for name, curves in (("without filter", self.bare_abs), ("with filter", self.filtered_abs)):
            ax.semilogy(khz, [joints[2] for joints in curves], label=name)
        ax.legend()
        ax.set(xlabel="frequency (kHz)", ylabel="velocity (m/s per N)")

    def pictures(self) -> list[ReportFigure]:
        """Return the velocities of all joints."""
        from pipeline.active import plots

        return [plots.mason(self.study)]


class ActiveMason(
    Question[MasonResult], family="active", without_case="", is_quick=True, example="active mason --frequency 20kHz"
):
    """Confine a mode of a bar with a filter, modelled as Mason's circuit.

    A case supplies material and losses.

    >>> import antinode
    >>> round(antinode.load("examples/small.toml").active_mason().filter["rejected_hz"])  # Hz
    25000
    """

    frequency_kHz: float | None = option(default=None, unit="kHz", at_least=0.0, help="the mode to confine")
    quality_factor: float | None = quality_option("cells and filter")
    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, help="frequencies of the curves")

    def compute(self, case: Case | None, plan: Plan, run: Run) -> MasonResult:
        """Solve the circuit over its own window and over the requested band."""
        import numpy as np

        from pipeline.active import thesis
        from solvers.thesis.circuit import MasonData, mason_study

        data = MasonData()
        data = replace(
            data,
            target_hz=KHZ * self.frequency_kHz if self.frequency_kHz else data.target_hz,
            quality_factor=self.quality_factor or (case.one_quality_factor("active") if case else data.quality_factor),
            material=case.design.stack.material if case else data.material,
        )
        with asked("mason"):
            whole = study = mason_study(data)
            if band := self._band(data.target_hz):
                study = mason_study(data, np.linspace(*band, 3121))
                _refuse_empty(band, study, whole)
        curves = ("clamped", "bare", "filtered", "filter_impedance")
        return MasonResult.of(
            study,
            target_hz=data.target_hz,
            quality_factor=data.quality_factor,
            cell={"length_m": data.cell.length_m, "area_m2": data.area_m2, "material": data.material.name},
            filter=vars(data.filter) | {"rejected_hz": data.filter.rejected_hz},
            **{f"{name}_abs": np.abs(getattr(study, name)) for name in curves},
            comparison=compared("mason", thesis.mason(whole)),
            study=study,
        )

    def _band(self, target_hz: float) -> Pair | None:
        """Return the band to show, Hz. Raises InputError beyond the range of a one-dimensional bar."""
        band = hz(self.band_kHz)
        if band and band[1] > MASON_HIGHEST * target_hz:
            highest = f"{MASON_HIGHEST * target_hz / KHZ:g} kHz or below, {MASON_HIGHEST} times the mode to confine"
            reason = "above it waves are shorter than the bar is thick"
            raise InputError(f"--band = {_shown(band)}: must end at {highest}: {reason}")
        return band


def _shown(band: Pair) -> str:
    return f"{band[0] / KHZ:g}kHz:{band[1] / KHZ:g}kHz"


def _refuse_empty(band: Pair, study: MasonStudy, whole: MasonStudy) -> None:
    """Raise InputError naming the modes' frequencies if none of the three bars has a mode in the band."""
    from pipeline.quantity import interval

    if not any(len(modes) for modes in study.modes_hz.values()):
        every = [float(mode) for modes in whole.modes_hz.values() for mode in modes]
        listed = f"from {interval(min(every), max(every))}, {len(every)} of them"
        raise InputError(f"--band = {_shown(band)}: contains no mode of the three bars; their modes lie {listed}")


# -- pillar ------------------------------------------------------------------------------------------------------------


class PillarModelResult(Modelled, table="comparison", axes=("quantity",)):
    """One pillar and rows of pillars on a strip of plate: transmission of a flexural wave."""

    clamped_hz: float = column("first bending frequency of the pillar on a rigid foot (Timoshenko)", "Hz")
    stopped_hz: float = column("frequency at which the moment of one pillar blocks a flexural wave completely", "Hz")
    oscillator_stopped_hz: float = column(
        "the same for a vertical oscillator with the pillar's mass and clamped frequency", "Hz"
    )
    band_hz: list[float] | None = column(
        "widest band in which one row transmits at most half the power; None without one", "Hz"
    )
    bands_hz: list[list[float] | None] = column("that band for 1, 2, ... rows", "Hz")
    stop_hz: list[float] | None = column(
        "widest band in which an infinite array without losses transmits no wave; None without one", "Hz"
    )
    frequencies_hz: list[float] = column(CURVES, "Hz", along="frequency")
    transmitted: list[list[float]] = column(
        "fraction of the power that 1, 2, ... rows transmit", along=("rows", "frequency")
    )
    reflected: list[list[float]] = column(
        "fraction of the power that is reflected; the rest is dissipated in the pillars", along=("rows", "frequency")
    )
    decay_db: list[float | None] = column("attenuation per row of an infinite array", "dB", along="frequency")
    point_force: dict[str, Any] = column(
        "a point obstacle on a beam in the path of a flexural wave: cases by name (spring, pin, damper, moment, "
        "printed force), each with the fractions transmitted, reflected and absorbed and the amplitude (abs, of the "
        "incident wave's) at x_over_wavelength"
    )
    cell: dict[str, Any] | None = column(
        "with --cell, the computed cell: model, frequencies_hz, db_per_row (None where no flexural wave was found) and "
        "db_error, its error bar (half-width; None without an estimate)"
    )
    comparison: list[Compared] = column(COMPARED)

    def lines(self) -> Iterator[str]:
        """Yield the comparison."""
        yield from self.compared()

    def draw(self, ax: Axes) -> None:
        """Draw the transmitted fraction of the power for each number of rows."""
        khz = [each / KHZ for each in self.frequencies_hz]
        for rows, passed in enumerate(self.transmitted, start=1):
            ax.plot(khz, passed, label=several(rows, "row"))
        ax.legend()
        ax.set(xlabel="frequency (kHz)", ylabel="transmitted fraction of power")

    def pictures(self) -> list[ReportFigure]:
        """Return the pictures of the point obstacle and of the rows."""
        from pipeline.active import plots

        row, point = self.study
        return plots.pillar(row, point, self.cell)


class ActivePillar(
    Question[PillarModelResult],
    needs=("plate", "pillar", "array.pitch_mm"),
    family="active",
    without_case="three-rows.toml",
    is_quick=True,
    honours=OF_A_PLATE,
    example="active pillar --cell",
):
    """Stop flexural waves with pillars on a strip of the case's plate.

    Without a case, it uses studies/three-rows.toml.

    >>> import antinode
    >>> len(antinode.load("examples/small.toml").active_pillar(band_kHz=(25.0, 45.0)).transmitted)
    1
    """

    quality_factor: float | None = quality_option("plate and pillar")
    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, help="frequencies")
    cell: bool = option(default=False, help="compare with the computed plate cell (takes seconds)")

    def check(self, case: Case) -> None:
        """Raise InputError for a case without pillar and pitch, or without a unit cell."""
        case.require(*self.needs, command="active pillar")
        case.require_one_kind(
            "active pillar is"
        )  # rows shifted by half a pitch along x see the same wave at normal incidence

    def compute(self, case: Case, plan: Plan, run: Run) -> PillarModelResult:
        """Compute the scattering by 1, 2, ... rows."""
        import numpy as np

        from pipeline.active import thesis
        from solvers.analytic.predesign import pillar_frequencies_hz
        from solvers.thesis.scattering import pillar_filter, point_force

        assert case.design.pillar is not None
        clamped = float(pillar_frequencies_hz(case.design.pillar, "timoshenko")[0])
        band = hz(self.band_kHz) or (0.5 * clamped, 1.5 * clamped)
        loss = 1.0 / (self.quality_factor or (case.one_quality_factor("active") if "damping" in case.given else inf))
        with asked("pillar"):
            row, point = pillar_filter(case.design, np.linspace(*band, 801), loss), point_force()
        cell = _computed_cell(case, run, band) if self.cell else None
        comparison = compared("pillar", thesis.pillar(row, point, cell))
        return PillarModelResult.of(
            row, point_force=point.to_dict(), cell=cell, comparison=comparison, study=(row, point)
        )


def _computed_cell(case: Case, run: Run, band_hz: Pair) -> dict[str, Any]:
    """Return the attenuation per row of the least attenuated flexural wave of the plate cell at normal incidence."""
    from pipeline.questions.attenuation import Attenuation
    from pipeline.questions.question import ask

    solved = ask(case, Attenuation((band_hz[0] / KHZ, band_hz[1] / KHZ), kx_per_m=0.0, points=81), run.log)
    named = {"frequencies_hz": "frequency_hz", "db_per_row": "db_per_row", "db_error": "db_error"}
    return {"model": solved.model} | {
        key: [getattr(point, name) for point in solved.points] for key, name in named.items()
    }


# -- beam --------------------------------------------------------------------------------------------------------------


class LoopCase(Part):
    """Layout of loops at a frequency and a gain: forces, amplitudes between (inside) and beyond (outside) them."""

    layout: str = column("point, pair, couple or opposed")
    frequency_hz: float = column("frequency of the force", "Hz")
    gain_n_m: float = column("gain K' of the loops", "N/m")
    strength: float = column("K'/(4 EI beta^3)")
    before_inside_max_m: float = column("largest amplitude inside, without loops", "m", table=False)
    before_inside_rms_m: float = column("rms amplitude inside, without loops", "m", table=False)
    before_outside_max_m: float = column("largest amplitude outside, without loops", "m", table=False)
    before_outside_rms_m: float = column("rms amplitude outside, without loops", "m", table=False)
    after_inside_max_m: float = column("largest amplitude inside, with loops", "m", table=False)
    after_inside_rms_m: float = column("rms amplitude inside, with loops", "m", table=False)
    after_outside_max_m: float = column("largest amplitude outside, with loops", "m", table=False)
    after_outside_rms_m: float = column("rms amplitude outside, with loops", "m", table=False)
    ratio_before: float = column("ratio of rms inside to rms outside, without loops")
    ratio_after: float = column("ratio of rms inside to rms outside, with loops")
    outside_reduced_by: float = column("ratio of rms beyond the loops without them to that with them", table=False)
    largest_force_n: float = column("largest point force in the steady state", "N")
    switch_on_force_n: float = column("largest force while the loops are being closed", "N", table=False)


class BeamResult(Modelled, table="cases", axes=("layout",)):
    """A strip driven at its centre with velocity feedback on both sides: amplitudes, forces, stability."""

    beam: dict[str, Any] = column(
        "the strip, with free ends and driven at its centre: length_m, width_m, thickness_m, material, "
        "quality_factor (None without losses), bending_n_m2 (bending stiffness), mass_kg_m, force_n; left_m, centre "
        "of the left loops, the right ones mirrored; apart_m between the two points of a pair; natural_hz, its "
        "lowest natural frequencies"
    )
    frequencies_hz: list[float] = column("frequencies of the force", "Hz", table=False)
    point_stiffness_n_m: list[float] = column(
        "point stiffness of the infinite beam at each frequency, the scale for a gain", "N/m"
    )
    thin_beam_limit_hz: float = column(
        "frequency at which wavenumber times thickness is 1, the limit of beam theory", "Hz", table=False
    )
    gains_n_m: list[float] = column("gains K' of the loops", "N/m")
    delays_s: list[float] = column("delays of the loops for the stability analysis", "s")
    cases: list[LoopCase] = column("every layout at every frequency and gain")
    stability: list[dict[str, Any]] = column(
        "for each layout: dual, whether sensing and actuation are dual; growth_per_s of the slowest pole at each "
        "gain, unstable above 0; unstable_from_n_m, the gain from which a pole grows (None: none found); "
        "delay_margin_s at each gain (None where the loop is unstable without delay); gain_limits_n_m at each delay "
        "and, last, for demodulation over one period, and gain_limits_hz, the frequency that sets each (None: none "
        "found)"
    )
    gain_sweep: dict[str, list[float]] = column(
        "ratio of rms inside to rms outside of each layout (point, pair, couple, opposed) over gains_n_m, first "
        "frequency"
    )
    place_sweep: dict[str, list[float]] = column(
        "the same ratio over the position of the loops, places_m, at the last gain: one list per layout and "
        "frequency, such as `pair at 3000 Hz`"
    )
    comparison: list[Compared] = column(COMPARED)

    def lines(self) -> Iterator[str]:
        """Yield the strip, the cases and the comparison."""
        from pipeline.quantity import figure

        beam = self.beam
        size = f"{beam['length_m'] / MM:g} x {beam['width_m'] / MM:g} x {beam['thickness_m'] / MM:g} mm"
        yield (
            f"free-free {beam['material']} strip {size}, 1 N at its centre, loops {figure(beam['left_m'] / MM)} mm "
            "from both ends; strength = K'/(4 EI beta^3), ratio = rms inside / rms outside"
        )
        yield self.reading()
        yield from self.compared()

    def draw(self, ax: Axes) -> None:
        """Draw the ratio of rms inside to rms outside of each layout over the gain."""
        for layout, ratio in self.gain_sweep.items():
            if layout != "gains_n_m":
                ax.loglog(self.gain_sweep["gains_n_m"], ratio, label=layout)
        ax.legend()
        ax.set(xlabel="gain K' (N/m)", ylabel="rms inside / outside")

    def pictures(self) -> list[ReportFigure]:
        """Return the pictures of the shapes and of the effects of gain and position."""
        from pipeline.active import plots

        return plots.beam(self.study)


class ActiveBeam(
    Question[BeamResult], family="active", without_case="", is_quick=True, example="active beam --gain 1e7 --gain 1e8"
):
    """Confine the motion of a strip by velocity feedback on both sides of its centre.

    A case supplies material and losses.

    >>> import antinode
    >>> loops = antinode.load("examples/small.toml").active_beam(frequency_kHz=(3.0,), gain_N_per_m=(1e7,))
    >>> [case.layout for case in loops.cases]
    ['point', 'pair', 'couple', 'opposed']
    """

    frequency_kHz: tuple[float, ...] = option(
        default=(), unit="kHz", at_least=0.0, metavar="F", help="frequency of the force"
    )
    gain_N_per_m: tuple[float, ...] = option(
        default=(), unit="N/m", at_least=GAIN_N_M[0], at_most=GAIN_N_M[1], metavar="K", help="gain K' in N/m"
    )
    quality_factor: float | None = quality_option("the strip")
    delay_s: tuple[float, ...] = option(default=(), unit="s", at_least=0.0, metavar="T", help="dead time of the loops")

    def compute(self, case: Case | None, plan: Plan, run: Run) -> BeamResult:
        """Close the loops at each frequency and gain."""
        from pipeline.active import thesis
        from solvers.thesis.active_beam import ActiveBeamData, active_beam_study

        data = ActiveBeamData() if case is None else ActiveBeamData(material=case.design.stack.material)
        data = replace(
            data,
            frequencies_hz=tuple(KHZ * each for each in self.frequency_kHz) or data.frequencies_hz,
            gains_n_m=self.gain_N_per_m or data.gains_n_m,
            quality_factor=self.quality_factor or (case.one_quality_factor("active") if case else data.quality_factor),
            delays_s=self.delay_s or data.delays_s,
        )
        with asked("beam"):
            study = active_beam_study(data)
        cases = [_loop_case(one) for one in study.cases]
        return BeamResult(**study.to_dict(), cases=cases, comparison=compared("beam", thesis.beam(study)), study=study)


def _loop_case(case: LoopedBeam) -> LoopCase:
    sides = {"before": case.before, "after": case.after}
    sizes = {f"{when}_{name}_m": size for when, side in sides.items() for name, size in vars(side).items()}
    return LoopCase.of(case, **sizes, **{f"ratio_{when}": side.ratio for when, side in sides.items()})


# -- shaping -----------------------------------------------------------------------------------------------------------


class ShapingResult(Modelled, table="comparison", axes=("quantity",)):
    """Patches that shape the field of a beam: separately moving regions and travelling waves."""

    assumptions: list[str] = column("assumptions where the thesis leaves something open, one sentence each")
    errors_assumed: dict[str, Any] = column(
        "errors of measured matrices: noise, gain, phase_rad and crosstalk, relative except for the phase; trials "
        "drawn from seed"
    )
    limit_v: float = column("largest voltage of a patch", "V")
    beams: list[dict[str, Any]] = column(
        "the beams, by name: length_m, width_m, thickness_m, material, piezo (material of the patches), centres_m of the "
        "patches, quality_factor; modes_hz with patches, antinodes of each, bare_modes_hz without; calibration of the sensors "
        "(None without any): on mode_hz, m_per_v as abs and phase_rad, common_phase_rad"
    )
    conditioning: list[dict[str, Any]] = column(
        "separability of patches and sensors for each beam and signal (calibrated sensors, or displacement) over "
        "frequencies_hz: condition, the matrix' condition number; coupling, 0 for orthogonal rows to 1; independence, "
        "1 - coupling; best_hz, the best frequencies"
    )
    choices: list[dict[str, Any]] = column(
        "effect of patch pitch and quality factor: pitch_m, quality_factor, peak_twr and peak_wavelength_m of "
        "the best wave; condition and independence by calibrated sensors and by displacement"
    )
    confinement: list[dict[str, Any]] = column(
        "each beam, signal, frequency_hz, region (left, middle, right) and target (in phase, alternating): "
        "peak_ratio of the field inside to that outside, contrast_db, volts_per_um, the largest voltage for 1 um; "
        "beyond_to_inside, largest voltage outside the region divided by that inside; within limit_v limited_error "
        "and limited_peak_ratio; for any voltages best_peak_ratio and best_contrast_db"
    )
    travelling: list[dict[str, Any]] = column(
        "requested waves of each beam, signal and frequency_hz: window_m where they are evaluated, "
        "free_wavelength_m of the beam itself; over wavelengths_m twr (1 travels, 0 stands), swr (1 - twr), "
        "fitted_twr (near fields left out); peak: the best of them with wavelength_m, twr, forward_energy_share, "
        "net_flux_over_forward; free: with any voltages, twr, fitted_twr, near_field_share and voltages_relative as "
        "abs and phase_rad"
    )
    errors: list[dict[str, Any]] = column(
        "effect of the assumed errors on each beam and signal: q05, median and q95 of peak_ratio, twr and pattern_error"
    )
    filter: dict[str, Any] = column(
        "the low-pass between bridge and patch: inductance_h, resistance_ohm, capacitance_f, corner_hz; pwm_ripple, "
        "the transmitted fraction of the carrier; compensation at each frequency_hz as abs and phase_rad; "
        "compensation_error_of_moving_patches, relative"
    )
    mode_pairs: list[dict[str, Any]] = column(
        "two modes held a quarter period apart on each beam: modes by number from 1, frequency_hz, twr, "
        "twr_of_the_two_modes_alone, wavenumber_rad_m, voltages_relative as abs and phase_rad"
    )
    passive_and_active: list[dict[str, Any]] = column(
        "resonators and patches on each beam: levels of the target region with neither_db, resonators alone passive_db, "
        "patches alone active_db, both_db"
    )
    comparison: list[Compared] = column(COMPARED)

    def lines(self) -> Iterator[str]:
        """Yield the assumptions and the comparison."""
        yield from (f"assumed: {text}" for text in self.assumptions)
        yield from self.compared()

    def draw(self, ax: Axes) -> None:
        """Draw the independence of the patches over frequency for each beam and signal."""
        for one in self.conditioning:
            khz = [each / KHZ for each in one["frequencies_hz"]]
            ax.plot(khz, one["independence"], label=f"{one['beam']}, {one['signal']}")
        ax.legend(fontsize=7)
        ax.set(xlabel="frequency (kHz)", ylabel="independence")

    def pictures(self) -> list[ReportFigure]:
        """Return the pictures of conditioning, patterns and travelling waves."""
        from pipeline.active import plots

        return plots.shaping_figures(self.study)


class ActiveShaping(
    Question[ShapingResult], family="active", without_case="", is_quick=True, example="active shaping --out shaping"
):
    """Shape the field of beams with patches: separately moving regions, travelling waves, errors, limits.

    It uses its own beams, listed in its JSON document.

    >>> import antinode
    >>> antinode.load("examples/small.toml").active_shaping(frequency_kHz=(30.0,)).limit_v > 0.0
    True
    """

    frequency_kHz: tuple[float, ...] = option(
        default=(), unit="kHz", at_least=0.0, metavar="F", help="frequency of the patches"
    )

    def compute(self, case: Case | None, plan: Plan, run: Run) -> ShapingResult:
        """Compute the study of all beams."""
        from pipeline.active.thesis import shaping
        from solvers.thesis.shaping_study import ShapingData, document, shaping_study

        if case is not None:
            run.info("the case is not used: shaping has its own beams, listed in its JSON document")
        own = tuple(KHZ * each for each in self.frequency_kHz)
        with asked("shaping"):
            study = shaping_study(ShapingData(frequencies_hz=own) if own else ShapingData())
        return ShapingResult(**document(study), comparison=compared("shaping", shaping(study)), study=study)
