"""The case file: one frozen, validated scene with its settings; units are converted to SI here and nowhere else."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from math import inf, isfinite, isnan, nan, pi
from pathlib import Path
from typing import Any

import numpy as np

from geometry import lattice
from geometry.elements import FloatArray
from geometry.fingertips import FINGERTIPS, Fingertip
from geometry.layout import Design, Patches, Pillar, Section, antinode_places
from geometry.materials import PIEZO_MATERIALS, Layer, Material, Stack
from geometry.outline import Outline
from geometry.pillar_shapes import PillarShape
from pipeline.case.attached import read_attached
from pipeline.case.checks import oblique_mm, one_table, span_mm
from pipeline.case.defects import Defect, read_defects
from pipeline.case.features import refusals
from pipeline.case.outlines import check_outline, faults_of_boxes
from pipeline.case.reading import (
    GLUE,
    GROUPS,
    UNIFORM_ROW_KEYS,
    CaseValues,
    Diagnostics,
    apply_overrides,
    check_exclusive,
    is_file,
    nearest,
    nearest_file,
    one_kind,
    parse_override,
    read_toml,
    read_values,
)
from pipeline.case.reading import CaseValues as Values
from pipeline.case.schema import BandsTable, FingertipTable, SolveTable, Table, Tables, ToleranceTable
from pipeline.case.several import check_placed
from pipeline.case.supports import check_beside_patches, check_places, read_supports
from pipeline.errors import InputError
from pipeline.quantity import GRAM, MM, UM, figure
from solvers.analytic.beams import antinodes, zone_mode
from solvers.measures.confinement import target_symmetry
from solvers.measures.radiation import Air

MAX_LISTED = 3  # largest number of patches, or pairs of them, that a message names
DISC = np.linspace(0.0, 2.0 * pi, 64, endpoint=False)  # corners of a polygon that stands for a disc
PATCH = 0.6, 0.2  # size of a patch in an example, relative to a half-wavelength of the zone and to its width
TOUCHING = 1e-9  # relative to the patch: boxes with a common edge do not overlap

Override = str | tuple[str, Any]

TABLE_EXAMPLES = {  # example of a rarely used table
    "patches": ", such as --set \"patches={{material='pz26', size_mm=[{length}, {width}, 0.3]}}\"",
    "tolerance": ', such as --set "tolerance={{height_mm=0.05}}"',
    "touch": ', such as --set "touch={{radius_mm=5.0}}"',
}


@dataclass(frozen=True)
class Touch:
    """Contact of a finger in SI; force_n and gap_m (low, high) are None without data on friction.

    limit_v: largest voltage of the amplifier, None if not given.
    """

    tip: Fingertip
    at_m: tuple[float, float]
    radius_m: float
    force_n: float | None
    gap_m: tuple[float, float] | None
    limit_v: float | None


@dataclass(frozen=True)
class MeasuredFiles:
    """Measured data of the plate: paths of a sweep and of a map, and the position of the sweep's laser, m."""

    sweep: Path | None
    map: Path | None
    at_m: tuple[float, float] | None

    def to_dict(self) -> dict[str, Any]:
        """Names and SHA-256 of the files, and the position."""
        plain: dict[str, Any] = {"at_m": _plain(self.at_m)}
        for name, path in (("sweep", self.sweep), ("map", self.map)):
            if path is not None:
                plain |= {name: path.name, f"{name}_sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
        return plain


@dataclass(frozen=True)
class Case:
    """One scene in SI, with defaults. Lengths of absent tables are NaN: call `require` first.

    quality_factor: None if the loss is that of the materials. group_materials: those of the groups of a mesh file.
    defects: cells of a supercell with another pillar. raw, overrides: the parsed file and its overrides, from which variants
    of the case are derived.
    """

    name: str
    source: Path | None
    design: Design
    solve: SolveTable
    bands: BandsTable
    quality_factor: float | None
    patches: Patches | None
    air: Air | None
    given: frozenset[str]
    tolerance: ToleranceTable | None = None
    measured: MeasuredFiles | None = None
    touch: Touch | None = None
    group_materials: tuple[tuple[str, Material], ...] = ()
    defects: tuple[Defect, ...] = ()
    raw: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)
    overrides: tuple[Override, ...] = field(default=(), repr=False, compare=False)

    @property
    def materials(self) -> tuple[Material, ...]:
        """Materials of the design, of a mesh file's groups and of other pillars, each once."""
        others = (section.material for each in self.defects if each.pillar for section in each.pillar.sections)
        return tuple(dict.fromkeys((*self.design.materials, *(each for _, each in self.group_materials), *others)))

    def refuse(self, command: str, honours: tuple[str, ...] = ()) -> None:
        """Raise InputError for what would change the answer, but what the command cannot honour (`features`)."""
        if lines := refusals(self, command, honours):
            raise InputError(f"{self.source or self.name}: {line}" for line in lines)

    @property
    def is_lossy(self) -> bool:
        """Whether the materials give the loss."""
        return self.quality_factor is None

    def one_quality_factor(self, command: str) -> float:
        """Return the quality factor. Raises InputError where the materials give the loss."""
        if self.quality_factor is None:
            what = f"must be a number: {command} supports a single quality factor only"
            raise InputError(f'{self.source or self.name}: damping.quality = "materials": {what}')
        for number, support in enumerate(self.design.supports):
            if support.damping_n_s_m:
                key, what = (
                    f"support.{number}.damping_Ns_per_m",
                    f"must be 0: {command} supports a single quality factor only",
                )
                raise InputError(f"{self.source or self.name}: {key} = {support.damping_n_s_m:g}: {what}")
        return self.quality_factor

    def require_mirrored(self, command: str) -> None:
        """Raise InputError where the plate's material has no mirrors in x and y, of which a command takes the halves."""
        if not {"x", "y"} <= {*self.design.stack.mirrors}:
            what = "needs a plate that is its own mirror image along x and y: turn the material's axes back"
            raise InputError(f"{self.source or self.name}: {command} {what}")

    @property
    def target_symmetry(self) -> str | None:
        """Mirror signs of u_z in the target mode, x then y: N nodes are even when N is.

        None without a zone, and for an unsymmetric plate, whose modes have no such signs.
        """
        if "zone" not in self.given or not self.design.is_mirrored:
            return None
        return target_symmetry(self.design.nodal_lines)

    @property
    def target_kx_per_m(self) -> float:
        """Wavenumber along the zone of the target mode, (N - 1/2) pi / L, rad/m; 0 for the rigid shapes N = 0, 1."""
        half = self.design.half_wavelength_m
        return pi / half if half else 0.0

    def but(self, changes: Mapping[str, Any]) -> Case:
        """Return the case with other values of dotted keys, in the units of the file. Raises InputError for faults."""
        return case_from_dict(self.raw, self.source, [*self.overrides, *changes.items()]) if changes else self

    def require(self, *keys: str, command: str = "this command") -> None:
        """Raise InputError naming every table or dotted key that the command needs and the file lacks.

        pitch_x_mm together with pitch_y_mm also satisfies "array.pitch_mm".
        """
        lacking = [key for key in keys if key not in self.given]
        where = self.source if self.source is not None else self.name
        if lacking:
            room = self._room_mm() if "zone" in self.given else {"length": "12", "width": "3"}
            raise InputError(
                f"{where}: {key if '.' in key else f'[{key}]'}: missing, {command} needs it"
                f"{TABLE_EXAMPLES.get(key, '').format(**room)}"
                for key in lacking
            )

    def _room_mm(self) -> dict[str, str]:
        """Size of a patch at every antinode, between the rows."""
        design = self.design
        return {
            "length": figure(PATCH[0] * design.length_m / max(design.nodal_lines, 1) / MM),
            "width": figure(PATCH[1] * design.width_m / MM),
        }

    def require_plate(self, command: str = "this command") -> None:
        """Raise InputError unless the case has [plate], [zone] and, with pillars, array.rows."""
        self.require("plate", "zone", *(("array.rows",) if "pillar" in self.given else ()), command=command)

    def require_one_kind(self, command: str) -> None:
        """Raise InputError for rows that differ, which a single unit cell or pillar cannot represent."""
        if self.design.is_graded:
            where = self.source if self.source is not None else self.name
            lists = " and ".join(key for key in UNIFORM_ROW_KEYS if key in self.given)
            example = " ".join(f"--set {text}" for text in one_kind(self.design))
            what = (
                f"rows differ, but {command} defined for one kind of row only: ask for each in turn, such as {example}"
            )
            raise InputError(f"{where}: {lists}: {what}")

    def path(self, points: int, cells: lattice.Lattice | None = None, walked: str | None = None) -> lattice.Path:
        """Return the path of the bands, or one through another lattice, `points` intervals per segment.

        Raises InputError for points of another lattice.
        """
        own, labels = cells or self.design.lattice, walked or self.bands.path
        try:
            return own.path(labels, points)
        except ValueError as fault:
            what = f"must consist of points of the {own.name} lattice, {', '.join(own.high_symmetry)}"
            example = f"such as {own.default_path}"
            raise InputError(f"{self.source or self.name}: bands.path = {labels}: {what}, {example}") from fault

    def to_dict(self) -> dict[str, Any]:
        """Return everything that influences results as plain JSON in SI; a STEP file by name and SHA-256."""
        design, outline = replace(self.design, outline=None), self.design.outline
        plain: dict[str, Any] = {"design": _plain(design)}
        plain |= {name: _plain(getattr(self, name)) for name in ("solve", "bands", "quality_factor", "patches")}
        if self.tolerance:
            plain["tolerance"] = _plain(self.tolerance)
        if self.touch:
            plain["touch"] = _plain(self.touch)
        if self.group_materials:
            plain["materials"] = {name: _plain(material) for name, material in self.group_materials}
        if self.defects:
            plain["defects"] = [_plain(each) for each in self.defects]
        if self.air:
            plain["air"] = _plain(self.air)
        if self.measured:
            plain["measured"] = self.measured.to_dict()
        if self.patches and not self.patches.resting:
            del plain["patches"]["resting"]
        pillar, shape = self.design.pillar, plain["design"]
        for key in (
            "graded",
            "graded_pitches_m",
            "stagger",
            "layers",
            "supports",
            "cell_file",
            "attached",
            "oblique_m",
            "others_m",
        ):
            if not shape[key]:
                del shape[key]
        del shape["outline"]
        if outline:
            shape["outline"] = {"file": Path(outline.file).name, "file_sha256": outline.sha256}
        if not self.design.larger_m:
            for key in ("larger_m", "centre_m", "surround"):
                del shape[key]
        if self.design.zones == 1:
            for key in ("zones", "shared_rows", "zone_gap_m"):
                del shape[key]
        for each in (shape["pillar"], *shape.get("graded", ())) if pillar else ():
            each |= dict(each.pop("more_m"))
            for section in each["upper"]:
                section |= dict(section.pop("more_m"))
            for key, usual in (("upper", []), ("faces", 1)):
                if each[key] == usual:
                    del each[key]
        if pillar and pillar.file:
            plain["design"]["pillar"]["file"] = Path(pillar.file).name
            plain["design"]["pillar"]["file_sha256"] = hashlib.sha256(Path(pillar.file).read_bytes()).hexdigest()
        if self.design.cell_file:
            file = Path(self.design.cell_file)
            shape |= {"cell_file": file.name, "cell_sha256": hashlib.sha256(file.read_bytes()).hexdigest()}
        return plain


