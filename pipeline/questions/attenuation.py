"""Attenuation per row across the border of the zone: complex bands at a wavenumber along it, and transmission."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite, nan, pi
from typing import Any

from pipeline.case.features import ATTACHED, CELL, GROUPS, OBLIQUE, OF_A_PLATE
from pipeline.case.limits import MAX_FREQUENCIES, MAX_WAVENUMBER
from pipeline.errors import InputError
from pipeline.models.answer_parts import AttenuationPoint
from pipeline.quantity import KHZ, figure, frequency, level, level_with_bar, several, with_bar
from pipeline.questions.bands import check_own_cell, plan_of_cell
from pipeline.questions.cell_meshes import OfCellMeshes
from pipeline.questions.late import (
    Axes,
    Case,
    FloatArray,
    Plan,
    ReportFigure,
    Simplification,
    confinement,
    np,
    plans,
    resource_estimate,
    simplifications,
    style,
)
from pipeline.questions.question import Pair, Question, Run, Unanswered, hz, option
from pipeline.questions.result import Result, figure_at, stacked
from pipeline.records.part import bar, column, live

POINTS, SHOWN = 201, 20
STUDY_POINTS = 101
DEEPEST_DB = 30.0
LOOKS = {"flexural": ("BLUE", "o"), "shear": ("ORANGE", "s"), "longitudinal": ("PURPLE", "D")}


class AttenuationResult(Result, table="points", axes=("frequency_hz",)):
    """Attenuation per row across the border of the zone over frequency: arrays (points,), in Hz and dB.

    >>> import antinode
    >>> waves = antinode.load("examples/small.toml", accuracy=0.1).attenuation((30.0, 34.0), points=3)
    >>> waves.frequency_hz.tolist(), waves.db_per_row.shape, round(waves.kx_per_m)
    ([30000.0, 32000.0, 34000.0], (3,), 196)
    """

    model: str = column("model of the unit cell and its element order")
    kx_per_m: float = column("wavenumber along the zone", "rad/m")
    pitch_y_m: float = column("pitch of the rows", "m")
    rows: int = column("rows on each side of the zone")
    expected_error: float | None = column(
        "largest discretisation error bar of the cell's bands, relative; None without an estimate"
    )
    reduction_error: float | None = column("largest truncation error of the cell's bands, relative")
    points: list[AttenuationPoint] = column("the waves at each frequency")
    zone_hz: float | None = live("frequency of the target mode by thin-plate theory", "Hz")

    frequency_hz = stacked("frequency_hz", "Frequencies (points,) in Hz.")
    db_per_row = stacked(
        "db_per_row",
        "Attenuation per row (points,) in dB of the least attenuated flexural wave; NaN where there is none.",
    )

    @property
    def decay(self) -> FloatArray:
        """Frequency and attenuation per row of the least attenuated flexural wave, where there is one, (k, 2)."""
        known = [(p.frequency_hz, p.db_per_row) for p in self.points if p.db_per_row is not None]
        return np.reshape(np.array(known, dtype=float), (-1, 2))

    def at(self, frequency_hz: float) -> float | None:
        """Interpolate the attenuation per row of the least attenuated flexural wave.

        Parameters
        ----------
        frequency_hz : float
            Frequency in Hz.

        Returns
        -------
        float or None
            Attenuation in dB per row; None outside the band.
        """
        known = self.decay
        if not len(known) or not known[0, 0] <= frequency_hz <= known[-1, 0]:
            return None
        return float(np.interp(frequency_hz, *known.T))

    def error_at(self, frequency_hz: float) -> float | None:
        """Return the error bar of `at`.

        It is the error bars of the two neighbours, weighted as their values are, plus the interpolation error: the difference
        of the neighbours, or what the adjacent chords bound it by where no band edge lies between them.

        Parameters
        ----------
        frequency_hz : float
            Frequency in Hz.

        Returns
        -------
        float or None
            Half-width of the error bar in dB; None where it is unknown.
        """
        own = self.at(frequency_hz)
        if own is None:
            return None
        known = [p for p in self.points if p.db_per_row is not None]
        bars = np.array([nan if p.db_error is None else p.db_error for p in known])
        tones, levels = self.decay.T
        if len(tones) < 2 or frequency_hz in tones:
            bar = float(bars[np.argmin(np.abs(tones - frequency_hz))])
            return bar if isfinite(bar) else None
        last = int(np.clip(np.searchsorted(tones, frequency_hz), 1, len(tones) - 1))
        missed = 0.0
        for first in (last - 2, last):
            if 0 <= first < len(tones) - 1:
                slope = (levels[first + 1] - levels[first]) / (tones[first + 1] - tones[first])
                missed = max(missed, abs(levels[first] + slope * (frequency_hz - tones[first]) - own))
        ends = levels[last - 1 : last + 1]
        has_edge = ends.any() and not ends.all()  # a wave propagates at one of them: the decay ends anywhere between
        bar = float(np.interp(frequency_hz, tones, bars)) + (np.ptp(ends) if has_edge else min(missed, np.ptp(ends)))
        return float(bar) if isfinite(bar) else None

    def lines(self) -> Iterator[str]:
        """Yield the model, some frequencies, and the attenuation at the target frequency of plate theory."""
        yield (
            f"{self.model}, kx = {figure(self.kx_per_m)} rad/m; attenuation of the least attenuated flexural wave, "
            f"and fractions of an incident flexural wave's power after {several(self.rows, 'row')}"
        )
        yield self.reading(("taken_error_db",), SHOWN)
        yield from self._at_the_zone()

    def _at_the_zone(self) -> Iterator[str]:
        """Yield the attenuation at the zone's thin-plate frequency; nothing outside the band or without a zone."""
        answer = None if self.zone_hz is None else prediction(self, self.zone_hz)
        if answer is None or answer.db_per_row is None:
            return
        where = f"at {frequency(answer.frequency_hz)}, the target mode by thin-plate theory"
        transmitted = ""
        if answer.transmission_db is not None:
            taken = level_with_bar(answer.transmission_db, answer.transmission_error_db)
            transmitted = f"; this case's rows reduce the power of a flexural wave by {taken}"
        if not answer.db_per_row:
            yield f"{where}: an infinite array transmits a flexural wave without attenuation{transmitted}"
            return
        every = with_bar(answer.rows_db, answer.rows_error_db, "dB")
        needed, goal = answer.rows_needed, f"{confinement.CONFINED_DB:g} dB"
        sure = f"{goal} after {several(needed, 'row')}" if needed else f"its bar does not say how many give {goal}"
        total = f"{every} after {several(self.rows, 'row')}, {sure}"
        per_row = with_bar(answer.db_per_row, answer.db_error, "dB")
        yield f"{where}: infinite array, {per_row} per row ({total}){transmitted}"

    def draw(self, ax: Axes) -> None:
        """Draw the attenuation per row of the least attenuated flexural wave over frequency."""
        self._draw_least(ax)
        ax.set(xlabel="frequency (kHz)", ylabel="attenuation per row (dB)")

    def pictures(self) -> list[ReportFigure]:
        """Return the complex bands."""
        return [self.complex_bands()]

    def complex_bands(self, predicted_hz: float | None = None) -> ReportFigure:
        """Draw three panels over frequency: attenuation per row, Re k_y and transmitted power.

        Parameters
        ----------
        predicted_hz : float, optional
            Frequency to mark, in Hz.

        Returns
        -------
        ReportFigure
            The figure with its title and its description in words.
        """
        drawn, (decay, phase, power) = style.panels(6.2, 3, 1, sharex=True, height_ratios=[1.2, 1.0, 1.0])
        self._draw_waves(decay, phase)
        self._draw_least(decay)
        self._draw_power(power)
        title = f"Waves across the rows at kx = {figure(self.kx_per_m)} rad/m"
        decay.set(ylim=(DEEPEST_DB, -0.5), ylabel="attenuation (dB per row)", title=title)
        phase.set(ylabel="|Re ky| p / π")
        power.set(ylabel="fraction of power", xlabel="frequency (kHz)")
        for axes in (decay, phase, power):
            axes.grid(True)
            if predicted_hz:
                axes.axvline(predicted_hz / KHZ, color=style.GREY, ls=":")
        handles = decay.get_legend_handles_labels()
        drawn.legend(*handles, loc="outside upper center", ncols=4, fontsize=9, markerscale=2.5)
        title = "Attenuation per row and transmitted power"
        return style.ReportFigure("attenuation", title, self._alt(), drawn, vector=True)

    def _draw_waves(self, decay: Axes, phase: Axes) -> None:
        for name, (colour, marker) in LOOKS.items():
            waves = [(p.frequency_hz, wave) for p in self.points for wave in p.waves if wave.polarisation == name]
            if not waves:
                continue
            khz = np.array([frequency for frequency, _ in waves]) / KHZ
            look: dict[str, Any] = {"color": getattr(style, colour), "marker": marker, "ls": "none", "ms": 1.8}
            decay.plot(khz, [wave.db_per_row for _, wave in waves], label=name, **look)
            weak = np.array([wave.db_per_row < DEEPEST_DB for _, wave in waves])
            turns = np.array([abs(wave.ky_re_per_m) * self.pitch_y_m / np.pi for _, wave in waves])
            phase.plot(khz[weak], turns[weak], **look)

    def _draw_least(self, ax: Axes) -> None:
        frequency, least = self.decay.T
        if len(frequency):
            ax.plot(frequency / KHZ, least, color=style.VERMILION, lw=1.4, label="least attenuated flexural wave")

    def _draw_power(self, ax: Axes) -> None:
        passed = [(p.frequency_hz, p.transmission) for p in self.points if p.transmission]
        if not passed:
            ax.text(0.5, 0.5, "no rows, or no incident flexural wave", ha="center", transform=ax.transAxes)
            return
        khz = np.array([frequency for frequency, _ in passed]) / KHZ
        flexural, turned = np.array([(share.flexural, share.shear + share.longitudinal) for _, share in passed]).T
        ax.plot(khz, flexural, color=style.BLUE, label=f"through {several(self.rows, 'row')}, flexural")
        ax.plot(khz, turned, color=style.ORANGE, ls="--", label="converted into in-plane waves")
        ax.set_yscale("symlog", linthresh=1e-4)
        ax.set_ylim(0.0, 1.5)
        ax.legend(loc="lower right", fontsize=9)

    def _alt(self) -> str:
        deepest = max(self.points, key=lambda point: point.db_per_row or 0.0)
        most = level(deepest.db_per_row or 0.0, deepest.db_error)
        return (
            "Attenuation per row of flexural, shear and longitudinal waves over frequency; the least attenuated "
            f"flexural wave decays most, {most} per row, at {frequency(deepest.frequency_hz)}; below, the power "
            f"transmitted by {several(self.rows, 'row')}"
        )

    def __repr__(self) -> str:
        return over(self, self.frequency_hz)


