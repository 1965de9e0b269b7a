"""The case file as written: tables, keys, units and permitted values, and the tables as keyword arguments."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypedDict

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model
from pydantic.json_schema import models_json_schema

from geometry.fingertips import FINGERTIPS
from geometry.lattice import KNOWN, labels_of
from geometry.materials import USUAL_C
from geometry.pillar_shapes import SHAPES, PillarShape, in_words
from pipeline.case import limits
from pipeline.case.limits import LENGTH_MM, Range, span
from pipeline.quantity import KHZ, MM

ABOVE_0 = "a finite number above 0"
NOT_NEGATIVE = "a finite number of 0 or more"

FINGERTIP_ALLOWED = (
    f"the name of a fingertip ({', '.join(FINGERTIPS)}) or a table with stiffness_N_per_m, damping_Ns_per_m and mass_g, "
    f"{span(limits.IMPEDANCE)}"
)

Coordinate = Annotated[float, Field(ge=-LENGTH_MM[1], le=LENGTH_MM[1])]
Place = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Frequency = Annotated[float, Field(ge=0, le=limits.FREQUENCY_KHZ[1])]
Gap = Annotated[float, Field(ge=limits.GAP_UM[0], le=limits.GAP_UM[1])]
Extent = Annotated[float, Field(ge=LENGTH_MM[0], le=LENGTH_MM[1])]
RowLengths = Annotated[list[Extent], Field(min_length=1, max_length=1000)]
ONE_A_ROW = f"a list of numbers above 0, {span(LENGTH_MM)}, one per row from the zone outwards"
SIZE_KEYS = tuple(dict.fromkeys(key for shape in SHAPES.values() for key in shape.keys))  # keys of every pillar shape
MATERIAL_OWNERS = ("", "pillar")  # tables that may contain a material; "" is the top level of the file
MATERIAL_ALLOWED = (
    "the name of a material or a table with density_kg_m3 and young_GPa with poisson, cubic_GPa, orthotropic or C_GPa"
)
SECTIONS_ALLOWED = (
    "tables [[pillar.section]] of height_mm, material and the keys of a shape where it differs from the one below, from the "
    "foot up"
)
GLUE_ALLOWED = "a table {material, thickness_mm} of the layer between patches and plate"
DEFECTS_ALLOWED = "tables [[defect]] of at = [i, j], a cell of the supercell, and remove = true or keys of [pillar]"
VECTOR_ALLOWED = "two numbers [x, y], a lattice vector"
LAYERS_ALLOWED = "tables [[plate.layer]] of material and thickness_mm, from the touch face to the back"
PLACE = f"two numbers [x, y] within {LENGTH_MM[1]:g} mm of"
FROM_CENTRE = "from the plate's centre"
ATTACHED_ALLOWED = "tables [[cell.attached]] of at_mm = [x, y] with mass_g, stiffness_N_per_m or both"
SUPPORTS_ALLOWED = "tables [[support]] of kind with edge, or with at_mm and radius_mm"
NAME_ALLOWED = "a text of 1 to 100 characters without slashes or control characters"

Numbers = Iterable[float]  # lists, tuples, arrays
GivenMaterial = str | dict[str, Any]  # a name, or density_kg_m3 with the constants of a law


class Table(BaseModel):
    """A table of the file: no unknown keys, implicit conversions, NaN or infinity."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_"):
                return super().__getattr__(name)
            near = get_close_matches(name, type(self).model_fields, n=1)
            raise AttributeError(f"no such key: {name}{f' (did you mean {near[0]}?)' if near else ''}")

    def but(self, **changes: Any) -> Self:
        """Return the table with other values of some keys, unchecked."""
        return self.model_copy(update=changes)

    def in_si(self) -> dict[str, Any]:
        """Return every key in SI by the name of its property, such as band_hz for band_kHz."""
        names = (name.replace("_mm", "_m").replace("_kHz", "_hz") for name in type(self).model_fields)
        return {name: getattr(self, name) for name in names}


def positive(within: Range, **more: Any) -> Any:
    """Declare a number within limits, required unless it has a default."""
    return Field(ge=within[0], le=within[1], description=f"{ABOVE_0}, {span(within)}", **more)


def optional(within: Range) -> Any:
    """Declare an optional number within limits, None if left out."""
    return positive(within, default=None)


