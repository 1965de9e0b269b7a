"""Bloch bands of the unit cell along a path through the Brillouin zone, and their gaps."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from pipeline import quantity
from pipeline.case.features import ATTACHED, CELL, DEFECTS, GROUPS, OBLIQUE, OF_A_PLATE
from pipeline.errors import InputError
from pipeline.quantity import KHZ, several
from pipeline.questions.cell_meshes import OfCellMeshes
from pipeline.questions.late import (
    Axes,
    Case,
    FloatArray,
    Plan,
    Simplification,
    np,
    outputs,
    plans,
    resource_estimate,
    simplifications,
    style,
)
from pipeline.questions.question import Question, Run, option
from pipeline.questions.result import Figure, Result, figure, figure_at, stacked
from pipeline.records.part import Part, bar, column

if TYPE_CHECKING:
    from pipeline.models.bands import SolvedBands
    from pipeline.planning.plan import Step

NAMES = {"G": "Γ"}
LABEL = {"ha": "center", "va": "center", "fontsize": 9, "clip_on": True}
WHITE = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
LEGEND_COLUMNS, LEGEND_IN = 3, 2.5  # most columns of a legend, and the width of one
PILLAR = "pillar"
SUPERCELL = re.compile(r"([1-9][0-9]?)x([1-9][0-9]?)", re.ASCII)
ONE_MESH = "no error bars: one mesh gives none; a second, finer --mesh-file of the same cell does"
MARKS = {"flexural": ("BLUE", "o", 2.8), "shear": ("ORANGE", "s", 2.8), "longitudinal": ("PURPLE", "^", 3.4)}


class Interval(Part):
    """A frequency interval without waves."""

    lower_hz: float = column("frequency where the gap begins", "Hz", error="lower_error")
    upper_hz: float = column("frequency where the gap ends", "Hz", error="upper_error")
    lower_error: float | None = bar("lower_hz, relative")
    upper_error: float | None = bar("upper_hz, relative")

    @property
    def relative_width(self) -> float:
        """Width divided by the centre frequency."""
        return 2.0 * (self.upper_hz - self.lower_hz) / (self.upper_hz + self.lower_hz)

    @property
    def width_error(self) -> float | None:
        """Error bar of the relative width (half-width, first order); None without those of both edges."""
        if self.lower_error is None or self.upper_error is None:
            return None
        middle = (self.upper_hz + self.lower_hz) / 2.0
        return self.lower_hz * self.upper_hz * (self.lower_error + self.upper_error) / middle**2

    @property
    def interval(self) -> str:
        """Edges with the digits that their error bars allow."""
        return quantity.interval(self.lower_hz, self.upper_hz, self.lower_error, self.upper_error)

    @property
    def text(self) -> str:
        """The gap in words."""
        raise NotImplementedError

    def __str__(self) -> str:
        return self.text


class Gap(Interval):
    """A frequency interval without waves between two bands."""

    lower_band: int = column("band below, counted from 1")
    upper_band: int = column("band above")

    @property
    def text(self) -> str:
        """Bands, edges with error bars, and relative width, in words."""
        low = quantity.frequency_with_bar(self.lower_hz, self.lower_error)
        high = quantity.frequency_with_bar(self.upper_hz, self.upper_error)
        bar = None if self.width_error is None else 100.0 * self.width_error
        width = quantity.figure(100.0 * self.relative_width, bar)
        return f"Gap from band {self.lower_band} ({low}) to band {self.upper_band} ({high}), {width} %"


class DirectionalGap(Gap):
    """A gap for wavevectors along one segment of the path."""

    start: str = column("start of the segment")
    end: str = column("end of the segment")

    @property
    def text(self) -> str:
        """Segment and edges in words."""
        return f"gap from {self.start} to {self.end} only: {self.interval}"


class PolarisationGap(Interval):
    """A frequency interval without waves of one polarisation."""

    polarisation: str = column("polarisation of the waves")

    @property
    def text(self) -> str:
        """Polarisation and edges in words."""
        return f"gap for {self.polarisation} waves only: {self.interval}"


class ZoneGap(Gap):
    """A gap over the whole Brillouin zone."""

    lower_at: list[float] = column("wavevector of the lower edge", "rad/m")
    upper_at: list[float] = column("wavevector of the upper edge", "rad/m")


class BandPoint(Part):
    """Waves at one wavevector, one entry per band; fields that only the reduced cell provides are None otherwise."""

    label: str | None = column("high-symmetry point, such as G, X or M, at a corner of the path, else None")
    kx_per_m: float = column("wavenumber along x", "rad/m")
    ky_per_m: float = column("wavenumber along y", "rad/m")
    frequencies_hz: list[float] = column(
        "frequency, best estimate", "Hz", along="band", name="frequency_hz", error="error"
    )
    computed_hz: list[float] = column(
        "frequency on the finest mesh, uncorrected", "Hz", along="band", error="error", default_factory=list
    )
    error: list[float | None] = column(
        "relative error bar of the frequency (half-width, discretisation and truncation); None without an estimate",
        along="band", default_factory=list,
    )  # fmt: skip
    polarisation: list[str] | None = column(
        "flexural, shear, longitudinal, or pillar where the pillar moves most", along="band", default=None
    )
    plate_polarisation: list[str] | None = column(
        "fractions of the wave's motion by polarisation", along="band", default=None
    )
    parity: list[str] | None = column(
        "signs under those mirrors of the cell that preserve the wavevector", along="band", default=None
    )
    branch: list[int] | None = column("number of the wave's branch", along="band", default=None)
    group_velocity_m_s: list[list[float] | None] | None = column(
        "group velocity; None for a wave at rest", "m/s", along="band",
        parts=("group_velocity_x_m_s", "group_velocity_y_m_s"), default=None,
    )  # fmt: skip
    quality_factor: list[float | None] | None = column(
        "quality factor by the loss of the materials; None without it, and for a wave at rest", along="band",
        error="quality_error", default=None,
    )  # fmt: skip
    quality_error: list[float | None] | None = column(
        "error bar of the quality factor (half-width); None without an estimate", along="band", default=None
    )


def _bending(place: int, which: str) -> Figure[float | None]:
    """Declare a figure for one of the pillars' two bending bands at M; None on a path without M."""
    about = figure(
        f"bending at M, {which}", "Hz", name=f"bending_m_{place + 1}_hz",
        error=lambda bands: next(iter(bands.bending_errors[place:]), None),
    )  # fmt: skip
    return about(lambda bands: next(iter(bands.bending_at_m_hz[place:]), None))


