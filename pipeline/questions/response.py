"""Forced response to the patches: motion of zone and passive face per volt, sensor signals, measured data."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.case.features import LARGER, PLACES, STRESS, SUPPORTS
from pipeline.case.limits import MAX_FREQUENCIES, MAX_SEED
from pipeline.errors import InputError
from pipeline.measured.parts import MeasuredRecord
from pipeline.quantity import KHZ, MM, NM, UM, frequency, frequency_with_bar, level, level_with_bar, several, with_bar
from pipeline.quantity import figure as in_digits
from pipeline.questions.attenuation import over
from pipeline.questions.late import Axes, Case, FloatArray, Plan, ReportFigure, np, outputs, plans, style
from pipeline.questions.question import Pair, Question, Run, hz, option
from pipeline.questions.result import Result, figure_at
from pipeline.records.part import Part, bar, column, live

if TYPE_CHECKING:
    from pathlib import Path

    from pipeline.measured.comparison import Measurements
    from pipeline.models.forced import SolvedResponse
    from solvers.piezo.forced import ForcedPlate
    from solvers.piezo.responses import Peak

POINTS, SHOWN = 401, 15
BAND = 0.1  # longer error bars are drawn down to this fraction of the value
SHARED = 0.2  # relative to the given quality factor: beyond it, the peak is wider or narrower than its mode


class PeakRecord(Part):
    """Response at one frequency, and the quality factor read from the curve."""

    frequency_hz: float = column("frequency of the peak", "Hz", error="frequency_error")
    zone_rms_m_per_V: float = column("rms of u_z on the active touch face", "m/V", error="height_error")
    passive_rms_m_per_V: float | None = column(
        "rms of u_z on the passive touch face; None without one", "m/V", error="height_error"
    )
    confinement_db: float | None = column(
        "rms on the active touch face relative to that on the passive one; None without one",
        "dB",
        error="confinement_error_db",
    )
    quality_factor: float | None = column(
        "quality factor; None if it cannot be read from the curve", error="quality_error"
    )
    height_error: float | None = bar("both rms, relative, for the given damping")
    frequency_error: float | None = bar("frequency_hz, relative: mesh, reduction and bonding together")
    quality_error: float | None = bar("quality_factor")
    confinement_error_db: float | None = bar("confinement_db", "dB")
    sound_db: float | None = column(
        "sound pressure level 0.5 m before the middle of the touch face at drive_V, in a baffle, re 20 uPa; None without "
        "[air]",
        "dB",
        error="sound_error_db",
        default=None,
    )
    sound_error_db: float | None = column("error bar of sound_db (half-width)", "dB", default=None)

    @property
    def zone_nm_per_V(self) -> float:
        """Rms on the zone in nm/V."""
        return self.zone_rms_m_per_V / NM

    @property
    def zone_error_nm_per_V(self) -> float | None:
        """Error bar of zone_nm_per_V (half-width)."""
        return None if self.height_error is None else self.height_error * self.zone_nm_per_V

    @property
    def volts_per_um(self) -> float | None:
        """Amplitude of the drive for 1 um rms on the zone, V; None where it does not move."""
        return UM / self.zone_rms_m_per_V if self.zone_rms_m_per_V > 0.0 else None

    @property
    def volts_error_per_um(self) -> float | None:
        """Error bar of volts_per_um (half-width), V."""
        return self.height_error * self.volts_per_um if self.height_error and self.volts_per_um else None

    @property
    def tone(self) -> str:
        """Frequency in words."""
        return frequency(self.frequency_hz, self.frequency_error)

    def line(self, name: str) -> str:
        """Return the peak in words."""
        level_text = ""
        if self.confinement_db is not None:
            level_text = f", {level_with_bar(self.confinement_db, self.confinement_error_db)} above the passive face"
        known = frequency_with_bar(self.frequency_hz, self.frequency_error)
        tone = known if self.frequency_error is not None else f"{known} (no error estimate)"
        bar = "no error estimate" if self.height_error is None else "for the given damping"
        quality = "none" if self.quality_factor is None else with_bar(self.quality_factor, self.quality_error)
        height = with_bar(self.zone_nm_per_V, self.zone_error_nm_per_V, "nm/V")
        drive = f"{with_bar(self.volts_per_um, self.volts_error_per_um, 'V')} for 1 um, " if self.volts_per_um else ""
        return (
            f"{name} at {tone}: {height} rms on the zone, {drive}{bar}{level_text}; "
            f"quality factor from the curve: {quality}"
        )


class ResponseResult(Result, axes=("frequency_hz",)):
    """Forced response to the patches, per volt: curves over frequency with more points about each peak, in Hz and m/V.

    >>> import antinode
    >>> patch = antinode.Patches(material="pz26", size_mm=(8.0, 3.0, 0.3), centres_mm=[(0.0, 0.0)])
    >>> driven = antinode.load("examples/small.toml", accuracy=0.1, patches=patch).response((33.0, 36.0), points=5)
    >>> driven.array("zone_rms_m_per_V").shape == driven.array("frequency_hz").shape
    True
    >>> 33e3 < driven.target_peak.frequency_hz < 36e3
    True
    """

    moves = "report.shapes.response_in_frame"

    model: str = column("model and element order, and the number of patches")
    dof: int = column("degrees of freedom that were solved for")
    frequency_hz: list[float] = column("frequencies", "Hz", along="frequency_hz")
    zone_rms_m_per_V: list[float] = column(
        "rms of u_z on the active touch face", "m/V", along="frequency_hz", error="zone_rms_error_m_per_V"
    )
    passive_rms_m_per_V: list[float] | None = column(
        "rms of u_z on the passive touch face; None without one", "m/V", along="frequency_hz",
        error="passive_rms_error_m_per_V",
    )  # fmt: skip
    zone_rms_error_m_per_V: list[float] | None = column(
        "error bar of zone_rms_m_per_V for the given damping (half-width); None without an estimate, as when a charge "
        "feeds the drivers",
        "m/V", along="frequency_hz", default=None,
    )  # fmt: skip
    passive_rms_error_m_per_V: list[float] | None = bar("passive_rms_m_per_V", "m/V", along="frequency_hz")
    sensor_V_per_V: list[list[float]] | None = column(
        "voltage of the first sensor relative to the drive, real and imaginary; None without a sensor", "V/V",
        along="frequency_hz", parts=("sensor_re", "sensor_im"),
    )  # fmt: skip
    sensors: list[int] = column("numbers of the sensor patches, from 0")
    polarisation_signs: list[int] = column("sign of each patch's drive")
    target_hz: float | None = column(
        "frequency of the target mode, all patches short; None without one", "Hz", error="target_error"
    )
    quality_factor_given: float = column("quality factor that the case, or the loss of its materials, gives the mode")
    expected_error: float | None = column(
        "largest error bar of a frequency in the band, relative; None without an estimate"
    )
    circuit: dict[str, Any] = column(
        "feeding of the drivers, and the effect of opening every patch on the target mode: drivers, short_hz, open_hz, "
        "coupling"
    )
    target_status: str = column("single, split or none")
    target_peak: PeakRecord | None = column("peak of the target mode; None if the band contains none")
    highest_peak: PeakRecord = column("highest peak of the band")
    widest_bar: dict[str, Any] | None = column(
        "largest error bar of a frequency in the band: error (relative), of (which resonance), parts (mesh, reduction, "
        "bonding) and largest_part",
        default=None,
    )
    measured: MeasuredRecord | None = column("comparison with measured data; None without a measurement", default=None)
    target_error: float | None = bar("target_hz, relative")
    forced: Any = live("the solved plate; None if read from a file")
    written: list[Any] = live("written files with synthetic data", default_factory=list)

    @classmethod
    def of_solved(cls, solved: SolvedResponse, case: Case) -> ResponseResult:
        """Return the result of a solved response, with the error bars of its curves and peaks.

        Parameters
        ----------
        solved : SolvedResponse
            Forced plate, curves and peaks.
        case : Case
            The case that was solved.

        Returns
        -------
        ResponseResult
            The result.
        """
        from pipeline.models.forced import curve_errors
        from solvers.piezo.responses import circuit_shift, frequency_error

        forced, curve, patches, shift = solved.forced, solved.curve, case.patches, circuit_shift(solved.forced)
        assert patches
        own, target_hz, passive = solved.target, forced.target_hz(), curve.passive_rms_m_per_v
        bars = curve_errors(forced, curve)
        zone_error, passive_error = [None, None] if bars is None else [*bars.tolist(), None][:2]
        first = curve.sensor_v_per_v[:, 0] if patches.sensors else None
        target = _peak(own, forced, patches.drive_v) if own else None
        same = target if own and solved.highest.is_at(own.frequency_hz, forced.loss_at(own.frequency_hz)) else None
        circuit = {name: getattr(shift, name, None) for name in ("short_hz", "open_hz", "coupling")}
        return cls(
            model=f"{forced.plate.name} with {several(patches.count, 'patch')}",
            dof=sum(group.pencil.dof for group in forced.plate.groups),
            frequency_hz=curve.frequency_hz.tolist(),
            zone_rms_m_per_V=curve.zone_rms_m_per_v.tolist(),
            passive_rms_m_per_V=None if passive is None else passive.tolist(),
            zone_rms_error_m_per_V=zone_error,
            passive_rms_error_m_per_V=passive_error,
            sensor_V_per_V=None if first is None else np.column_stack([first.real, first.imag]).tolist(),
            sensors=list(patches.sensors),
            polarisation_signs=[int(sign) for sign in forced.signs],
            target_hz=target_hz,
            target_error=frequency_error(forced, target_hz) if target_hz else None,
            quality_factor_given=1.0 / forced.loss_at((own or solved.highest).frequency_hz),
            expected_error=solved.expected_error,
            circuit={"drivers": forced.circuit, **circuit},
            target_status=forced.verdict.status,
            target_peak=target,
            highest_peak=_peak(solved.highest, forced, patches.drive_v, same),
            widest_bar=solved.widest_bar.to_dict(),
            forced=forced,
        )

    def to_pyvista(self, frequency_kHz: float | None = None) -> Any:
        """Return the closed outer surface of the whole plate, without its patches, with its driven displacement.

        Parameters
        ----------
        frequency_kHz : float, optional
            Frequency of the drive in kHz; that of `peak` by default.

        Returns
        -------
        pyvista.PolyData
            Surface in m; its arrays (points, 3) are `displacement`, in m per volt when u_z is largest anywhere, and
            `quadrature`, a quarter period later. Its method `save` writes a file for ParaView (.vtp).

        Raises
        ------
        InputError
            For a frequency outside the solved band.
        ValueError
            For a response that was read from a file, which holds no shapes.

        Examples
        --------
        >>> import antinode
        >>> patch = antinode.Patches(material="pz26", size_mm=(8.0, 3.0, 0.3), centres_mm=[(0.0, 0.0)])
        >>> driven = antinode.load("examples/small.toml", accuracy=0.1, patches=patch).response((33.0, 36.0), points=5)
        >>> surface = driven.to_pyvista(34.5)
        >>> surface.point_data.keys(), surface.n_open_edges
        (['displacement', 'quadrature'], 0)
        """
        from pipeline.models.mode_fields import driven_surface

        if self.forced is None:
            raise ValueError("this response was read from a file, which holds no shapes: compute it again")
        low, high = (end / KHZ for end in self.forced.band_hz)
        if frequency_kHz is not None and not low <= frequency_kHz <= high:
            raise InputError(f"frequency_kHz = {frequency_kHz}: must lie in the solved band, {low:g} to {high:g} kHz")
        return driven_surface(self.forced, self.peak.frequency_hz if frequency_kHz is None else frequency_kHz * KHZ)

    @property
    def peak(self) -> PeakRecord:
        """Peak of the target mode; the highest peak if the band contains none."""
        return self.target_peak or self.highest_peak

    @property
    def same(self) -> bool:
        """Whether the target mode's peak is the highest: both lie within a half-power width."""
        own, other = self.target_peak, self.highest_peak.frequency_hz
        return own is not None and abs(other - own.frequency_hz) <= own.frequency_hz / self.quality_factor_given

    target_peak_hz = figure_at("target_peak.frequency_hz", "target mode's peak, driven", "Hz")
    target_peak_nm_per_v = figure_at(
        "target_peak.zone_nm_per_V", "zone at the driven peak", "nm/V", error="target_peak.zone_error_nm_per_V"
    )
    target_peak_db = figure_at("target_peak.confinement_db", "driven confinement", "dB")
    highest_peak_hz = figure_at("highest_peak.frequency_hz", "highest peak of the response", "Hz")
    highest_peak_nm_per_v = figure_at(
        "highest_peak.zone_nm_per_V", "zone at the highest peak", "nm/V", error="highest_peak.zone_error_nm_per_V"
    )
    highest_peak_db = figure_at("highest_peak.confinement_db", "confinement at the highest peak", "dB")
    measured_hz = figure_at("measured.sweep.frequency_hz", "measured resonance", "Hz")
    measured_shift_hz = figure_at(
        "measured.sweep.frequency_shift_hz", "measured minus computed", "Hz", is_difference=True, is_signed=True
    )
    measured_quality_factor = figure_at("measured.sweep.quality_factor", "measured quality factor")
    measured_db = figure_at("measured.map.confinement_db", "measured confinement", "dB")
    measured_mac = figure_at("measured.map.mac_operating", "MAC of measured and computed shapes")

    # -- words and pictures

    def lines(self) -> Iterator[str]:
        """Yield the model, the curves around the peak, the peaks, measured data and the written files."""
        rows = [[*row.values()] for row in self.to_rows()]
        near = sorted(sorted(rows, key=lambda row: abs(row[0] - self.peak.frequency_hz))[:SHOWN])
        whose = "target mode" if self.target_peak else "zone"
        yield f"{self.model}, {self.dof} degrees of freedom; around the peak of the {whose}, per volt of drive:"
        yield outputs.reading_table(*outputs.filled(tuple(self.to_rows()[0]), near))
        yield from self.peaks()
        yield from self.measured.lines(self.expected_error) if self.measured else ()
        yield from (f"wrote {path}" for path in self.written)

    def peaks(self) -> Iterator[str]:
        """Yield the peak of the target mode, and the highest peak if it is another one.

        Yields
        ------
        str
            One peak in words.
        """
        if self.target_peak:
            yield self.target_peak.line("target mode's peak")
        if not self.same:
            yield self.highest_peak.line("highest peak")

    def draw(self, ax: Axes) -> None:
        """Draw the rms of zone and passive face per volt over frequency, the peaks marked."""
        self._draw_curve(ax, "zone_rms", color=style.BLUE, label="zone")
        self._draw_curve(ax, "passive_rms", color=style.VERMILION, ls="--", label="passive face")
        target, highest = self.target_peak, self.highest_peak
        for peak, dashes in ((target, ":"), (highest, "-.")):
            if peak:
                ax.axvline(peak.frequency_hz / KHZ, color=style.GREY, ls=dashes, lw=0.8)
        title = f"highest peak at {highest.tone} (dash-dotted)"
        title = f"Target mode's peak at {target.tone} (dotted),\n{title}" if target else title.capitalize()
        ax.set(ylabel="rms u_z (nm/V)", xlabel="frequency (kHz)", title=title)
        ax.grid(True)
        ax.legend(fontsize=9)

    def _draw_curve(self, ax: Axes, name: str, **look: Any) -> None:
        """Draw a curve with the band of its error bars, no lower than the fraction BAND of the curve."""
        if getattr(self, f"{name}_m_per_V") is None:
            return
        tone, values = self.array("frequency_hz") / KHZ, self.array(f"{name}_m_per_V") / NM
        ax.semilogy(tone, values, **look)
        if getattr(self, f"{name}_error_m_per_V") is not None:
            half = self.array(f"{name}_error_m_per_V") / NM
            low = np.maximum(values - half, BAND * values)
            ax.fill_between(tone, low, values + half, color=look["color"], alpha=0.2, lw=0)

    def pictures(self) -> list[ReportFigure]:
        """Return the pictures of the curves, of the operating deflection shape if stored, and of the comparison."""
        from pipeline.measured.pictures import report_figure

        shape = self.arrays.get("response_uz")
        count = 1 + (self.sensor_V_per_V is not None) + (shape is not None)
        drawn, panels = style.panels(2.3 * count + 0.6, count, 1, squeeze=False)
        self.draw(panels[0, 0])
        if self.sensor_V_per_V is not None:
            self._draw_sensor(panels[1, 0])
        if shape is not None:
            self._draw_shape(panels[-1, 0], self.arrays["response_xy"], shape)
        own = style.ReportFigure("response", "Response per volt of drive", self._alt(), drawn, vector=shape is None)
        if self.measured and self.plate_design:
            return [own, report_figure(self.measured, self.arrays, self.plate_design)]
        return [own]

    def _draw_sensor(self, ax: Axes) -> None:
        tone, volts = self.array("frequency_hz") / KHZ, self.array("sensor_V_per_V") @ np.array([1.0, 1j])
        ax.semilogy(tone, np.abs(volts), color=style.GREEN)
        title = f"Sensor patch {self.sensors[0]}, open circuit"
        ax.set(ylabel="sensor (V/V)", xlabel="frequency (kHz)", title=title)
        ax.grid(True)
        phase = ax.twinx()
        phase.plot(tone, _turns(np.degrees(np.angle(volts))), color=style.ORANGE, ls="--")
        phase.set(ylim=(-190.0, 190.0), yticks=(-180, -90, 0, 90, 180))
        phase.set_ylabel("phase (°)", color=style.ORANGE)
        phase.spines["right"].set_visible(True)

    def _draw_shape(self, ax: Axes, points: FloatArray, shape: Any) -> None:
        turned = shape * np.exp(-1j * np.angle(shape[np.argmax(np.abs(shape))]))
        limit = np.abs(shape).max() / NM
        x, y = np.unique(points[:, 0]), np.unique(points[:, 1])
        field = turned.real.reshape(len(x), len(y)).T / NM
        look: dict[str, Any] = {"cmap": style.SIGNED, "vmin": -limit, "vmax": limit}
        image = ax.pcolormesh(x / MM, y / MM, field, shading="gouraud", rasterized=True, **look)
        style.mm_axes(ax)
        ax.set_title(f"Operating deflection shape at {self.peak.tone}")
        ax.set_anchor("W")
        ax.figure.colorbar(image, cax=ax.inset_axes((1.05, 0.0, 0.05, 1.0)), label="u_z (nm/V)")

    def _alt(self) -> str:
        peak = self.peak
        whose = "the target mode peaks" if self.target_peak else "the zone peaks highest"
        level_text = "" if peak.confinement_db is None else f", {level(peak.confinement_db)} above the passive face"
        quality = ""
        if peak.quality_factor is not None:
            quality = f", quality factor {in_digits(peak.quality_factor, peak.quality_error)} read from the curve"
        return (
            f"Displacement per volt over frequency: {whose} at {peak.tone} with "
            f"{with_bar(peak.zone_nm_per_V, peak.zone_error_nm_per_V, 'nm/V')} rms{level_text}{quality}"
        )

    def __repr__(self) -> str:
        return over(self, self.array("frequency_hz"))