def optional_from_0(within: Range) -> Any:
    """Declare an optional number of 0 or more, None if left out."""
    return Field(default=None, ge=0.0, le=within[1], description=f"{NOT_NEGATIVE}, at most {within[1]:g}")


def either(within: Range, **more: Any) -> Any:
    """Declare a number of either sign within limits."""
    return Field(ge=within[0], le=within[1], description=f"a number, {span(within)}", **more)


Modulus = Annotated[float, Field(ge=limits.YOUNG_GPA[0], le=limits.YOUNG_GPA[1])]
Ratio = Annotated[float, Field(ge=limits.POISSON_RATIO[0], le=limits.POISSON_RATIO[1])]
Stiffness = Annotated[float, Field(ge=-limits.YOUNG_GPA[1], le=limits.YOUNG_GPA[1])]
Six = Annotated[list[Stiffness], Field(min_length=6, max_length=6)]
Angle = Annotated[float, Field(ge=limits.ANGLE_DEG[0], le=limits.ANGLE_DEG[1])]
NINE = ("E1_GPa", "E2_GPa", "E3_GPa", "nu12", "nu13", "nu23", "G12_GPa", "G13_GPa", "G23_GPa")


class CubicTable(Table):
    C11: Modulus
    C12: Stiffness
    C44: Modulus


OrthotropicTable: type[Table] = create_model(
    "OrthotropicTable",
    __base__=Table,
    **{key: (Ratio if key.startswith("nu") else Modulus, ...) for key in NINE},  # type: ignore[call-overload]
)


SpectrumRow = Annotated[list[float], Field(min_length=3, max_length=3)]


class ZenerTable(Table):
    relaxed_GPa: Modulus
    unrelaxed_GPa: Modulus
    time_s: float = positive(limits.RELAXATION_S)
    order: float = positive(limits.ORDER)


class MaterialTable(Table):
    density_kg_m3: float = positive(limits.DENSITY_KG_M3)
    young_GPa: float | None = optional(limits.YOUNG_GPA)
    poisson: float | None = Field(
        default=None,
        ge=-1.0 + limits.POISSON_MARGIN,
        le=0.5 - limits.POISSON_MARGIN,
        description=f"a number between -1 and 0.5, both excluded and {limits.POISSON_MARGIN:g} away",
    )
    cubic_GPa: CubicTable | None = Field(default=None, description="a table {C11, C12, C44} in GPa")
    orthotropic: OrthotropicTable | None = Field(  # type: ignore[valid-type]
        default=None, description=f"a table {{{', '.join(NINE)}}}, moduli {span(limits.YOUNG_GPA)}"
    )
    C_GPa: Annotated[list[Six], Field(min_length=6, max_length=6)] | None = Field(
        default=None, description="six rows of six numbers in GPa, over xx, yy, zz, yz, xz, xy"
    )
    young_GPa_at: Annotated[list[SpectrumRow], Field(min_length=2, max_length=limits.MAX_SPECTRUM)] | None = Field(
        default=None,
        description=f"2 to {limits.MAX_SPECTRUM} rows [Hz, GPa, loss factor] in order of rising frequency",
    )
    zener: ZenerTable | None = Field(
        default=None,
        description=f"a table {{relaxed_GPa, unrelaxed_GPa, time_s, order}}, moduli {span(limits.YOUNG_GPA)}, time "
        f"{span(limits.RELAXATION_S)} s, order {span(limits.ORDER)}",
    )
    axes_deg: Annotated[list[Angle], Field(min_length=3, max_length=3)] | None = Field(
        default=None,
        description="three angles [phi, theta, psi] about z, the new x and the new z, "
        f"each {span(limits.ANGLE_DEG)} degrees",
    )
    loss_factor: float | None = Field(
        default=None,
        ge=limits.LOSS_FACTOR[0],
        le=limits.LOSS_FACTOR[1],
        description=f"{NOT_NEGATIVE}, {span(limits.LOSS_FACTOR)}",
    )
    dE_dT_per_K: float | None = either(limits.PER_KELVIN, default=None)
    expansion_per_K: float | None = either(limits.EXPANSION_PER_K, default=None)


class LayerTable(Table):
    thickness_mm: float = positive(LENGTH_MM)


