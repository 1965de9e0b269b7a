"""The case file: one frozen, validated scene; units turned to SI here and nowhere else."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from math import isfinite, isnan, nan, pi
from pathlib import Path
from typing import Any

from geometry import lattice
from geometry.layout import Design, Patches, Pillar, Tip
from geometry.materials import Material
from geometry.pillar_shapes.base import PillarShape
from pipeline.case.attachments import Touch, read_patches, read_touch
from pipeline.case.checks import one_table, span_mm
from pipeline.case.diagnostics import nearest_file
from pipeline.case.reading import INSTEAD, apply_overrides, is_file, one_kind, parse_override, read_toml, read_values
from pipeline.case.reading import CaseValues as Values
from pipeline.case.schema import BandsTable, SolveTable, Table, Tables, ToleranceTable
from pipeline.errors import InputError
from pipeline.units import MM
from solvers.measures.confinement import target_symmetry

Override = str | tuple[str, Any]

SUCH_AS = {  # a table that few cases have: one to begin with
    "patches": ", such as --set \"patches={material='pz26', size_mm=[12.0, 3.0, 0.3]}\"",
    "tolerance": ', such as --set "tolerance={height_mm=0.05}"',
    "touch": ', such as --set "touch={radius_mm=5.0}"',
}


@dataclass(frozen=True)
class MeasuredFiles:
    """What was measured of the plate: the paths of a sweep and of a map, and where the sweep's laser stood, m."""

    sweep: Path | None
    map: Path | None
    at_m: tuple[float, float] | None

    def to_dict(self) -> dict[str, Any]:
        """Names and SHA-256 of the files, and the place."""
        plain: dict[str, Any] = {"at_m": _plain(self.at_m)}
        for name, path in (("sweep", self.sweep), ("map", self.map)):
            if path is not None:
                plain |= {name: path.name, f"{name}_sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
        return plain


@dataclass(frozen=True)
class Case:
    """One scene in SI, with defaults. Lengths of tables that the file does not have are NaN: ask `require` first.

    raw, overrides: the parsed file and what was set in it, from which other designs of the same file are made.
    """

    name: str
    source: Path | None
    design: Design
    solve: SolveTable
    bands: BandsTable
    quality_factor: float
    patches: Patches | None
    given: frozenset[str]
    tolerance: ToleranceTable | None = None
    measured: MeasuredFiles | None = None
    touch: Touch | None = None
    raw: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)
    overrides: tuple[Override, ...] = field(default=(), repr=False, compare=False)

    @property
    def target_symmetry(self) -> str | None:
        """Mirror signs of u_z in the target mode, x then y: N nodes are even when N is.

        None without a zone, and where the plate is not its own mirror image: its modes have no such signs.
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
        """The case with other values of dotted keys, in the file's units. InputError for what cannot be built."""
        return case_from_dict(self.raw, self.source, [*self.overrides, *changes.items()]) if changes else self

    def require(self, *keys: str, command: str = "this command") -> None:
        """InputError naming every table or dotted key that the command needs and the file lacks.

        "array.pitch_mm" is also met by pitch_x_mm with pitch_y_mm.
        """
        lacking = [key for key in keys if key not in self.given]
        where = self.source if self.source is not None else self.name
        if lacking:
            visible = [
                (key if "." in key else f"[{key}]", f"{command} needs it{SUCH_AS.get(key, '')}") for key in lacking
            ]
            raise InputError(f"{where}: {name}: missing, {why}" for name, why in visible)

    def require_plate(self, command: str = "this command", several: bool = False) -> None:
        """InputError unless a finite plate is described: [plate], [zone] and, with pillars, array.rows; one zone unless
        `several` may be.
        """
        if self.design.zones > 1 and not several:
            where, count = self.source if self.source is not None else self.name, self.design.zones
            what = f"{command} is of one zone alone, must be 1 (antinode crosstalk takes several)"
            raise InputError(f"{where}: zone.count = {count}: {what}")
        self.require("plate", "zone", *(("array.rows",) if "pillar" in self.given else ()), command=command)

    def require_one_kind(self, command: str) -> None:
        """InputError for rows that differ, which no unit cell and no lone pillar stands for: each kind by its own keys."""
        if self.design.is_graded:
            where = self.source if self.source is not None else self.name
            lists = " and ".join(key for key in INSTEAD if key in self.given)
            example = " ".join(f"--set {text}" for text in one_kind(self.design))
            what = f"rows differ, {command} of one kind of row alone: ask for each in turn, such as {example}"
            raise InputError(f"{where}: {lists}: {what}")

    def path(self, points: int) -> lattice.Path:
        """The path of its bands, `points` intervals per segment. InputError for points that its lattice does not have."""
        own, labels = self.design.lattice, self.bands.path
        try:
            return own.path(labels, points)
        except ValueError as fault:
            what = f"must be of the points {', '.join(own.high_symmetry)} of its {own.name} lattice"
            example = f"such as {own.default_path}"
            raise InputError(f"{self.source or self.name}: bands.path = {labels}: {what}, {example}") from fault

    def to_dict(self) -> dict[str, Any]:
        """Everything that influences results as plain JSON in SI; a STEP file by its name and SHA-256."""
        plain: dict[str, Any] = {
            name: _plain(getattr(self, name)) for name in ("design", "solve", "bands", "quality_factor", "patches")
        }
        if self.tolerance:
            plain["tolerance"] = _plain(self.tolerance)
        if self.touch:
            plain["touch"] = _plain(self.touch)
        if self.measured:
            plain["measured"] = self.measured.to_dict()
        pillar, shape = self.design.pillar, plain["design"]
        for key in ("graded", "graded_pitches_m", "stagger"):
            if not shape[key]:
                del shape[key]
        if self.design.zones == 1:
            for key in ("zones", "shared_rows", "zone_gap_m"):
                del shape[key]
        for each in (shape["pillar"], *shape.get("graded", ())) if pillar else ():
            each |= dict(each.pop("more_m"))
            for key, usual in (("tip", None), ("faces", 1)):
                if each[key] == usual:
                    del each[key]
        if pillar and pillar.file:
            plain["design"]["pillar"]["file"] = Path(pillar.file).name
            plain["design"]["pillar"]["file_sha256"] = hashlib.sha256(Path(pillar.file).read_bytes()).hexdigest()
        return plain