def _peak(peak: Peak, forced: ForcedPlate, drive_v: float, same: PeakRecord | None = None) -> PeakRecord:
    """Return a peak with its error bars; `same` is a peak of the same resonance, whose error bars it shares."""
    from pipeline.models.forced import level_error_db, quality_error
    from solvers.piezo.forced import sound_db
    from solvers.piezo.responses import frequency_error, height_error

    height, sound = height_error(forced, peak.frequency_hz), sound_db(forced, peak.frequency_hz, drive_v)
    return PeakRecord.of(
        peak,
        zone_rms_m_per_V=peak.zone_rms,
        passive_rms_m_per_V=peak.passive_rms,
        height_error=height,
        sound_db=sound,
        sound_error_db=None if sound is None or height is None else 20.0 * np.log10(1.0 + height),
        frequency_error=frequency_error(forced, peak.frequency_hz),
        quality_error=same.quality_error if same else quality_error(forced, peak),
        confinement_error_db=same.confinement_error_db if same else level_error_db(forced, peak),
    )


def _turns(degrees: FloatArray) -> FloatArray:
    """Return a phase in degrees with a gap wherever it wraps from -180 to 180."""
    broken = degrees.copy()
    broken[1:][np.abs(np.diff(degrees)) > 180.0] = np.nan
    return broken