class PlateTable(Table):
    thickness_mm: float = positive(LENGTH_MM)
    length_mm: float | None = optional(LENGTH_MM)
    width_mm: float | None = optional(LENGTH_MM)
    file: str | None = Field(default=None, min_length=1, description="the path of a STEP file")
    layer: None = Field(default=None, description=LAYERS_ALLOWED)  # read one by one, as their materials are


def whole(low: int, high: int, **more: Any) -> Any:
    """Declare a whole number."""
    return Field(ge=low, le=high, description=f"a whole number from {low} to {high}", **more)


AXES = ("zone.centre_x_mm", "zone.centre_y_mm")


class ZoneTable(Table):
    length_mm: float = positive(LENGTH_MM)
    width_mm: float = positive(LENGTH_MM)
    nodal_lines: int = whole(0, limits.MAX_NODAL_LINES)
    count: int = whole(1, limits.MAX_ZONES, default=1)
    shared_rows: int = whole(0, 1000, default=0)
    gap_mm: float | None = optional(LENGTH_MM)
    centre_mm: Place | None = Field(default=None, description=f"{PLACE} the plate's centre")
    centre_x_mm: Coordinate | None = Field(default=None, description=f"a number, {FROM_CENTRE}")
    centre_y_mm: Coordinate | None = Field(default=None, description=f"a number, {FROM_CENTRE}")
    centres_mm: Annotated[list[Place], Field(min_length=2, max_length=limits.MAX_ZONES)] | None = Field(
        default=None, description=f"a list of 2 to {limits.MAX_ZONES} centres [x, y], {FROM_CENTRE}"
    )

    @property
    def places_mm(self) -> list[list[float]]:
        """Centre of every zone, [0, 0] where none is given."""
        return self.centres_mm or [self.centre_mm or [self.centre_x_mm or 0.0, self.centre_y_mm or 0.0]]


def _zero_or(within: Range) -> AfterValidator:
    """Reject a value that is neither 0 nor within the limits."""

    def check(value: float) -> float:
        if value != 0.0 and not within[0] <= value <= within[1]:
            raise ValueError("out of range")
        return value

    return AfterValidator(check)


Length = Annotated[float, _zero_or(LENGTH_MM), Field(description=f"{NOT_NEGATIVE}: 0, or {span(LENGTH_MM)}")]


class ArrayTable(Table):
    pitch_mm: float | None = optional(LENGTH_MM)
    pitch_x_mm: float | None = optional(LENGTH_MM)
    pitch_y_mm: float | None = optional(LENGTH_MM)
    rows: int | None = whole(0, 1000, default=None)
    heights_mm: RowLengths | None = Field(default=None, description=ONE_A_ROW)
    sides_mm: RowLengths | None = Field(default=None, description=ONE_A_ROW)
    pitches_y_mm: RowLengths | None = Field(default=None, description=ONE_A_ROW)
    stagger: bool = Field(default=False, description="true or false")
    lattice: Literal["square", "rectangular", "staggered", "triangular"] | None = Field(
        default=None, description="square, rectangular, staggered or triangular"
    )
    a1_mm: Place | None = Field(default=None, description=VECTOR_ALLOWED)
    a2_mm: Place | None = Field(default=None, description=VECTOR_ALLOWED)
    extension_mm: Length = 0.0
    surround: bool = Field(default=False, description="true or false")


class SolveTable(Table):
    band_kHz: Annotated[list[Frequency], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description=f"two numbers [low, high], 0 <= low < high, high {span(limits.FREQUENCY_KHZ)}"
    )
    near_kHz: float | None = optional(limits.FREQUENCY_KHZ)
    count: int | None = whole(1, limits.MAX_MODES, default=None)
    accuracy: float = Field(
        default=0.003,
        ge=limits.ACCURACY[0],
        le=limits.ACCURACY[1],
        description=f"a number above 0, at most {limits.ACCURACY[1]:g} and at least {limits.ACCURACY[0]:g}",
    )
    model: Literal["auto", "analytic", "superelement", "solid"] = "auto"
    mesh: Literal["auto", "hex", "tet"] = "auto"
    temperature_C: float = either(limits.TEMPERATURE_C, default=USUAL_C)
    moduli_kHz: float | None = optional(limits.FREQUENCY_KHZ)

    @property
    def band_hz(self) -> tuple[float, float] | None:
        """Ends of the band, Hz."""
        return (KHZ * self.band_kHz[0], KHZ * self.band_kHz[1]) if self.band_kHz else None

    @property
    def near_hz(self) -> float | None:
        """Frequency near which modes are computed, Hz."""
        return None if self.near_kHz is None else KHZ * self.near_kHz

    @property
    def moduli_hz(self) -> float | None:
        """Frequency at which moduli are taken, Hz; None for that of each figure."""
        return None if self.moduli_kHz is None else KHZ * self.moduli_kHz


