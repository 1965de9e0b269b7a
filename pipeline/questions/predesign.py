"""Analytic sizing of zone and pillar by plate and beam theory, with the expected errors of the theories."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from pipeline.case.features import OF_ROWS
from pipeline.quantity import figure, frequency, percent, percentage
from pipeline.questions.late import Axes, Case, Plan, fields, np, outputs, style
from pipeline.questions.question import Question, Run
from pipeline.questions.result import Result
from pipeline.records.part import Part, column, live

if TYPE_CHECKING:
    from geometry.layout import Design, Pillar
    from solvers.analytic.predesign import PillarSize, ZoneSize
    from solvers.fem.surface import Skin

THEORIES = {  # names in the result, and in the calibration
    "zone": {"thin_clamped_hz": "thin_clamped_hz", "clamped_hz": "clamped_hz"},
    "pillar": {"given_euler_hz": "euler", "given_timoshenko_hz": "timoshenko"},
}
STACKED = ((0.42, 0.58), (0.0, 0.3))  # lower end and height of zone and pillar within their panel
BENT, RINGS, DRAWN = (
    0.12,
    9,
    121,
)  # bending as drawn, relative to the height; rings of a pillar; points along each side of a zone
TUNED = 0.005  # relative to the zone's frequency: a pillar within this distance needs no other height
EXPECTED = (
    "expected error of each frequency compared with a solid with clamped faces, relative; None without a calibration"
)


class ZoneSizes(Part):
    """The zone's mode (0, N); the last three frequencies are None beyond 40 nodal lines."""

    nodal_lines: int = column("nodal lines along x of the mode")
    frequency_hz: float = column("exact thin plate with pinned sides (Levy), of several layers with their shear", "Hz")
    half_wavelength_mm: float | None = column("half-wavelength along the zone", "mm")
    formula_hz: float = column("free-free beam function between pinned sides", "Hz")
    node_spacing_mm: float | None = column("distance between two nodal lines at the centre of the zone", "mm")
    pinned_hz: float | None = column(
        "plate with shear (Mindlin; of several layers their own waves') and pinned sides", "Hz"
    )
    thin_clamped_hz: float | None = column("thin plate (Kirchhoff) with clamped sides", "Hz")
    clamped_hz: float | None = column(
        "plate with shear (Mindlin; of several layers their own waves') and clamped sides", "Hz"
    )
    expected_error: dict[str, float | None] = column(EXPECTED, default_factory=dict)


class PillarSizes(Part):
    """The pillar whose first clamped bending mode matches the zone's frequency, and the pillar of the case."""

    height_mm: float = column("height that matches the zone's frequency by Euler-Bernoulli theory", "mm")
    frequency_hz: float = column("frequency to match", "Hz")
    timoshenko_height_mm: float = column("height that matches it by Timoshenko theory", "mm")
    given_height_mm: float = column("height of the case's pillar", "mm")
    given_euler_hz: float = column("first bending of the case's pillar by Euler-Bernoulli theory", "Hz")
    given_timoshenko_hz: float = column("first bending of the case's pillar by Timoshenko theory", "Hz")
    given_second_hz: float = column("second bending of the case's pillar by Timoshenko theory", "Hz")
    expected_error: dict[str, float | None] = column(EXPECTED, default_factory=dict)