class Response(
    Question[ResponseResult],
    needs=("patches",),
    drives=True,
    honours=(LARGER, PLACES, SUPPORTS, STRESS),
    at_own_frequencies=True,
    example="response studies/three-rows.toml --band 28kHz:38kHz",
):
    """Compute the forced response to the patches over a band, with more points about each peak.

    Measured data named in the case are compared with it.

    >>> from antinode import Patches, load
    >>> plate = load("examples/small.toml", accuracy=0.1, patches=Patches(size_mm=(8.0, 3.0, 0.3)))
    >>> peak = plate.response((33.0, 36.0), points=5).target_peak
    >>> round(peak.frequency_hz, -3), round(peak.confinement_db)
    (34000.0, 13)
    """

    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, kw_only=False, help="frequencies")
    points: int = option(default=POINTS, at_least=1, at_most=MAX_FREQUENCIES, help="number of frequencies")

    @classmethod
    def in_study(cls) -> Response:
        """Return the question that also writes the mode table of the plate."""
        return _InStudies()

    def plan(self, case: Case) -> Plan:
        return plans.plan_of(case, plans.response_step(case, hz(self.band_kHz), self.points))

    def compute(self, case: Case, plan: Plan, run: Run) -> ResponseResult:
        from pipeline.measured.comparison import compare
        from pipeline.models.forced import gridded, solve_response
        from pipeline.records.record import DesignRecord
        from solvers.threads import one_thread

        files = self._measured(case)
        solved = solve_response(case, plan.steps[0].choice, run, hz(self.band_kHz), self.points, run.meshes)
        run.solved["forced"] = solved.forced
        with one_thread():
            result = ResponseResult.of_solved(solved, case)
        _report(result, solved, case, run)
        arrays = gridded(*solved.forced.shape(result.peak.frequency_hz))
        more: dict[str, Any] = {"written": self._write(case, solved, run)}
        if files:
            more["measured"], measured_arrays = compare(case, solved, files, run)
            arrays |= measured_arrays
            for line in more["measured"].lines(solved.expected_error):
                run.info(line)
        run.arrays |= arrays
        return replace(result, **more).with_arrays(arrays, DesignRecord.of_design(case.design))

    def _measured(self, case: Case) -> Measurements | None:
        """Read the measured data of the plate. Raises InputError for unsuitable files."""
        from pipeline.measured.comparison import read

        return read(case, None, None, None)

    def _write(self, case: Case, solved: SolvedResponse, run: Run) -> list[Path]:
        return []


