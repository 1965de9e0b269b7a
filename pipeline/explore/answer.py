"""One design answered at once: bands and gaps, decay per row, and the wanted mode of one column of cells."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import qmc

from geometry.elements import FloatArray
from pipeline.case.model import Case, case_from_dict
from pipeline.case.overrides import apply_overrides, parse_override
from pipeline.errors import InputError
from pipeline.models.live_column import LiveCell, live_modes
from pipeline.models.parametric import CellModel
from pipeline.models.parametric_mesh import sizes_of
from pipeline.planning import mesh_rules
from pipeline.search.fidelity import COLUMN, column_level_error_db, frequency_slack
from pipeline.search.limits import mass_kg
from pipeline.units import GRAM, MM
from solvers.errors import SolverError
from solvers.measures.confinement import measure_profile
from solvers.parametric.affine import NAMES, Sizes, between
from solvers.superelement.cell import Cell
from solvers.threads import one_thread
from solvers.waves.evanescent import Row
from solvers.waves.gaps import complete_gaps
from solvers.waves.polarisation import label_of

POINTS = 25  # frequencies of the decay per row
STEEPEST_DB = 100.0  # a row: beyond, the boundary polynomials do not resolve the wave
PROFILE = 121  # places across the plate


@dataclass(frozen=True)
class Limit:
    """A slider: key of the case file, what it is called, unit, ends and step."""

    key: str
    word: str
    unit: str
    low: float
    high: float
    step: float


LIMITS = {
    "height": Limit("pillar.height_mm", "Pillar height", "mm", 4.0, 9.0, 0.05),
    "side": Limit("pillar.side_mm", "Pillar side", "mm", 1.0, 3.0, 0.05),
    "pitch": Limit("array.pitch_mm", "Pitch", "mm", 3.0, 8.0, 0.05),
    "thickness": Limit("plate.thickness_mm", "Plate thickness", "mm", 1.0, 3.0, 0.05),
    "rows": Limit("array.rows", "Rows a side", "", 0.0, 8.0, 1.0),
    "extension": Limit("array.extension_mm", "Extension", "mm", 0.0, 40.0, 0.5),
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
        return LIMITS | {"side": replace(side, word=WIDTHS.get(pillar.shape, side.word))}

    @property
    def following(self) -> dict[str, float]:
        """Further keys of the pillar's shape, each so many times its width."""
        pillar = self.case.design.pillar
        assert pillar is not None
        lengths = {"pillar.tip_mm": pillar.tip_m} | {f"pillar.{name}m": size for name, size in pillar.more_m}
        named = {key: f"pillar.{key}" for key in pillar.form.keys[1:]}
        return {key: lengths[key] / pillar.base_m for key in named.values()}

    def overrides(self, design: dict[str, float]) -> list[tuple[str, Any]]:
        """The keys and values that make a design of the page."""
        values = {name: int(value) if name == "rows" else value for name, value in design.items()}
        own = [(self.limits[name].key, value) for name, value in values.items()]
        return own + [(key, float(f"{ratio * design['side']:.12g}")) for key, ratio in self.following.items()]

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
        """What the page starts with: the case's name, the sliders, the file's own design, designs of the cloud a question."""
        limits = {name: asdict(limit) for name, limit in self.limits.items()}
        return {"name": self.case.name, "limits": limits, "design": self.own(), "batch": BATCH}

    def own(self) -> dict[str, float]:
        """The design of the file itself."""
        design = self.case.design
        assert design.pillar is not None
        lengths = {"height": design.pillar.height_m, "side": design.pillar.base_m, "pitch": design.pitch_x_m}
        lengths |= {"thickness": design.thickness_m, "extension": design.extension_m}
        own = {name: round(1e3 * value, 9) for name, value in lengths.items()} | {"rows": float(design.rows)}
        return {name: own[name] for name in LIMITS}