def read_patches(values: CaseValues, design: Design) -> Patches | None:
    """Return the patches in SI, or None without the table; faults are added to the diagnostics."""
    table, diagnostics = values.tables.patches, values.diagnostics
    if "patches" not in values.tables.present or diagnostics.touch("patches"):
        return None
    name, allowed = table.material, ", ".join(PIEZO_MATERIALS)
    if name not in PIEZO_MATERIALS:
        diagnostics.add("patches.material", name, f"must be one of {allowed}{nearest(name, PIEZO_MATERIALS)}")
    x, y, z = (MM * side for side in table.size_mm)
    each = [_places(table.centres_mm, view, (x, y, z)) for view in ((design,) if table.centres_mm else design.views)]
    centres, lengths = sum((own for own, _ in each), ()), sum((own for _, own in each), ())
    firsts = np.cumsum([0, *(len(own) for own, _ in each[:-1])]).tolist()
    sensors = tuple(first + number for first in firsts for number in table.sensors)  # every zone has the same
    resting: tuple[int, ...] = ()
    if design.others_m and table.centres_mm:
        elsewhere = ~design.passive(np.array(centres)) & ~design.in_zone(np.array(centres))
        resting = tuple(np.flatnonzero(elsewhere).tolist())
    elif design.others_m:
        resting = tuple(range(len(each[0][0]), len(centres)))
    if behind := table.behind_mm:
        (*_, low, high), beyond = design.reach_m, MM * behind
        centres += tuple((place, across) for across in (low - beyond, high + beyond) for place, _ in each[0][0])
        lengths += each[0][1] * 2
    patches = Patches(
        material=PIEZO_MATERIALS.get(name, PIEZO_MATERIALS["pz26"]),
        size_m=(x, y, z),
        face=table.face,
        at="centres" if table.centres_mm else "antinodes",
        centres_m=centres,
        lengths_m=lengths,
        sensors=sensors,
        drive_v=float(table.drive_V),
        circuit=table.circuit,
        resting=tuple(number for number in resting if number not in sensors),
        glue=None if values.glue_mm is None else Layer(values.materials[GLUE], MM * values.glue_mm),
    )
    _check_sensors(patches, diagnostics)
    if "zone" in values.tables.present:
        _check_places(patches, design, values.tables, diagnostics)
    return patches


