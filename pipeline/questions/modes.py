"""Modes of the plate, of the bare zone, of the lone pillar, or of a mesh of one's own, and the wanted one among them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, overload

from pipeline.case.limits import MAX_MODES
from pipeline.errors import InputError
from pipeline.models.mode_parts import CountRecord, ModeRecord, WantedMode, WantedRecord
from pipeline.questions.question import Pair, Question, Run, hz, option
from pipeline.questions.result import Result
from pipeline.records.part import column, live
from pipeline.units import KHZ

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from geometry.elements import FloatArray
    from pipeline.case.model import Case
    from pipeline.models.modes import PartModes
    from pipeline.planning.plan import Plan
    from pipeline.planning.request import Request

Part = Literal["plate", "zone", "pillar"]
Class = Literal["SS", "SA", "AS", "AA"]
NEEDED = {"plate": ("plate", "zone"), "zone": ("plate", "zone"), "pillar": ("pillar",)}
BAND = "every mode between two frequencies"
NEAR = "modes nearest to a frequency"
COUNT = "how many, nearest to that frequency or the lowest"


class ModesResult(Result, Sequence[ModeRecord], table="modes", axes=("mode",)):
    """Modes in ascending order, proven complete by a count; a sequence of modes, arrays of shape (modes,).

    >>> import antinode
    >>> pillar = antinode.load("examples/small.toml", accuracy=0.02).modes(part="pillar", count=2)
    >>> len(pillar), round(pillar[0].frequency_hz, -2)
    (2, 39100.0)
    """

    model: str = column("model of the part and its element order, such as superelement hex3")
    part: str = column("plate, zone, pillar, or mesh for a mesh file")
    dof: int = column("degrees of freedom that were solved for")
    rigid_count: int = column("rigid-body modes, which are counted and not listed")
    modes: list[ModeRecord] = column("the modes")
    count_check: CountRecord = column("the count by inertia beside what was found")
    wanted: WantedMode | WantedRecord | None = column(
        "the wanted mode; None for a part or symmetry class that has none", default=None
    )
    reduction_error: float | None = column(
        "largest error by the reduction, relative; None for a body that was not reduced", default=None
    )
    expected_error: float | None = column(
        "widest error bar by the mesh alone, relative; None without an estimate", default=None
    )
    error_bar: dict[str, float | None] | None = column(
        "half-widths of the wanted mode's bars: frequency, relative, and confinement_db", default=None
    )
    widest_bar: dict[str, Any] | None = column(
        "widest error bar of a frequency: error (relative), of (which mode), parts (mesh, truncation) and largest_part",
        default=None,
    )
    solved: Any = live()
    case: Any = live()

    @classmethod
    def of_solved(cls, solved: PartModes, case: Case) -> ModesResult:
        """Return the result of solved modes."""
        from pipeline.models.mode_fields import closed_surface
        from pipeline.models.mode_rows import widest_bar

        modes = [
            ModeRecord.of(row, surface=partial(closed_surface, solved, case, place))
            for place, row in enumerate(solved.rows)
        ]
        return cls(
            model=solved.model.name, part=solved.part, dof=solved.dof, rigid_count=solved.rigid_count, modes=modes,
            count_check=solved.count_check, wanted=solved.wanted_part(), reduction_error=solved.reduction_error,
            expected_error=solved.expected_error, error_bar=solved.bar.to_dict() if solved.bar else None,
            widest_bar=widest_bar(solved.rows).to_dict(), solved=solved, case=case,
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

    @property
    def frequency_hz(self) -> FloatArray:
        """Frequencies (modes,) in Hz."""
        return self.array("frequency_hz")

    @property
    def error(self) -> FloatArray:
        """Half-width of each frequency's error bar (modes,), relative; NaN without an estimate."""
        return self.array("error")

    def to_pyvista(self, mode: int | ModeRecord | None = None) -> Any:
        """Return the closed surface of a mode, by its index from 0 or itself; None: of the wanted mode.

        Raises ValueError where no mode is the wanted one, and for modes that were read from a file.
        """
        if mode is None:
            at = self.wanted.index if self.wanted else None
            if at is None:
                raise ValueError("none of these modes is the wanted one: name a mode by its number")
            mode = at
        return (self.modes[mode] if isinstance(mode, int) else mode).to_pyvista()

    # -- words and pictures

    @property
    def _marked(self) -> list[int]:
        at = self.wanted.frequency_hz if self.wanted else None
        return [place for place, mode in enumerate(self.modes) if at is not None and mode.frequency_hz == at]

    def _read(self) -> tuple[list[str], list[list[Any]]]:
        """Return the head and the rows that people read."""
        from pipeline.records.reading import filled

        unread = ("mode", "parity", "computed_hz")
        rows = [{key: value for key, value in row.items() if key not in unread} for row in self.to_rows()]
        head = tuple(rows[0]) if rows else ("frequency_hz", "error", "symmetry")
        return filled(head, [[*row.values()] for row in rows])

    def lines(self) -> Iterator[str]:
        """Yield the model, the modes with the wanted one marked, the widest error bar, the wanted mode and the count."""
        from pipeline.models import wanted_text
        from pipeline.planning.error_bar import WidestBar
        from pipeline.records.reading import reading_table

        plural = "s" * (self.rigid_count != 1)
        yield f"{self.model}, {self.dof} degrees of freedom, {self.rigid_count} rigid-body mode{plural}"
        yield reading_table(*self._read(), self._marked)
        if self.widest_bar:
            yield WidestBar(**{name: self.widest_bar[name] for name in ("error", "of", "parts")}).text()
        if self.solved:
            yield from wanted_text.lines(self.solved, self.case.design)

    def draw(self, ax: Axes) -> None:
        """Draw the confinement of each mode over its frequency, the wanted mode marked; without one, frequencies alone."""
        import numpy as np

        from pipeline.plots import style
        from solvers.measures.levels import CONFINED_DB

        khz, level = self.frequency_hz / KHZ, self.array("confinement_db")
        if not np.isfinite(level).any():
            ax.plot(np.arange(1, len(khz) + 1), khz, "o", color=style.BLUE, ms=4)
            ax.set(xlabel="mode", ylabel="frequency (kHz)")
            return
        ax.plot(khz, level, "o", color=style.BLUE, ms=4)
        ax.axhline(CONFINED_DB, color=style.GREEN, lw=0.9, ls="--", label=f"confined from {CONFINED_DB:g} dB")
        wanted = self.wanted
        if wanted and wanted.frequency_hz is not None and wanted.confinement_db is not None:
            at = wanted.frequency_hz / KHZ, wanted.confinement_db
            ax.plot(*at, "*", color=style.VERMILION, ms=11, label=f"wanted mode ({wanted.status})")
        ax.legend()
        ax.set(xlabel="frequency (kHz)", ylabel="confinement (dB)")

    def fields(self) -> dict[str, Any]:
        """Return the field of every mode, as --save-all-fields writes it into fields.npz."""
        from pipeline.models.mode_fields import full_fields

        return full_fields(self.solved)

    def _repr_html_(self) -> str:
        from pipeline.records.frames import html_table

        return super()._repr_html_() + html_table(*self._read(), self._marked)

    def __repr__(self) -> str:
        from pipeline.quantity import interval

        ends = [(mode.frequency_hz, mode.error) for mode in (self[0], self[-1])] if len(self) else []
        span = f", {interval(*(at for at, _ in ends), *(error for _, error in ends))}" if ends else ""
        return f"<antinode.Modes of the {self.part}: {len(self)}{span}>"


