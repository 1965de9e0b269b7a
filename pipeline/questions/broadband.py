"""Broadband behaviour of the rows: attenuation of a wave and confinement of a driven zone over frequency."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan
from typing import Any

from pipeline.case.features import CELL, GROUPS, OBLIQUE
from pipeline.case.limits import MAX_FREQUENCIES
from pipeline.models.answer_parts import BroadbandPoint
from pipeline.quantity import KHZ, frequency_with_bar, interval, several, with_bar
from pipeline.quantity import figure as in_digits
from pipeline.questions.attenuation import over
from pipeline.questions.bands import check_own_cell
from pipeline.questions.cell_meshes import OfCellMeshes
from pipeline.questions.late import Axes, Case, Plan, ReportFigure, confinement, np, simplifications, style
from pipeline.questions.question import Pair, Question, Run, hz, option
from pipeline.questions.result import Result, figure, figure_at, stacked
from pipeline.records.part import bar, column

POINTS, SHOWN = 201, 20
ENDS = "relative error bars of both ends of each interval of `{}` (half-widths)"


class BroadbandResult(Result, table="points", axes=("frequency_hz",)):
    """Attenuation and confinement over frequency for one column of cells: arrays (points,) in Hz and dB.

    >>> import antinode
    >>> held = antinode.load("examples/small.toml", accuracy=0.1).broadband((30.0, 36.0), points=3)
    >>> held.frequency_hz.tolist(), held.confinement_db.shape
    ([30000.0, 33000.0, 36000.0], (3,))
    """

    model: str = column("model of the column of cells and its element order")
    kx_per_m: float = column("wavenumber along the zone", "rad/m")
    rows: int = column("rows on each side of the zone")
    target_hz: float | None = column("frequency of the column's target mode", "Hz", error="target_error")
    target_db: float | None = column("confinement of the column's target mode", "dB", error="target_error_db")
    confined_hz: list[float] | None = column(
        "interval of `confined` that contains the target mode", "Hz", error="confined_error"
    )
    stopped_hz: list[float] | None = column(
        "interval of `stopped` that contains the target mode", "Hz", error="stopped_error"
    )
    confined: list[list[float]] = column(
        "intervals in which the driven motion is confined", "Hz", error="confined_error"
    )
    stopped: list[list[float]] = column(
        "intervals in which the rows transmit at most a tenth of the power of a wave", "Hz", error="stopped_error"
    )
    points: list[BroadbandPoint] = column("the column at each frequency")
    target_error: float | None = bar("target_hz, relative")
    target_error_db: float | None = bar("target_db", "dB")
    frequency_error: float | None = bar("any frequency of the column, relative")
    confined_error: list[list[float | None]] = column(ENDS.format("confined"), default_factory=list)
    stopped_error: list[list[float | None]] = column(ENDS.format("stopped"), default_factory=list)

    frequency_hz = stacked("frequency_hz", "Frequencies (points,) in Hz.")
    confinement_db = stacked("confinement_db", "Confinement (points,) in dB under a pressure in the target shape.")

    def taken_db(self, frequency_hz: float) -> float:
        """Interpolate the attenuation by the rows.

        Parameters
        ----------
        frequency_hz : float
            Frequency in Hz.

        Returns
        -------
        float
            Attenuation in dB; NaN outside the band and without an incident wave.
        """
        levels = [point.taken_db for point in self.points]
        return float(np.interp(frequency_hz, self.frequency_hz, levels, left=nan, right=nan))

    def end_errors(self, ends_hz: list[float]) -> tuple[float | None, float | None]:
        """Return the error bars of the ends of an interval.

        Parameters
        ----------
        ends_hz : list of float
            Lower and upper end in Hz.

        Returns
        -------
        tuple of float or None
            Half-width for each end, relative to its frequency; None without an estimate.
        """
        from pipeline.models.broadband import end_errors

        return end_errors(self.points, self.frequency_error, ends_hz)

    @figure("stop band around the target mode", "Hz", error="stopped_width_error_hz", is_difference=True)
    def stopped_width_hz(self) -> float:
        """Width of the band around the target mode in which the rows stop nine tenths of the power; 0 without one."""
        return self.stopped_hz[1] - self.stopped_hz[0] if self.stopped_hz else 0.0

    @property
    def stopped_width_error_hz(self) -> float | None:
        """Error bar of stopped_width_hz from those of both ends (half-width); None without an estimate."""
        if self.stopped_hz is None:
            return None
        errors = self.end_errors(self.stopped_hz)
        known = [error * end for error, end in zip(errors, self.stopped_hz, strict=True) if error is not None]
        return sum(known) if len(known) == len(errors) else None

    column_target_hz = figure_at("target_hz", "target mode of the column", "Hz")
    column_target_db = figure_at("target_db", "confinement in the column", "dB")

    def lines(self) -> Iterator[str]:
        """Yield the model, some frequencies, the intervals and the target mode of the column."""
        yield f"{self.model}, kx = {in_digits(self.kx_per_m)} rad/m, {several(self.rows, 'row')}"
        yield self.reading(("taken_error_db",), SHOWN)
        stretches = {
            f"stopped (at most a tenth of the power passes {several(self.rows, 'row')})": self.stopped,
            f"driven motion confined by {confinement.CONFINED_DB:g} dB or more": self.confined,
        }
        for what, windows in stretches.items():
            found = ", ".join(interval(low, high, *self.end_errors([low, high])) for low, high in windows)
            yield f"{what}: {found or 'nowhere in the requested band'}"
        if self.target_hz is None or self.target_db is None:
            yield "no mode of the column in its window has the target shape"
            return
        own = frequency_with_bar(self.target_hz, self.target_error)
        yield f"target mode of the column: {own}, {with_bar(self.target_db, self.target_error_db, 'dB')}"

    def draw(self, ax: Axes) -> None:
        """Draw the attenuation by the rows and the confinement of the driven zone, the column's target mode marked."""
        khz = self.frequency_hz / KHZ
        taken = [point.taken_db for point in self.points]
        ax.plot(khz, taken, color=style.BLUE, label=f"attenuation by {several(self.rows, 'row')}")
        look: dict[str, Any] = {"color": style.ORANGE, "lw": 0.9, "ls": "--"}
        ax.plot(khz, self.confinement_db, label="confinement of the driven zone", **look)
        if self.target_hz is not None and self.target_db is not None:
            ax.plot(self.target_hz / KHZ, self.target_db, "*", color=style.ORANGE, ms=10)
        ax.axhline(confinement.CONFINED_DB, color=style.GREEN, lw=0.9, ls=":")
        ax.set(xlabel="frequency (kHz)", ylabel="level (dB)", ylim=(-15.0, 60.0))
        ax.grid(True)
        ax.legend(fontsize=9)

    def pictures(self) -> list[ReportFigure]:
        """Return the picture of attenuation and confinement over frequency."""
        bands = ", ".join(interval(low, high, *self.end_errors([low, high])) for low, high in self.stopped) or "nowhere"
        least = f"at least {confinement.CONFINED_DB:g} at {bands}"
        alt = f"Over frequency: attenuation of a flexural wave by {several(self.rows, 'row')} in dB, {least}; "
        title, more = "Attenuation by the rows and confinement over frequency", "and confinement of the driven zone"
        return [style.ReportFigure("broadband", title, alt + more, self.as_figure(), vector=True)]

    def __repr__(self) -> str:
        return over(self, self.frequency_hz)


