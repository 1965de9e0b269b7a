"""Cross-talk between several zones on one plate: each driven in turn, all measured."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from pipeline.case.limits import MAX_FREQUENCIES
from pipeline.errors import InputError
from pipeline.questions.question import Pair, Question, Run, hz, option
from pipeline.questions.result import Result, figure
from pipeline.records.part import Part, column
from pipeline.units import KHZ, MM, NM

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from geometry.elements import FloatArray
    from pipeline.case.model import Case
    from pipeline.planning.plan import Plan
    from pipeline.plots.style import ReportFigure

POINTS = 401
DARK = -25.0  # dB: below it letters are white


class DrivenZone(Part):
    """One zone driven at its own peak while the others' patches are held at 0 V; lists have an entry a measured zone."""

    centre_m: float = column("y of the driven zone's centre line", "m")
    drivers: list[int] = column("numbers of the driven patches, from 0")
    peak_hz: float = column("frequency at which the driven zone moves most", "Hz", error="peak_error")
    peak_error: float | None = column(
        "half-width of the error bar of peak_hz, relative; None without an estimate", default=None
    )
    rms_m_per_V: list[float] = column("rms of u_z", "m/V", along="measured", error="rms_error_m_per_V")
    rms_error_m_per_V: list[float | None] | None = column(
        "half-width of the error bar of rms_m_per_V; None without an estimate", "m/V", along="measured", default=None
    )
    level_db: list[float] = column("rms over the driven zone's", "dB", along="measured", error="level_error_db")
    level_error_db: list[float | None] | None = column(
        "half-width of the error bar of level_db; None without an estimate", "dB", along="measured", default=None
    )
    passive_db: float | None = column(
        "rms of the passive face over the driven zone's; None without a passive face", "dB", error="passive_error_db"
    )
    passive_error_db: float | None = column(
        "half-width of the error bar of passive_db; None without an estimate", "dB", default=None
    )
    mac: float | None = column(
        "modal assurance criterion of the driven zone with the target shape", error="mac_error", default=None
    )
    mac_error: float | None = column("half-width of the error bar of mac; None without an estimate", default=None)
    over_rms_m_per_V: list[list[float]] = column(
        "rms of u_z over frequency", "m/V", along=("measured", "frequency_hz"), error="over_rms_error_m_per_V"
    )
    over_rms_error_m_per_V: list[list[float | None]] | None = column(
        "half-width of the error bar of over_rms_m_per_V; None without an estimate", "m/V",
        along=("measured", "frequency_hz"), default=None,
    )  # fmt: skip