class _InStudies(Response):
    """The response, and the mode table of the patched plate instead of the bare one."""

    def compute(self, case: Case, plan: Plan, run: Run) -> ResponseResult:
        """Compute the response and write mode_table.bin and mode_table.h into the case's folder."""
        from pipeline.board.export import write_patched

        result = super().compute(case, plan, run)
        if result.target_hz is None:
            run.log.warning(
                "TABLE", "no mode of the plate with its patches has the target shape, so there is no mode table"
            )
            return result
        try:
            assert run.folder
            write_patched(case, run.solved["forced"], run.folder, run.log)
        except InputError as error:
            run.log.warning("TABLE", error.lines[0])
        return result


class MeasuredResponse(Response, instead_of="response", by=("measured", "map")):
    """Compute the forced response to the patches and compare it with a measured sweep, a measured map, or both, in Hz and dB.

    >>> import antinode, tempfile
    >>> patch = antinode.Patches(size_mm=(8.0, 3.0, 0.3), centres_mm=[(0.0, 0.0)])
    >>> plate, folder = antinode.load("examples/small.toml", accuracy=0.1, patches=patch), tempfile.mkdtemp()
    >>> files = plate.synthetic_response((33.0, 36.0), points=101, synthetic_data=folder).written
    >>> sweep = plate.measured_response((33.0, 36.0), points=101, measured=str(files[0])).measured.sweep
    >>> sweep.synthetic, abs(sweep.frequency_shift_hz) < 10.0
    (True, True)
    """

    measured: str | None = option(
        default=None, metavar="FILE",
        help="measured sweep to compare with: CSV with frequency_Hz (or kHz) and real, imag or amplitude, phase_deg",
    )  # fmt: skip
    map: str | None = option(
        default=None, metavar="FILE",
        help="vibrometer map of the touch face: CSV with x_mm, y_mm and real, imag or amplitude, phase_deg",
    )  # fmt: skip
    at: str | None = option(
        default=None, metavar="X,Y", help="position of the sweep's laser, mm (default: where the zone moves most)"
    )

    def check(self, case: Case) -> None:
        """Raise InputError for a case without patches or without a file to compare with."""
        super().check(case)
        if self.measured is None and self.map is None:
            raise InputError("measured, map: at least one must name a file to compare with")

    def _measured(self, case: Case) -> Measurements | None:
        from pipeline.measured.comparison import read

        return read(case, self.measured, self.map, self.at, hz(self.band_kHz))