class Broadband(
    Question[BroadbandResult],
    needs=("plate", "zone", "array.pitch_mm", "array.rows"),
    honours=(CELL, OBLIQUE),
    example="broadband studies/three-rows.toml --set array.heights_mm=[6.3,6.0,5.7] --band 25kHz:45kHz",
):
    """Compute the attenuation by the rows and the confinement of a driven zone over frequency, in dB; rows may differ.

    >>> import antinode
    >>> plate = antinode.load("examples/small.toml", accuracy=0.1)
    >>> plate.broadband((30.0, 36.0), points=3).confinement_db.shape
    (3,)
    """

    step = ("rows over frequency", "column of reduced cells at the target wavenumber")
    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, kw_only=False, help="frequencies")
    points: int = option(default=POINTS, at_least=1, at_most=MAX_FREQUENCIES, help="number of frequencies")

    def check(self, case: Case) -> None:
        """Raise InputError for a case without rows of pillars that hexahedra can mesh."""
        from pipeline.models.broadband import check_rows, checked

        super().check(case)
        if not case.design.cell_file:
            checked(case)
            return
        check_own_cell(case, "broadband")
        check_rows(case)

    @classmethod
    def spared(cls, case: Case) -> simplifications.Simplification | None:
        from pipeline.models.broadband import of_rows

        if case.design.rows and simplifications.hexahedra(of_rows(case), "plate"):
            return None
        return simplifications.Simplification(
            "no_rows", "broadband", "it needs rows of pillars that hexahedra can mesh"
        )

    def compute(self, case: Case, plan: Plan, run: Run) -> BroadbandResult:
        from pipeline.models.broadband import broadband

        own = None
        if case.design.cell_file:
            from pipeline.models.plate_cell import step_rows
            from pipeline.planning.mesh_rules import tet_cell_edge_m

            own = step_rows(case, tet_cell_edge_m(case.design, case.solve.accuracy), run)
        return BroadbandResult(**broadband(case, run, hz(self.band_kHz), self.points, own=own))


class MeshBroadband(
    OfCellMeshes, Broadband, Question[BroadbandResult],
    instead_of="broadband", by="mesh_file", needs=("plate", "zone", "array.pitch_mm", "array.rows"), honours=(GROUPS, OBLIQUE),
):  # fmt: skip
    """Compute the attenuation and the confinement by rows of your own mesh of a unit cell, in dB, over frequency.

    The first cell begins at the border of the zone; cells on its other side are mirror images.

    >>> import antinode, meshio, tempfile
    >>> file, side = f"{tempfile.mkdtemp()}/cell.inp", 0.004
    >>> lines = [[side * k / 6 for k in range(7)]] * 2 + [[0.002 * k / 4 for k in range(5)]]
    >>> points = [[x, y, z] for z in lines[2] for y in lines[1] for x in lines[0]]
    >>> first = [x + 7 * y + 49 * z for z in range(4) for y in range(6) for x in range(6)]
    >>> cells = [[n, n + 1, n + 8, n + 7, n + 49, n + 50, n + 57, n + 56] for n in first]
    >>> meshio.write_points_cells(file, points, [("hexahedron", cells)])
    >>> plate = antinode.load("examples/small.toml", accuracy=0.1)
    >>> passed = plate.mesh_broadband((30.0, 34.0), mesh_file=[file], points=2)
    >>> len(passed.points)
    2
    """

    def check(self, case: Case) -> None:
        """Raise InputError for a case without rows, and for unsuitable files."""
        from pipeline.models.broadband import check_rows

        Question.check(self, case)
        check_rows(case)
        self.check_files()

    def compute(self, case: Case, plan: Plan, run: Run) -> BroadbandResult:
        from pipeline.models.broadband import broadband
        from pipeline.models.plate_cell import own_rows
        from pipeline.planning.model_choice import driven_band_hz

        own = own_rows(case, self.files, run, driven_band_hz(case, hz(self.band_kHz))[1])
        return BroadbandResult(**broadband(case, run, hz(self.band_kHz), self.points, own=own))