class BandsResult(Result, table="points", axes=("point", "band")):
    """Bloch bands along a path: frequencies (points, bands) in Hz, wavevectors (points, 2) in rad/m.

    >>> import antinode
    >>> bands = antinode.load("examples/small.toml", accuracy=0.02, bands__points=2, bands__count=4).bands()
    >>> bands.frequencies_hz.shape, bands.labels[0]
    ((7, 4), 'G')
    """

    moves = "report.shapes.bands_in_frame"

    model: str = column("model of the unit cell and its element order, such as superelement hex3")
    dof: int = column("degrees of freedom at one wavevector")
    points: list[BandPoint] = column("the waves at each wavevector of the path")
    expected_error: float | None = column(
        "largest discretisation error bar, relative; None without an estimate", default=None
    )
    widest_bar: dict[str, Any] | None = column(
        "largest error bar of a frequency: error (relative), of (which frequency), parts (mesh, truncation), "
        "largest_part",
        default=None,
    )
    gaps: list[Gap] = column("complete gaps along the path", default_factory=list)
    reduction_error: float | None = column(
        "largest truncation error, relative; None for a cell that is not reduced", default=None
    )
    directional_gaps: list[DirectionalGap] | None = column(
        "gaps along one segment of the path; None if not searched for", default=None
    )
    polarisation_gaps: list[PolarisationGap] | None = column(
        "gaps for waves of one polarisation; None if not searched for", default=None
    )
    zone_gaps: list[ZoneGap] | None = column(
        "with bands.grid: complete gaps over the whole Brillouin zone, None without", default=None
    )

    @classmethod
    def of_solved(cls, solved: SolvedBands) -> BandsResult:
        """Return the result of solved bands.

        Parameters
        ----------
        solved : SolvedBands
            Bands along the path, their error bars and their gaps.

        Returns
        -------
        BandsResult
            The result.
        """
        points = [BandPoint(**solved.point(index)) for index in range(len(solved.path.labels))]
        kinds = {
            "gaps": Gap,
            "directional_gaps": DirectionalGap,
            "polarisation_gaps": PolarisationGap,
            "zone_gaps": ZoneGap,
        }
        gaps = {kind: [kinds[kind](**gap) for gap in found] for kind, found in solved.every_gap.items()}
        return cls(
            model=solved.model, dof=solved.dof, points=points, expected_error=solved.expected_error,
            widest_bar=solved.widest_bar.to_dict(),
            reduction_error=solved.detail.reduction_error if solved.detail else None, **gaps,
        )  # fmt: skip

    # -- arrays

    frequencies_hz = stacked("frequencies_hz", "Frequencies (points, bands) in Hz.")
    computed_hz = stacked("computed_hz", "Frequencies (points, bands) on the finest mesh, uncorrected, Hz.")
    error = stacked("error", "Relative error bars (points, bands), half-widths; NaN without an estimate.")

    @property
    def wavevectors_per_m(self) -> FloatArray:
        """Wavevectors (points, 2) in rad/m."""
        return np.column_stack([self.array("kx_per_m"), self.array("ky_per_m")])

    @property
    def labels(self) -> tuple[str | None, ...]:
        """Label of each point, such as G, X or M; None between high-symmetry points."""
        return tuple(point.label for point in self.points)

    @property
    def distance_per_m(self) -> FloatArray:
        """Distance along the path (points,) in rad/m."""
        from geometry.lattice import Path

        return Path(self.wavevectors_per_m, self.labels).arc

    # -- gaps and the pillars' bending bands

    @property
    def widest_gap(self) -> Gap | None:
        """Widest complete gap; None if there is none."""
        return max(self.gaps, key=lambda gap: gap.upper_hz - gap.lower_hz, default=None)

    @property
    def known_to_hz(self) -> float:
        """Frequency up to which gaps are detected: the minimum of the highest band."""
        return min(point.frequencies_hz[-1] for point in self.points)

    @property
    def where_gaps_are_known(self) -> str:
        """Range in which complete gaps are detected, in words."""
        lowest = min(self.points, key=lambda point: point.frequencies_hz[-1])
        end = quantity.frequency(self.known_to_hz, next(iter(lowest.error[-1:]), None))
        return f"along the path up to {end}, where the lowest {len(lowest.frequencies_hz)} bands end"

    @property
    def labelled(self) -> dict[str, BandPoint]:
        """Points by label, the last one of each."""
        return {point.label: point for point in self.points if point.label}

    @property
    def bending_at_m_hz(self) -> list[float]:
        """Two bending bands of the pillars at M, the corner of a rectangular zone; [] on a path without it."""
        return next((point.frequencies_hz[:2] for point in self._corners), [])

    @property
    def _corners(self) -> list[BandPoint]:
        """Points at the corner of a rectangular zone: M of a triangular lattice is another one."""
        if "K" in self.labels or self._is_by("supercell") or getattr(self.plate_design, "staggered", False):
            return []
        return [point for point in self.points if point.label == "M"]

    @property
    def bending_errors(self) -> list[float | None]:
        """Relative error bars of bending_at_m_hz (half-widths)."""
        known = next((point.error[:2] for point in self._corners), [])
        return [*known, *[None] * (len(self.bending_at_m_hz) - len(known))]

    @property
    def bending_texts(self) -> list[str]:
        """Values of bending_at_m_hz with the digits that their error bars allow."""
        return list(map(quantity.frequency, self.bending_at_m_hz, self.bending_errors))

    # -- figures of a sweep

    gap_lower_hz = figure_at("widest_gap.lower_hz", "gap from", "Hz")
    gap_upper_hz = figure_at("widest_gap.upper_hz", "gap to", "Hz")
    gap_lower_error = figure_at("widest_gap.lower_error", "expected error of gap from", "%")
    gap_upper_error = figure_at("widest_gap.upper_error", "expected error of gap to", "%")
    bending_m_1_hz = _bending(0, "first")
    bending_m_2_hz = _bending(1, "second")

    # -- words and pictures

    def lines(self) -> Iterator[str]:
        """Yield the model, the frequencies at the corners of the path, the gaps, and the largest error bar."""
        from pipeline.planning.refinement import WidestBar

        count = len(self.points[0].frequencies_hz)
        bands = range(1, count + 1)
        head = ("label", "kx_per_m", "ky_per_m", *(f"band_{n}_{what}" for what in ("hz", "error") for n in bands))
        corners = [point for point in self.points if point.label]
        rows = [[p.label, p.kx_per_m, p.ky_per_m, *p.frequencies_hz, *(p.error or [None] * count)] for p in corners]
        yield f"{self.model}, {self.dof} degrees of freedom per wavevector"
        yield outputs.reading_table(head, rows)
        yield from (gap.text for gap in self.gaps)
        if not self.gaps:
            yield f"No complete gap {self.where_gaps_are_known}; raise bands.count to search higher"
        if self.has_pillar and self.bending_texts:
            yield f"bending of the pillars at M: {' and '.join(self.bending_texts)}"
        if losses := [q for p in self.points for q in p.quality_factor or () if q is not None]:
            ends = " to ".join(quantity.figure(pick(losses)) for pick in (min, max))
            yield f"quality factors by the loss of the materials: {ends}"
        if self.widest_bar:
            known = {name: self.widest_bar[name] for name in ("error", "of", "parts")}
            bar = WidestBar(**known)
            yield ONE_MESH if bar.error is None and self._is_by("mesh_file") else bar.text()

    def _is_by(self, option: str) -> bool:
        return bool(self.origin and self.origin.options.get(option))

    @property
    def has_pillar(self) -> bool:
        """Whether the cell has a pillar, as far as the result's origin is known; that of a mesh file is not."""
        if self._is_by("mesh_file"):
            return False
        known = self.origin.with_defaults if self.origin else None
        design = (known or {}).get("design") or {}
        return bool(design.get("pillar"))

    def details(self) -> Iterator[str]:
        """Yield the gaps for waves of one polarisation, and for those along one segment of the path."""
        yield from (each.text for each in (*(self.polarisation_gaps or ()), *(self.directional_gaps or ())))

    def draw(self, ax: Axes) -> None:
        """Draw the bands over the path, waves marked by polarisation where known, complete gaps shaded."""
        self.draw_bands(ax)
        if len(ax.get_legend_handles_labels()[1]) > 1:
            columns = max(1, min(LEGEND_COLUMNS, int(ax.figure.get_window_extent().width / ax.figure.dpi / LEGEND_IN)))
            ax.legend(fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=columns)

    def draw_bands(self, ax: Axes, label: str = "bands") -> None:
        """Draw the bands without a legend.

        Parameters
        ----------
        ax : Axes
            Axes to draw in.
        label : str, optional
            Label of the bands if their polarisations are unknown.
        """
        s, values = self.distance_per_m, self.frequencies_hz / KHZ
        if all(point.plate_polarisation for point in self.points):
            ax.plot(s, values, color="#C8C8C8", lw=0.7)
            self._draw_polarisations(ax, s, values)
        else:
            ax.plot(s, values, color=style.BLUE, lw=1.0, marker=".", ms=2.2)
            ax.lines[0].set_label(label)
        corners = [(x, NAMES.get(p.label, p.label)) for x, p in zip(s, self.points, strict=True) if p.label]
        ax.set_xticks([x for x, _ in corners], [name for _, name in corners])
        ax.grid(True, axis="x")
        span = s[-1] or 1.0  # a single point has none
        ax.set(xlim=(-0.02 * span, 1.02 * span), ylim=(0, 1.04 * values.max()))  # room for the markers at both ends
        ax.set(xlabel="wavevector along the path (to scale)", ylabel="frequency (kHz)")
        for gap in self.gaps:
            low, high = gap.lower_hz / KHZ, gap.upper_hz / KHZ
            ax.axhspan(low, high, color=style.ORANGE, alpha=0.3, lw=0)
            middle, text = (low + high) / 2, f"complete gap {gap.interval}"
            ax.text(0.5, middle, text, transform=ax.get_yaxis_transform(), bbox=WHITE, **LABEL)  # type: ignore[arg-type]

    def _draw_polarisations(self, ax: Axes, s: FloatArray, values: FloatArray) -> None:
        """Mark every wave by its polarisation, hollow where most of its kinetic energy is in the pillar."""
        plate, whole = (
            np.array([getattr(point, key) for point in self.points]) for key in ("plate_polarisation", "polarisation")
        )
        x, hollow = np.broadcast_to(s[:, None], values.shape), whole == PILLAR
        for name, (colour, marker, size) in MARKS.items():
            color = getattr(style, colour)
            for among, fill, label in ((~hollow, color, name), (hollow, "white", f"{name}, mostly in the pillar")):
                here = among & (plate == name)
                if here.any():
                    ax.plot(x[here], values[here], marker, color=color, mfc=fill, ms=size, mew=0.6, label=label)

    def __repr__(self) -> str:
        points, bands = self.frequencies_hz.shape
        gaps = several(len(self.gaps), "complete gap")
        return f"<antinode.Bands: {bands} bands at {points} wavevectors, {gaps}>"