def load_case(path: str | Path, overrides: Iterable[Override] = ()) -> Case:
    """The case of a TOML file with overrides, "key.path=value" or (key, value); InputError with one line for every fault."""
    file = Path(path)
    return case_from_dict(read_case(file), source=file, overrides=overrides)


def read_case(file: Path) -> dict[str, Any]:
    """The tables of a case file as written; InputError for a study file and what read_toml refuses."""
    raw = read_toml(file)
    if isinstance(raw.get("study"), dict):
        raise InputError(
            f"{file}: a study file with a [study] table, must be a case file; antinode run {file} computes it"
        )
    return raw


def case_from_dict(raw: dict[str, Any], source: Path | None = None, overrides: Iterable[Override] = ()) -> Case:
    """The case of a parsed file; STEP paths are taken from the folder of `source`. InputError as load_case."""
    given = tuple(overrides)
    settings = parsed(given)
    raw = one_table(raw, str(source) if source is not None else "case")
    values = read_values(apply_overrides(raw, settings), source, [key for key, _ in settings])
    patches, touch, measured = None, None, _measured(values, source)
    attached = {"patches", "touch"} & values.tables.present
    if attached and not values.diagnostics.touch("material", "plate", "zone", "pillar", "tip", "array"):
        design = _design(values)
        patches, touch = read_patches(values, design), read_touch(values, design)
    values.diagnostics.stop()
    design = _design(values)
    return Case(
        name=values.name,
        source=source,
        design=design,
        solve=_solve(values.tables.solve),
        bands=_bands(values.tables.bands, design),
        quality_factor=values.tables.damping.quality,
        patches=patches,
        given=values.given,
        tolerance=values.tables.tolerance if "tolerance" in values.tables.present else None,
        measured=measured,
        touch=touch,
        raw=raw,
        overrides=given,
    )