def read_touch(values: CaseValues, design: Design) -> Touch | None:
    """Return the contact, or None without the table; faults are added to the diagnostics."""
    table, diagnostics = values.tables.touch, values.diagnostics
    if "touch" not in values.tables.present or diagnostics.touch("touch"):
        return None
    gap, force, limit = table.gap_um, table.force_N, table.limit_V
    if gap and gap[0] > gap[1]:
        diagnostics.add("touch.gap_um", gap, "must be [low, high] with low <= high")
    if (gap is None) != (force is None):
        given, other = ("gap_um", "force_N") if gap else ("force_N", "gap_um")
        diagnostics.add(f"touch.{given}", gap or force, f"requires touch.{other}: friction is computed from both")
    at, radius = table.at_mm, MM * table.radius_mm
    place = (MM * at[0], MM * at[1]) if at else (_middle_antinode_m(design), design.centre_m[1])
    x0, x1, y0, y1 = design.ends_m
    beyond = min(place[0] - x0, x1 - place[0], place[1] - y0, y1 - place[1]) < radius
    if "zone" in values.tables.present and (beyond or not _is_on_outline(design, place, radius)):
        size = f"{design.plate_m[0] / MM:g} x {design.plate_m[1] / MM:g} mm"
        key = "at_mm" if at else "radius_mm"
        diagnostics.add(f"touch.{key}", at or table.radius_mm, f"the contact extends beyond the plate of {size}")
    elif design.larger_m and design.pillar and design.pillar.faces == 2:
        diagnostics.add("pillar.faces", "both", "must be back where a finger touches a plate larger than its zone")
    elif "zone" in values.tables.present and abs(place[1]) + radius > design.bare_touch_m:
        room = (
            f"the contact overlaps the pillars on the touch face, which begin at |y| = {design.bare_touch_m / MM:g} mm"
        )
        diagnostics.add("touch.at_mm", at or list(place), room)
    return Touch(
        tip=_fingertip(values),
        at_m=place,
        radius_m=radius,
        force_n=None if force is None else float(force),
        gap_m=(UM * gap[0], UM * gap[1]) if gap else None,
        limit_v=None if limit is None else float(limit),
    )