def plan_of_cell(case: Case, step: Step) -> Plan:
    """Return the plan of a step that needs only the unit cell."""
    given = simplifications.no_patches(case.patches)
    return plans.plan_of(case, step, simplifications.no_plate_modes(), given, simplifications.no_figures())


def check_own_cell(case: Case, command: str) -> None:
    """Raise InputError for what a cell from a file cannot have: a solid model, and moduli over frequency."""
    design, where, said = case.design, case.source or case.name, []
    if case.solve.model == "solid" and (design.cell_file or design.attached):
        said.append(f"solve.model = 'solid': must be auto or superelement for {command} with [cell]")
    if design.cell_file and any(material.spectrum for material in case.materials) and case.solve.moduli_kHz is None:
        said.append(f"young_GPa_at: {command} with cell.file needs solve.moduli_kHz, at which moduli are taken")
    if said:
        raise InputError(f"{where}: {line}" for line in said)


class Bands(
    Question[BandsResult],
    needs=("plate", "array.pitch_mm"),
    pictures=("report.gallery.dispersion",),
    at_own_frequencies=True,
    honours=(*OF_A_PLATE, CELL, ATTACHED, OBLIQUE),
):
    """Compute Bloch bands and gaps of the unit cell along the case's path.

    >>> import antinode
    >>> plate = antinode.load("examples/small.toml", accuracy=0.1, bands__points=2, bands__count=4)
    >>> plate.bands().frequencies_hz.shape
    (7, 4)
    """

    def check(self, case: Case) -> None:
        """Raise InputError for a case without a unit cell, and for rows that differ or have no pillar."""
        super().check(case)
        case.require_one_kind("bands are")
        case.path(1)
        check_own_cell(case, "bands")
        if case.design.pillar is None and case.design.rows and not case.design.cell_file:
            raise InputError(f"{case.name}: array.rows = {case.design.rows}: must be 0 in a case without a [pillar]")

    @classmethod
    def spared(cls, case: Case) -> Simplification | None:
        return simplifications.no_lattice(case.design, "bands")

    @staticmethod
    def of_one_cell(case: Case) -> Case:
        """Return the case with the cell that is reduced."""
        from pipeline.planning.model_choice import by_vectors

        return by_vectors(case)

    def plan(self, case: Case) -> Plan:
        from pipeline.planning.mesh_rules import refinement_of
        from pipeline.planning.model_choice import SOLID, cell_model_choice

        case = self.of_one_cell(case)
        choice, query = cell_model_choice(case), case.bands
        wavevectors = query.segments * query.points + 1
        looks = f"{query.count} bands at {wavevectors} wavevectors of {query.path}"
        asked = {"count": query.count, "path": query.path, "grid": query.grid}
        numbers: dict[str, Any] = {"wavevectors": wavevectors, **asked}
        if choice.model != SOLID:
            factor = refinement_of(query.points)
            numbers["solved_wavevectors"] = query.segments * query.points * factor + 1
            looks += f", {numbers['solved_wavevectors']} solved to track branches" if factor > 1 else ""
        looks += f" and a grid of {query.grid} intervals" if query.grid else ""
        left_out = (*choice.left_out, simplifications.off_path(case.design, query.path, query.grid))
        demand = resource_estimate.of_bands(case, choice, numbers.get("solved_wavevectors", wavevectors))
        step = plans.step_of(self.name, "bands of the unit cell", choice, (), looks, left_out, numbers, demand)
        return plan_of_cell(case, step)

    def compute(self, case: Case, plan: Plan, run: Run) -> BandsResult:
        from pipeline.models.bands import solve_bands

        choice = plan.steps[0].choice
        assert choice
        solved = solve_bands(self.of_one_cell(case), choice, run, shapes=run.shapes, every_gap=run.detailed)
        run.meshes += solved.meshes
        run.arrays |= solved.shapes
        run.solved["lattice"] = solved.lattice
        return BandsResult.of_solved(solved)