def over(result: Result, frequency_hz: FloatArray) -> str:
    """Describe a result over frequency in a few words."""
    ends = f"{frequency_hz[0] / KHZ:g} to {frequency_hz[-1] / KHZ:g} kHz"
    return f"<antinode.{type(result).__name__.removesuffix('Result')}: {len(frequency_hz)} frequencies from {ends}>"


class Attenuation(
    Question[AttenuationResult],
    needs=("plate", "array.pitch_mm"),
    pictures=("report.gallery.attenuation",),
    honours=(*OF_A_PLATE, CELL, ATTACHED, OBLIQUE),
    at_own_frequencies=True,
):
    """Compute the attenuation per row in dB across the border of the zone, at a wavenumber along it.

    >>> import antinode
    >>> antinode.load("examples/small.toml", accuracy=0.1).attenuation((30.0, 34.0), points=3).frequency_hz.tolist()
    [30000.0, 32000.0, 34000.0]
    """

    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, kw_only=False, help="frequencies")
    points: int = option(default=POINTS, at_least=1, at_most=MAX_FREQUENCIES, help="number of frequencies")
    kx_per_m: float | None = option(
        default=None, unit="rad/m", at_least=-MAX_WAVENUMBER, at_most=MAX_WAVENUMBER, metavar="K",
        help="wavenumber along the zone (default: the target mode's)",
    )  # fmt: skip

    def check(self, case: Case) -> None:
        """Raise InputError for a case without pillar and pitch, and for a wavenumber beyond the Brillouin zone's edge."""
        from pipeline.planning.model_choice import SOLID

        super().check(case)
        if not (case.design.cell_file or case.design.attached or "mesh_file" in self.options):
            case.require("pillar", command="attenuation")
        check_own_cell(case, "attenuation")
        case.require_one_kind("attenuation per row is")
        if self.kx_per_m is None:
            case.require("zone", command="attenuation without --kx")
        if case.solve.model == SOLID:
            raise InputError(f"{case.name}: solve.model = 'solid': must be auto or superelement for attenuation")
        case.path(1)
        edge, kx = pi / self._pitch_m(case), self._kx(case)
        if not abs(kx) <= edge * (1.0 + 1e-12):
            raise InputError(f"--kx = {kx:g}: must lie between -pi/p and pi/p, {-edge:g} and {edge:g} rad/m here")

    @staticmethod
    def _pitch_m(case: Case) -> float:
        """Distance of pillars along a row. Raises InputError for a lattice without rows along x."""
        from geometry.lattice import pitch_along_x

        if not case.design.oblique_m:
            return case.design.pitch_x_m
        pitch_m = pitch_along_x(*case.design.oblique_m)
        if pitch_m is None:
            raise InputError(f"{case.source or case.name}: array.a2_mm: attenuation needs a lattice with rows along x")
        return pitch_m

    def _kx(self, case: Case) -> float:
        return case.target_kx_per_m if self.kx_per_m is None else self.kx_per_m

    @classmethod
    def in_study(cls) -> Attenuation:
        """Return the question with fewer frequencies."""
        return cls(points=STUDY_POINTS)

    @classmethod
    def spared(cls, case: Case) -> Simplification | None:
        return simplifications.no_lattice(case.design, "attenuation")

    def plan(self, case: Case) -> Plan:
        from pipeline.models.own_frequency import at_middle
        from pipeline.planning.model_choice import by_rows, cell_model_choice, driven_band_hz

        low, high = driven_band_hz(case, hz(self.band_kHz))
        case, kx = by_rows(case), self._kx(case)
        choice = cell_model_choice(at_middle(case, (low, high)), high)
        span = " to ".join(map(simplifications.khz, (low, high)))
        looks = f"{self.points} frequencies from {span} at kx = {figure(kx)} rad/m"
        numbers = {"band_hz": [low, high], "frequencies": self.points, "kx_per_m": kx}
        left_out = (*choice.left_out, simplifications.waves_downwards(case.design))
        demand = resource_estimate.of_attenuation(case, choice, self.points) if choice.reduction else None
        step = plans.step_of(self.name, "attenuation across the rows", choice, (), looks, left_out, numbers, demand)
        return plan_of_cell(case, step)

    def compute(self, case: Case, plan: Plan, run: Run) -> AttenuationResult:
        from pipeline.models.attenuation import solve
        from pipeline.planning.model_choice import by_rows, driven_band_hz
        from solvers.analytic.predesign import predesign

        choice, band = plan.steps[0].choice, driven_band_hz(case, hz(self.band_kHz))
        assert choice
        kx, known = self._kx(case), run.solved.get("lattice")
        solved = solve(by_rows(case), choice, run, band, kx, self.points, run.meshes, known)
        zone = predesign(case.design).zone
        return AttenuationResult(**solved, zone_hz=zone.frequency_hz if zone else None)