def load_case(path: str | Path, overrides: Iterable[Override] = ()) -> Case:
    """Load the case of a TOML file with overrides, "key.path=value" or (key, value); InputError lists every fault."""
    file, given = Path(path), tuple(overrides)
    check_exclusive(parsed(given), "--set")
    return case_from_dict(read_case(file), source=file, overrides=given)


def read_case(file: Path) -> dict[str, Any]:
    """Read the tables of a case file as written; InputError for a study file and the faults of read_toml."""
    raw = read_toml(file)
    if isinstance(raw.get("study"), dict):
        raise InputError(
            f"{file}: a study file (it has a [study] table), but a case file is needed; antinode run {file} computes "
            "the study"
        )
    return raw


def case_from_dict(raw: dict[str, Any], source: Path | None = None, overrides: Iterable[Override] = ()) -> Case:
    """Build the case of a parsed file; STEP paths are relative to the folder of `source`. InputError as load_case."""
    given = tuple(overrides)
    settings = parsed(given)
    raw = one_table(raw, str(source) if source is not None else "case")
    applied = apply_overrides(raw, settings)
    defects, held = applied.pop("defect", None), applied.pop("support", [])
    values = read_values(applied, source, [key for key, _ in settings])
    supports = read_supports(held, values.diagnostics) if held != [] else ()
    patches, touch, measured = None, None, _measured(values, source)
    attached = {"patches", "touch"} & values.tables.present
    if attached and not values.diagnostics.touch("material", "plate", "zone", "pillar", "array"):
        design = _design(values)
        patches, touch = read_patches(values, design), read_touch(values, design)
    values.diagnostics.stop()
    design = replace(_design(values), supports=supports, cell_file=_cell_file(values, source))
    hung = applied["cell"].get("attached") if isinstance(applied.get("cell"), dict) else None
    if hung is not None:
        design = replace(design, attached=read_attached(hung, design, values.diagnostics))
        if design.cell_file:
            values.diagnostics.missing("cell.attached", "cannot be combined with cell.file: draw the mass as a body")
    values.diagnostics.stop()
    _check_losses(values, design, patches)
    if design.others_m:
        for fault in check_placed(design):
            values.diagnostics.add(*fault)
        values.diagnostics.stop()
    if design.outline:
        for fault in check_outline(design, values.given):
            values.diagnostics.add(*fault)
        values.diagnostics.stop()
    if design.supports and {"plate", "zone"} <= values.given:
        check_places(design, values.diagnostics)
        check_beside_patches(design, patches, values.diagnostics)
        values.diagnostics.stop()

    def pillar_of(other: dict[str, Any]) -> Pillar | None:
        return case_from_dict(other, source).design.pillar

    return Case(
        name=values.name,
        source=source,
        design=design,
        solve=_solve(values.tables.solve),
        bands=_bands(values.tables.bands, design),
        quality_factor=None if values.tables.damping.quality == "materials" else values.tables.damping.quality,
        patches=patches,
        air=_air(values),
        given=values.given,
        tolerance=values.tables.tolerance if "tolerance" in values.tables.present else None,
        measured=measured,
        touch=touch,
        group_materials=tuple(
            (owner.removeprefix(GROUPS), each) for owner, each in values.materials.items() if owner.startswith(GROUPS)
        ),
        defects=() if defects is None else read_defects(defects, applied, str(source or "case"), pillar_of),
        raw=raw,
        overrides=given,
    )