class SupercellBands(
    Bands, Question[BandsResult], instead_of="bands", by="supercell",
    honours=(*OF_A_PLATE, DEFECTS, ATTACHED, OBLIQUE),
):  # fmt: skip
    """Compute Bloch bands and gaps of a supercell of the case's own cells, some of them changed by `[[defect]]`.

    >>> import antinode
    >>> plate = antinode.load("examples/small.toml", accuracy=0.1, bands__points=1, bands__count=4)
    >>> plate.supercell_bands("2x1").frequencies_hz.shape
    (5, 4)
    """

    supercell: str = option(
        default="", kw_only=False, metavar="NxM", help="cells along both lattice vectors, such as 3x1; see [[defect]]"
    )

    @property
    def size(self) -> tuple[int, int]:
        """Cells along both lattice vectors. Raises InputError for another text."""
        match = SUPERCELL.fullmatch(self.supercell)
        if not match:
            raise InputError(
                f"--supercell = {self.supercell!r}: must be two numbers of cells from 1 to 99, such as 3x1"
            )
        return int(match[1]), int(match[2])

    def check(self, case: Case) -> None:
        """Raise InputError for a case without a unit cell, and for a defect outside the supercell."""
        from pipeline.models.supercell import check_places

        super().check(case)
        check_places(case, self.size)

    @staticmethod
    def of_one_cell(case: Case) -> Case:
        """Return the case with a cell along the vectors of its lattice."""
        from pipeline.models.supercell import in_one_cell

        return in_one_cell(case)

    def compute(self, case: Case, plan: Plan, run: Run) -> BandsResult:
        from pipeline.models.supercell import solve_supercell_bands

        choice = plan.steps[0].choice
        assert choice
        return BandsResult.of_solved(solve_supercell_bands(case, choice, self.size, run))