class Modes(Question[ModesResult], example="modes studies/three-rows.toml --part zone --count 14"):
    """Compute the modes of plate, zone or pillar in a band, or some of them near a frequency.

    >>> import antinode
    >>> antinode.load("examples/small.toml", accuracy=0.1).modes(part="pillar", count=2).frequency_hz.shape
    (2,)
    """

    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, kw_only=False, help=BAND)
    part: Part = option(default="plate", kw_only=False, help="which part")
    near_kHz: float | None = option(default=None, unit="kHz", at_least=0.0, help=NEAR)
    count: int | None = option(default=None, at_least=1, at_most=MAX_MODES, help=COUNT)
    symmetry: Class | None = option(
        default=None,
        help="one symmetry class: u_z symmetric (S) or antisymmetric (A), in x then in y",
    )

    def check(self, case: Case) -> None:
        """Raise InputError for a case that lacks the part, and for a band beside a frequency."""
        _check_window(self.near_kHz, self.band_kHz)
        if self.part == "plate":
            case.require_plate(command="modes --part plate")
        else:
            case.require(*NEEDED[self.part], command=f"modes --part {self.part}")

    def request(self) -> Request:
        """Return what is asked for, in Hz."""
        return _request(self.part, self.band_kHz, self.near_kHz, self.count, self.symmetry)

    def plan(self, case: Case) -> Plan:
        """Plan the modes of the part."""
        from pipeline.planning import simplifications
        from pipeline.planning.plan import modes_step, plan_of

        whole = (simplifications.no_patches(case.patches), simplifications.no_response())
        step = modes_step(case, self.request())
        unpatched = simplifications.no_patches(case.patches) if case.patches and self.part == "plate" else None
        return plan_of(case, replace(step, left_out=(*step.left_out, *([unpatched] if unpatched else []))), *whole)

    def compute(self, case: Case, plan: Plan, run: Run) -> ModesResult:
        """Compute the modes, their count, and the wanted one among them."""
        from pipeline.models.modes import solve_modes

        return _answered(solve_modes(case, self.request(), run, plan.steps[0].choice), case, run)


