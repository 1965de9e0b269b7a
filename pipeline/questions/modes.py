"""Modes of the plate, the isolated zone, the isolated pillar or a user's mesh, and the target mode among them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, overload

from pipeline.case.features import GROUPS, LARGER, OF_ROWS, OUTLINE, PLACES, STRESS, SUPPORTS, ZONES
from pipeline.case.limits import MAX_MODES
from pipeline.errors import InputError
from pipeline.models.answer_parts import ALONG, CountRecord, ModeRecord, TargetMode, TargetRecord, ZoneTarget
from pipeline.quantity import (
    HZ,
    KHZ,
    MM,
    frequency,
    frequency_figure,
    frequency_with_bar,
    interval,
    level_with_bar,
    several,
    signed,
    with_bar,
)
from pipeline.questions.late import (
    Axes,
    Case,
    Plan,
    Simplification,
    confinement,
    fields,
    np,
    outputs,
    plans,
    simplifications,
    style,
)
from pipeline.questions.question import Pair, Question, Run, Unanswered, hz, option
from pipeline.questions.result import Result, figure, figure_at, stacked
from pipeline.records.part import column, live

if TYPE_CHECKING:
    from pipeline.models.modes import PartModes
    from pipeline.planning.model_choice import Request

Part = Literal["plate", "zone", "pillar"]
Class = Literal["SS", "SA", "AS", "AA"]
NEEDED = {"plate": ("plate", "zone"), "zone": ("plate", "zone"), "pillar": ("pillar",)}
BAND = "every mode between two frequencies"
NEAR = "modes nearest to a frequency"
PRINTED = 24  # modes in the printed table, around the target mode
SHAPES = 4  # modes nearest the target mode in a record, which a page draws and animates
DRAWN = 0.12  # largest displacement of a body as drawn, relative to its size
UNGRADED: dict[str, Any] = {"graded": (), "graded_pitches_m": ()}
COUNT = "number of modes, nearest to --near or the lowest"


class ModesResult(Result, Sequence[ModeRecord], table="modes", axes=("mode",)):
    """Modes in ascending order, proven complete by an inertia count; a sequence of modes, arrays of shape (modes,).

    >>> import antinode
    >>> pillar = antinode.load("examples/small.toml", accuracy=0.02).modes(part="pillar", count=2)
    >>> len(pillar), round(pillar[0].frequency_hz, -2)
    (2, 39100.0)
    """

    moves = "report.shapes.modes_in_frame"

    model: str = column("model of the part and its element order, such as superelement hex3")
    part: str = column("plate, zone, pillar, or mesh for a mesh file")
    dof: int = column("degrees of freedom that were solved for")
    rigid_count: int = column("number of rigid-body modes, which are not listed")
    modes: list[ModeRecord] = column("the modes")
    count_check: CountRecord = column("inertia count compared with the number of modes found")
    target: TargetMode | TargetRecord | None = column(
        "target mode; None for a part or symmetry class that has none", default=None
    )
    without_supports: TargetMode | TargetRecord | None = column(
        "target mode of the same plate without its supports: what the mount costs; None for a plate without supports",
        default=None,
    )
    other_zones: list[ZoneTarget] = column(
        "target modes of the zones after the first, if there are several on a larger plate", default_factory=list
    )
    reduction_error: float | None = column(
        "largest truncation error, relative; None for a body that was not reduced", default=None
    )
    expected_error: float | None = column(
        "largest discretisation error bar, relative; None without an estimate", default=None
    )
    error_bar: dict[str, float | None] | None = column(
        "error bars of the target mode (half-widths): frequency, relative, and confinement_db", default=None
    )
    widest_bar: dict[str, Any] | None = column(
        "largest error bar of a frequency: error (relative), of (which mode), parts (mesh, truncation and more), largest_part",
        default=None,
    )
    solved: Any = live("solved model; None if read from a file")
    case: Any = live("case of the solved model; None if read from a file")

    target_status = figure_at("target.status", "target mode: single, split or none", None)
    target_hz = figure_at("found.frequency_hz", "target mode", "Hz")
    target_error = figure_at("found.frequency_error", "expected error of the target mode", "%")
    confinement_db = figure_at("found.confinement_db", "confinement", "dB")
    confinement_error_db = figure_at(
        "found.confinement_error_db", "expected error of the confinement", "dB", error="found.confinement_error_db"
    )
    zone_to_extension_db = figure_at("found.extension_db", "zone to margin", "dB")
    mac = figure_at("found.mac", "MAC")
    zone_share = figure_at("found.zone_share", "zone fraction")
    pillar_share = figure_at("found.pillar_energy_share", "fraction of energy in the pillars")
    strength = figure_at("found.strength", "effective-mass fraction in the target shape")
    shape_share = figure_at("found.share", "fraction of the target shape")

    @figure("other modes with the target shape", None)
    def rivals(self) -> str | None:
        """Frequencies of other modes with as large a part of the target shape."""
        known = self.found.rivals if self.found else []
        return "; ".join(f"{frequency_figure(each.frequency_hz, each.error, HZ)} Hz" for each in known) or None

    unsupported_hz = figure_at("without_supports.frequency_hz", "target mode without supports", "Hz")
    unsupported_db = figure_at("without_supports.confinement_db", "confinement without supports", "dB")

    @figure("inertia count", None, name="count_check")
    def counted(self) -> str:
        """Whether the inertia count agrees with the modes found."""
        check = self.count_check
        return "holds" if check.holds else f"{check.found} of {check.expected}"

    @property
    def found(self) -> TargetMode | None:
        """Target mode; None if there is none or the question does not look for one."""
        return self.target if isinstance(self.target, TargetMode) else None

    @classmethod
    def of_solved(cls, solved: PartModes, case: Case, free: PartModes | None = None) -> ModesResult:
        """Return the result of solved modes.

        Parameters
        ----------
        solved : PartModes
            Modes of the part with their measures and error bars.
        case : Case
            The case that was solved.
        free : PartModes, optional
            Target mode of the plate without its supports.

        Returns
        -------
        ModesResult
            The result.
        """
        from pipeline.models.mode_fields import closed_surface
        from pipeline.models.modes import of_other_zones
        from pipeline.models.target import widest_bar

        modes = [
            ModeRecord.of(row, surface=partial(closed_surface, solved, case, place))
            for place, row in enumerate(solved.rows)
        ]
        bar, row, shape = None, solved.target_row, ALONG[case.design.held_ends if solved.part == "plate" else 0]
        own, loose = solved.target_part(), free.target_part() if free else None
        if row and solved.errors is not None:
            bar = {"frequency": row.error, "confinement_db": row.confinement_error_db}
        return cls(
            model=solved.model.name, part=solved.part, dof=solved.dof, rigid_count=solved.rigid_count, modes=modes,
            count_check=solved.count_check, target=own and replace(own, shape=shape), reduction_error=solved.reduction_error,
            expected_error=solved.expected_error, error_bar=bar,
            widest_bar=widest_bar(solved.rows).to_dict(), solved=solved, case=case,
            without_supports=loose and replace(loose, index=None, shape=shape), other_zones=of_other_zones(case, solved),
        )  # fmt: skip

    # -- a sequence of modes

    @overload
    def __getitem__(self, index: int) -> ModeRecord: ...
    @overload
    def __getitem__(self, index: slice) -> list[ModeRecord]: ...
    def __getitem__(self, index: int | slice) -> ModeRecord | list[ModeRecord]:
        return self.modes[index]

    def __len__(self) -> int:
        return len(self.modes)

    def __iter__(self) -> Iterator[ModeRecord]:
        return iter(self.modes)

    def __bool__(self) -> bool:
        return True  # an answer, whether a mode was found or not

    frequency_hz = stacked("frequency_hz", "Frequencies (modes,) in Hz.")
    error = stacked("error", "Relative error bar of each frequency (modes,), half-width; NaN without an estimate.")

    def to_pyvista(self, mode: int | ModeRecord | None = None) -> Any:
        """Return the closed outer surface of the whole body with a mode's displacement.

        Parameters
        ----------
        mode : int or Mode, optional
            Index from 0, or the mode itself; the target mode by default.

        Returns
        -------
        pyvista.PolyData
            Surface in m; its array `displacement` (points, 3) has unit modal mass.

        Raises
        ------
        ValueError
            If no mode is the target mode, and for modes that were read from a file.
        """
        if mode is None:
            at = self._target_at
            if at is None:
                raise ValueError("none of these modes is the target mode: give the number of a mode")
            mode = at
        return (self.modes[mode] if isinstance(mode, int) else mode).to_pyvista()

    # -- words and pictures

    @property
    def _marked(self) -> list[int]:
        at = self.target.frequency_hz if self.target else None
        return [place for place, mode in enumerate(self.modes) if at is not None and mode.frequency_hz == at]

    def _read(self) -> tuple[list[str], list[list[Any]]]:
        """Return the head and the rows of the printed table."""
        unread = ("mode", "parity", "computed_hz")
        rows = [{key: value for key, value in row.items() if key not in unread} for row in self.to_rows()]
        head = tuple(rows[0]) if rows else ("frequency_hz", "error", "symmetry")
        return outputs.filled(head, [[*row.values()] for row in rows])

    def lines(self) -> Iterator[str]:
        """Yield the model, the modes with the target mode marked, the largest error bar, target mode and count."""
        from pipeline.models.modes import target_lines
        from pipeline.planning.refinement import WidestBar

        yield f"{self.model}, {self.dof} degrees of freedom, {several(self.rigid_count, 'rigid-body mode')}"
        head, rows = self._read()
        marked = self._marked
        if len(rows) > PRINTED:
            centre = marked[0] if marked else 0
            first = max(0, min(centre - PRINTED // 2, len(rows) - PRINTED))
            above, below = first, len(rows) - PRINTED - first
            rows = rows[first : first + PRINTED]
            marked = [place - first for place in marked if 0 <= place - first < PRINTED]
            yield f"{several(above, 'mode')} below and {below} above these: --csv and --json list all"
        yield outputs.reading_table(head, rows, marked)
        if self.widest_bar:
            yield WidestBar(**{name: self.widest_bar[name] for name in ("error", "of", "parts")}).text()
        if self.solved:
            yield from target_lines(self.solved, self.case.design)
        yield from map(_in_words, self.other_zones)
        yield from self._mounted()

    def _mounted(self) -> Iterator[str]:
        """Yield the target mode without the supports, and the change by them."""
        free, own = self.without_supports, self.found
        if free is None:
            return
        if not isinstance(free, TargetMode):
            yield "without the supports no mode has the target shape"
            return
        text, cost = f"without the supports: {frequency_with_bar(free.frequency_hz, free.frequency_error)}", ""
        if own is not None:
            both = hypot(*((each.frequency_error or 0.0) * each.frequency_hz for each in (own, free)))
            shift = with_bar(own.frequency_hz - free.frequency_hz, both or None, "Hz")
            cost = f"; the supports shift it by {signed(shift)}"
        if free.confinement_db is not None:
            text += f", {level_with_bar(free.confinement_db, free.confinement_error_db)}"
            if own is not None and own.confinement_db is not None:
                gained = own.confinement_db - free.confinement_db
                both = hypot(*(each.confinement_error_db or 0.0 for each in (own, free)))
                cost += f" and change its confinement by {signed(level_with_bar(gained, both or None))}"
        yield text + cost

    def draw(self, ax: Axes) -> None:
        """Draw the confinement of each mode over frequency, target mode marked; without one, only frequencies."""
        khz, level = self.frequency_hz / KHZ, self.array("confinement_db")
        if not np.isfinite(level).any():
            ax.plot(np.arange(1, len(khz) + 1), khz, "o", color=style.BLUE, ms=4)
            ax.plot([place + 1 for place in self._marked], khz[self._marked], "*", color=style.VERMILION, ms=11)
            ax.set(xlabel="mode", ylabel="frequency (kHz)")
            ax.locator_params(axis="x", integer=True)
            return
        ax.plot(khz, level, "o", color=style.BLUE, ms=4)
        least = confinement.CONFINED_DB
        ax.axhline(least, color=style.GREEN, lw=0.9, ls="--", label=f"confined from {least:g} dB")
        target = self.target
        if target and target.frequency_hz is not None and target.confinement_db is not None:
            at = target.frequency_hz / KHZ, target.confinement_db
            ax.plot(*at, "*", color=style.VERMILION, ms=11, label=f"target mode ({target.status})")
        ax.legend(handlelength=1.2, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
        ax.set(xlabel="frequency (kHz)", ylabel="confinement (dB)")

    @property
    def _target_at(self) -> int | None:
        return self.target.index if self.target else None

    @property
    def has_shape(self) -> bool:
        """Whether a shape is known: the target mode of a plate, or any mode of another part."""
        return self.solved is not None and len(self) > 0 and (self.part != "plate" or self._target_at is not None)

    def illustrate(self, ax: Axes) -> None:
        """Draw the target mode of plate or zone on the touch face; of another part its body, or those of the first modes."""
        from pipeline.models.mode_fields import whole_skin
        from pipeline.records.record import DesignRecord
        from pipeline.records.surface_codec import touch_arrays

        at = self._target_at
        shown = range(min(len(self), SHAPES)) if at is None else [at]
        skins = [whole_skin(self.solved, place) for place in shown]
        captions = [frequency(self.modes[place].frequency_hz) for place in shown]
        if at is None or self.part not in ("plate", "zone"):
            fields.draw_bodies(ax, skins, captions, DRAWN * float(np.ptp(skins[0].points, axis=0).max()))
            return
        design = self.case.design
        alone = design if self.part == "plate" else replace(design.zone_alone, rows=0, extension_m=0.0, **UNGRADED)
        fields.draw_touch(ax, touch_arrays(skins), DesignRecord.of_design(alone))
        ax.set_title(f"Target mode, {captions[0]}")

    def fields(self) -> dict[str, Any]:
        """Return the field of every mode, as `--save-all-fields` writes it into fields.npz.

        Returns
        -------
        dict
            Points (p, 3) in m, facets, frequencies (k,) in Hz, symmetry classes (k,) and displacements (k, p, 3).
        """
        from pipeline.models.mode_fields import full_fields

        return full_fields(self.solved)

    def _repr_html_(self) -> str:
        return super()._repr_html_() + outputs.html_table(*self._read(), self._marked)

    def __repr__(self) -> str:
        ends = [(mode.frequency_hz, mode.error) for mode in (self[0], self[-1])] if len(self) else []
        span = f", {interval(*(at for at, _ in ends), *(error for _, error in ends))}" if ends else ""
        return f"<antinode.Modes of the {self.part}: {len(self)}{span}>"


def _in_words(zone: ZoneTarget) -> str:
    x, y = (place / MM for place in zone.centre_m)
    where, found = f"zone {zone.zone} at ({x:g}, {y:g}) mm: ", zone.target
    return f"{where}{found}"


class Modes(
    Question[ModesResult],
    example="modes studies/three-rows.toml --part zone --count 14",
    at_own_frequencies=True,
    honours=(LARGER, PLACES, OUTLINE, SUPPORTS, STRESS),
    aliases=("confinement",),
    pictures=("plots.rendering.report_figures", "plots.fields.touch_face", "plots.fields.neighbours"),
):
    """Compute the modes of plate, zone or pillar in a band, or some of them near a frequency.

    >>> import antinode
    >>> antinode.load("examples/small.toml", accuracy=0.1).modes(part="pillar", count=2).frequency_hz.shape
    (2,)
    """

    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, kw_only=False, help=BAND)
    part: Part = option(default="plate", kw_only=False, help="part to solve")
    near_kHz: float | None = option(default=None, unit="kHz", at_least=0.0, help=NEAR)
    count: int | None = option(default=None, at_least=1, at_most=MAX_MODES, help=COUNT)
    symmetry: Class | None = option(
        default=None,
        help="one symmetry class: u_z symmetric (S) or antisymmetric (A), in x then in y",
    )

    def asked_of(self, case: Case) -> Case:
        """Return the case of the part: its zone ends free, also where the plate goes on."""
        return replace(case, design=case.design.zone_alone) if self.part == "zone" else case

    def honoured(self) -> tuple[str, ...]:
        """Return what the part honours: a zone or a pillar alone has nothing of the plate."""
        return self.honours if self.part == "plate" else OF_ROWS

    def check(self, case: Case) -> None:
        """Raise InputError for a case that lacks the part, and for a band together with a frequency."""
        _check_window(self.near_kHz, self.band_kHz)
        if self.part == "plate":
            case.require_plate("modes --part plate")
        else:
            case.require(*NEEDED[self.part], command=f"modes --part {self.part}")

    @classmethod
    def in_study(cls) -> Modes:
        """Return the question with the window of the target mode within that of the case."""
        return _InStudies()

    def request(self, case: Case) -> Request:
        """Return the requested window in Hz."""
        return _request(self.part, self.band_kHz, self.near_kHz, self.count, self.symmetry)

    def plan(self, case: Case) -> Plan:
        whole = (simplifications.no_patches(case.patches), simplifications.no_response())
        step = plans.modes_step(case, self.request(case))
        unpatched = simplifications.no_patches(case.patches) if case.patches and self.part == "plate" else None
        return plans.plan_of(
            case, replace(step, left_out=(*step.left_out, *([unpatched] if unpatched else []))), *whole
        )

    def compute(self, case: Case, plan: Plan, run: Run) -> ModesResult:
        from pipeline.models.modes import solve_modes, without_supports

        request = self.request(case)
        solved = solve_modes(case, request, run, plan.steps[0].choice)
        return _answered(solved, case, run, without_supports(case, request, solved, run))


# -- in studies --------------------------------------------------------------------------------------------------------


class _InStudies(Modes):
    """Modes of the plate in the case's window and in that of the target mode, in its symmetry class."""

    def request(self, case: Case) -> Request:
        """Return the requested window in Hz."""
        from pipeline.planning.model_choice import of_case

        return of_case(case)

    def plan(self, case: Case) -> Plan:
        return plans.plan_of(case, plans.modes_step(case, self.request(case)))

    def compute(self, case: Case, plan: Plan, run: Run) -> ModesResult:
        """Compute the modes and keep the data that other questions use."""
        from pipeline.models.modes import solve_modes, without_supports
        from pipeline.models.target import warn_of_target

        solved = solve_modes(case, self.request(case), run, plan.steps[0].choice).whole_window
        run.meshes += solved.meshes
        run.solved["modes"] = solved
        assert solved.target
        warn_of_target(solved.target, case, run.log)
        return ModesResult.of_solved(solved, case, without_supports(case, self.request(case), solved, run))