def parsed(overrides: Iterable[Override]) -> list[tuple[str, Any]]:
    """Overrides as keys and values. InputError, one line a fault, for texts that are none."""
    settings, lines = [], []
    for given in overrides:
        try:
            settings.append(parse_override(given) if isinstance(given, str) else given)
        except InputError as error:
            lines += error.lines
    if lines:
        raise InputError(lines)
    return settings


def _design(values: Values) -> Design:
    file = values.tables
    array = file.array
    pillars = tuple(pillar for row, form in values.rows if (pillar := _pillar(values, row, form)))
    pitches = tuple(MM * pitch for pitch in array.pitches_y_mm or ())
    return Design(
        length_m=_metres(file.zone.length_mm),
        width_m=_metres(file.zone.width_mm),
        thickness_m=_metres(file.plate.thickness_mm),
        nodal_lines=file.zone.nodal_lines or 0,
        material=values.materials[""],
        pillar=pillars[0] if pillars else None,
        pitch_x_m=_metres(array.pitch_x_mm),
        pitch_y_m=_metres(array.pitch_y_mm),
        rows=array.rows or 0,
        extension_m=MM * (array.extension_mm or 0.0),
        graded=pillars if len(set(pillars)) > 1 else (),
        graded_pitches_m=pitches if len(set(pitches)) > 1 else (),
        stagger=array.stagger or False,
        **_zones(values),
    )


def _metres(length_mm: float | None) -> float:
    """A length in m; NaN where the file has none."""
    return nan if length_mm is None else MM * length_mm


def _zones(values: Values) -> dict[str, Any]:
    """How many zones, the rows between them, and the distance of their borders in m."""
    zone = values.tables.zone
    if (zone.count or 1) == 1:
        return {}
    gap = zone.gap_mm or span_mm(values.tables, values.rows[0][1])
    return {"zones": zone.count, "shared_rows": zone.shared_rows or 0, "zone_gap_m": _metres(gap or None)}


def _pillar(values: Values, row: Tables, form: PillarShape | None) -> Pillar | None:
    if form is None:
        return None
    material = values.materials.get("pillar", values.materials[""])
    height, fillet = form.height_m(_metres(row.pillar.height_mm)), MM * row.pillar.fillet_mm
    more: dict[str, Any] = {"file": form.file, "more_m": form.more_m, "tip": _tip(values, material)}
    more["faces"] = 2 if row.pillar.faces == "both" else 1
    return Pillar(form.name, form.width_m, form.tip_m, height, material, fillet, **more)


def _tip(values: Values, pillar: Material) -> Tip | None:
    """The heavy tip, of the pillar's material where it has none of its own; None where its height is 0."""
    tip = values.tables.tip
    return Tip(MM * tip.side_mm, MM * tip.height_mm, values.materials.get("tip", pillar)) if tip.height_mm else None


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


def _solve(table: SolveTable) -> SolveTable:
    """The table with its band as a tuple, so that a case can be hashed."""
    return table.but(band_kHz=table.band_kHz and tuple(table.band_kHz))


def _bands(table: BandsTable, design: Design) -> BandsTable:
    """The table with the path that the cell has where none is given."""
    own = "GXMG" if isnan(design.pitch_x_m) else design.lattice.border(design.stack.mirrors)
    return table.but(path=table.path or own or design.lattice.default_path)


def _plain(value: Any) -> Any:
    """Dataclasses, tables, tuples and numbers as JSON; NaN (nothing given) as null; sources of constants left out."""
    if isinstance(value, Material):
        return _plain(value.stated)
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
