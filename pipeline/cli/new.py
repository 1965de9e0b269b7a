"""`antinode new`: write a commented case file whose plate, as solved, has its target mode at a requested frequency."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.case.model import Case
    from pipeline.logs import Log

WISHES = {
    "material": ("aluminium", "material of the plate, and of the pillars unless they have their own"),
    "pillar_material": ("", "material of the pillars, if it is another one"),
    "target": ("32kHz", "frequency of the target mode, met within 1 %%"),
    "thickness": (2.0, "thickness of the plate, mm"),
    "half_wavelength": (0.0, "largest half-wavelength along the zone, mm; 0: 1.2 of the bare plate's at the target"),
    "length": (115.5, "length of the zone, mm"),
    "side": (2.0, "side of the square pillars, mm"),
    "pitch": (4.0, "pitch of the pillars, mm"),
    "rows": (3, "rows of pillars on each side of the zone"),
    "extension": (25.0, "plate beyond the last row, mm"),
}
UNITS = {"material": "NAME", "pillar_material": "NAME", "target": "F", "rows": "N"}  # the others are lengths
OPTIONS = {  # keys that take the value unchanged
    "plate.thickness_mm": "--thickness",
    "zone.length_mm": "--length",
    "pillar.side_mm": "--side",
    "array.pitch_mm": "--pitch",
    "array.rows": "--rows",
    "array.extension_mm": "--extension",
}
BRITTLE = ("glass", "borosilicate", "aluminosilicate", "silicon")  # plates of them carry pillars of another material
LONGER = 1.2  # half-wavelength along the zone over the bare plate's: 0.3 of the wave's square are left across it
TEMPLATE = Path(__file__).with_name("new_case.toml.template")


def add_options(new: ArgumentParser) -> None:
    """Add the output path and the requirements to the command."""
    new.add_argument("place", metavar="FILE", help="case file to write")
    for name, (default, words) in WISHES.items():
        new.add_argument(
            option(name), type=type(default), metavar=UNITS.get(name, "MM"),
            help=f"{words} (default: {default})" if default else words,
        )  # fmt: skip
    new.add_argument("--force", action="store_true", help="overwrite an existing file")


def run(arguments: Namespace) -> int:
    """Prompt if interactive and nothing was given, size zone and pillars, solve, resize, and write the case."""
    from geometry.materials import MATERIALS
    from pipeline.case.limits import parse_frequency
    from pipeline.case.reading import known_as
    from pipeline.errors import InputError
    from pipeline.logs import TerminalLog
    from pipeline.records.outputs import is_standard_output, write_file

    place = Path(arguments.place)
    if place.exists() and not arguments.force:
        raise InputError(f"{place}: already exists; --force overwrites it")
    wishes = _wishes(arguments)
    for key in ("material", "pillar_material"):
        if wishes[key] not in MATERIALS and (wishes[key] or key == "material"):
            near = known_as(wishes[key])
            raise InputError(f"{option(key)} = {wishes[key]}: must be one of {', '.join(MATERIALS)}{near}")
    target_hz = parse_frequency(str(wishes["target"]), "--target")
    wishes["half_wavelength"] = wishes["half_wavelength"] or _half_wavelength_mm(wishes, target_hz)
    log = TerminalLog(arguments.quiet)
    if doubt := _brittle(wishes):
        log.warning("PILLARS", doubt)
    text = solved_text(place, wishes, target_hz, log)
    write_file(place, text.encode())
    if not is_standard_output(place):
        print(f"wrote {place}; next: antinode predesign {place}, antinode bands {place}, antinode modes {place}")
    return 0


def solved_text(place: Path, wishes: dict[str, Any], target_hz: float, log: Log) -> str:
    """Return the case whose target mode, as solved, has a frequency.

    Raises
    ------
    InputError
        If no zone fits, or the case has a fault.
    SolverError
        If no zone brings the target mode there.
    """
    from pipeline.models.aim import aim
    from pipeline.quantity import frequency_with_bar, level

    def text(theory_hz: float, solved: str) -> str:
        return case_text(place.stem, wishes, target_hz, theory_hz, solved)

    def sized(theory_hz: float) -> Case:
        return check(text(theory_hz, ""), place, wishes)

    found = aim(sized, target_hz, log)
    row = found.row
    decibels = "" if row.confinement_db is None else f", {level(row.confinement_db)} above the passive face"
    return text(found.theory_hz, frequency_with_bar(row.frequency_hz, row.error) + decibels)


def case_text(name: str, wishes: dict[str, Any], target_hz: float, theory_hz: float, solved: str) -> str:
    """Return the case with zone and pillars sized for frequencies by theory. Raises InputError if no zone fits.

    `solved` is the target mode in words, as solved.
    """
    from geometry.layout import Pillar
    from geometry.materials import MATERIALS, Stack
    from pipeline.case.limits import MAX_NODAL_LINES
    from pipeline.errors import InputError
    from pipeline.quantity import KHZ, MM
    from solvers.analytic.plates import Strip
    from solvers.analytic.predesign import min_nodal_lines, pillar_height_m, zone_width_m
    from solvers.errors import SolverError

    _check_lengths(wishes)
    material, of_pillars = (MATERIALS[wishes[key] or wishes["material"]] for key in ("material", "pillar_material"))
    length, thickness, side = (MM * wishes[key] for key in ("length", "thickness", "side"))
    strip = Strip(length, length / 5.0, Stack.of(thickness, material))
    lines = min_nodal_lines(strip, MM * wishes["half_wavelength"])
    if lines > MAX_NODAL_LINES:
        least = wishes["length"] / (MAX_NODAL_LINES - 0.5)
        raise InputError(f"--half-wavelength = {wishes['half_wavelength']:g}: must be at least {least:g} mm")
    try:
        _check_frequency(wishes, theory_hz, strip, lines)
        width = zone_width_m(strip, lines, theory_hz)
        pillar = Pillar("square", side, side, 3.0 * side, of_pillars)
        height = pillar_height_m(pillar, theory_hz, "timoshenko")
    except SolverError as error:
        raise InputError(f"--target = {wishes['target']}: {error}") from error
    sizes = {"width": width / MM, "height": height / MM, "lines": lines, "khz": target_hz / KHZ}
    own = f'material = "{wishes["pillar_material"]}"\n' if wishes["pillar_material"] else ""
    return TEMPLATE.read_text(encoding="utf-8").format(
        name=name, solved=solved, theory_khz=theory_hz / KHZ, **{**wishes, **sizes, "own_material": own}
    )


def _half_wavelength_mm(wishes: dict[str, Any], target_hz: float) -> float:
    """Return LONGER times the bare plate's half-wavelength, as far as a case may have it."""
    from math import pi, sqrt

    from geometry.materials import MATERIALS, Stack
    from pipeline.case.limits import LENGTH_MM, MAX_NODAL_LINES
    from pipeline.quantity import MM
    from solvers.analytic.plates import Strip, thin_plate_hz

    length, thickness = wishes["length"], wishes["thickness"]
    if not (length > 0.0 and thickness > 0.0):
        return LENGTH_MM[0]
    stack = Stack.of(MM * thickness, MATERIALS[wishes["material"]])
    bare_m = pi / sqrt(target_hz / thin_plate_hz(Strip(MM * length, MM * length, stack), 1.0))
    least = max(LENGTH_MM[0], length / (MAX_NODAL_LINES - 0.5), 2.0 * thickness)  # plate theory ends there
    return min(max(LONGER * bare_m / MM, least), LENGTH_MM[1])