class SyntheticResponse(Response, instead_of="response", by="synthetic_data"):
    """Compute the forced response and write it like a measurement, in m/s per V, with noise and marked SYNTHETIC.

    >>> import antinode, tempfile
    >>> patch = antinode.Patches(size_mm=(8.0, 3.0, 0.3), centres_mm=[(0.0, 0.0)])
    >>> plate = antinode.load("examples/small.toml", accuracy=0.1, patches=patch)
    >>> made = plate.synthetic_response((33.0, 36.0), points=5, synthetic_data=tempfile.mkdtemp())
    >>> [path.name for path in made.written]
    ['sweep.csv', 'field.csv']
    """

    synthetic_data: str | None = option(
        default=None,
        metavar="DIR",
        help="folder for sweep.csv and field.csv, written like a measurement and marked SYNTHETIC",
    )
    seed: int = option(default=1, at_least=1, at_most=MAX_SEED, help="random seed of the --synthetic-data noise")
    noise: float = option(
        default=0.01, at_least=0.0, at_most=1.0, metavar="R", help="rms of that noise relative to the peak"
    )

    def check(self, case: Case) -> None:
        """Raise InputError for losses without one quality factor, too, from which the file's frequencies follow."""
        super().check(case)
        case.one_quality_factor("--synthetic-data")

    def _write(self, case: Case, solved: SolvedResponse, run: Run) -> list[Path]:
        from pipeline.measured.synthetic import write

        return write(case, solved, Path(self.synthetic_data or "."), run.asked_by or repr(self), self.seed, self.noise)


