"""Universal files: directions, accelerations and units as the format has them."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from pipeline.case.model import load_case
from pipeline.errors import InputError
from pipeline.measured.files import read_field, read_sweep
from tests.geometry.formats.test_mutants import limited, mutant

SMALL = Path(__file__).resolve().parents[3] / "examples" / "small.toml"
TONES = 30e3 + 10.0 * np.arange(12)
PLACES = np.array([(x, y) for x in (-0.01, 0.0, 0.01) for y in (-0.005, 0.005)])
SHAPE = np.array([1.0, -2.0, 3.0, -4.0, 5.0, -6.0])
PEAK = 1.0 / (TONES[6] ** 2 - TONES**2 + 1j * TONES * TONES[6] / 300.0) * 1e6


def written(path: Path, directions: list[list[int]], *kinds: int, at_0_hz: complex = 0.0) -> str:
    """Nodes, and a response of each in each of its directions; along x and y ten times the motion along z.

    kinds: of all nodes in turn, 11 by default; at_0_hz: of the first node, which then has another frequency.
    """
    lines = ["    -1", "    15"]
    lines += [f"{n:10d}{0:10d}{0:10d}{0:10d}{x:13.5E}{y:13.5E}{0.0:13.5E}" for n, (x, y) in enumerate(PLACES, 1)]
    lines += ["    -1"]
    for node, along in enumerate(directions):
        for direction in along:
            kind = (kinds or (11,))[node % max(1, len(kinds))]
            tones, peak = TONES, PEAK
            if at_0_hz and not node:
                tones, peak = np.append(0.0, TONES), np.append(at_0_hz, PEAK)
            scale = SHAPE[node] * (10.0 if abs(direction) in (1, 2) else 1.0) * (-1.0 if direction == -3 else 1.0)
            values = scale * peak * (-((2 * np.pi * tones) ** 2) if kind == 12 else 1.0)
            lines += ["    -1", "    58", *["NONE"] * 5]
            lines += [f"{4:5d}{0:10d}{0:5d}{0:10d} {'NONE':10s}{node + 1:10d}{direction:4d} {'NONE':10s}{0:10d}{0:4d}"]
            lines += [f"{6:10d}{len(tones):10d}{0:10d}{0.0:13.5E}{0.0:13.5E}{0.0:13.5E}"]
            lines += [f"{code:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}" for code in (18, kind, 13, 0)]
            lines += [f"{f:13.5E}{v.real:20.11E}{v.imag:20.11E}" for f, v in zip(tones, values, strict=True)]
            lines += ["    -1"]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def shape_of(path: str) -> np.ndarray:
    values = read_field(path, load_case(SMALL).design).values
    return (values / values[0]).real


@pytest.mark.parametrize(
    "directions",
    [[[3]] * 6, [[-3], [3]] * 3, [[0]] * 6, [[1, 2, 3]] * 6, [[3, -1]] * 3 + [[-3, 2]] * 3],
    ids=["along", "turned", "unsaid", "3-D head", "mixed"],
)
def test_a_map_is_the_motion_along_the_normal(directions: list[list[int]], tmp_path: Path) -> None:
    assert shape_of(written(tmp_path / "map.uff", directions)) == pytest.approx(SHAPE, rel=1e-6)


def test_a_sweep_is_of_the_node_that_moves_most_along_the_normal(tmp_path: Path) -> None:
    sweep = read_sweep(written(tmp_path / "sweep.uff", [[1, 2, 3]] * 6)).sweep
    assert np.allclose(sweep.response, SHAPE[5] * PEAK, rtol=1e-5)


def test_an_accelerance_is_a_displacement_over_minus_omega_squared(tmp_path: Path) -> None:
    measured = read_sweep(written(tmp_path / "sweep.uff", [[3]] * 6, 12))
    assert measured.quantity == "displacement" and np.allclose(measured.sweep.response, SHAPE[5] * PEAK, rtol=1e-5)


@pytest.mark.parametrize(("kinds", "at_0_hz"), [((12, 8, 8), 0.0), ((11,), 1e9)], ids=["accelerations", "offset"])
def test_neither_an_acceleration_nor_an_offset_makes_a_node_the_one_that_moves_most(
    tmp_path: Path, kinds: tuple[int, ...], at_0_hz: float
) -> None:
    """The last node moves most; accelerations of others are larger as numbers, and so is the first node's value at 0 Hz."""
    measured = read_sweep(written(tmp_path / "sweep.uff", [[3]] * 6, *kinds, at_0_hz=at_0_hz))
    assert np.allclose(measured.sweep.response, SHAPE[5] * PEAK, rtol=1e-5)


def test_responses_of_two_quantities_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "mixed.uff", [[3]] * 6, 8, 11)
    for reader in (read_sweep, shape_of):
        with pytest.raises(InputError, match="types 8, 11: must be of one quantity"):
            reader(path)


@pytest.mark.parametrize(
    ("line", "change", "words"),
    [
        (3, ("-1.00000E-02", "         NaN"), "finite x, y and z"),
        (-3, ("3.01000E+04", "3.00900E+04"), "must be finite and ascend"),
        (16, (f"{4:5d}", f"{1:5d}"), "no frequency response"),
    ],
)
def test_places_frequencies_and_kinds_that_mean_nothing_are_refused(
    tmp_path: Path, line: int, change: tuple[str, str], words: str
) -> None:
    path = Path(written(tmp_path / "map.uff", [[3]]))
    lines = path.read_text().splitlines()
    assert change[0] in lines[line]
    lines[line] = lines[line].replace(*change, 1)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=words):
        read_field(path, load_case(SMALL).design)


def mutants_end_well(seeds: range, folder: Path) -> tuple[int, int]:
    """How many mutants are refused, and how many read; anything else is raised."""
    whole = Path(written(folder / "map.uff", [[3]] * 6)).read_bytes()
    design, path, refused, read = load_case(SMALL).design, folder / "other.uff", 0, 0
    for seed in seeds:
        path.write_bytes(mutant(whole, random.Random(seed)))
        try:
            with limited():
                field = read_field(path, design)
        except InputError as error:
            assert error.lines and not any("\n" in line for line in error.lines)
            refused += 1
            continue
        read += 1
        assert (
            len(field.values) == len(field.points_m)
            and np.isfinite(field.values).all()
            and np.isfinite(field.points_m).all()
        )
    return refused, read


def test_mutants_are_refused_line_by_line_or_read_whole(tmp_path: Path) -> None:
    refused, read = mutants_end_well(range(120), tmp_path)
    assert refused > 5 and read > 5


@pytest.mark.slow
def test_five_thousand_mutants_end_well(tmp_path: Path) -> None:
    refused, read = mutants_end_well(range(5000), tmp_path)
    assert refused + read == 5000


def test_motion_in_the_plane_alone_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "map.uff", [[1], [2]] * 3)
    for read in (read_sweep, lambda place: read_field(place, load_case(SMALL).design)):
        with pytest.raises(InputError, match="responses along x, y only: must have some along z"):
            read(path)