def _brittle(wishes: dict[str, Any]) -> str | None:
    """Return a doubt about slender pillars of a material that is neither printed nor machined, or None."""
    if wishes["pillar_material"] or wishes["material"] not in BRITTLE:
        return None
    return (
        f"the pillars are {wishes['material']}, like the plate: --pillar-material sets a material that can be printed or "
        "bonded, such as printing-resin or pmma, and sizes them for it"
    )


def _check_lengths(wishes: dict[str, Any]) -> None:
    """Raise InputError with a line for every length outside a case file's limits."""
    from pipeline.case.limits import LENGTH_MM, span
    from pipeline.errors import InputError

    names = ("length", "thickness", "side", "half_wavelength")
    wrong = [name for name in names if not LENGTH_MM[0] <= wishes[name] <= LENGTH_MM[1]]
    if wrong:
        raise InputError(f"{option(name)} = {wishes[name]:g}: must be {span(LENGTH_MM)} mm" for name in wrong)


def _check_frequency(wishes: dict[str, Any], frequency_hz: float, strip: Any, lines: int) -> None:
    """Raise InputError with the range of frequencies for which the zone has an admissible width."""
    from dataclasses import replace

    from pipeline.errors import InputError
    from pipeline.quantity import KHZ, MM
    from solvers.analytic.plates import levy_hz

    narrowest, widest = max(2.0 * wishes["side"], wishes["thickness"]), 1000.0 * wishes["length"]
    low, high = (levy_hz(replace(strip, width_m=MM * width), lines) / KHZ for width in (widest, narrowest))
    if not low < frequency_hz / KHZ <= high:
        raise InputError(
            f"--target = {wishes['target']}: must be from {low:g}kHz to {high:g}kHz for a zone of "
            f"{wishes['length']:g} mm with {lines} nodal lines, at least {narrowest:g} mm wide (two pillar sides, "
            "and the plate's thickness)"
        )


def option(name: str) -> str:
    """Return a requirement as an option of the command."""
    return f"--{name.replace('_', '-')}"


def check(text: str, place: Path, wishes: dict[str, Any]) -> Case:
    """Return the case. Raises InputError with a line for every fault, named by the option behind the key."""
    import tomllib

    from pipeline.case.model import case_from_dict
    from pipeline.errors import InputError

    try:
        return case_from_dict(tomllib.loads(text), place)
    except InputError as error:
        raise InputError(_by_option(line.removeprefix(f"{place}: "), wishes) for line in error.lines) from None


def _by_option(fault: str, wishes: dict[str, Any]) -> str:
    """Rephrase the fault of a key in terms of the option that sets or sizes it."""
    for key, given in OPTIONS.items():
        if fault.startswith(key):
            return fault.replace(key, given, 1)
    name = "half_wavelength" if fault.startswith("zone.nodal_lines") else "target"
    return f"{option(name)} = {wishes[name]}: gives {fault}"


def _wishes(arguments: Namespace) -> dict[str, Any]:
    """Return the requirements: options, prompts if interactive and nothing was given, else defaults."""
    given = {name: getattr(arguments, name) for name in WISHES}
    asks = sys.stdin.isatty() and not arguments.quiet and all(value is None for value in given.values())
    if asks:
        return {name: _answer(words, default) for name, (default, words) in WISHES.items()}
    return {name: default if given[name] is None else given[name] for name, (default, _) in WISHES.items()}


def _answer(words: str, default: Any) -> Any:
    while True:
        text = input(f"{words} [{default}]: ").strip()
        if not text:
            return default
        try:
            return type(default)(text)
        except ValueError:
            print(f"{text!r}: must be a {'whole number' if isinstance(default, int) else 'number'}")