def parsed(overrides: Iterable[Override]) -> list[tuple[str, Any]]:
    """Parse overrides into keys and values. Raises InputError, one line per fault."""
    settings, lines = [], []
    for given in overrides:
        try:
            settings.append(parse_override(given) if isinstance(given, str) else given)
        except InputError as error:
            lines += error.lines
    if lines:
        raise InputError(lines)
    return settings


def _places(
    centres_mm: list[list[float]] | None, design: Design, size_m: tuple[float, float, float]
) -> tuple[tuple[tuple[float, float], ...], tuple[float, ...]]:
    if centres_mm:
        return tuple((MM * x, MM * y) for x, y in centres_mm), (size_m[0],) * len(centres_mm)
    lines, length = design.nodal_lines, design.length_m
    rigid, shape = lines == 0 and not design.held_ends, zone_mode(lines, *design.goes_on)
    inner = (0.0,) if rigid else tuple((s - 0.5) * length for s in antinodes(shape))
    low, high = design.goes_on
    centres, lengths = antinode_places(inner, length, size_m, ends=lines > 0 and not (low and high))
    kept = slice(1 if low != high and low else None, -1 if low != high and high else None)  # none at a pinned end
    x, y = design.centre_m
    return tuple((place + x, across + y) for place, across in centres[kept]), lengths[kept]


def _check_sensors(patches: Patches, diagnostics: Diagnostics) -> None:
    wrong = [number for number in patches.sensors if number >= patches.count]
    if wrong:
        diagnostics.add(
            "patches.sensors", list(patches.sensors), f"no such patch: must be numbers from 0 to {patches.count - 1}"
        )
    elif not patches.drivers:
        diagnostics.add("patches.sensors", list(patches.sensors), "every patch is a sensor: at least one must drive")