def text(allowed: str, **limits: Any) -> Any:
    """Declare an optional text, None by default."""
    return Field(default=None, description=allowed, **limits)


class BandsTable(Table):
    path: str = text(  # None until the cell is known
        f"at least two labels of the lattice's Brillouin zone, such as GXMG, and at most {limits.MAX_PATH}",
        pattern=rf"^({'|'.join(sorted(KNOWN, reverse=True))}){{2,{limits.MAX_PATH}}}$",
    )
    points: int = whole(1, 10_000, default=25)
    count: int = whole(1, 1000, default=10)
    grid: int = Field(default=0, ge=0, le=200, description="a whole number from 0 (path only) to 200")

    @property
    def segments(self) -> int:
        """Number of straight parts of the path."""
        return len(labels_of(self.path)) - 1


class DampingTable(Table):
    quality: Annotated[float, Field(gt=limits.QUALITY[0], le=limits.QUALITY[1])] | Literal["materials"] = Field(
        default=300.0,
        description=f'a number above 0.5 (at 0.5 nothing resonates), at most {limits.QUALITY[1]:g}, or "materials" '
        "(each material's own loss)",
    )


class AirTable(Table):
    density_kg_m3: float = positive(limits.FLUID_KG_M3, default=1.204)
    sound_m_s: float = positive(limits.SOUND_M_S, default=343.2)
    faces: Literal["touch", "both"] = "both"


class SupportTable(Table):
    kind: Literal["clamp", "simple", "foam", "spring", "mass"]
    edge: Literal["x-", "x+", "y-", "y+"] | None = Field(default=None, description="x-, x+, y- or y+")
    at_mm: Place | None = Field(default=None, description=f"{PLACE} the plate's centre")
    radius_mm: float | None = optional(LENGTH_MM)
    stiffness_N_per_m: float | None = optional_from_0(limits.STIFFNESS_N_M)
    stiffness_N_per_m2: float | None = optional_from_0(limits.STIFFNESS_N_M)
    damping_Ns_per_m: float | None = optional_from_0(limits.DAMPING_NS_M)
    mass_g: float | None = optional_from_0(limits.MASS_G)


class AttachedTable(Table):
    at_mm: Place = Field(description=f"{PLACE} the cell's centre")
    mass_g: float | None = optional_from_0(limits.MASS_G)
    stiffness_N_per_m: float | None = optional_from_0(limits.STIFFNESS_N_M)
    damping_Ns_per_m: float | None = optional_from_0(limits.DAMPING_NS_M)


class PatchesTable(Table):
    material: str = Field(default="pz26", description="the name of a piezo material")
    size_mm: Annotated[list[Extent], Field(min_length=3, max_length=3)] = Field(
        description=f"three numbers above 0, {span(LENGTH_MM)}, along x, y and z"
    )
    face: Literal["back", "touch"] = "back"
    at: Literal["antinodes"] | None = Field(default=None, description="antinodes (or give centres_mm instead)")
    centres_mm: Annotated[list[Place], Field(min_length=1, max_length=limits.MAX_PATCHES)] | None = Field(
        default=None,
        description=f"a list of [x, y], at least one, at most {limits.MAX_PATCHES}, "
        f"each within {LENGTH_MM[1]:g} mm of the plate's centre",
    )
    behind_mm: float | None = optional(LENGTH_MM)
    sensors: Annotated[list[Annotated[int, Field(ge=0)]], Field(max_length=limits.MAX_PATCHES)] = Field(
        default_factory=list, description="a list of patch numbers, counted from 0"
    )
    drive_V: float = positive(limits.VOLTS, default=1.0)
    circuit: Literal["short", "open"] = Field(
        default="short", description="short (a voltage drives the patches) or open (a charge does)"
    )
    glue: None = Field(default=None, description=GLUE_ALLOWED)  # read by itself, as its material is