class PredesignResult(Result, axes=("part", "quantity")):
    """Analytic sizing of zone and pillar: frequencies in Hz, lengths in mm; the main table has one row per quantity.

    >>> import antinode
    >>> sizes = antinode.load("examples/small.toml").predesign()
    >>> round(sizes.zone_hz / 1e3, 1), round(sizes.pillar_height_mm, 1)
    (33.5, 7.0)
    """

    zone: ZoneSizes | None = column("the zone; None without one")
    pillar: PillarSizes | None = column("the pillar; None without one")
    limits: list[str] = column("limits of these figures, in words")
    design: Any = live("design of the case; None if read from a file")

    @property
    def zone_hz(self) -> float:
        """Frequency of the target mode of the isolated zone, Hz."""
        assert self.zone
        return self.zone.frequency_hz

    @property
    def half_wavelength_mm(self) -> float | None:
        """Half-wavelength along the zone, mm."""
        return self.zone.half_wavelength_mm if self.zone else None

    @property
    def pillar_height_mm(self) -> float | None:
        """Height at which the pillar resonates at the zone's frequency, mm; None without a pillar."""
        return self.pillar.height_mm if self.pillar else None

    @property
    def _sizes(self) -> dict[str, dict[str, Any]]:
        parts: dict[str, Part | None] = {"zone": self.zone, "pillar": self.pillar}
        return {name: part.values() for name, part in parts.items() if part}

    def to_rows(self) -> list[dict[str, Any]]:
        """Return one row per quantity of zone and pillar, then the expected error of each theory's frequency."""
        rows = []
        for part, sizes in self._sizes.items():
            errors = {f"{name}_error": error for name, error in sizes.pop("expected_error").items()}
            rows += [{"part": part, "quantity": name, "value": value} for name, value in (sizes | errors).items()]
        return rows

    def lines(self) -> Iterator[str]:
        """Yield proposed and given sizes, the given pillar relative to the zone, and the theories' expected errors."""
        rows = [[*row.values()] for row in self.to_rows() if not row["quantity"].endswith("_error")]
        yield outputs.reading_table(("part", "quantity", "value"), rows)
        yield from self._tuning()
        for part, sizes in self._sizes.items():
            errors = sizes["expected_error"]
            known = [
                f"{outputs.named(name)[0]} {percent(error)}" for name, error in errors.items() if error is not None
            ]
            unknown = [outputs.named(name)[0] for name, error in errors.items() if error is None]
            if known:
                yield f"{part}, expected error relative to a solid with clamped faces: {', '.join(known)}"
            if unknown:
                yield f"{part}, no error estimate for: {', '.join(unknown)}"
        yield from (f"note: {text}" for text in self.limits)

    def _tuning(self) -> Iterator[str]:
        """Yield the case's pillar compared with the zone."""
        if not self.zone or not self.pillar:
            return
        target, given = self.pillar.frequency_hz, self.pillar.given_timoshenko_hz
        known = self.pillar.expected_error.get("given_timoshenko_hz")
        off = given / target - 1.0
        apart = f"{percentage(abs(off), known)} {'above' if off > 0.0 else 'below'} the zone's {frequency(target)}"
        better = f"; a height of {figure(self.pillar.timoshenko_height_mm)} mm would match it"
        where = apart + better if abs(off) >= TUNED else "like the zone"
        yield f"the pillar of this case resonates at {frequency(given, known)}, {where}"

    def draw(self, ax: Axes) -> None:
        """Draw the frequencies of zone and pillar by each theory."""
        values = {
            f"{part}: {outputs.named(name)[0]}": value / 1e3
            for part, sizes in self._sizes.items()
            for name, value in sizes.items()
            if name.endswith("_hz") and value is not None
        }
        ax.barh(list(values), list(values.values()), color=style.SKY, alpha=0.6)
        ax.set(xlabel="frequency (kHz)", yticks=[])
        for place, name in enumerate(values):
            ax.annotate(name, (0.0, place), (3.0, 0.0), textcoords="offset points", va="center")

    @property
    def has_shape(self) -> bool:
        """Whether the design is known."""
        return self.design is not None and self.zone is not None

    def illustrate(self, ax: Axes) -> None:
        """Draw the zone's target shape from above and the first bending of the pillar, both by theory."""
        from pipeline.records.record import DesignRecord

        above, below = (ax.inset_axes((0.0, low, 1.0, high)) for low, high in STACKED)
        fields.draw_touch(above, _target_shape(self.design), DesignRecord.of_design(self.design))
        above.set_title(f"Target shape, {frequency(self.zone_hz)}")
        pillar = self.design.pillar
        ax.set_axis_off()
        below.set_axis_off()
        if self.pillar and pillar and not pillar.upper and not pillar.file:
            tone = frequency(self.pillar.given_timoshenko_hz, self.pillar.expected_error.get("given_timoshenko_hz"))
            fields.draw_bodies(below, [_first_bending(pillar)], [f"pillar, {tone}"], BENT * pillar.height_m)

    def __repr__(self) -> str:
        height = "" if self.pillar_height_mm is None else f", pillar {figure(self.pillar_height_mm)} mm"
        return f"<antinode.Predesign: zone {frequency(self.zone_hz)}{height}>"