def _check_places(patches: Patches, design: Design, file: Tables, diagnostics: Diagnostics) -> None:
    boxes, size = patches.boxes_m(), file.patches.size_mm
    slack = TOUCHING * max(patches.size_m)
    x0, x1, y0, y1 = np.array(design.ends_m) + slack * np.array([-1.0, 1.0, -1.0, 1.0])
    length_mm, width_mm = design.plate_m[0] / MM, design.plate_m[1] / MM
    if patches.size_m[1] > y1 - y0 or patches.size_m[0] > x1 - x0:
        diagnostics.add("patches.size_mm", size, f"larger than the plate of {length_mm:g} x {width_mm:g} mm")
        return
    given = [f"patches.{name}" for name in ("centres_mm", "behind_mm") if getattr(file.patches, name)]
    key = [*given, "patches.size_mm"][0]
    value = file.get(key)
    outside = (boxes[:, 0] < x0) | (boxes[:, 1] > x1) | (boxes[:, 2] < y0) | (boxes[:, 3] > y1)
    if design.outline and not outside.any():
        for number in faults_of_boxes(design.outline, boxes, patches.face)[:MAX_LISTED]:
            diagnostics.add(
                key, value, f"patch {number} extends beyond the outline of plate.file, or over a hole of it"
            )
    for number in np.flatnonzero(outside)[:MAX_LISTED]:
        diagnostics.add(key, value, f"patch {number} extends beyond the plate of {length_mm:g} x {width_mm:g} mm")
    for i, j in _first_overlaps(boxes, slack):
        diagnostics.add(key, value, f"patches {i} and {j} overlap")
    if patches.face == "back" or file.pillar.faces == "both":
        _check_pillars(patches, design, key, value, diagnostics, slack)
    if min(patches.lengths_m, default=inf) <= 0.0:
        diagnostics.add(key, value, "no room for the end patches: must be shorter along x")


def _check_pillars(
    patches: Patches, design: Design, key: str, value: object, diagnostics: Diagnostics, slack: float
) -> None:
    boxes = patches.boxes_m()
    hit = np.zeros(len(boxes), dtype=bool)
    for stand in design.standing():
        reach = stand.pillar.widest_m / 2.0 - slack
        along = stand.centres[np.argsort(stand.centres[:, 0])]
        hit |= [_holds(along, *box) for box in boxes + reach * np.array([-1.0, 1.0, -1.0, 1.0])]
    if hit.any():
        diagnostics.add(key, value, f"patch {np.flatnonzero(hit)[0]} on the {patches.face} overlaps a pillar's foot")


def _holds(along: FloatArray, x0: float, x1: float, y0: float, y1: float) -> bool:
    """Return whether an open rectangle contains one of some points (n, 2), ascending in x."""
    first, last = np.searchsorted(along[:, 0], x0, side="right"), np.searchsorted(along[:, 0], x1)
    y = along[first:last, 1]
    return bool(((y0 < y) & (y < y1)).any())


def _first_overlaps(boxes_m: FloatArray, slack: float) -> list[tuple[int, int]]:
    """Return the first MAX_LISTED pairs i < j of footprints x0, x1, y0, y1 that share more than an edge."""
    overlaps: list[tuple[int, int]] = []
    for i, (x0, x1, y0, y1) in enumerate(boxes_m):
        later = boxes_m[i + 1 :]
        apart = (x1 <= later[:, 0] + slack) | (later[:, 1] <= x0 + slack)
        apart |= (y1 <= later[:, 2] + slack) | (later[:, 3] <= y0 + slack)
        overlaps += [(i, i + 1 + int(j)) for j in np.flatnonzero(~apart)[:MAX_LISTED]]
        if len(overlaps) >= MAX_LISTED:
            break
    return overlaps[:MAX_LISTED]


def _is_on_outline(design: Design, place: tuple[float, float], radius: float) -> bool:
    """Whether a disc of the touch face lies on a plate of a file; True for other plates."""
    disc = np.array(place) + radius * np.column_stack([np.cos(DISC), np.sin(DISC)])
    return design.outline is None or not design.outline.touch.beneath(disc)