class ShapesResult(Result, axes=("shape",)):
    """Shapes of the modes closest to the target shape: coefficients of u_z on the active face."""

    target: int = column("row of the target mode", table=False)
    frequency_hz: list[float] = column("frequency", "Hz", along="shape")
    share: list[float] = column("fraction of the motion on the active face", along="shape")
    coefficients: list[list[float]] = column("coefficients of u_z", along=("shape", "function"))


class Shapes(Question[ShapesResult], follows="modes"):
    """Keep the shapes of the modes nearest the target mode, its mode table and, on demand, the field of every mode."""

    def compute(self, case: Case, plan: Plan, run: Run) -> ShapesResult:
        """Describe the shapes; write mode_table.bin, mode_table.h and fields.npz into the case's folder."""
        from pipeline.board.export import write_table
        from pipeline.models import mode_fields
        from pipeline.records import store

        solved: PartModes = run.solved["modes"]
        assert run.folder
        if run.all_fields:
            with run.step("fields of all modes"):
                store.save_arrays(run.folder, mode_fields.full_fields(solved), store.FIELDS)
        index = solved.index(solved.target_row)
        if index is None:
            raise Unanswered
        with run.step("fields"):
            run.arrays |= mode_fields.kept_arrays(solved, mode_fields.nearest_rows(solved, index)[:SHAPES])
        try:
            write_table(case, solved, index, run.folder)
        except InputError as error:
            run.log.warning("TABLE", error.lines[0])
        return ShapesResult(**mode_fields.shapes(solved, case.design))