def read_design(given: Any, limits: dict[str, Limit] = LIMITS) -> dict[str, float]:
    """A design as the page sends it: a number for every slider. InputError, a line a fault, for anything else."""
    if not isinstance(given, dict) or set(given) != set(limits):
        raise InputError(f"a design has the numbers {', '.join(limits)} and nothing else")
    said = []
    for name, value in given.items():
        key, unit, low, high = limits[name].key, limits[name].unit, limits[name].low, limits[name].high
        good = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        if not good:
            said.append(f"{key} must be a number")
        elif not low <= value <= high:
            said.append(f"{key} = {value:g}: the model answers from {low:g} to {high:g} {unit}".rstrip())
        elif name == "rows" and value != int(value):
            said.append(f"{key} = {value:g}: must be a whole number")
    if said:
        raise InputError(said)
    return {name: float(given[name]) for name in limits}


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
        window = mesh_rules.wanted_window_hz(design)
        document["rows"] = self._decay(case, sizes, window)
        document["plate"] = self.plate(case)
        if "frequency_error" in document["plate"]:
            document["plate"]["frequency_error"] += self._mesh_at(sizes, document)
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
        designs = []
        for number, (one, other) in enumerate(unit):
            values = {name: 1e3 * own[number] for name, own in sizes.items()}
            values |= {"rows": 1.0 + np.floor(5.0 * one), "extension": 5.0 + 30.0 * other}
            stepped = {name: round(round(values[name] / limit.step) * limit.step, 6) for name, limit in LIMITS.items()}
            if not box.faults((MM * stepped["thickness"], *(MM * stepped[name] for name in NAMES[1:]))):
                designs.append(stepped)
        return designs

    @one_thread()
    def cloud(self, first: int, count: int) -> list[Document]:
        """Frequency, confinement and mass of some of those designs; None where one has no wanted mode in its window."""
        out = []
        for design in self.cloud_designs[first : first + min(count, BATCH)]:
            case = self.scene.at(design)
            plate = self.plate(case)
            known = {name: plate.get(name) for name in ("frequency_hz", "confinement_db")}
            out.append({"design": design, "mass_g": mass_kg(case.design) / GRAM} | known)
        return out

    def _warnings(self, case: Case) -> list[str]:
        said, design = [], case.design
        edge = np.pi / design.pitch_x_m
        if case.kx_wanted_per_m > edge:
            said.append(
                f"the wanted wavenumber {case.kx_wanted_per_m:.0f} rad/m lies beyond the zone's edge {edge:.0f} rad/m"
            )
        if design.is_short_wave:
            said.append("half a wave of the wanted mode is shorter than two thicknesses: its window is a guess")
        if design.rows * design.pitch_y_m + design.extension_m > 0.06:
            said.append(
                "a wide passive part carries many modes near the wanted one: the column may pick another than the plate"
            )
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
            "error": error.tolist(),
            "mesh_error": None if by_mesh is None else by_mesh.tolist(),
            "labels": list(bases.labels),
            "gaps": gaps,
        }

    def _mesh_at(self, sizes: Sizes, document: Document) -> float:
        """The largest error by the mesh of the bands that reach down to the wanted frequency; 0 where it is not known. A column
        stands as its cells are meshed.
        """
        by_mesh = self.model.as_meshed(sizes)
        low = np.min(document["bands"]["frequency_hz"], axis=0) <= document["plate"]["frequency_hz"]
        return 0.0 if by_mesh is None else float(np.max(by_mesh[low], initial=0.0))

    def _decay(self, case: Case, sizes: Sizes, window: tuple[float, float]) -> Document:
        """dB per row of the flexural wave that decays least at the wanted wavenumber, None where all are too steep."""
        kx = case.kx_wanted_per_m
        if kx > np.pi / sizes[3]:
            return {"frequency_hz": [], "db_per_row": [], "kx_per_m": kx}
        row = Row(self._live.at(sizes), kx)
        frequencies = np.linspace(window[0], window[1], POINTS)
        return {
            "frequency_hz": np.round(frequencies, 1).tolist(),
            "db_per_row": [_flexural_db(row, float(hz)) for hz in frequencies],
            "kx_per_m": kx,
        }

    @one_thread()
    def plate(self, case: Case) -> Document:
        """The wanted mode of a case's column, or `why_not`."""
        try:
            return self._column(case, mesh_rules.wanted_window_hz(case.design))
        except (SolverError, InputError) as fault:
            return {"why_not": " ".join(str(fault).split())}

    def _column(self, case: Case, window: tuple[float, float]) -> Document:
        design = case.design
        frequency_hz, profile = live_modes(case, self._live, self._bare, window)
        level = measure_profile(profile, design)
        at = level.wanted.index if len(frequency_hz) else None
        if at is None:
            return {"why_not": "no mode of the wanted shape in the window"}
        numbers = {
            name: _number(getattr(level, name)[at]) for name in ("confinement_db", "extension_db", "mac", "zone_share")
        }
        squares = np.abs(profile.values[:, at]) ** 2
        return numbers | {
            "frequency_hz": float(frequency_hz[at]),
            "frequency_error": frequency_slack(COLUMN, design.nodal_lines),
            "confinement_error_db": column_level_error_db(numbers["confinement_db"], design.nodal_lines),
            "status": level.wanted.status,
            "rivals": len(level.wanted.rivals),
            "profile": _profile(profile.y_m, profile.weights, squares, design.half_span_m),
            "half_width_mm": 5e2 * design.width_m,
            "half_span_mm": 1e3 * design.half_span_m,
        }