class MeshAttenuation(
    OfCellMeshes, Attenuation, Question[AttenuationResult],
    instead_of="attenuation", by="mesh_file", needs=("plate", "array.pitch_mm"),
    honours=(*OF_A_PLATE, GROUPS, OBLIQUE), at_own_frequencies=False,
):  # fmt: skip
    """Compute the attenuation per row in dB of rows of your own mesh of a unit cell, whose sides are faces of bare plate.

    >>> import antinode, meshio, tempfile
    >>> file, side = f"{tempfile.mkdtemp()}/cell.inp", 0.004
    >>> lines = [[side * k / 6 for k in range(7)]] * 2 + [[0.002 * k / 4 for k in range(5)]]
    >>> points = [[x, y, z] for z in lines[2] for y in lines[1] for x in lines[0]]
    >>> first = [x + 7 * y + 49 * z for z in range(4) for y in range(6) for x in range(6)]
    >>> cells = [[n, n + 1, n + 8, n + 7, n + 49, n + 50, n + 57, n + 56] for n in first]
    >>> meshio.write_points_cells(file, points, [("hexahedron", cells)])
    >>> plate = antinode.load("examples/small.toml", accuracy=0.1, bands__count=4)
    >>> waves = plate.mesh_attenuation((30.0, 34.0), mesh_file=[file], points=2)
    >>> waves.db_per_row.tolist()  # a bare plate
    [0.0, 0.0]
    """

    def check(self, case: Case) -> None:
        """Raise InputError as `attenuation`, without a window of frequencies, and for unsuitable files."""
        super().check(case)
        if not (self.band_kHz or case.solve.band_hz):
            case.require("zone", command="attenuation without --band")
        self.check_files()

    def plan(self, case: Case) -> Plan:
        why = ("your own mesh is reduced unchanged",)
        step = plans.Step(
            self.name, "attenuation across rows", "superelement", " and ".join(self.mesh_file), (), "", why
        )
        return plans.plan_of(case, step)

    def compute(self, case: Case, plan: Plan, run: Run) -> AttenuationResult:
        from pipeline.models.attenuation import solve_own
        from pipeline.models.parts import mesh_record
        from pipeline.models.plate_cell import in_own_vectors, plate_cell, read_cells
        from pipeline.planning.model_choice import driven_band_hz

        band = driven_band_hz(case, hz(self.band_kHz))
        bodies, ratio = read_cells(case, self.files, run)
        run.meshes += [mesh_record("cell", body.mesh) for body in bodies[:1]]
        case = in_own_vectors(case, bodies[0])
        model = plate_cell(case, bodies, ratio, run, band[1])
        return AttenuationResult(**solve_own(case, model, run, band, self._kx(case), self.points))