class ZoneModes(
    Question[ModesResult],
    in_studies_only=True,
    aliases=("parts",),
    at_own_frequencies=True,
    honours=OF_ROWS,
):
    """Compute the modes of the isolated zone, to compare with the pre-design."""

    asked: ClassVar[dict[str, Any]] = {"part": "zone"}

    def plan(self, case: Case) -> Plan:
        alone = replace(case, design=case.design.zone_alone)
        return plans.plan_of(case, replace(plans.modes_step(alone, _request(**self.asked)), measure=self.name))

    def compute(self, case: Case, plan: Plan, run: Run) -> ModesResult:
        from pipeline.models.modes import solve_modes

        alone = replace(case, design=case.design.zone_alone)
        solved = solve_modes(alone, _request(**self.asked), run, plan.steps[0].choice)
        run.meshes += solved.meshes
        return ModesResult.of_solved(solved, case)


class PillarModes(ZoneModes, Question[ModesResult]):
    """Compute the modes of the isolated pillar, to compare with the pre-design."""

    asked: ClassVar[dict[str, Any]] = {"part": "pillar", "near_kHz": 0.0, "count": 4}

    @classmethod
    def spared(cls, case: Case) -> Simplification | None:
        return simplifications.no_lone_pillar(case.design)


# -- of a mesh file ----------------------------------------------------------------------------------------------------


