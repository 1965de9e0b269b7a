"""Laws that every command obeys: scaled, mirrored and respelled scenes give the same figures, each by its unit.

Commands that are not here stand in LEFT_OUT with the reason.

Lengths times a, moduli times e and densities times d give frequencies times sqrt(e/d)/a and leave ratios, levels and error bars
alone. Volts keep the piezoceramic's strain times length, so displacements per volt do not change with the scale of lengths.
"""

from __future__ import annotations

import json
import math
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from pipeline.cli.main import _parser, main

BAND_HZ = (20e3, 60e3)
ROUNDING = 1e-5  # of the largest value of its key: residuals of 1e-9 in values that differ by 1e-4
COARSE = """
name = "coarse"
material = {young_GPa = 70.0, density_kg_m3 = 2700.0, poisson = 0.34, dE_dT_per_K = -4e-4, expansion_per_K = 2e-5}
[plate]
thickness_mm = 2.0
[zone]
length_mm = 28.0
width_mm = 20.0
nodal_lines = 2
[pillar]
shape = "square"
side_mm = 2.0
height_mm = 6.3
[array]
pitch_mm = 4.0
rows = 1
extension_mm = 5.0
[solve]
accuracy = 0.1
[bands]
points = 2
count = 4
[damping]
quality = 100.0
"""
BARE = COARSE.replace("rows = 1", "rows = 0").replace("extension_mm = 5.0", "extension_mm = 10.0")  # panels of one kind
PATCHED = """
[patches]
material = "pz26"
size_mm = [8.0, 3.0, 0.3]
centres_mm = [[-6.0, -3.0], [5.0, 4.0], [7.0, -5.0]]
sensors = [2]
[touch]
at_mm = [3.0, 2.0]
radius_mm = 1.5
impedance = "tissue"
[tolerance]
height_mm = 0.05
"""
PASSIVE = {
    "predesign": [],
    "modes": ["--band", BAND_HZ],
    "bands": [],
    "attenuation": ["--band", BAND_HZ, "--points", "5"],
    "broadband": ["--band", BAND_HZ, "--points", "5"],
    "drift": ["--points", "3"],
}
DRIVEN = {
    "response": ["--band", BAND_HZ, "--points", "5"],
    "touch": ["--band", BAND_HZ, "--no-map"],
    "crosstalk": ["--band", BAND_HZ, "--points", "5"],
    "hybrid": ["--band", BAND_HZ, "--points", "5"],
    "travel": ["--band", BAND_HZ],
    "tolerance": ["--band", BAND_HZ, "--samples", "2"],
}
OPTIONS = PASSIVE | DRIVEN
LEFT_OUT = {
    "repeats these commands over cases": {"run", "search", "explore"},
    "models the strips and filters of the thesis": {"active"},
    "compares a cell of its own with committed edges": {"check-gap"},
    "writes or shows what others computed": {"report", "view", "export", "compare", "show", "list"},
    "computes nothing": {"new", "doctor", "materials", "glossary", "schema", "completion"},
}
UNCOMPARED = {"seconds", "schema", "version", "fingerprint", "digest", "residual"}  # a residual is rounding itself
DESCRIBING = {"case", "design", "input", "with_defaults"}  # the scene in words
RELATIVE = {"expected_error"}  # errors named by what they are errors of
INHERITED = {"mean", "deviation", "lowest", "highest"}  # statistics have the unit of what they are about


@dataclass(frozen=True)
class Scaling:
    """Factors of lengths, moduli and densities."""

    length: float = 1.0
    modulus: float = 1.0
    density: float = 1.0

    @property
    def frequency(self) -> float:
        return math.sqrt(self.modulus / self.density) / self.length

    def of(self, key: str) -> float:
        """Factor of a value by the unit in its key."""
        units = {
            "_hz": self.frequency,
            "_kHz": self.frequency,
            "_hz_per_K": self.frequency,
            "_per_m_K": 1.0 / self.length,
            "_Pa_per_K": self.modulus,
            "_m_s": self.frequency * self.length,
            "_per_m": 1.0 / self.length,
            "_mm": self.length,
            "_pa": self.modulus,
            "_GPa": self.modulus,
            "_kg_m3": self.density,
            "_kg": self.density * self.length**3,
            "_N_s_m": self.length**2,  # of a fingertip's area
        }
        figure = key.replace("_error", "")
        if figure in ("zone_rms_m", "passive_rms_m", "finger_m", "field_m", "touched_m"):  # driven by so many volts
            return 1.0
        if figure in ("crest_m_s", "fastest_m_s"):  # such a motion's velocity
            return self.frequency
        return next((factor for unit, factor in units.items() if key.endswith(unit)), self._of_metres(key))

    def _of_metres(self, key: str) -> float:
        return self.length if key.endswith("_m") else 1.0


