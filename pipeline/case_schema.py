"""The case file as written: its tables, keys, units and what each value may be."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

ABOVE_0 = "a finite number above 0"
NOT_NEGATIVE = "a finite number of 0 or more"


def _number(allowed: str, **limits: Any) -> Any:
    return Field(default=None, description=allowed, **limits)


def _needed(allowed: str, **limits: Any) -> Any:
    return Field(description=allowed, **limits)


class Table(BaseModel):
    """A table of the file: unknown keys refused, no silent conversion, no NaN, no infinity."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class MaterialTable(Table):
    young_GPa: float = _needed(ABOVE_0, gt=0)
    density_kg_m3: float = _needed(ABOVE_0, gt=0)
    poisson: float = _needed("a number between -1 and 0.5, both excluded", gt=-1, lt=0.5)


class PlateTable(Table):
    thickness_mm: float = _needed(ABOVE_0, gt=0)


class ZoneTable(Table):
    length_mm: float = _needed(ABOVE_0, gt=0)
    width_mm: float = _needed(ABOVE_0, gt=0)
    nodal_lines: int = _needed("a whole number from 0 to 1000", ge=0, le=1000)


class PillarTable(Table):
    shape: Literal["square", "round", "tapered", "step"] = Field(
        default="square", description="square, round, tapered or step"
    )
    side_mm: float | None = _number(ABOVE_0, gt=0)
    diameter_mm: float | None = _number(ABOVE_0, gt=0)
    base_mm: float | None = _number(ABOVE_0, gt=0)
    tip_mm: float | None = _number(ABOVE_0, gt=0)
    file: str | None = Field(default=None, min_length=1, description="the path of a STEP file")
    height_mm: float | None = _number(ABOVE_0, gt=0)
    fillet_mm: float = Field(default=0.0, ge=0, description=NOT_NEGATIVE)


class ArrayTable(Table):
    pitch_mm: float | None = _number(ABOVE_0, gt=0)
    pitch_x_mm: float | None = _number(ABOVE_0, gt=0)
    pitch_y_mm: float | None = _number(ABOVE_0, gt=0)
    rows: int | None = _number("a whole number from 0 to 1000", ge=0, le=1000)
    extension_mm: float = Field(default=0.0, ge=0, description=NOT_NEGATIVE)


class SolveTable(Table):
    band_kHz: Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="two numbers [low, high], 0 <= low < high"
    )
    near_kHz: float | None = _number(ABOVE_0, gt=0)
    count: int | None = _number("a whole number from 1 to 10000", ge=1, le=10_000)
    accuracy: float = Field(default=0.003, gt=0, le=0.1, description="a number above 0, at most 0.1")
    model: Literal["auto", "analytic", "superelement", "solid"] = Field(
        default="auto", description="auto, analytic, superelement or solid"
    )
    mesh: Literal["auto", "hex", "tet"] = Field(default="auto", description="auto, hex or tet")


class BandsTable(Table):
    path: str | None = Field(
        default=None, pattern=r"^[GXMY]{2,}$", description="at least two of the letters G, X, M and Y, such as GXMG"
    )
    points: int = Field(default=25, ge=1, le=10_000, description="a whole number from 1 to 10000")
    count: int = Field(default=10, ge=1, le=1000, description="a whole number from 1 to 1000")
    grid: int = Field(default=0, ge=0, le=200, description="a whole number from 0 (the path alone) to 200")


class DampingTable(Table):
    quality: float = Field(default=300.0, gt=0.5, description="a number above 0.5 (at 0.5 nothing resonates)")


class PatchesTable(Table):
    material: str = Field(default="pz26", description="the name of a piezo material")
    size_mm: Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=3, max_length=3)] = Field(
        description="three numbers above 0, along x, y and z"
    )
    face: Literal["back", "touch"] = Field(default="back", description="back or touch")
    at: Literal["antinodes"] | None = Field(default=None, description="antinodes (or give centres_mm instead)")
    centres_mm: (
        Annotated[list[Annotated[list[float], Field(min_length=2, max_length=2)]], Field(min_length=1)] | None
    ) = Field(default=None, description="a list of [x, y], at least one")
    sensors: list[Annotated[int, Field(ge=0)]] = Field(
        default_factory=list, description="a list of patch numbers, counted from 0"
    )
    drive_V: float = Field(default=1.0, gt=0, description=ABOVE_0)
    circuit: Literal["short", "open"] = Field(
        default="short", description="short (a voltage drives the patches) or open (a charge does)"
    )


class MeasuredTable(Table):
    sweep: str | None = Field(default=None, min_length=1, description="the path of a CSV file")
    map: str | None = Field(default=None, min_length=1, description="the path of a CSV file")
    at_mm: Annotated[list[float], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="two numbers [x, y], where the sweep's laser stood"
    )


class ToleranceTable(Table):
    height_mm: float = Field(default=0.0, ge=0, description=NOT_NEGATIVE)
    side_mm: float = Field(default=0.0, ge=0, description=NOT_NEGATIVE)
    position_mm: float = Field(default=0.0, ge=0, description=NOT_NEGATIVE)
    samples: int = Field(default=20, ge=1, le=10_000, description="a whole number from 1 to 10000")
    seed: int = Field(default=1, ge=0, description="a whole number of 0 or more")


TABLES: dict[str, type[Table]] = {
    "plate": PlateTable,
    "zone": ZoneTable,
    "pillar": PillarTable,
    "array": ArrayTable,
    "solve": SolveTable,
    "bands": BandsTable,
    "damping": DampingTable,
    "patches": PatchesTable,
    "tolerance": ToleranceTable,
    "measured": MeasuredTable,
}
MATERIAL_OWNERS = ("", "pillar")  # the tables that may hold a material; "" is the top of the file
MATERIAL_ALLOWED = "the name of a material or a table with young_GPa, density_kg_m3 and poisson"
NAME_ALLOWED = "a text of 1 to 100 characters without slashes or control characters"


def known_keys() -> list[str]:
    """Every key of a case file, dotted, such as pillar.side_mm."""
    keys = ["name", "material", "pillar.material"]
    keys += [f"{owner}material.{key}".lstrip(".") for owner in ("", "pillar.") for key in MaterialTable.model_fields]
    keys += [f"{table}.{key}" for table, model in TABLES.items() for key in model.model_fields]
    return sorted(set(keys))
