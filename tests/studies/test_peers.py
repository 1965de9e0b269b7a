"""The comparison with other programs: how it judges, what its tables say, what may be missing. Nothing is solved."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from studies import ladder
from studies.benchmarks.peers import __main__ as peers
from studies.benchmarks.peers import scene
from studies.benchmarks.peers.__main__ import Solution

PILLAR = Solution("pillar", "Antinode", "finest", [[100.0, 200.0, 300.0]], 10, 5.0)


def test_the_error_is_the_largest_one_with_its_sign() -> None:
    low = replace(PILLAR, frequencies_hz=[[101.0, 200.0, 294.0]])
    assert peers.error(low, PILLAR) == pytest.approx(-0.02)


def test_the_modes_of_all_classes_are_merged_or_refused() -> None:
    assert scene.merged([[3.0, 1.0, 9.0], [2.0, 8.0]], 3) == [1.0, 2.0, 3.0]
    with pytest.raises(RuntimeError, match="too few"):
        scene.merged([[1.0, 2.0], [3.0, 4.0]], 3)


def test_rigid_waves_are_not_compared_and_bands_are_sorted() -> None:
    known = Solution("cell", "Antinode", "", [[0.0, 100.0], [50.0, 80.0]], 1, 1.0)
    other = replace(known, frequencies_hz=[[101.0, 3e-3], [80.0, 50.0]])
    assert peers.error(other, known) == pytest.approx(0.01)


def test_the_plates_mode_is_the_strongest_not_the_nearest() -> None:
    known = Solution("plate", "Antinode", "", [[100.0]], 1, 1.0)
    other = replace(known, program="NGSolve", frequencies_hz=[[99.9, 102.0, 120.0]], strengths=[0.1, 0.8, 0.9])
    assert peers.error(other, known) == pytest.approx(0.02)


def test_the_tables_hold_every_row_and_the_least_time_within_an_error() -> None:
    rough = replace(PILLAR, program="NGSolve", frequencies_hz=[[100.5, 200.0, 300.0]], seconds=1.0)
    fine = replace(rough, frequencies_hz=[[100.2, 200.0, 300.0]], seconds=7.0)
    results, references = [PILLAR, rough, fine], {"pillar": PILLAR}
    assert peers.rows(results, references)[-1] == "| pillar | NGSolve | finest | 10 | 7.00 | +0.2000% |  |"
    assert "reference" in peers.rows(results, references)[2]
    assert peers.cheapest(results, references)[2:] == [
        "| pillar | 1.0% | – | 1.0 |",
        "| pillar | 0.3% | – | 7.0 |",
        "| pillar | 0.1% | – | – |",
    ]


def test_a_program_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(peers.shutil, "which", lambda name: None)
    monkeypatch.setattr(peers, "find_spec", lambda name: None)
    missing = peers.left_out(str(tmp_path / "python"))
    assert set(missing) == {peers.SCIKIT, peers.CALCULIX, peers.NGSOLVE}
    text = peers.page([PILLAR], {"pillar": PILLAR}, missing)
    assert all(f"{program} is left out: " in text for program in missing)


def test_an_interpreter_without_ngsolve_leaves_it_out(tmp_path: Path) -> None:
    place = tmp_path / "python"
    place.write_text("#!/bin/sh\nexit 1\n")
    place.chmod(0o755)
    assert peers.NGSOLVE in peers.left_out(os.fspath(place))
    place.write_text("#!/bin/sh\nexit 0\n")
    assert peers.NGSOLVE not in peers.left_out(os.fspath(place))


def test_a_row_that_is_kept_is_not_solved_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    row = next(peers.listed())
    monkeypatch.setattr(peers, "solve", lambda row, interpreter: PILLAR)
    assert peers.kept(row, "python", tmp_path) == PILLAR
    monkeypatch.setattr(peers, "solve", None)
    assert peers.kept(row, "python", tmp_path) == PILLAR


def test_rows_have_names_of_their_own_and_a_reference_first() -> None:
    rows = list(peers.listed())
    assert len({row.name for row in rows}) == len(rows)
    first = {part: next(row for row in rows if row.part == part) for part in scene.PARTS}
    assert {row.program for row in first.values()} == {peers.OURS}
    assert {row.settings["accuracy"] for row in first.values() if "accuracy" in row.settings} == {peers.FINEST}


def test_bodies_have_the_volume_of_the_design() -> None:
    """The cell whole; of the plate with one row on each side, a quarter with half the pillars of one side."""

    def volume(bodies: list[list[float]]) -> float:
        return float(sum(np.prod(np.diff(np.reshape(each, (3, 2)))) for each in bodies))

    design = peers.task("cell", {})
    assert volume(design["bodies"]) == pytest.approx(4e-3**2 * 2e-3 + 2e-3**2 * 6.3e-3)
    assert volume(scene.bodies("pillar")) == pytest.approx(2e-3**2 * 6.3e-3 / 4.0)
    assert volume(scene.bodies("zone")) == pytest.approx(115.5e-3 * 20e-3 * 2e-3 / 4.0)
    plate = scene.bodies("plate")
    pillars = sum(len(stand.centres) for stand in ladder.plate_design().standing())
    assert volume(plate[1:]) == pytest.approx(pillars / 4.0 * 2e-3**2 * 6.3e-3)


def test_a_class_holds_what_its_mirrors_hold() -> None:
    assert scene.clamped_axes("zone", "SA") == {"x-": [0], "y-": [0, 2], "y+": [0, 1, 2]}


def test_the_committed_page_shows_every_program_and_part() -> None:
    page = peers.PAGE.read_text()
    assert "(pictures/peers.svg)" in page
    for row in peers.listed():
        assert f"| {row.program} |" in page and f"\n| {row.part} | 0.1% |" in page, (
            "python -m studies.benchmarks.peers --write"
        )
    ElementTree.parse(peers.PICTURE)