OTHER = Scaling(0.037, 3.1, 0.7)


def scaled(case: dict[str, Any], scaling: Scaling) -> dict[str, Any]:
    """The case with every number times its factor."""
    return {key: _scaled(key, value, scaling) for key, value in case.items()}


def _scaled(key: str, value: Any, scaling: Scaling) -> Any:
    if isinstance(value, dict):
        return scaled(value, scaling)
    if isinstance(value, list):
        return [_scaled(key, each, scaling) for each in value]
    return value * scaling.of(key) if isinstance(value, float) else value


@cache
def first(command: str, text: str) -> dict[str, Any]:
    """What a command says of a scene as it stands; scaled, respelled and mirrored ones are compared with it."""
    with tempfile.TemporaryDirectory() as folder:
        return answer(Path(folder), command, OPTIONS[command], tomllib.loads(text), Scaling())


def answer(folder: Path, command: str, options: list[Any], case: dict[str, Any], scaling: Scaling) -> dict[str, Any]:
    """The JSON document of a command."""
    (folder / "case.toml").write_text(tomli_w.dumps(case))
    words = [_spelled(option, scaling.frequency) if isinstance(option, tuple) else option for option in options]
    code = main([command, str(folder / "case.toml"), *words, "--quiet", "--json", str(folder / "answer.json")])
    assert code == 0
    return json.loads((folder / "answer.json").read_text())


def _spelled(band: tuple[float, float], factor: float) -> str:
    return ":".join(f"{end * factor!r}Hz" for end in band)


def numbers(document: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], float | None]]:
    """Every number of a document, and where there is none, with the keys that lead to it."""
    if isinstance(document, dict):
        for key in sorted(set(document) - UNCOMPARED):
            yield from numbers(document[key], (*path, key))
    elif isinstance(document, list):
        for each in _in_order(document):
            yield from numbers(each, path)
    elif document is None or (isinstance(document, (int, float)) and not isinstance(document, bool)):
        yield path, document


def _in_order(entries: list[Any]) -> list[Any]:
    """Pairs of waves of one decay by the size of their wavenumbers: +-ky, and +-pi/pitch, which is one wave, by rounding."""
    if not (entries and isinstance(entries[0], dict) and "ky_im_per_m" in entries[0]):
        return entries
    sizes = [wave | {"ky_re_per_m": abs(wave["ky_re_per_m"])} for wave in entries]
    return sorted(sizes, key=lambda wave: (float(f"{wave['ky_im_per_m']:.4g}"), wave["ky_re_per_m"]))


def assert_alike(first: dict[str, Any], second: dict[str, Any], scaling: Scaling) -> None:
    """Every number of the second document is that of the first times the factor of its unit."""
    kept, moved = list(numbers(first)), list(numbers(second))
    assert [path for path, _ in kept] == [path for path, _ in moved]
    largest: dict[tuple[str, ...], float] = {}
    for path, value in kept:
        largest[path] = max(largest.get(path, 0.0), abs(value or 0.0))
    off = []
    for (path, value), (_, other) in zip(kept, moved, strict=True):
        factor = 1.0 if RELATIVE & set(path) else scaling.of(_with_unit(path))
        if not _near(value, other, largest[path], factor):
            off.append(("/".join(path), value, factor, other))
    assert not off


def _with_unit(path: tuple[str, ...]) -> str:
    return next(key for key in reversed(path) if key not in INHERITED)


def _near(value: float | None, other: float | None, largest: float, factor: float) -> bool:
    if value is None or other is None:
        return value is other
    return abs(value * factor - other) <= max(ROUNDING * largest * factor, np.finfo(float).tiny)


def respelled(case: dict[str, Any]) -> dict[str, Any]:
    """The same scene in other words: rows given singly, equal pitches, a material of the pillar's own."""
    array, pillar = case["array"], case["pillar"]
    rows, pitch = int(array["rows"]), array["pitch_mm"]
    return {
        **case,
        "pillar": {"shape": pillar["shape"], "material": case["material"]},
        "array": {
            **{key: value for key, value in array.items() if key != "pitch_mm"},
            "pitch_x_mm": pitch,
            "pitch_y_mm": pitch,
            "heights_mm": [pillar["height_mm"]] * rows,
            "sides_mm": [pillar["side_mm"]] * rows,
        },
    }