class MeshBands(
    OfCellMeshes, Question[BandsResult], instead_of="bands", by="mesh_file", honours=(*OF_A_PLATE, GROUPS, OBLIQUE)
):
    """Compute Bloch bands and gaps of your own mesh of a unit cell, whose sides are tied along the case's lattice vectors.

    The mesh is unchanged: it is reduced to within 1e-6 where its sides are faces of bare plate, and solved whole otherwise. A
    second, finer or coarser, mesh of the cell gives error bars.

    >>> import antinode, meshio, tempfile
    >>> file, side = f"{tempfile.mkdtemp()}/cell.inp", 0.004
    >>> corners = [[side * x, side * y, side * z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    >>> meshio.write_points_cells(file, corners, [("hexahedron", [[*range(8)]])])
    >>> plate = antinode.Plate(material="steel", array={"pitch_mm": 4.0}, bands={"points": 1, "count": 3})
    >>> plate.mesh_bands(mesh_file=[file]).frequencies_hz.shape
    (4, 3)
    """

    def check(self, case: Case) -> None:
        """Raise InputError for a case without a lattice, for more than two files and for a missing one."""
        case.require("array.pitch_mm", command="bands --mesh-file")
        case.require_one_kind("bands are")
        case.path(1)
        self.check_files()

    def plan(self, case: Case) -> Plan:
        why = ("your own mesh is unchanged; it is reduced where its sides are faces of bare plate",)
        step = plans.Step(self.name, "bands of the mesh", "solid", " and ".join(self.mesh_file), (), "", why)
        return plans.plan_of(case, step)

    def compute(self, case: Case, plan: Plan, run: Run) -> BandsResult:
        from pipeline.models.own_cell import solve_own_bands

        solved = solve_own_bands(case, self.files, run)
        run.meshes += solved.meshes
        return BandsResult.of_solved(solved)