def not_negative(within: Range) -> Any:
    """Declare a number of 0 or more, 0 if left out."""
    return Field(default=0.0, ge=within[0], le=within[1], description=f"{NOT_NEGATIVE}, {span(within)}")


class FingertipTable(Table):
    stiffness_N_per_m: float = not_negative(limits.IMPEDANCE)
    damping_Ns_per_m: float = not_negative(limits.IMPEDANCE)
    mass_g: float = not_negative(limits.IMPEDANCE)


class TouchTable(Table):
    impedance: str | FingertipTable = Field(default="finger", description=FINGERTIP_ALLOWED)
    at_mm: Place | None = Field(default=None, description=f"{PLACE} the plate's centre")
    radius_mm: float = positive(LENGTH_MM)
    force_N: float | None = optional(limits.FORCE_N)
    gap_um: Annotated[list[Gap], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description=f"two numbers [low, high], low <= high, {span(limits.GAP_UM)}"
    )
    limit_V: float | None = optional(limits.VOLTS)


class MaterialsTable(Table):  # keys are names of groups, read one by one
    pass


class CellTable(Table):
    file: str | None = text("the path of a STEP file", min_length=1)


class MeasuredTable(Table):
    sweep: str | None = text("the path of a CSV file", min_length=1)
    map: str | None = text("the path of a CSV file", min_length=1)
    at_mm: Place | None = Field(
        default=None, description=f"{PLACE} the plate's centre, the position of the sweep's laser"
    )


Deviation = Annotated[
    float, _zero_or(limits.DEVIATION_MM), Field(description=f"{NOT_NEGATIVE}: 0, or {span(limits.DEVIATION_MM)}")
]


class ToleranceTable(Table):
    height_mm: Deviation = 0.0
    side_mm: Deviation = 0.0
    position_mm: Deviation = 0.0
    young_percent: float = not_negative(limits.STIFFNESS_PERCENT)
    samples: int = whole(1, limits.MAX_SAMPLES, default=20)
    seed: int = whole(0, limits.MAX_SEED, default=1)

    @property
    def height_m(self) -> float:
        """Standard deviation of a pillar's height, m."""
        return MM * self.height_mm

    @property
    def side_m(self) -> float:
        """Standard deviation of a pillar's width, m."""
        return MM * self.side_mm

    @property
    def position_m(self) -> float:
        """Standard deviation of a pillar's position along x and along y, m."""
        return MM * self.position_mm

    @property
    def stiffness(self) -> float:
        """Relative standard deviation of a pillar's stiffness."""
        return self.young_percent / 100.0


@dataclass(frozen=True)
class UpperSection:
    """A valid section above a pillar's first one: number in the file from 0, shape, height, and the owner of its material."""

    number: int
    form: PillarShape
    height_mm: float
    owner: str


@dataclass
class Tables:
    """Tables of one file, with values in the units of the file.

    An absent key without a default is None; so is one of `faulty` (dotted), and each key of a table not `present`.
    `pitches_given` names the keys that set a pitch, () for none; None if one of them is faulty or there is no [array]. `upper`:
    the pillar's sections above the first one.
    """

    plate: PlateTable
    zone: ZoneTable
    pillar: Any  # with the keys of every registered shape
    array: ArrayTable
    solve: SolveTable
    bands: BandsTable
    damping: DampingTable
    air: AirTable
    patches: PatchesTable
    touch: TouchTable
    tolerance: ToleranceTable
    measured: MeasuredTable
    cell: CellTable
    materials: MaterialsTable
    present: frozenset[str]
    faulty: set[str] = field(default_factory=set)
    pitches_given: tuple[str, ...] | None = None
    upper: tuple[UpperSection, ...] = ()

    @classmethod
    def of(cls, found: dict[str, Table], faulty: set[str]) -> Tables:
        """Build from the tables found, with empty ones for the others."""
        empty = {name: model.model_construct(**dict.fromkeys(model.model_fields)) for name, model in TABLES.items()}
        tables: dict[str, Any] = empty | found
        return cls(**tables, present=frozenset(found), faulty=faulty)

    def get(self, key: str) -> Any:
        """Return the value of a dotted key."""
        table, _, name = key.partition(".")
        return getattr(getattr(self, table), name)

    def set(self, values: dict[str, Any]) -> None:
        """Set values of dotted keys."""
        for key, value in values.items():
            table, _, name = key.partition(".")
            setattr(self, table, getattr(self, table).but(**{name: value}))

    def knows(self, table: str, name: str) -> bool:
        """Whether the table is present and the key's value, or its absence, is valid."""
        return table in self.present and f"{table}.{name}" not in self.faulty