class Predesign(Question[PredesignResult], needs=("plate", "zone"), is_quick=True, honours=OF_ROWS):
    """Size zone and pillar analytically: frequencies in Hz, lengths in mm.

    >>> import antinode
    >>> round(antinode.load("examples/small.toml").predesign().zone_hz)
    33494
    """

    def compute(self, case: Case, plan: Plan, run: Run) -> PredesignResult:
        from pipeline.case.limits import short_wave

        if text := short_wave(case.design):
            run.warning("SHORT_WAVE", text)
        return sized(case.design)


def sized(design: Design) -> PredesignResult:
    """Size a design analytically, each theory with its expected error."""
    from solvers.analytic.predesign import predesign

    known = predesign(design)
    return PredesignResult(
        zone=ZoneSizes.of(known.zone, **_about("zone", known.zone, design)) if known.zone else None,
        pillar=PillarSizes.of(known.pillar, **_about("pillar", known.pillar, design)) if known.pillar else None,
        limits=list(known.limits),
        design=design,
    )


def _target_shape(design: Design) -> dict[str, Any]:
    """Return touch_* arrays of the zone's target shape by beam theory, zero beyond the zone."""
    from matplotlib.tri import Triangulation

    from solvers.analytic.beams import zone_mode

    x, y = (size * np.linspace(-0.5, 0.5, DRAWN) for size in (design.length_m, design.width_m))
    along = zone_mode(design.nodal_lines, *design.goes_on).shape(x / design.length_m + 0.5)
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    uz = np.outer(along, np.cos(np.pi * y / design.width_m)).ravel()
    places += design.centre_m
    return {"touch_xy": places, "touch_triangles": Triangulation(*places.T).triangles, "touch_uz": uz[None]}


def _first_bending(pillar: Pillar) -> Skin:
    """Return a pillar's surface and its first clamped bending along x by beam theory."""
    from solvers.analytic.beams import beam_mode
    from solvers.fem.surface import Skin

    heights = np.linspace(0.0, 1.0, RINGS)
    rings = [pillar.form.outline((pillar.tip_m - pillar.base_m) * height / 2.0) for height in heights]
    corners, count = np.concatenate(rings), len(rings[0])
    points = np.column_stack([corners, np.repeat(pillar.height_m * heights, count)])
    points = np.vstack([points, [0.0, 0.0, pillar.height_m]])
    own = np.arange(count * (RINGS - 1)).reshape(-1, count)
    following = np.roll(own, -1, axis=1)
    sides = np.stack([own, following, following + count, own + count], axis=-1).reshape(-1, 4)
    rim, top = own[-1] + count, np.full(count, len(points) - 1)
    facets = np.vstack([sides, np.stack([rim, following[-1] + count, top, top], axis=-1)])
    bent = np.zeros((1, *points.shape))
    bent[0, :, 0] = beam_mode("clamped", "free", 1).shape(points[:, 2] / pillar.height_m)
    return Skin(points, facets, bent)


def _about(part: str, sizes: ZoneSize | PillarSize, design: Design) -> dict[str, Any]:
    """Return the lengths of a part in mm, and the expected error of each theory's frequency."""
    errors, known = expected_errors(part, design), vars(sizes).items()
    lengths = {f"{name}m": value and 1e3 * value for name, value in known if name.endswith("_m")}
    told = {name: errors.get(name) for name, value in known if name.endswith("_hz") and value is not None}
    return lengths | {"expected_error": told}


def expected_errors(part: str, design: Design) -> dict[str, float]:
    """Return the expected relative error of each theory's frequency compared with the solid; {} without a calibration."""
    from solvers.accuracy import calibration

    slender = design.nodal_lines * design.thickness_m / design.length_m
    if part == "pillar":
        if not design.pillar or not design.pillar.is_square_prism or design.pillar.material.constants is None:
            return {}
        slender = design.pillar.base_m / design.pillar.height_m
    elif design.nodal_lines < 2 or design.held_ends or not design.stack.is_uniform:
        return {}
    errors = {name: calibration.by_theory(part, theory, slender) for name, theory in THEORIES[part].items()}
    return {name: error for name, error in errors.items() if error is not None}