def mirrored(case: dict[str, Any]) -> dict[str, Any]:
    """The scene with x and y the other way round."""
    patches, touch = case["patches"], case["touch"]
    centres = [[-x, -y] for x, y in patches["centres_mm"]]
    at = [-each for each in touch["at_mm"]]
    return {**case, "patches": {**patches, "centres_mm": centres}, "touch": {**touch, "at_mm": at}}


def same(folder: Path, command: str, text: str, other: dict[str, Any]) -> None:
    """Both scenes have the same figures but for the words that describe them; places are compared by their distance."""
    options = OPTIONS[command]
    words = [":".join(f"{end / 1e3!r}kHz" for end in each) if isinstance(each, tuple) else each for each in options]
    documents = first(command, text), answer(folder, command, words, other, Scaling())
    assert_alike(*(_without_sides(_without(each, DESCRIBING)) for each in documents), Scaling())


def _without(document: Any, keys: set[str]) -> Any:
    return {key: value for key, value in document.items() if key not in keys}


def _without_sides(document: Any) -> Any:
    """Places without their signs."""
    if isinstance(document, dict):
        return {
            key: _sizes(value) if key in ("at_m", "centre_m") else _without_sides(value)
            for key, value in document.items()
        }
    return [_without_sides(each) for each in document] if isinstance(document, list) else document


def _sizes(value: Any) -> Any:
    return [abs(each) for each in value] if isinstance(value, list) else abs(value)


def compared(folder: Path, command: str, text: str, scaling: Scaling) -> None:
    other = answer(folder, command, OPTIONS[command], scaled(tomllib.loads(text), scaling), scaling)
    assert_alike(first(command, text), other, scaling)


def test_every_command_is_compared_or_left_out_with_its_reason() -> None:
    (commands,) = (action.choices for action in _parser()._actions if action.dest == "command")
    assert commands is not None
    here = [*PASSIVE, *DRIVEN, *(command for group in LEFT_OUT.values() for command in group)]
    assert sorted(commands) == sorted(here)


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [pytest.param(c, marks=pytest.mark.slow) if c in ("bands", "attenuation", "broadband") else c for c in PASSIVE],
)
def test_a_scaled_scene_gives_scaled_figures(command: str, tmp_path: Path) -> None:
    """Modes of a bare plate: those with pillars take half a minute."""
    compared(tmp_path, command, BARE if command == "modes" else COARSE, OTHER)


@pytest.mark.slow
@pytest.mark.parametrize("scaling", [Scaling(17.0), Scaling(modulus=0.004), Scaling(density=9.3), OTHER], ids=str)
@pytest.mark.parametrize("command", PASSIVE)
def test_further_scales_of_a_passive_plate(command: str, scaling: Scaling, tmp_path: Path) -> None:
    compared(tmp_path, command, COARSE, scaling)


@pytest.mark.slow
@pytest.mark.parametrize("length", [0.037, 17.0])
@pytest.mark.parametrize("command", DRIVEN)
def test_a_scaled_driven_plate_moves_as_much_per_volt(command: str, length: float, tmp_path: Path) -> None:
    compared(tmp_path, command, COARSE + PATCHED, Scaling(length))


@pytest.mark.parametrize("command", ["predesign", pytest.param("bands", marks=pytest.mark.slow)])
def test_other_words_for_a_scene_give_the_same_figures(command: str, tmp_path: Path) -> None:
    """Frequencies of options in kHz, too."""
    same(tmp_path, command, COARSE, respelled(tomllib.loads(COARSE)))


@pytest.mark.slow
@pytest.mark.parametrize("command", [*(each for each in PASSIVE if each not in ("predesign", "bands")), *DRIVEN])
def test_other_words_for_a_driven_scene_give_the_same_figures(command: str, tmp_path: Path) -> None:
    same(tmp_path, command, COARSE + PATCHED, respelled(tomllib.loads(COARSE + PATCHED)))


@pytest.mark.slow
@pytest.mark.parametrize("command", ["response", "touch", "crosstalk", "hybrid"])
def test_a_mirrored_plate_moves_alike(command: str, tmp_path: Path) -> None:
    same(tmp_path, command, COARSE + PATCHED, mirrored(tomllib.loads(COARSE + PATCHED)))