class CrosstalkResult(Result, table="zones", axes=("driven", "measured")):
    """Several zones on one plate, each driven in turn: levels of all of them over the driven one's, dB.

    >>> import antinode
    >>> from pipeline.questions.crosstalk import DrivenZone
    >>> zone = {"centre_m": 0.0, "drivers": [0], "peak_hz": 33e3, "passive_db": None, "over_rms_m_per_V": []}
    >>> zones = [DrivenZone(**zone, rms_m_per_V=[1e-9, 2e-11], level_db=[0.0, -34.0])] * 2
    >>> levels = antinode.Crosstalk(model="", dof=0, shared_rows=3, gap_m=0.01, frequency_hz=[], zones=zones)
    >>> float(levels.level_db[0, 1])
    -34.0
    """

    model: str = column("model of the plate and its element order, and the number of patches")
    dof: int = column("degrees of freedom that were solved for")
    shared_rows: int = column("rows between two zones")
    gap_m: float = column("distance of two zones' borders", "m")
    frequency_hz: list[float] = column("frequencies of over_rms_m_per_V", "Hz", along="frequency_hz")
    zones: list[DrivenZone] = column("one driven zone each, by ascending y")

    @property
    def level_db(self) -> FloatArray:
        """Levels (driven zones, measured zones) in dB."""
        return self.array("level_db")

    @figure("gap between zones", "mm", error="exact")
    def gap_mm(self) -> float:
        """Distance of two zones' borders."""
        return self.gap_m / MM

    exact = 0.0  # the half-width of the bar of what was given

    @figure("largest cross-talk", "dB", name="crosstalk_db", error="worst_error_db")
    def worst_db(self) -> float | None:
        """The largest level of a zone while another is driven; None with one zone."""
        return self._worst[0]

    @figure("peak of the first zone, driven", "Hz", name="crosstalk_hz", error="first_error")
    def first_hz(self) -> float:
        """Frequency at which the first zone moves most."""
        return self.zones[0].peak_hz

    @figure("passive face, first zone driven", "dB", error="passive_error_db")
    def passive_db(self) -> float | None:
        """Level of the passive face while the first zone is driven."""
        return self.zones[0].passive_db

    @property
    def worst_error_db(self) -> float | None:
        """Half-width of the bar of worst_db."""
        return self._worst[1]

    @property
    def first_error(self) -> float | None:
        """Relative half-width of the bar of first_hz."""
        return self.zones[0].peak_error

    @property
    def passive_error_db(self) -> float | None:
        """Half-width of the bar of passive_db."""
        return self.zones[0].passive_error_db

    @property
    def _worst(self) -> tuple[float | None, float | None]:
        others = [
            (level, zone.level_error_db[j] if zone.level_error_db else None)
            for i, zone in enumerate(self.zones)
            for j, level in enumerate(zone.level_db)
            if i != j
        ]
        return max(others, default=(None, None), key=lambda pair: pair[0] or 0.0)

    def lines(self) -> Iterator[str]:
        """Yield the gap and a line for each driven zone."""
        between = f"{self.shared_rows} rows" if self.shared_rows else "no row"
        head = f"{len(self.zones)} zones, {self.gap_m / MM:g} mm and {between} between two of them"
        yield head if len(self.zones) > 1 else "one zone"
        yield from map(_in_words, self.zones)

    def draw(self, ax: Axes) -> None:
        """Draw the level of every zone while each of them is driven, dB."""
        import numpy as np

        from pipeline.plots import style
        from pipeline.quantity import level_figure

        levels, names = self.level_db, [str(number) for number in range(1, len(self.zones) + 1)]
        ax.imshow(levels, cmap=style.QUALITY, vmin=-60.0, vmax=0.0)
        for row, at in np.ndindex(levels.shape):
            errors, level = self.zones[row].level_error_db, float(levels[row, at])
            words: dict[str, Any] = {"ha": "center", "va": "center", "color": "black" if level > DARK else "white"}
            ax.text(at, row, level_figure(level, errors[at] if errors else None), **words)
        ax.set_xticks(range(len(levels)), names)
        ax.set_yticks(range(len(levels)), names)
        ax.set(xlabel="zone measured", ylabel="zone driven", title="dB over the driven zone")

    def pictures(self) -> list[ReportFigure]:
        """Return the table of levels, and every zone over frequency while the first is driven."""
        import numpy as np

        from pipeline.plots import style
        from pipeline.quantity import level

        drawn, (table, over) = style.panels(3.4, 1, 2, width_ratios=(1.0, 1.6))
        self.draw(table)
        first = self.zones[0]
        curves = {f"zone {i}": np.array(rms) / NM for i, rms in enumerate(first.over_rms_m_per_V, start=1)}
        style.draw_lines(over.semilogy, np.array(self.frequency_hz) / KHZ, curves)
        style.mark(over, first.peak_hz / KHZ)
        over.set(xlabel="frequency (kHz)", ylabel="rms u_z (nm/V)", title="Zone 1 driven")
        over.legend(fontsize=8)
        worst = "one zone" if self.worst_db is None else f"at most {level(self.worst_db)} in another zone"
        alt = f"Cross-talk between {len(self.zones)} zones, {self.shared_rows} rows between two of them: {worst}"
        return [style.ReportFigure("crosstalk", "Cross-talk between zones", alt, drawn, vector=True)]

    def __repr__(self) -> str:
        return f"<antinode.Crosstalk: {len(self.zones)} zones>"


def _in_words(zone: DrivenZone) -> str:
    from pipeline.quantity import frequency_with_bar, level_with_bar

    errors = zone.level_error_db or [None] * len(zone.level_db)
    levels = ", ".join(level_with_bar(*each) for each in zip(zone.level_db, errors, strict=True))
    passive = ""
    if zone.passive_db is not None:
        passive = f"; passive face {level_with_bar(zone.passive_db, zone.passive_error_db)}"
    peak = frequency_with_bar(zone.peak_hz, zone.peak_error)
    return f"driven at y = {zone.centre_m / MM:g} mm, {peak}: zones at {levels}{passive}"


