"""Pillars of a supercell that differ from the others: the tables [[defect]]."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from geometry.layout import Pillar
from geometry.pillar_shapes import SHAPES
from pipeline.case.reading import Diagnostics, check_table, keep_sizes, known_keys
from pipeline.case.schema import DEFECTS_ALLOWED, DefectTable
from pipeline.errors import InputError

MAX_DEFECTS = 100
PLACE = ("at", "remove")  # keys that are not those of [pillar]


@dataclass(frozen=True)
class Defect:
    """A cell of a supercell, counted from 0 along both lattice vectors, and its pillar; None for a missing one."""

    at: tuple[int, int]
    pillar: Pillar | None


def read_defects(
    tables: Any, raw: dict[str, Any], source: str, pillar_of: Callable[[dict[str, Any]], Pillar | None]
) -> tuple[Defect, ...]:
    """Read the tables [[defect]] of a case.

    Parameters
    ----------
    tables : object
        Tables as in the file.
    raw : dict
        All other tables of the case.
    source : str
        Name of the file, for messages.
    pillar_of : callable
        Reads the pillar of a whole case.

    Returns
    -------
    tuple of Defect
        One for each table.

    Raises
    ------
    InputError
        With one line for every fault.
    """
    diagnostics = Diagnostics(source)
    if (
        not isinstance(tables, list)
        or not 0 < len(tables) <= MAX_DEFECTS
        or not all(isinstance(t, dict) for t in tables)
    ):
        diagnostics.add("defect", tables, f"must be one to {MAX_DEFECTS} {DEFECTS_ALLOWED}")
        diagnostics.stop()
    known, found = known_keys(), []
    for number, table in enumerate(tables):
        key, before = f"defect.{number}", len(diagnostics.lines)
        check_table(
            DefectTable, {name: table[name] for name in table if name != "material"}, f"{key}.", known, diagnostics
        )
        changes = {name: value for name, value in table.items() if name not in PLACE}
        if bool(table.get("remove")) == bool(changes):
            what = (
                "remove = true alone, or keys of [pillar] that differ"
                if changes
                else "remove = true or keys of [pillar]"
            )
            diagnostics.missing(key, f"must have {what}")
        if len(diagnostics.lines) == before:
            try:
                own = (
                    None
                    if table.get("remove")
                    else pillar_of(raw | {"pillar": _changed(raw.get("pillar", {}), changes)})
                )
            except InputError as fault:
                diagnostics.lines += [line.replace(": pillar.", f": {key}.") for line in fault.lines]
            else:
                found.append(Defect((table["at"][0], table["at"][1]), own))
    _refuse_twins(found, diagnostics)
    diagnostics.stop()
    return tuple(found)


def _changed(pillar: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Tables of a pillar with other values, without the sizes of another shape."""
    own: dict[str, Any] = {"pillar": dict(pillar)}
    if changes.get("shape") in SHAPES:
        keep_sizes(own, SHAPES[changes["shape"]])
    return own["pillar"] | changes


def _refuse_twins(found: Sequence[Defect], diagnostics: Diagnostics) -> None:
    places = [each.at for each in found]
    for number, place in enumerate(places):
        if place in places[:number]:
            diagnostics.add(f"defect.{number}.at", list(place), f"is the cell of defect.{places.index(place)}, too")
