"""The committed calibration is what the stored accuracy study says, and a study of other meshes is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from pipeline.planning import mesh_rules
from pipeline.records import store
from studies import accuracy, ladder

SECONDS = {"seconds": 1.0, "repeats": 1, "peak_bytes": 1_000_000}


def stored(part: str, mesh_level: dict[str, Any], values: dict[str, float], role: str = "mesh_level") -> dict[str, Any]:
    return {"parameters": {"part": part, "mesh_level": mesh_level, "role": role}, "values": values, "measured": SECONDS}


def pillar(values: tuple[float, float, float]) -> dict[str, float]:
    return dict(zip(accuracy.QUANTITIES["pillar"], values, strict=True))


REFERENCES = [
    stored(
        "pillar", {"model": "hex", "order": 4, "size_mm": 1.0}, pillar((100.0 + d, 200.0 + d, 300.0 + d)), "reference"
    )
    for d in (4.0, 2.0, 1.0)
]  # their limit: 100, 200, 300


def test_a_mesh_has_its_worst_quantity_and_a_theory_its_first() -> None:
    planned = {"model": "hex", "order": 3, "size_mm": 2.0, "layers": 1, "factor": 0.1, "share": 0.5, "through": 2}
    other = {"model": "hex", "order": 3, "size_mm": 2.0}
    tets = {"model": "tet", "order": 2, "size_mm": 1.0}
    theory = {"model": "analytic", "theory": "euler"}
    result = accuracy.calibration_rows(
        [
            *REFERENCES,
            stored("pillar", planned, pillar((101.0, 200.0, 297.0))),
            stored("pillar", other, pillar((150.0, 200.0, 300.0))),
            stored("pillar", tets, pillar((100.0, 206.0, 300.0))),
            stored("pillar", theory, pillar((102.0, 260.0, 500.0))),
        ]
    )
    assert result == [
        ("pillar", "euler", 0, 0, 0.0, 0.0, 0, 0.0, 1.0, 0.02),
        ("pillar", "hex", 3, 1, 0.1, 0.5, 2, 0.0, 1.0, 0.01),
        ("pillar", "tet", 2, 0, 0.0, 0.0, 0, 2.0, 1.0, 0.03),
    ]


def test_a_zones_modes_tell_what_hexahedra_do_at_their_frequencies_and_tetrahedra_at_the_first() -> None:
    good = mesh_rules.good_to_hz("zone", ladder.design())
    low, high = 1.2005 * good, 1.7509 * good

    def zone(mesh_level: dict[str, Any], errors: tuple[float, ...], role: str = "mesh_level") -> dict[str, Any]:
        tones = [hz * (1.0 + error) for hz, error in zip((low, high), errors, strict=False)]
        return stored("zone", mesh_level, dict(zip(ladder.ZONE, tones, strict=False)), role)

    planned = {"model": "hex", "order": 3, "size_mm": 8.0, "layers": 1, "factor": 0.1, "share": 0.8, "through": 1}
    result = accuracy.calibration_rows(
        [
            *(zone({"model": "hex", "order": 4, "size_mm": 1.0}, (d, d), "reference") for d in (4e-6, 2e-6, 1e-6)),
            zone(planned, (0.01, 0.04)),
            zone({**planned, "share": 1.0}, (0.02,)),
            zone({"model": "tet", "order": 2, "size_mm": 2.0}, (0.03, 0.08)),
        ]
    )
    assert result == [
        ("zone", "hex", 3, 1, 0.1, 0.8, 1, 0.0, 1.2, 0.01),
        ("zone", "hex", 3, 1, 0.1, 0.8, 1, 0.0, 1.75, 0.04),
        ("zone", "hex", 3, 1, 0.1, 1.0, 1, 0.0, 1.2, 0.02),
        ("zone", "tet", 2, 0, 0.0, 0.0, 0, 2.0, 1.0, 0.03),
    ]


def test_a_study_of_other_meshes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    name, given = next((name, given) for name, given in accuracy.cases() if given["role"] == "mesh_level")
    folder = tmp_path / "accuracy" / name
    folder.mkdir(parents=True)
    other = {**given, "mesh_level": {**given["mesh_level"], "size_mm": 123.0}}
    (folder / "input.json").write_text(json.dumps({"parameters": other}))
    store.seal(folder, {"schema": store.SCHEMA, "case_id": name, "status": "OK"})
    monkeypatch.setattr(accuracy, "RESULTS", tmp_path)
    monkeypatch.setattr(accuracy, "TABLE", tmp_path / "calibration.csv")
    assert accuracy.main() == 2
    assert name in capsys.readouterr().err
    assert not (tmp_path / "calibration.csv").exists()