class Crosstalk(
    Question[CrosstalkResult],
    needs=("patches",),
    drives=True,
    example="crosstalk examples/two-zones.toml --out crosstalk",
):
    """Drive each of several zones on one plate in turn and measure all, in dB ([[zone]] in the case).

    >>> from antinode import Patches, load
    >>> one = load("examples/small.toml", accuracy=0.1, patches=Patches(size_mm=(8.0, 3.0, 0.3)))
    >>> plate = one.with_(zone=[one.to_dict()["zone"], {"shared_rows": 3}])
    >>> bool(plate.crosstalk((33.0, 36.0), points=5).level_db[0, 1] < -3.0)
    True
    """

    band_kHz: Pair | None = option(default=None, unit="kHz", at_least=0.0, kw_only=False, help="frequencies")
    points: int = option(default=POINTS, at_least=1, at_most=MAX_FREQUENCIES, help="how many frequencies")

    def check(self, case: Case) -> None:
        """Raise InputError for a case without patches that drive each of its zones, the others' at 0 V."""
        import numpy as np

        case.require_plate(command="crosstalk", several=True)
        super().check(case)
        patches, design = case.patches, case.design
        assert patches is not None
        said = []
        if patches.circuit != "short":
            said.append(
                f"patches.circuit = {patches.circuit!r}: must be 'short', zones at rest hold their patches at 0 V"
            )
        y = np.array([patches.centres_m[i][1] for i in patches.drivers])
        bare = [
            i + 1 for i, mid in enumerate(design.zone_centres_m) if not (np.abs(y - mid) < design.width_m / 2.0).any()
        ]
        if bare:
            said.append(f"patches.centres_mm: zone {', '.join(map(str, bare))} has no patch that drives it")
        if said:
            raise InputError(f"{case.source or case.name}: {text}" for text in said)

    def plan(self, case: Case) -> Plan:
        """Plan each zone driven and all measured."""
        from dataclasses import replace

        from pipeline.planning.plan import plan_of, response_step

        step = response_step(case, hz(self.band_kHz), self.points, several=True)
        looks = f"{self.points} frequencies, each of {case.design.zones} zones driven in turn"
        own = replace(step, measure=self.name, name="cross-talk between zones", looks_for=looks)
        return plan_of(case, own)

    def compute(self, case: Case, plan: Plan, run: Run) -> CrosstalkResult:
        """Drive each zone at its own peak and measure every zone."""
        import numpy as np

        from pipeline.models.patched_plate import forced_plate
        from pipeline.planning import calibration
        from solvers.driven.crosstalk import curve_half_widths, peak_half_widths, zone_volts, zones_of
        from solvers.driven.curve_bars import doubts
        from solvers.driven.error_bars import frequency_error, frequency_errors
        from solvers.measures.levels import ratio_db
        from solvers.threads import one_thread

        forced = forced_plate(case, run, hz(self.band_kHz), run.meshes, is_announced=True)
        patches, design = case.patches, case.design
        assert patches is not None
        with run.step(f"{design.zones} zones, each driven in turn"), one_thread():
            zones, volts = zones_of(forced), zone_volts(forced, np.array(patches.centres_m))
            frequencies = np.linspace(*forced.band_hz, self.points)
            errors, known = frequency_errors(forced), doubts(forced, calibration.mixing())
            curves = curve_half_widths(zones, volts, frequencies, known)
            driven = []
            for zone, fed in enumerate(volts):
                peak = zones.peak_hz(fed, zone)
                (at,) = zones.rms(fed, np.array([peak]))
                driven.append(
                    DrivenZone(
                        centre_m=float(design.zone_centres_m[zone]),
                        drivers=np.flatnonzero(fed).tolist(),
                        peak_hz=peak,
                        rms_m_per_V=at[:-1].tolist(),
                        level_db=ratio_db(at[:-1], at[zone]).tolist(),
                        passive_db=float(ratio_db(at[-1], at[zone])),
                        mac=zones.mac(fed, peak, zone),
                        over_rms_m_per_V=zones.rms(fed, frequencies)[:, :-1].T.tolist(),
                        over_rms_error_m_per_V=curves[zone].tolist(),
                        peak_error=frequency_error(forced, peak, errors),
                        **peak_half_widths(zones, fed, zone, peak, known),
                    )
                )
                _warn_of_shape(zone, driven[-1], run)
        result = CrosstalkResult(
            model=f"{forced.plate.name} with {patches.count} patches",
            dof=sum(group.pencil.dof for group in forced.plate.groups),
            shared_rows=design.shared_rows,
            gap_m=design.zone_gap_m,
            frequency_hz=frequencies.tolist(),
            zones=driven,
        )
        for line in result.lines():
            run.info(line)
        return result


def _warn_of_shape(number: int, zone: DrivenZone, run: Run) -> None:
    """Warn of a zone that moves most in another shape than the target's."""
    from pipeline.quantity import figure as in_digits
    from pipeline.quantity import frequency
    from solvers.measures.wanted_mode import SIMILAR

    if zone.mac is not None and zone.mac < SIMILAR:
        run.warning(
            "OTHER_PEAK",
            f"zone {number + 1} moves most at {frequency(zone.peak_hz, zone.peak_error)}, but not in the target shape "
            f"(MAC {in_digits(zone.mac, zone.mac_error)}): the levels are another mode's; give a --band about the target mode",
        )