class PredictionResult(Result, axes=()):
    """Attenuation of an infinite array at the target mode, compared with the finite plate's zone_to_extension_db."""

    frequency_hz: float = column("frequency of the target mode", "Hz")
    db_per_row: float | None = column("attenuation per row", "dB", error="db_error")
    db_error: float | None = bar("db_per_row", "dB")
    rows_db: float | None = column("number of rows times the attenuation per row", "dB", error="rows_error_db")
    rows_error_db: float | None = bar("rows_db", "dB")
    transmission_db: float | None = column(
        "power of a flexural wave transmitted by the rows, relative to the incident power",
        "dB",
        error="transmission_error_db",
    )
    transmission_error_db: float | None = bar("transmission_db", "dB")
    zone_to_extension_db: float | None = column(
        "rms on the zone of the finite plate relative to that beyond the rows", "dB", error="zone_to_extension_error_db"
    )
    zone_to_extension_error_db: float | None = bar("zone_to_extension_db", "dB")
    rows_needed: int | None = column(
        "rows that give 10 dB at this attenuation, in an infinite array; None where its error bar is as large"
    )

    decay = figure_at("db_per_row", "attenuation per row", "dB", name="db_per_row")
    decay_error = figure_at("db_error", "expected error of the attenuation", "dB", name="db_error", error="db_error")
    of_rows = figure_at("rows_db", "predicted attenuation of all rows", "dB", name="rows_db")
    needed = figure_at("rows_needed", "rows needed (infinite array)", name="rows_needed")


