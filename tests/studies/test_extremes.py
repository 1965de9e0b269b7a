"""The extreme scenes that are quick: right or refused, and a wrong number would be seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from geometry.mesh import split_hexahedra
from studies import extremes


class Quiet:
    def info(self, *_: Any) -> None:
        pass


QUICK = [
    (name, parameters)
    for name, parameters in extremes.cases()
    if parameters["scene"] in ("thin", "size", "cluster", "on_eigenvalue", "one_element", "mixed_units")
    or (parameters["scene"] == "poisson" and parameters["poisson"] in (-0.5, 0.4999, 0.5))
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "parameters"), QUICK, ids=[name for name, _ in QUICK])
def test_right_or_refused(name: str, parameters: dict[str, Any]) -> None:
    result = extremes.compute(parameters, Path(), Quiet())["found"]
    low_order = parameters.get("element") in ("hex1", "tet1", "tet2")
    assert result["verdict"] in (("right", "refused", "locks") if low_order else ("right", "refused"))
    if result["verdict"] == "refused":
        assert result["reason"]


def test_the_slender_and_the_impossible_are_refused() -> None:
    for parameters in (
        {"scene": "thin", "length_over_thickness": 10_000},
        {"scene": "poisson", "element": "hex2", "poisson": 0.5},
        {"scene": "mixed_units", "thickness_mm": 2000.0},
    ):
        assert extremes.compute(parameters, Path(), Quiet())["found"]["verdict"] == "refused"


def test_a_wrong_number_fails_its_case(monkeypatch: pytest.MonkeyPatch) -> None:
    exact = extremes.supported_plate_hz
    monkeypatch.setattr(extremes, "supported_plate_hz", lambda *given: 1.05 * exact(*given))
    record = extremes.compute({"scene": "thin", "length_over_thickness": 30}, Path(), Quiet())
    assert record["found"]["verdict"] == "WRONG" and record["status"] == "FAILED"


def test_the_flattest_angle_of_known_tetrahedra() -> None:
    mesh = split_hexahedra(extremes.box((1.0, 1.0, 1.0), (1, 1, 1), 2))
    assert extremes.smallest_dihedral(mesh) == pytest.approx(45.0)