class Zone(TypedDict, total=False):
    """Active zone: a strip of length_mm along x and width_mm across; the target mode has nodal_lines nodes along x.

    On a plate larger than zone and rows its centre may be anywhere, at centre_mm from the plate's; centres_mm gives those of
    several equal zones.

    >>> from antinode import Zone
    >>> Zone(length_mm=115.5, width_mm=20.0, nodal_lines=8)["width_mm"]
    20.0
    """

    length_mm: float
    width_mm: float
    nodal_lines: int
    count: int
    shared_rows: int
    gap_mm: float
    centre_mm: list[float]
    centre_x_mm: float
    centre_y_mm: float
    centres_mm: list[list[float]]


class Pillar(TypedDict, total=False):
    """Pillar: shape with the sizes that it takes (mm), height_mm or sections, fillet_mm, faces, optional material.

    >>> from antinode import Pillar
    >>> Pillar(shape="round", diameter_mm=2.0, height_mm=6.3)
    {'shape': 'round', 'diameter_mm': 2.0, 'height_mm': 6.3}
    """

    shape: str
    side_mm: float
    diameter_mm: float
    base_mm: float
    tip_mm: float
    arm_mm: float
    file: str
    height_mm: float
    fillet_mm: float
    faces: Literal["back", "both"]
    material: GivenMaterial
    section: list[Section]


class Section(TypedDict, total=False):
    """Section of a pillar from the foot up: height_mm, material, and the keys of a shape where it differs from the one below.

    >>> from antinode import Pillar, Section
    >>> neck = Section(height_mm=2.0, material="silicone-rubber")
    >>> Pillar(side_mm=3.0, section=[neck, Section(height_mm=2.0, material="lead")])["section"][1]
    {'height_mm': 2.0, 'material': 'lead'}
    """

    shape: str
    side_mm: float
    diameter_mm: float
    base_mm: float
    tip_mm: float
    arm_mm: float
    height_mm: float
    material: GivenMaterial


class Array(TypedDict, total=False):
    """Rows of pillars on each side of the zone at pitch_mm (or pitch_x_mm, pitch_y_mm), and the margin extension_mm.

    surround: rows on all four sides of a zone within a larger plate.
    a1_mm and a2_mm give any lattice by its vectors. Rows that differ are given by lists from the zone outwards: heights_mm,
    sides_mm, pitches_y_mm. stagger shifts every other row by half a pitch.

    >>> from antinode import Array
    >>> Array(pitch_mm=4.0, rows=3, extension_mm=25.0)["rows"]
    3
    """

    pitch_mm: float
    pitch_x_mm: float
    pitch_y_mm: float
    rows: int
    heights_mm: Numbers
    sides_mm: Numbers
    pitches_y_mm: Numbers
    stagger: bool
    lattice: Literal["square", "rectangular", "staggered", "triangular"]
    a1_mm: Numbers
    a2_mm: Numbers
    extension_mm: float
    surround: bool


class Solve(TypedDict, total=False):
    """Requested modes and accuracy: band_kHz, or near_kHz with count; accuracy (relative), model, mesh, temperature_C,
    moduli_kHz.

    >>> from antinode import Solve
    >>> Solve(band_kHz=(30.0, 34.0), accuracy=0.003)["band_kHz"]
    (30.0, 34.0)
    """

    band_kHz: Numbers
    near_kHz: float
    count: int
    accuracy: float
    model: Literal["auto", "analytic", "superelement", "solid"]
    mesh: Literal["auto", "hex", "tet"]
    temperature_C: float
    moduli_kHz: float


class BandPath(TypedDict, total=False):
    """The table [bands]: path through the irreducible Brillouin zone, points (intervals per segment), count of bands.

    >>> from antinode import BandPath
    >>> BandPath(path="GXMG", points=25, count=10)["path"]
    'GXMG'
    """

    path: str
    points: int
    count: int
    grid: int


class Damping(TypedDict, total=False):
    """Losses: the quality factor of all modes, or "materials" for each material's own loss factor.

    >>> from antinode import Damping
    >>> Damping(quality=300.0)["quality"]
    300.0
    """

    quality: float | Literal["materials"]