class MeshModes(Question[ModesResult], instead_of="modes", by="mesh_file"):
    """Compute the modes of a mesh of one's own with the case's material.

    The mesh is solved whole as it is, in Hz and dB; a group TOUCH is the face that is measured.

    >>> import antinode, meshio, tempfile
    >>> file, side = f"{tempfile.mkdtemp()}/block.inp", 0.01
    >>> corners = [[side * x, side * y, side * z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    >>> meshio.write_points_cells(file, corners, [("hexahedron", [[*range(8)]])])
    >>> antinode.load("examples/small.toml").mesh_modes(file, count=1).rigid_count
    6
    """

    mesh_file: str = option(
        default="", kw_only=False, metavar="FILE", help="solve this mesh instead of a part: .med, .msh or .inp"
    )
    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, help=BAND)
    near_kHz: float | None = option(default=None, unit="kHz", at_least=0.0, help=NEAR)
    count: int | None = option(default=None, at_least=1, at_most=MAX_MODES, help=COUNT)
    unit: Literal["m", "mm"] | None = option(default=None, help="length unit of the mesh file (default: m)")
    merge: float | None = option(
        default=None, at_least=0.0, metavar="D",
        help="make one node of nodes closer than this, in the file's unit (0: leave bodies that touch apart)",
    )  # fmt: skip
    clamp: tuple[str, ...] = option(
        default=(), metavar="NAME", help="fix this group of faces or nodes of the mesh file"
    )
    support: tuple[str, ...] = option(
        default=(), metavar="NAME:AXES",
        help="support such a group along some axes only, as on a mirror plane: RIM:z, CUT:x",
    )  # fmt: skip

    def check(self, case: Case) -> None:
        """Raise InputError for a band beside a frequency, and for a file that is not there."""
        from pathlib import Path

        from pipeline.case.diagnostics import nearest_file

        _check_window(self.near_kHz, self.band_kHz)
        if not Path(self.mesh_file).exists():
            raise InputError(f"{self.mesh_file}: no such mesh file{nearest_file(Path(self.mesh_file).absolute())}")

    def plan(self, case: Case) -> Plan:
        """Plan the mesh as it is."""
        from pipeline.planning.plan import Step, plan_of

        why = ("a mesh of one's own is solved whole as it is",)
        return plan_of(case, Step(self.name, "modes of the mesh", "solid", self.mesh_file, (), "", why))

    def compute(self, case: Case, plan: Plan, run: Run) -> ModesResult:
        """Solve the mesh."""
        from pipeline.models.user_mesh import UserMesh, solve

        mesh = UserMesh(self.mesh_file, self.unit or "m", self.clamp, self.support, self.merge)
        query = _request("plate", self.band_kHz, self.near_kHz, self.count, None)
        return _answered(solve(case, mesh, query, run), case, run)


def _check_window(near_kHz: float | None, band_kHz: Pair | None) -> None:
    if near_kHz is not None and band_kHz is not None:
        without = "must be left out beside --band, which asks for every mode between its ends"
        raise InputError(f"--near = {near_kHz:g}kHz: {without}")


def _request(
    part: str, band_kHz: Pair | None, near_kHz: float | None, count: int | None, symmetry: str | None
) -> Request:
    from pipeline.planning.request import Request

    return Request(part, hz(band_kHz), None if near_kHz is None else KHZ * near_kHz, count, symmetry)


def _answered(solved: PartModes, case: Case, run: Run) -> ModesResult:
    from pipeline.models.mode_rows import widest_bar

    run.meshes += solved.meshes
    widest_bar(solved.rows).warn(case, run)
    return ModesResult.of_solved(solved, case)
