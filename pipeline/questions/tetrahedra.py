"""Cross-check of the design with tetrahedra (CAD and pytetwild): target mode of the plate, and unit cell."""

from __future__ import annotations

from dataclasses import replace

from pipeline.models.answer_parts import CountRecord
from pipeline.questions.bands import Bands, BandsResult
from pipeline.questions.late import Case, Plan, Simplification, plans, resource_estimate
from pipeline.questions.question import Question, Run, Unanswered, ask
from pipeline.questions.result import Result
from pipeline.records.part import column


class TetModesResult(Result, axes=()):
    """Target mode on tetrahedra compared with that on the structured mesh."""

    model: str = column("model and element order", default="")
    dof: int = column("degrees of freedom that were solved for")
    frequency_hz: float = column("frequency on tetrahedra", "Hz", error="error")
    error: float | None = column("its relative error bar (half-width); None without an estimate", default=None)
    hex_frequency_hz: float = column("frequency of the structured mesh", "Hz", error="hex_error")
    hex_error: float | None = column("its relative error bar (half-width); None without an estimate", default=None)
    relative_difference: float = column("frequency on tetrahedra relative to hexahedra, minus 1")
    agrees: bool | None = column("whether the two agree within both error bars", default=None)
    mac: float | None = column("modal assurance criterion with the target shape", default=None)
    count_check: CountRecord | None = column(
        "inertia count compared with the number of modes found", table=False, default=None
    )
    confinement_db: float | None = column("confinement on tetrahedra", "dB", error="confinement_bar_db", default=None)
    hex_confinement_db: float | None = column(
        "confinement of the structured mesh", "dB", error="hex_confinement_error_db", default=None
    )
    hex_confinement_error_db: float | None = column("its error bar (half-width)", "dB", default=None)
    confinement_bar_db: float | None = column(
        "possible change of the level by neighbouring modes that both frequency error bars may mix in",
        "dB",
        default=None,
    )


class TetModes(
    Question[TetModesResult],
    in_studies_only=True,
    aliases=("tetrahedra",),
    pictures=("plots.fields.mode_on_both_meshes",),
):
    """Compute the target mode of the whole plate meshed with tetrahedra."""

    def plan(self, case: Case) -> Plan:
        from pipeline.planning.mesh_rules import NEAR_COUNT, PLATE_ACCURACY

        name, mesh = "the plate and its cell with tetrahedra", "tetrahedra of order 2 from CAD"
        demand = resource_estimate.of_meshed_whole(case, max(PLATE_ACCURACY, case.solve.accuracy), NEAR_COUNT)
        why = ("a cross-check with another mesh",)
        return plans.plan_of(
            case,
            plans.Step(
                self.name, name, "solid tet2", mesh, (), "the modes nearest the target mode", why, demand=demand
            ),
        )

    def compute(self, case: Case, plan: Plan, run: Run) -> TetModesResult:
        """Mesh and solve the plate around the structured mesh's frequency; skip a plate too large for the memory."""
        from pipeline.models import modes
        from pipeline.models.cross_check import compared
        from solvers.errors import TooLarge

        structured = run.solved.get("modes")
        if structured is None:
            structured = modes.solve_modes(case, modes.Request("plate", symmetry=case.target_symmetry), run.log)
        row = structured.target_row
        bar = (row.error if row else None) or 0.0
        if row is None:
            run.log.warning("NO_MODE", "no mode has the target shape: tetrahedra have nothing to be compared with")
            raise Unanswered
        try:
            meshes, arrays, figures = compared(case, structured, row, bar, run.log)
        except TooLarge as fault:
            run.log.warning("TOO_LARGE", f"the cross-check of the whole plate with tetrahedra is left out: {fault}")
            raise Unanswered from fault
        run.meshes += meshes
        if not figures:
            raise Unanswered
        run.arrays |= arrays
        return TetModesResult(**figures)


class TetBands(Question[BandsResult], follows="tet_modes"):
    """Compute the bands of the unit cell meshed with tetrahedra, at the corners of the path."""

    @classmethod
    def spared(cls, case: Case) -> Simplification | None:
        return Bands.spared(case)

    def compute(self, case: Case, plan: Plan, run: Run) -> BandsResult:
        corners = replace(case, solve=case.solve.but(mesh="tet"), bands=case.bands.but(points=1))
        alone = Run(run.log, detailed=False)
        result = ask(corners, Bands(), alone)
        run.meshes += alone.meshes
        return result