class Air(TypedDict, total=False):
    """Air before the plate: density_kg_m3, sound_m_s, and the faces that radiate.

    >>> from antinode import Air
    >>> Air(faces="touch")
    {'faces': 'touch'}
    """

    density_kg_m3: float
    sound_m_s: float
    faces: Literal["touch", "both"]


class Patches(TypedDict, total=False):
    """Piezoelectric patches: material, size_mm along x, y and z, face, at or centres_mm, sensors, drive_V, circuit, glue.

    >>> from antinode import Patches
    >>> Patches(material="pz26", size_mm=(12.0, 3.0, 0.3), at="antinodes", sensors=(7,))["sensors"]
    (7,)
    """

    material: str
    size_mm: Numbers
    face: Literal["back", "touch"]
    at: Literal["antinodes"]
    centres_mm: Iterable[Numbers]
    behind_mm: float
    sensors: Iterable[int]
    drive_V: float
    circuit: Literal["short", "open"]
    glue: dict[str, Any]


class Scatter(TypedDict, total=False):
    """The table [tolerance]: scatter of pillars by height_mm, side_mm, position_mm and young_percent, samples, seed.

    >>> from antinode import Scatter
    >>> Scatter(height_mm=0.05, samples=20)["samples"]
    20
    """

    height_mm: float
    side_mm: float
    position_mm: float
    young_percent: float
    samples: int
    seed: int


class Finger(TypedDict, total=False):
    """The table [touch]: impedance (a name or a dictionary), at_mm, radius_mm, force_N with gap_um, the amplifier's limit_V.

    >>> from antinode import Finger
    >>> Finger(radius_mm=5.0, at_mm=(0.0, 0.0))["at_mm"]
    (0.0, 0.0)
    """

    impedance: str | dict[str, float]
    at_mm: Numbers
    radius_mm: float
    force_N: float
    gap_um: Numbers
    limit_V: float


def _pillar_table() -> type[Table]:
    """[pillar] with the keys of every registered shape."""
    named = Field(default=next(iter(SHAPES)), description=in_words())
    file = text("the path of a STEP file", min_length=1)
    keys: dict[str, Any] = {"shape": (Literal[tuple(SHAPES)], named)}
    for key in SIZE_KEYS:
        keys[key] = (float | None, optional(LENGTH_MM)) if key.endswith("_mm") else (str | None, file)
    keys |= {"height_mm": (float | None, optional(LENGTH_MM)), "fillet_mm": (Length, 0.0)}
    sections = Field(default=None, description=SECTIONS_ALLOWED)
    keys["section"] = (None, sections)  # read one by one, as their materials are
    faces = Field(
        default="back", description="back, or both: with their mirror images on the touch face beside the zone"
    )
    keys |= {"faces": (Literal["back", "both"], faces)}
    return create_model("PillarTable", __base__=Table, **keys)


def _section_table() -> type[Table]:
    """[[pillar.section]] with the keys of every shape that is drawn."""
    drawn = tuple(name for name, shape in SHAPES.items() if shape.has_height)
    keys: dict[str, Any] = {"shape": (Literal[drawn] | None, Field(default=None, description=" or ".join(drawn)))}
    keys |= {key: (float | None, optional(LENGTH_MM)) for key in SIZE_KEYS if key.endswith("_mm")}
    height = Field(default=None, description=f"{NOT_NEGATIVE}: 0 for none, or {span(LENGTH_MM)}")
    return create_model("SectionTable", __base__=Table, **keys, height_mm=(Length | None, height))


def _defect_table() -> type[Table]:
    """[[defect]] with the keys of [pillar] that a single pillar may have of its own."""
    place = Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=2, max_length=2)]
    keys: dict[str, Any] = {
        "at": (place, Field(description="two whole numbers [i, j], a cell of the supercell from 0")),
        "remove": (bool, Field(default=False, description="true or false")),
    }
    own = {name: field for name, field in TABLES["pillar"].model_fields.items() if name != "section"}
    keys |= {name: (field.annotation, field) for name, field in own.items()}
    return create_model("DefectTable", __base__=Table, **keys)