def _fingertip(values: CaseValues) -> Fingertip:
    given: Any = values.tables.touch.impedance  # a table as the dictionary in the file
    if isinstance(given, str):
        if given not in FINGERTIPS:
            known = f"must be one of {', '.join(FINGERTIPS)} or a table{nearest(given, FINGERTIPS)}"
            values.diagnostics.add("touch.impedance", given, known)
        return FINGERTIPS.get(given, Fingertip("unknown"))
    stiffness, damping, mass = (float(given.get(name, 0.0)) for name in FingertipTable.model_fields)
    return Fingertip("given", stiffness, damping, GRAM * mass)


def _middle_antinode_m(design: Design) -> float:
    """Return x of the target mode's antinode nearest the centre of the zone; the centre for a rigid motion."""
    if design.half_wavelength_m is None:
        return design.centre_m[0]
    shape = zone_mode(design.nodal_lines, *design.goes_on)
    places = [round((share - 0.5) * design.length_m, 12) + 0.0 for share in antinodes(shape)]
    return min(places, key=lambda x: (round(abs(x), 9), -x)) + design.centre_m[0]


def _design(values: Values) -> Design:
    file = values.tables
    array = file.array
    pillars = tuple(pillar for row, form in values.rows if (pillar := _pillar(values, row, form)))
    pitches = tuple(MM * pitch for pitch in array.pitches_y_mm or ())
    layers = _layers(values)
    return Design(
        length_m=_metres(file.zone.length_mm),
        width_m=_metres(file.zone.width_mm),
        thickness_m=Stack(layers).thickness_m if layers else _metres(file.plate.thickness_mm),
        nodal_lines=file.zone.nodal_lines or 0,
        material=layers[-1].material if layers else values.materials[""],
        pillar=pillars[0] if pillars else None,
        pitch_x_m=_metres(array.pitch_x_mm),
        pitch_y_m=_metres(array.pitch_y_mm),
        rows=array.rows or 0,
        extension_m=MM * (array.extension_mm or 0.0),
        graded=pillars if len(set(pillars)) > 1 else (),
        graded_pitches_m=pitches if len(set(pitches)) > 1 else (),
        stagger=array.stagger or False,
        layers=layers if len(layers) > 1 else (),
        **_zones(values),
        **_around(file, values.outline),
        oblique_m=_oblique_m(file),
    )


def _oblique_m(file: Tables) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return the shortest vectors of a lattice without rows as pitches give them, m."""
    vectors = oblique_mm(file)
    if vectors is None:
        return None
    (x1, y1), (x2, y2) = vectors
    return (MM * x1, MM * y1), (MM * x2, MM * y2)


def _around(file: Tables, outline: Outline | None) -> dict[str, Any]:
    """Return the size of a plate larger than zone and rows, and the place of the zone on it; none for other plates."""
    if file.plate.length_mm is None or file.plate.width_mm is None:
        return {}
    (x, y), *others = file.zone.places_mm
    larger = outline.size_m if outline else (MM * file.plate.length_mm, MM * file.plate.width_mm)
    placed = {"centre_m": (MM * x, MM * y), "surround": bool(file.array.surround), "outline": outline}
    return {"larger_m": larger, **placed, "others_m": tuple((MM * x, MM * y) for x, y in others)}


def _air(values: Values) -> Air | None:
    """Return the air before the plate, None without the table."""
    table = values.tables.air
    if "air" not in values.tables.present:
        return None
    return Air(table.density_kg_m3, table.sound_m_s, 2 if table.faces == "both" else 1)


def _check_losses(values: Values, design: Design, patches: Patches | None) -> None:
    """Raise InputError for each material without the loss that the case takes from its materials."""
    if values.tables.damping.quality != "materials":
        return
    lossy: list[tuple[str, float | None]] = [(each.name, each.loss_factor) for each in design.materials]
    if patches:
        lossy.append((patches.material.name, patches.material.loss_factor))
    if patches and patches.glue:
        lossy.append((patches.glue.material.name, patches.glue.material.loss_factor))
    for name in dict.fromkeys(name for name, factor in lossy if factor is None):
        values.diagnostics.add("damping.quality", "materials", f"material {name} has no loss_factor: give it one")
    values.diagnostics.stop()


def _layers(values: Values) -> tuple[Layer, ...]:
    """Return the plate's layers, those of one material that touch as one; none for a plate without [[plate.layer]]."""
    named = (values.materials[f"plate.layer.{number}"] for number in range(len(values.layers_mm)))
    given = (Layer(material, MM * each) for material, each in zip(named, values.layers_mm, strict=True))
    return Stack.of_layers(given).layers


