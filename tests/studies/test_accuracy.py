"""The accuracy study: extrapolation, what counts as cheapest, and a page from records alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pipeline.report.html import write_page
from solvers.accuracy import calibration
from solvers.analytic.predesign import predesign
from studies import accuracy, ladder


def record(
    part: str, mesh_level: dict[str, Any], value: float, seconds: float, role: str = "mesh_level"
) -> dict[str, Any]:
    measured = {"seconds": seconds, "repeats": 1, "peak_bytes": 5_000_000}
    quantity = accuracy.QUANTITIES[part][0]
    parameters = {"part": part, "mesh_level": mesh_level, "role": role}
    return {
        "case_id": "c", "status": "OK", "diagnosis": "done", "parameters": parameters,
        "values": {quantity: value}, "dof": 10, "measured": measured,
    }  # fmt: skip


def test_a_geometric_sequence_is_carried_to_its_limit() -> None:
    limit, spread = accuracy.extrapolated([100.0 + 8.0, 100.0 + 4.0, 100.0 + 2.0])
    assert limit == pytest.approx(100.0) and spread == pytest.approx(2.0)


def test_what_does_not_settle_keeps_its_last_difference() -> None:
    assert accuracy.extrapolated([1.0, 2.0, 4.0]) == (4.0, 2.0)


def test_every_case_has_a_name_of_its_own() -> None:
    names = [case for case, _ in accuracy.cases()]
    assert len(set(names)) == len(names)
    assert {p["part"] for _, p in accuracy.cases()} == {"zone", "pillar", "cell", "plate"}


def test_the_cheapest_way_counts_the_references_uncertainty_against_a_mesh(tmp_path: Path) -> None:
    levels = [
        record("zone", {"model": "hex", "order": 4, "size_mm": 1.0}, v, 1.0, "reference") for v in (108.0, 104.0, 102.0)
    ]
    near = record("zone", {"model": "hex", "order": 2, "size_mm": 1.0}, 100.5, 0.1)  # 0.5 % off, reference +-2 %
    exact = record("zone", {"model": "hex", "order": 3, "size_mm": 1.0}, 100.0, 9.0)
    page = accuracy.conclude([*levels, near, exact])
    row = page.sections[0].tables[0].rows[0]
    assert "hex2" in row[1] and row[2:] == ["none of these"] * 3  # 3 %, then 1 % and finer
    paths = write_page(tmp_path, "accuracy", accuracy.TITLE, accuracy.LEAD, page)
    assert (tmp_path / "pictures" / "accuracy_zone.svg").exists() and paths[-1].name == "report.html"


def test_a_refused_mesh_is_shown_with_its_reason() -> None:
    levels = [
        record("zone", {"model": "hex", "order": 4, "size_mm": 1.0}, v, 1.0, "reference") for v in (108.0, 104.0, 102.0)
    ]
    refused = {
        **record("zone", {"model": "hex", "order": 2, "size_mm": 1.0}, 1.0, 1.0),
        "values": {},
        "refused": "too large",
    }
    del refused["measured"]
    section = accuracy.conclude([*levels, refused]).sections[-1]
    assert section.tables[0].rows[0][-1] == "too large"


def test_a_mesh_is_measured_and_repeated() -> None:
    class Quiet:
        def info(self, *_: Any) -> None:
            pass

    mesh_level = {"model": "hex", "order": 2, "size_mm": 1.0, "layers": 0}
    result = accuracy.compute({"part": "pillar", "mesh_level": mesh_level, "role": "mesh_level"}, Path(), Quiet())
    design = ladder.plate_design()
    pillar = predesign(design).pillar
    slender = pillar.given_height_m / design.pillar.tip_m
    theory = calibration.by_theory(
        "pillar", "timoshenko", calibration.SLENDER["pillar"]
    )  # at the calibrated slenderness
    coarse = 1.5 * 0.016  # the calibrated error of order 2 with elements of a millimetre, and its safety
    assert slender == pytest.approx(3.15) and result["measured"]["repeats"] == 3
    assert abs(result["values"]["pillar"] / pillar.given_timoshenko_hz - 1.0) < theory + coarse