SectionTable = _section_table()
TABLES: dict[str, type[Table]] = {
    "plate": PlateTable,
    "zone": ZoneTable,
    "pillar": _pillar_table(),
    "array": ArrayTable,
    "solve": SolveTable,
    "bands": BandsTable,
    "damping": DampingTable,
    "air": AirTable,
    "patches": PatchesTable,
    "touch": TouchTable,
    "tolerance": ToleranceTable,
    "measured": MeasuredTable,
    "materials": MaterialsTable,
    "cell": CellTable,
}


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of the case file (draft 2020-12), for completion and validation in editors."""
    models: list[type[BaseModel]] = [
        *TABLES.values(),
        MaterialTable,
        SectionTable,
        DefectTable,
        SupportTable,
        AttachedTable,
    ]
    references, root = models_json_schema([(model, "validation") for model in models])
    of = {model: references[model, "validation"] for model in models}
    material = {"anyOf": [{"type": "string"}, of[MaterialTable]], "description": MATERIAL_ALLOWED}
    tables: dict[str, Any] = {name: of[model] for name, model in TABLES.items()}
    tables["zone"] = {"anyOf": [tables["zone"], {"type": "array", "items": {"type": "object"}}]}
    layer = {"type": "object", "properties": {"material": material, "thickness_mm": {"type": "number"}}}
    root["$defs"]["PlateTable"]["properties"]["layer"] = {
        "type": "array", "items": layer | {"required": ["material", "thickness_mm"]}, "description": LAYERS_ALLOWED
    }  # fmt: skip
    root["$defs"]["PlateTable"]["required"] = []
    root["$defs"]["PatchesTable"]["properties"]["glue"] = layer | {"description": GLUE_ALLOWED}
    root["$defs"]["SectionTable"]["properties"]["material"] = material
    root["$defs"]["MaterialsTable"]["additionalProperties"] = material
    root["$defs"]["PillarTable"]["properties"]["section"] = {
        "type": "array", "items": of[SectionTable], "description": SECTIONS_ALLOWED
    }  # fmt: skip
    for owner in filter(None, MATERIAL_OWNERS):
        root["$defs"][TABLES[owner].__name__]["properties"]["material"] = material
    root["$defs"]["CellTable"]["properties"]["attached"] = {
        "type": "array", "items": of[AttachedTable], "description": ATTACHED_ALLOWED
    }  # fmt: skip
    tables["support"] = {"type": "array", "items": of[SupportTable], "description": SUPPORTS_ALLOWED}
    root["$defs"]["DefectTable"]["properties"]["material"] = material
    defects = {"type": "array", "items": of[DefectTable], "description": DEFECTS_ALLOWED}
    top = {"name": {"type": "string", "description": NAME_ALLOWED}, "material": material, "defect": defects}
    dialect = "https://json-schema.org/draft/2020-12/schema"
    return {"$schema": dialect, "type": "object", "properties": top | tables, "additionalProperties": False, **root}


DefectTable = _defect_table()
LISTS: dict[str, type[Table]] = {
    "plate.layer": LayerTable,
    "pillar.section": SectionTable,
    "defect": DefectTable,
    "support": SupportTable,
    "cell.attached": AttachedTable,
}


def of_any_element(key: str) -> str:
    """Return a key of an element of a list of tables as that of the first element, any other key as it is."""
    return re.sub(rf"^({'|'.join(map(re.escape, LISTS))})\.\d{{1,4}}\.", r"\1.0.", key, flags=re.ASCII)


def known_keys() -> list[str]:
    """Return every dotted key of a case file, such as pillar.side_mm."""
    owners = [f"{owner}.material".lstrip(".") for owner in MATERIAL_OWNERS]
    constants = [*MaterialTable.model_fields]
    constants += [f"cubic_GPa.{key}" for key in CubicTable.model_fields] + [f"orthotropic.{key}" for key in NINE]
    keys = ["name", "defect", *owners, *(f"{owner}.{key}" for owner in owners for key in constants)]
    keys += [f"{name}.0.{key}" for name, model in LISTS.items() for key in model.model_fields]
    keys += [f"{name}.0.material" for name in LISTS if name not in ("support", "cell.attached")]
    keys += ["patches.glue.material", "patches.glue.thickness_mm"]
    keys += [f"touch.impedance.{key}" for key in FingertipTable.model_fields]
    keys += [f"{table}.{key}" for table, model in TABLES.items() for key in model.model_fields]
    return sorted(set(keys))