def _flexural_db(row: Row, frequency_hz: float) -> float | None:
    waves = row.waves(frequency_hz)
    kept = np.flatnonzero(waves.db_per_row <= STEEPEST_DB)
    ky = waves.wavenumber_per_m[kept]
    labels = label_of(row.cell, waves.dofs[:, kept], np.vstack([np.full(len(ky), row.kx, dtype=complex), ky]))
    flexural = [
        abs(float(waves.db_per_row[i])) for i, label in zip(kept, labels, strict=True) if label.name == "flexural"
    ]
    return round(min(flexural), 4) if flexural else None


def _profile(y_m: FloatArray, weights: FloatArray, squares: FloatArray, end_m: float) -> Document:
    """The root mean square of |u_z| along x over the distance from the zone's middle, the largest 1; empty slots left out."""
    slot = np.minimum((np.abs(y_m) / end_m * PROFILE).astype(int), PROFILE - 1)
    area = np.bincount(slot, weights, PROFILE)
    level = np.sqrt(np.bincount(slot, weights * squares, PROFILE)[area > 0.0] / area[area > 0.0])
    places = (np.flatnonzero(area > 0.0) + 0.5) / PROFILE * end_m
    return {"y_mm": np.round(1e3 * places, 3).tolist(), "level": np.round(level / level.max(), 5).tolist()}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def compute(scene: Scene, given: dict[str, float], log: Any) -> Document:
    """The wanted mode of the assembled plate, as `antinode modes` finds it, its progress told to a log."""
    from pipeline.planning.request import of_case

    case = scene.at(given)
    case = replace(case, solve=replace(case.solve, model="auto"))
    from pipeline.analysis import modes

    solved = modes.solve_modes(case, of_case(case), log)
    row, bar = solved.wanted.row if solved.wanted else None, solved.bar
    if row is None:
        return {"why_not": "no mode of the wanted shape in the window"}
    return {
        "frequency_hz": row.frequency_hz,
        "status": solved.wanted.status if solved.wanted else "none",
        "confinement_db": row.confinement_db,
        "extension_db": row.extension_db,
        "frequency_error": bar.frequency if bar else None,
        "confinement_error_db": bar.confinement_db if bar else None,
    }
