"""Answer the explorer's questions about a design, and compute its scatter when all pillars share one deviation.

Every sample of that scatter is itself a design of the parametric cell. That cell does not cover pillars that differ within
one plate: they have their own families of reductions (`pipeline.models.tolerance`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from geometry.elements import FloatArray, IntArray
from pipeline.case.model import Case, case_from_dict
from pipeline.case.reading import apply_overrides, parse_override
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models.answer_parts import SampleRecord
from pipeline.models.live_column import TIED, Detuned, LiveCell, LivePlate, boundary_error, end_layer, live_modes
from pipeline.models.parametric import CellModel, cell_model, lattice_of, resized, sizes_of
from pipeline.planning import mesh_rules
from pipeline.planning.simplifications import Simplification
from pipeline.quantity import GRAM, MM, figure, frequency, level, percent
from pipeline.search.terms import mass_kg
from solvers.errors import SolverError
from solvers.measures.confinement import measure_profile
from solvers.parametric.affine import NAMES, DesignBox, Sizes, between
from solvers.superelement.cell import Cell
from solvers.threads import one_thread
from solvers.variation.samples import CUT, Deviations
from solvers.waves.branches import FELT, is_flexural
from solvers.waves.complex_bands import Row
from solvers.waves.gaps import complete_gaps

POINTS, FINER = 25, 24  # frequencies of the decay per row: evenly spaced, and at most added where its curve bends
NARROW = 16  # parts of an even step: the closest that these stand, some pixels of the page
STRAIGHT_DB = 0.05  # change of slope times step up to which a step is drawn as a line
ALIKE = 1.0 - 1e-6  # of the largest: page and Python halve the first of equal steps
STEEPEST_DB = 100.0  # a row: beyond, the boundary polynomials do not resolve the wave
PROFILE = 121  # places across the plate
SWINGING = 2.0  # times the plate's root mean square motion: from there on the page calls a wave one of the pillar
WIDE_M = 0.06  # of plate beyond the zone: from there on many modes lie near the target mode
NEAR = 3.0  # times the error of a frequency: both frequencies have one, and the coupling has the same range

# every sentence of an answer, with names for its numbers: an exported page fills in the same ones
WORDS = {
    "number": "{key} must be a number",
    "limit": "{key} = {value:g}: the model answers from {low:g} to {high:g} {unit}",
    "whole": "{key} = {value:g}: must be a whole number",
    "beyond": "the target wavenumber {kx} rad/m lies beyond the zone's edge {edge} rad/m",
    "short_wave": "the half-wavelength of the target mode is less than two thicknesses: its frequency window is a guess",
    "wide": "a wide passive part carries many modes near the target mode: the column may pick another than the plate",
    "no_mode": "no mode of the target shape in the window",
    "near": "a mode of the passive plate at {hz} lies near the target mode, whose frequency is known to {error}: "
    "the confinement may lie between {least} and {most}",
    "split": "the target shape is split among several modes: the plate may show another one of them",
    "others": "within the error bars the strongest mode may also be that at {named}",
}

WIDTHS = {
    "round": "Pillar diameter",
    "hexagonal": "Pillar width across flats",
    "tapered": "Pillar side at the foot",
    "cross": "Pillar width",
}

CLOUD = 2000  # designs of the Pareto picture
PLATES = 4  # of them with the same cell, one after another: other rows and extensions
BATCH = 2 * PLATES  # designs a question: a drag waits no longer
Document = dict[str, Any]

FIXED = Simplification(
    "alike_position", "where the pillars stand", "pillars that all stand off alike are the same plate, moved"
)


@dataclass(frozen=True)
class Limit:
    """A slider: key of the case file, what it is called, unit, ends and step."""

    key: str
    word: str
    unit: str
    low: float
    high: float
    step: float

    def scaled(self, factor: float) -> Limit:
        """The slider with its ends times a factor, and a step of 1, 2 or 5 in the first digit."""
        if factor == 1.0:
            return self
        low, high = (float(f"{factor * end:.9g}") for end in (self.low, self.high))
        power = 10.0 ** math.floor(math.log10(factor * self.step))
        digit = max(each for each in (1.0, 2.0, 5.0) if each * power <= factor * self.step * (1.0 + 1e-9))
        return replace(self, low=low, high=high, step=float(f"{digit * power:.9g}"))


LIMITS = {  # of plates of ordinary sizes; Scene.limits lays them about others
    "height": Limit("pillar.height_mm", "Pillar height", "mm", 4.0, 9.0, 0.05),
    "side": Limit("pillar.side_mm", "Pillar side", "mm", 1.0, 3.0, 0.05),
    "pitch": Limit("array.pitch_mm", "Pitch", "mm", 3.0, 8.0, 0.05),
    "thickness": Limit("plate.thickness_mm", "Plate thickness", "mm", 1.0, 3.0, 0.05),
    "rows": Limit("array.rows", "Rows a side", "", 0.0, 8.0, 1.0),
    "extension": Limit("array.extension_mm", "Extension", "mm", 0.0, 40.0, 0.5),
}


@dataclass(frozen=True)
class Scene:
    """A case file with its --set words: what every design of the page is a variation of."""

    case: Case
    raw: dict[str, Any]
    fixed: tuple[str, ...]

    @property
    def limits(self) -> dict[str, Limit]:
        """The sliders of the scene's shape of pillars."""
        pillar = self.case.design.pillar
        assert pillar is not None
        side = replace(LIMITS["side"], key=f"pillar.{pillar.form.keys[0]}")
        own = LIMITS | {"side": replace(side, word=WIDTHS.get(pillar.shape, side.word))}
        if self.case.design.pitch_x_m != self.case.design.pitch_y_m:
            own["pitch"] = replace(own["pitch"], key="array.pitch_x_mm", word="Pitch along the zone")
        return {name: limit.scaled(self.factors[name]) for name, limit in own.items()}

    @cached_property
    def factors(self) -> dict[str, float]:
        """Factors on the sliders' ends, as on those of the box of bases: 1 where they hold the file's own design."""
        usual = DesignBox()
        sizes = np.divide(usual.about(sizes_of(self.case.design)).low, usual.low)
        own = dict(zip(NAMES, sizes.round(9).tolist(), strict=True))
        return own | {"rows": 1.0, "extension": own["pitch"]}

    @property
    def following(self) -> dict[str, tuple[str, float]]:
        """Keys that follow a slider, with their ratio to it: the pillar's other widths, and an unequal pitch along y."""
        design = self.case.design
        pillar = design.pillar
        assert pillar is not None
        unequal = design.pitch_x_m != design.pitch_y_m
        pitches = {"array.pitch_y_mm": ("pitch", design.pitch_y_m / design.pitch_x_m)} if unequal else {}
        lengths = {"pillar.tip_mm": pillar.tip_m} | {f"pillar.{name}m": size for name, size in pillar.more_m}
        named = {key: f"pillar.{key}" for key in pillar.form.keys[1:]}
        return {key: ("side", lengths[key] / pillar.base_m) for key in named.values()} | pitches

    def overrides(self, design: dict[str, float]) -> list[tuple[str, Any]]:
        """The keys and values that make a design of the page."""
        values = {name: int(value) if name == "rows" else value for name, value in design.items()}
        own = [(self.limits[name].key, value) for name, value in values.items()]
        return own + [(key, float(f"{ratio * design[of]:.12g}")) for key, (of, ratio) in self.following.items()]

    def at(self, design: dict[str, float]) -> Case:
        """The case of a design. InputError, a line a fault."""
        return case_from_dict(self.raw, self.case.source, [*self.fixed, *self.overrides(design)])

    def toml(self, design: dict[str, float]) -> str:
        """The case file of a design."""
        import tomli_w

        self.at(design)
        settings = [*(parse_override(text) for text in self.fixed), *self.overrides(design)]
        return tomli_w.dumps(apply_overrides(self.raw, settings))

    def template(self) -> str:
        """The case file with "@NAME@" in the place of each number of a design."""
        import tomli_w

        places = [(limit.key, f"@{name}@") for name, limit in self.limits.items()]
        places += [(key, f"@{key}@") for key in self.following]
        return tomli_w.dumps(apply_overrides(self.raw, [*(parse_override(text) for text in self.fixed), *places]))

    def document(self) -> Document:
        """What the page starts with: the case's name, the sliders, the file's own design, designs of the cloud a question, the
        labelled wavevectors in units of pi / pitch, and by which a wave is one of the pillar or flexural.
        """
        limits = {name: asdict(limit) for name, limit in self.limits.items()}
        corners = {label: (k / np.pi).tolist() for label, k in lattice_of(self.case.design).high_symmetry.items()}
        design = self.case.design
        plate = {"length_mm": round(1e3 * design.length_m, 9), "zone_mm": round(1e3 * design.width_m, 9)}
        assert design.pillar is not None
        plate_kg = design.stack.mass_kg_m2 * design.pitch_x_m * design.pitch_y_m
        plate |= {"ratio": design.pitch_y_m / design.pitch_x_m, "stagger": design.stagger, "lines": design.nodal_lines}
        plate["patches"] = self.case.patches is not None
        return {
            **{"name": self.case.name, "limits": limits, "design": self.own(), "batch": BATCH, "corners": corners},
            "plate": plate,
            "motion": {"times": SWINGING, "flexural": FELT, "carried": design.pillar.mass_kg / plate_kg},
        }

    def check(self) -> None:
        """Raise InputError, with one line per fault, for a case outside the sliders' limits."""
        own = self.own().items()
        lines = [
            f"{self.case.name}: explore: {limit.key} = {value:g}: must be from {limit.low:g} to {limit.high:g} {limit.unit}"
            for (name, value), limit in ((pair, self.limits[pair[0]]) for pair in own)
            if not limit.low <= value <= limit.high
        ]
        if lines:
            raise InputError(line.rstrip() for line in lines)

    def own(self) -> dict[str, float]:
        """The design of the file itself."""
        design = self.case.design
        assert design.pillar is not None
        lengths = {"height": design.pillar.height_m, "side": design.pillar.base_m, "pitch": design.pitch_x_m}
        lengths |= {"thickness": design.thickness_m, "extension": design.extension_m}
        own = {name: round(1e3 * value, 9) for name, value in lengths.items()} | {"rows": float(design.rows)}
        return {name: own[name] for name in LIMITS}