def _report(result: ResponseResult, solved: SolvedResponse, case: Case, run: Run) -> None:
    """Log the largest error bar, the peak and the effect of opening the patches; warn of misleading figures."""
    run.info(solved.widest_bar.text())
    solved.widest_bar.warn(case, run)
    run.info(next(result.peaks()))
    shift, error = result.circuit, result.peak.frequency_error
    if shift["coupling"] is not None:
        run.info(
            f"target mode at {frequency(shift['short_hz'], error)} with all patches short, "
            f"{frequency(shift['open_hz'], error)} with all open: effective coupling factor squared (k_eff^2) "
            f"{in_digits(shift['coupling'])}"
        )
    if result.target_peak is None:
        known = result.target_hz is not None
        where = f"it lies at {frequency(result.target_hz)}" if known else "no mode of the plate has the target shape"
        low, high = (end / KHZ for end in solved.forced.band_hz)
        run.warning(
            "NO_MODE",
            f"the band from {low:g} to {high:g} kHz does not contain the target mode, {where}: the peak belongs to "
            "another mode",
        )
    elif not result.same:
        run.warning(
            "OTHER_PEAK",
            f"the highest peak, at {result.highest_peak.tone}, is not that of the target mode, at "
            f"{result.target_peak.tone}",
        )
    if result.target_status == "split":
        run.warning(
            "SPLIT_MODE",
            "the target shape is split among several modes of the patched plate: results refer to the strongest",
        )
    if result.highest_peak.frequency_hz in (result.frequency_hz[0], result.frequency_hz[-1]):
        run.warning("PEAK_AT_END", "the response is largest at the end of the band: widen it")
    quality, given = result.peak.quality_factor, result.quality_factor_given
    if quality and abs(quality / given - 1.0) > SHARED:
        run.warning(
            "SHARED_PEAK",
            f"the peak's width implies a quality factor of {in_digits(quality)}, but its mode has {given:g}: modes overlap",
        )