class MeshModes(Question[ModesResult], instead_of="modes", by="mesh_file", honours=(ZONES, LARGER, GROUPS)):
    """Compute the modes of your own mesh with the material of the case.

    The mesh is solved whole and unchanged, in Hz and dB; the group TOUCH, if present, is the face that is evaluated.

    >>> import antinode, meshio, tempfile
    >>> file, side = f"{tempfile.mkdtemp()}/block.inp", 0.01
    >>> corners = [[side * x, side * y, side * z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    >>> meshio.write_points_cells(file, corners, [("hexahedron", [[*range(8)]])])
    >>> antinode.load("examples/small.toml").mesh_modes(file, count=1).rigid_count
    6
    """

    mesh_file: str = option(
        default="", kw_only=False, metavar="FILE", help="mesh to solve instead of a part: .med, .msh or .inp"
    )
    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, help=BAND)
    near_kHz: float | None = option(default=None, unit="kHz", at_least=0.0, help=NEAR)
    count: int | None = option(default=None, at_least=1, at_most=MAX_MODES, help=COUNT)
    unit: Literal["m", "mm"] | None = option(default=None, help="length unit of the mesh file (default: m)")
    merge: float | None = option(
        default=None, at_least=0.0, metavar="D",
        help="merge nodes closer than this, in the unit of the file (0: keep touching bodies separate)",
    )  # fmt: skip
    clamp: tuple[str, ...] = option(default=(), metavar="NAME", help="group of faces or nodes of the mesh file to fix")
    support: tuple[str, ...] = option(
        default=(), metavar="NAME:AXES",
        help="group to fix along some axes only, as on a mirror plane: RIM:z, CUT:x",
    )  # fmt: skip

    def check(self, case: Case) -> None:
        """Raise InputError for a band together with a frequency, and for a missing file."""
        _check_window(self.near_kHz, self.band_kHz)
        check_mesh_files([self.mesh_file])

    def plan(self, case: Case) -> Plan:
        why = ("your own mesh is solved whole and unchanged",)
        return plans.plan_of(case, plans.Step(self.name, "modes of the mesh", "solid", self.mesh_file, (), "", why))

    def compute(self, case: Case, plan: Plan, run: Run) -> ModesResult:
        from pipeline.models.user_mesh import UserMesh, solve

        mesh = UserMesh(self.mesh_file, self.unit or "m", self.clamp, self.support, self.merge)
        query = _request("plate", self.band_kHz, self.near_kHz, self.count)
        return _answered(solve(case, mesh, query, run), case, run)


def check_mesh_files(files: Iterable[str]) -> None:
    """Raise InputError for a mesh file that does not exist, with the nearest one that does."""
    from pipeline.case.reading import nearest_file

    for file in files:
        if not Path(file).exists():
            raise InputError(f"{file}: no such mesh file{nearest_file(Path(file).absolute())}")


def _check_window(near_kHz: float | None, band_kHz: Pair | None) -> None:
    if near_kHz is not None and band_kHz is not None:
        without = "cannot be combined with --band, which returns every mode between its ends: remove one of them"
        raise InputError(f"--near = {near_kHz:g}kHz: {without}")


def _request(
    part: str, band_kHz: Pair | None = None, near_kHz: float | None = None, count: int | None = None,
    symmetry: str | None = None,
) -> Request:  # fmt: skip
    from pipeline.planning.model_choice import Request

    return Request(part, hz(band_kHz), None if near_kHz is None else KHZ * near_kHz, count, symmetry)


def _answered(solved: PartModes, case: Case, run: Run, free: PartModes | None = None) -> ModesResult:
    from pipeline.models.target import widest_bar

    run.meshes += solved.meshes
    widest_bar(solved.rows).warn(case, run)
    return ModesResult.of_solved(solved, case, free)