class Explorer:
    """Answers designs of one scene from the parametric cell."""

    def __init__(self, scene: Scene, model: CellModel) -> None:
        self.scene, self.model = scene, model
        self._live = LiveCell(model.cell)
        self._bare: dict[str, Cell] = {}

    def answer(self, given: dict[str, float]) -> Document:
        """Everything that the page shows of a design. InputError for one that cannot be built or lies outside the model."""
        return self.document(self.scene.at(given), given)

    @one_thread()
    def document(self, case: Case, given: dict[str, float]) -> Document:
        """The same of a case; `given` is what the page called it."""
        design = case.design
        assert design.pillar is not None
        sizes = sizes_of(design)
        faults = self.model.cell.box.faults(sizes)
        if faults:
            raise InputError(faults)
        document: Document = {"design": given, "warnings": self._warnings(case), "bands": self._bands(sizes)}
        window = mesh_rules.target_window_hz(design)
        document["rows"] = self._decay(case, sizes, window)
        lowest_hz = np.min(document["bands"]["frequency_hz"], axis=0)
        document["plate"] = self.plate(case, lambda hz: self._mesh_at(sizes, lowest_hz <= hz))
        document["warnings"] += document["plate"].pop("warnings", [])
        return document

    @cached_property
    def cloud_designs(self) -> list[dict[str, float]]:
        """The designs of the Pareto picture: cells evenly spread over the box, on the sliders' steps, PLATES of each one after
        another; the same at every call.
        """
        box = self.model.cell.box
        cells = np.repeat(box.sample(between(CLOUD // PLATES, seed=4)), PLATES, axis=0)
        sizes = dict(zip(NAMES, cells.T, strict=True))
        unit = qmc.Halton(2, seed=5).random(CLOUD)
        designs, limits = [], self.scene.limits
        for number, (one, other) in enumerate(unit):
            values = {name: 1e3 * own[number] for name, own in sizes.items()}
            values |= {
                "rows": 1.0 + np.floor(5.0 * one),
                "extension": self.scene.factors["extension"] * (5.0 + 30.0 * other),
            }
            stepped = {
                name: float(f"{round(values[name] / limit.step) * limit.step:.9g}") for name, limit in limits.items()
            }
            if not box.faults(np.array([MM * stepped[name] for name in NAMES])):
                designs.append(stepped)
        return designs

    @one_thread()
    def cloud(self, first: int, count: int) -> list[Document]:
        """Frequency, confinement and mass of some of those designs; None where one has no target mode in its window."""
        out = []
        for design in self.cloud_designs[first : first + min(count, BATCH)]:
            case = self.scene.at(design)
            out.append({"design": design, "mass_g": mass_kg(case.design) / GRAM} | self.estimate(case))
        return out

    def _warnings(self, case: Case) -> list[str]:
        said, design = [], case.design
        edge = np.pi / design.pitch_x_m
        if case.target_kx_per_m > edge:
            said.append(WORDS["beyond"].format(kx=figure(case.target_kx_per_m), edge=figure(edge)))
        if design.is_short_wave:
            said.append(WORDS["short_wave"])
        if design.rows * design.pitch_y_m + design.extension_m > WIDE_M:
            said.append(WORDS["wide"])
        return said

    def _bands(self, sizes: Sizes) -> Document:
        bases, dispersion = self.model.bases, self.model.bands(sizes)
        error, by_mesh = dispersion.error, self.model.by_mesh(sizes)
        gaps = [
            {
                "lower_hz": gap.lower_hz, "upper_hz": gap.upper_hz, "lower_band": gap.lower_band, "upper_band": gap.upper_band,
                "error": None if by_mesh is None else float(max((error + by_mesh)[gap.lower_band - 1 : gap.upper_band])),
            }
            for gap in complete_gaps(dispersion.frequency_hz)
        ]  # fmt: skip
        return {
            "frequency_hz": np.round(dispersion.frequency_hz, 1).tolist(),
            "sector": dispersion.sector.tolist(),
            **{name: [list(map(_share, row)) for row in getattr(dispersion, name)] for name in ("pillar", "flexural")},
            "error": error.tolist(),
            "mesh_error": None if by_mesh is None else by_mesh.tolist(),
            "labels": list(bases.labels),
            "gaps": gaps,
        }

    def _mesh_at(self, sizes: Sizes, reaching: NDArray[np.bool_]) -> float:
        """The largest discretisation error of the bands that reach down to a frequency; 0 if unknown.

        It includes the part that is otherwise corrected, because the plate is assembled from the cells as meshed.
        """
        by_mesh = self.model.as_meshed(sizes)
        return 0.0 if by_mesh is None else float(np.max(by_mesh[reaching], initial=0.0))

    def _decay(self, case: Case, sizes: Sizes, window: tuple[float, float]) -> Document:
        """dB per row of the flexural wave that decays least at the target wavenumber, None where all are too steep."""
        kx = case.target_kx_per_m
        if kx > np.pi / sizes[3]:
            return {"frequency_hz": [], "db_per_row": [], "kx_per_m": kx}
        row = Row(self._live.row(sizes, case.design.stack.material), kx)
        frequency_hz, decay = _bisected(window, lambda hz: _flexural_db(row, hz))
        rounded = [None if each is None else round(each, 4) for each in decay]
        return {"frequency_hz": np.round(frequency_hz, 1).tolist(), "db_per_row": rounded, "kx_per_m": kx}

    @one_thread()
    def plate(self, case: Case, mesh_error: Callable[[float], float] = lambda hz: 0.0) -> Document:
        """The target mode of a case's plate with its bars, or `why_not`; mesh_error: of the cells at a frequency, relative."""
        try:
            return self._plate(case, mesh_rules.target_window_hz(case.design), mesh_error)
        except (SolverError, InputError) as fault:
            return {"why_not": " ".join(str(fault).split())}

    def _plate(self, case: Case, window: tuple[float, float], mesh_error: Callable[[float], float]) -> Document:
        live = LivePlate(case, self._live, self._bare, window)
        design = live.design
        found = live.verdict()
        at = found.verdict.index
        if at is None:
            return {"why_not": WORDS["no_mode"]}
        layer = end_layer(design) / 2.0  # half of it is corrected, the other half may be left
        frequency_hz, level = float(found.frequency_hz[at]) * (1.0 - layer), found.level
        numbers = {
            name: _number(getattr(level, name)[at]) for name in ("confinement_db", "extension_db", "mac", "zone_share")
        }
        if not case.design.extension_m:
            numbers["extension_db"] = None
        error = boundary_error(design) + layer + live.moved + mesh_error(frequency_hz)
        bar = Bar.over(live.within(error), found, error, layer)
        squares = live.plate.profile(live.modes.vectors @ found.turn[:, at])
        return numbers | {
            "frequency_hz": frequency_hz,
            "frequency_error": bar.frequency,
            "confinement_error_db": bar.confinement.half_db,
            "extension_error_db": None if numbers["extension_db"] is None else bar.extension.half_db,
            "status": bar.status,
            "near_hz": bar.near_hz,
            "rivals": len(found.verdict.rivals),
            "others": list(map(asdict, bar.others)),
            "warnings": bar.warnings(),
            "profile": _profile(*squares, design.half_span_m),
            "half_width_mm": 5e2 * design.width_m,
            "half_span_mm": 1e3 * design.half_span_m,
        }

    @one_thread()
    def estimate(self, case: Case) -> Document:
        """Frequency and confinement of one column at the wavenumber between free ends, without bars; None without a mode."""
        none = dict.fromkeys(("frequency_hz", "confinement_db"))
        try:
            window = mesh_rules.target_window_hz(case.design)
            frequency_hz, profile = live_modes(case, self._live, self._bare, window)
        except (SolverError, InputError):
            return none
        level = measure_profile(profile, case.design)
        at = level.target.index if len(frequency_hz) else None
        if at is None:
            return none
        return {"frequency_hz": float(frequency_hz[at]), "confinement_db": _number(level.confinement_db[at])}


@dataclass(frozen=True)
class Levels:
    """A level, the least and the greatest that it may have, dB; None where the plate has no such part."""

    least_db: float | None
    most_db: float | None
    half_db: float | None

    @classmethod
    def over(cls, every: FloatArray) -> Levels:
        """Levels of a mode and, after it, of what the mode becomes under changes."""
        if not math.isfinite(every[0]):
            return cls(None, None, None)
        least, most, own = float(every.min()), float(every.max()), float(every[0])
        return cls(least, most, TIED + max(most - own, own - least))


@dataclass(frozen=True)
class Candidate:
    """Another mode that may be the target mode of the plate, with the error bars of its frequency (relative) and level."""

    frequency_hz: float
    frequency_error: float
    confinement_db: float | None
    confinement_error_db: float | None

    @classmethod
    def over(cls, hz: FloatArray, levels: FloatArray, error: float) -> Candidate:
        """The middle of the frequencies and levels that the mode has under changes."""
        low, high, least, most = hz.min(), hz.max(), levels.min(), levels.max()
        is_known = math.isfinite(least + most)
        return cls(
            float(low + high) / 2.0,
            float((high - low) / (high + low) + error),
            float(least + most) / 2.0 if is_known else None,
            float(most - least) / 2.0 + TIED if is_known else None,
        )


@dataclass(frozen=True)
class Bar:
    """Error bars of the target mode: relative frequency and levels, over all changes of zone's and rows' frequencies within
    their error.

    others: modes that a change makes the target mode, by frequency. near_hz: another mode that carries some of the target
    shape so near that these changes turn the level over, None where there is none.
    """

    frequency: float
    confinement: Levels
    extension: Levels
    others: tuple[Candidate, ...]
    status: str
    near_hz: float | None
    error: float

    @classmethod
    def over(cls, changed: list[Detuned], own: Detuned, error: float, layer: float = 0.0) -> Bar:
        """From the verdict and those over changes within an error; others are lowered by an end layer's share."""
        known = [one for one in changed if one.verdict.index is not None]
        hz = np.concatenate([one.frequency_hz[list(one.tied)] for one in (own, *known)])
        confinement, extension = (
            np.concatenate([getattr(one.level, name)[list(one.tied)] for one in (own, *known)])
            for name in ("confinement_db", "extension_db")
        )
        single = len(known) == len(changed) and all(one.verdict.status == "single" for one in known)
        modes = apart(hz, error)
        (same,) = (mode for mode in modes if 0 in mode)
        off = np.abs(hz[same] / hz[0] - 1.0)
        return cls(
            float(np.max(off[off > error] + error, initial=error)),
            Levels.over(confinement[same]),
            Levels.over(extension[same]),
            tuple(
                Candidate.over((1.0 - layer) * hz[mode], confinement[mode], error) for mode in modes if mode is not same
            ),
            "single" if single else "split",
            own.rival_hz(NEAR * error),
            error,
        )

    def warnings(self) -> list[str]:
        """What limits the use of the answer."""
        said, least, most = [], self.confinement.least_db, self.confinement.most_db
        if self.near_hz is not None and least is not None and most is not None:
            near_hz, error = frequency(self.near_hz, self.error), percent(self.error)
            said.append(WORDS["near"].format(hz=near_hz, error=error, least=level(least), most=level(most)))
        if self.status == "split":
            said.append(WORDS["split"])
        if self.others:
            named = ", ".join(frequency(each.frequency_hz, each.frequency_error) for each in self.others)
            said.append(WORDS["others"].format(named=named))
        return said


def read_design(given: Any, limits: dict[str, Limit] = LIMITS) -> dict[str, float]:
    """A design as the page sends it: a number for every slider. InputError, a line a fault, for anything else."""
    if not isinstance(given, dict) or set(given) != set(limits):
        raise InputError(f"a design has the numbers {', '.join(limits)} and nothing else")
    said = []
    for name, own in given.items():
        limit, value = limits[name], _float(own)
        if not math.isfinite(value):
            fault = "number"
        elif not limit.low <= value <= limit.high:
            fault = "limit"
        elif name == "rows" and value != int(value):
            fault = "whole"
        else:
            continue
        said.append(WORDS[fault].format(value=value, **vars(limit)).rstrip())
    if said:
        raise InputError(said)
    return {name: float(given[name]) for name in limits}


def apart(hz: FloatArray, error: float) -> list[IntArray]:
    """Group frequencies (n,) of which each lies within a relative error of the next: indices, ascending in each group."""
    order = np.argsort(hz, kind="stable")
    ends = np.flatnonzero(np.diff(hz[order]) > error * hz[order][:-1]) + 1
    return [np.sort(group) for group in np.split(order, ends)]


def compute(scene: Scene, given: dict[str, float], log: Any) -> Document:
    """Find the target mode of the assembled plate as `antinode modes` does, and report progress to a log."""
    from pipeline.models import modes
    from pipeline.planning.model_choice import of_case

    case = scene.at(given)
    case = replace(case, solve=case.solve.but(model="auto"))
    solved = modes.solve_modes(case, of_case(case), log)
    row = solved.target_row
    if row is None:
        return {"why_not": WORDS["no_mode"]}
    return {
        "frequency_hz": row.frequency_hz,
        "status": solved.target.status if solved.target else "none",
        "confinement_db": row.confinement_db,
        "extension_db": row.extension_db,
        "frequency_error": row.error,
        "confinement_error_db": row.confinement_error_db,
    }


def check(case: Case) -> None:
    """InputError without [tolerance], without pillars, or where no size of theirs differs."""
    case.require_plate("tolerance --alike")
    case.require("tolerance", "pillar", command="tolerance --alike")
    if case.tolerance and case.tolerance.young_percent:
        text = "tolerance.young_percent must be 0: give a batch of another stiffness a pillar.material of its own"
        raise InputError(f"{case.name}: tolerance --alike: {text}")
    if not _deviations(case).sizes.any():
        raise InputError(f"{case.name}: tolerance --alike: tolerance.height_mm or tolerance.side_mm must be above 0")


def solve(case: Case, log: Log) -> tuple[SampleRecord, list[SampleRecord], float]:
    """Solve the nominal plate and the samples, each with one deviation shared by all pillars.

    Also returns the relative error of a frequency. InputError for designs outside the bases.
    """
    given, deviations = case.tolerance, _deviations(case)
    assert given is not None
    explorer = Explorer(Scene(case, {}, ()), cell_model(case, log))
    _require_inside(case, deviations, explorer)
    with log.step("nominal plate"):
        answer = explorer.document(case, {})
        nominal = _sample(answer["plate"])
    if nominal.peak_hz is None:
        raise InputError(f"{case.name}: tolerance --alike: {answer['plate'].get('why_not', 'no target mode')}")
    for text in answer["warnings"]:
        log.warning("LIVE", text)
    samples = []
    for number, change in enumerate(deviations.draw(1, given.samples, given.seed)[:, 0, :2], start=1):
        with log.step(f"plate {number} of {given.samples}"):
            samples.append(_sample(explorer.plate(printed(case, change))))
    return nominal, samples, answer["plate"]["frequency_error"]


def printed(case: Case, change_m: FloatArray) -> Case:
    """The case with the height and width of every pillar changed by (2,) m."""
    thickness, height, width, pitch = sizes_of(case.design)
    sizes = thickness, height + float(change_m[0]), width + float(change_m[1]), pitch
    return replace(case, design=resized(case.design, sizes))


def _float(value: Any) -> float:
    """A number of a request; nan for whatever is none, or too large for one."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def _bisected(
    window: tuple[float, float], decay: Callable[[float], float | None]
) -> tuple[list[float], list[float | None]]:
    """Frequencies in a window and the decay at each: even steps, and the middles of those where a line is farthest off.

    The error of a line over a step h is about h / 8 times the change of slope at its ends, of which the geometric mean is
    taken; a decay without value counts as the steepest.
    """
    hz: list[float] = np.linspace(*window, POINTS).tolist()
    db = [decay(each) for each in hz]
    narrow = 1.5 * (window[1] - window[0]) / (POINTS - 1) / NARROW
    for _ in range(FINER):
        step = np.diff(hz)
        slope = np.diff([STEEPEST_DB if each is None else each for each in db]) / step
        bend = np.concatenate([[0.0], np.abs(np.diff(slope)), [0.0]])
        off = np.where(step > narrow, step * np.sqrt(bend[:-1] * bend[1:]), 0.0)
        if off.max() < STRAIGHT_DB:
            break
        at = int(np.argmax(off >= ALIKE * off.max()))
        hz.insert(at + 1, (hz[at] + hz[at + 1]) / 2.0)
        db.insert(at + 1, decay(hz[at + 1]))
    return hz, db


def _flexural_db(row: Row, frequency_hz: float) -> float | None:
    waves = row.waves(frequency_hz)
    kept = np.flatnonzero(waves.db_per_row <= STEEPEST_DB)
    flexural = waves.db_per_row[kept[is_flexural(row.periodic, waves.dofs[:, kept])]]
    return float(np.abs(flexural).min()) if len(flexural) else None


def _profile(y_m: FloatArray, weights: FloatArray, squares: FloatArray, end_m: float) -> Document:
    """The root mean square of |u_z| along x over the distance from the zone's middle, the largest 1; empty slots left out."""
    slot = np.minimum((np.abs(y_m) / end_m * PROFILE).astype(int), PROFILE - 1)
    area = np.bincount(slot, weights, PROFILE)
    level = np.sqrt(np.bincount(slot, weights * squares, PROFILE)[area > 0.0] / area[area > 0.0])
    places = (np.flatnonzero(area > 0.0) + 0.5) / PROFILE * end_m
    return {
        "y_mm": [float(f"{1e3 * place:.6g}") for place in places],
        "level": np.round(level / level.max(), 5).tolist(),
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _share(value: float) -> float | None:
    return round(float(value), 4) if math.isfinite(value) else None


def _deviations(case: Case) -> Deviations:
    assert case.tolerance is not None
    return Deviations(case.tolerance.height_m, case.tolerance.side_m, 0.0)


def _require_inside(case: Case, deviations: Deviations, explorer: Explorer) -> None:
    """InputError, a line a size, where the largest deviations leave the box of the bases."""
    reach, said = np.array(deviations.reach[:2]), []
    for signs in ((1.0, 1.0), (-1.0, -1.0)):
        sizes = sizes_of(printed(case, reach * signs).design)
        for fault in explorer.model.cell.box.faults(sizes):
            said.append(f"{case.name}: tolerance --alike: {CUT:g} standard deviations reach {fault}")
    if said:
        raise InputError(list(dict.fromkeys(said)))


def _sample(plate: dict) -> SampleRecord:
    return SampleRecord(
        peak_hz=plate.get("frequency_hz"),
        zone_rms=None,
        confinement_db=plate.get("confinement_db"),
        quality_factor=None,
        tracking=plate.get("status", "none"),
    )