def _metres(length_mm: float | None) -> float:
    """Return a length in m; NaN if the file has none."""
    return nan if length_mm is None else MM * length_mm


def _zones(values: Values) -> dict[str, Any]:
    """Return the number of zones, the rows between them, and the gap between their borders in m."""
    zone = values.tables.zone
    if (zone.count or 1) == 1:
        return {}
    gap = zone.gap_mm or span_mm(values.tables, values.rows[0][1])
    return {"zones": zone.count, "shared_rows": zone.shared_rows or 0, "zone_gap_m": _metres(gap or None)}


def _pillar(values: Values, row: Tables, form: PillarShape | None) -> Pillar | None:
    if form is None:
        return None
    known = values.materials
    usual = known.get("pillar", known.get("")) or known["pillar.section.0"]
    material = known.get("pillar.section.0", usual)
    height, fillet = form.height_m(_metres(row.pillar.height_mm)), MM * row.pillar.fillet_mm
    more: dict[str, Any] = {"file": form.file, "more_m": form.more_m, "upper": _upper(values, usual)}
    more["faces"] = 2 if row.pillar.faces == "both" else 1
    return Pillar(form.name, form.width_m, form.tip_m, height, material, fillet, **more)


def _upper(values: Values, usual: Material) -> tuple[Section, ...]:
    """Return the sections above the first one, of the usual material unless they have their own."""
    return tuple(
        Section(
            (form := each.form).name,
            form.width_m,
            form.tip_m,
            MM * each.height_mm,
            values.materials.get(each.owner, usual),
            form.more_m,
        )
        for each in values.tables.upper
    )


def _measured(values: Values, source: Path | None) -> MeasuredFiles | None:
    table = values.tables.measured
    if "measured" not in values.tables.present:
        return None
    paths: dict[str, Path | None] = {}
    for name, given in (("sweep", table.sweep), ("map", table.map)):
        paths[name] = path = None if given is None else (source.parent if source else Path()) / given
        if path is not None and not is_file(path):
            values.diagnostics.add(f"measured.{name}", given, f"no such file {path}{nearest_file(path)}")
    place = table.at_mm
    return MeasuredFiles(paths["sweep"], paths["map"], (MM * place[0], MM * place[1]) if place else None)


def _cell_file(values: Values, source: Path | None) -> str | None:
    """Return the path of the cell's STEP file; a missing one is a fault."""
    given = values.tables.cell.file if "cell" in values.tables.present else None
    if given is None:
        return None
    path = (source.parent if source else Path()) / given
    if not is_file(path):
        values.diagnostics.add("cell.file", given, f"no such file {path}{nearest_file(path)}")
    return str(path)


def _solve(table: SolveTable) -> SolveTable:
    """Return the table with its band as a tuple, so that a case can be hashed."""
    return table.but(band_kHz=table.band_kHz and tuple(table.band_kHz))


def _bands(table: BandsTable, design: Design) -> BandsTable:
    """Return the table with the default path of the cell if none is given."""
    if isnan(design.pitch_x_m):
        own = "GXMG"
    else:
        of_pillar = design.lattice.is_triangular or design.oblique_m
        own = design.lattice.border(design.zone_mirrors if of_pillar else design.stack.mirrors)
    return table.but(path=table.path or own or design.lattice.default_path)


def _plain(value: Any) -> Any:
    """Convert dataclasses, tables, tuples and numbers to JSON; NaN (not given) is null; no sources of constants."""
    if isinstance(value, Material):
        return _plain(value.stated)
    if isinstance(value, Layer):
        return _plain(value._asdict())
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: _plain(getattr(value, f.name)) for f in fields(value) if f.name != "source"}
    if isinstance(value, Table):
        return _plain(value.in_si())
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not isfinite(value):
        return None
    return value