class Prediction(Question[PredictionResult], follows="attenuation"):
    """Predict the plate's confinement from the attenuation per row at its target mode."""

    def compute(self, case: Case, plan: Plan, run: Run) -> PredictionResult:
        if not run.target:
            raise Unanswered
        level = run.target.extension_db, run.target.extension_error_db
        return prediction(run.found["attenuation"], run.target.frequency_hz, *level)


def prediction(
    attenuation: AttenuationResult, frequency_hz: float, extension_db: float | None = None,
    extension_error_db: float | None = None,
) -> PredictionResult:  # fmt: skip
    """Compare rows times attenuation per row with the transmitted power and the finite plate's level, dB."""
    from math import ceil

    per_row, error = attenuation.at(frequency_hz), attenuation.error_at(frequency_hz)
    is_told = per_row is not None and per_row > (error or 0.0)
    nearest = min(attenuation.points, key=lambda point: abs(point.frequency_hz - frequency_hz))
    passes = nearest.transmission is not None and nearest.transmission.flexural > 0.0
    return PredictionResult(
        frequency_hz=frequency_hz,
        db_per_row=per_row,
        db_error=error,
        rows_db=None if per_row is None else attenuation.rows * per_row,
        rows_error_db=None if error is None else attenuation.rows * error,
        transmission_db=nearest.taken_db if passes else None,
        transmission_error_db=nearest.taken_error_db if passes else None,
        zone_to_extension_db=extension_db,
        zone_to_extension_error_db=extension_error_db,
        rows_needed=ceil(confinement.CONFINED_DB / per_row) if per_row and is_told else None,
    )
