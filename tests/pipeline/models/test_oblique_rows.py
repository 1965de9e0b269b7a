"""Rows of own cells along any two vectors: attenuation against the case's own shifted rows, and bare plate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry.hex.oblique import oblique_mesh
from geometry.hex.scenes import HexSettings
from geometry.tiling import Panel
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.questions.attenuation import Attenuation, AttenuationResult, MeshAttenuation
from pipeline.questions.broadband import MeshBroadband
from pipeline.questions.question import Run, ask
from tests.pipeline.models.test_own_cell import written

LOG = TerminalLog(True)
PILLAR = {"shape": "square", "side_mm": 2.0, "height_mm": 4.0}
STAGGERED = {"pitch_x_mm": 5.0, "pitch_y_mm": 4.0, "rows": 2, "stagger": True}
OBLIQUE = {"a1_mm": [5.0, 0.0], "a2_mm": [1.2, 4.0], "rows": 2}
WINDOW: dict[str, Any] = {"band_kHz": (60.0, 110.0), "points": 6, "kx_per_m": 150.0}


def case(array: dict[str, Any] = STAGGERED, **own: Any) -> Case:
    plain: dict[str, Any] = {"name": "rows", "material": "aluminium", "plate": {"thickness_mm": 1.0}, "array": array}
    plain |= {"pillar": PILLAR}
    return case_from_dict(plain | {"solve": {"accuracy": 0.01}, "bands": {"count": 6}} | own)


def files(folder: Path, lean_mm: float, pillar: bool = True, sizes: tuple[float, ...] = (1e-3, 0.6e-3)) -> list[str]:
    """Meshes of the cell between (5, 0) and (lean, 4) mm, with or without the pillar."""
    design = case().design
    edges = ((5e-3, 0.0), (1e-3 * lean_mm, 4e-3))
    panel = Panel((0.0, 0.0), (0.0, 0.0), (0.0, 0.0) if pillar else None, edges_m=edges)
    found = []
    for number, size in enumerate(sizes):
        mesh = oblique_mesh(panel, design.stack, design.pillar, HexSettings(2, size, 0, least=2, through=2)).mesh
        whole = replace(mesh, regions={"plate": np.arange(len(mesh.cells))})
        found.append(written(whole, folder / f"{lean_mm}-{number}.msh"))
    return found


def attenuation(scene: Case, meshes: list[str]) -> AttenuationResult:
    return ask(scene, MeshAttenuation(mesh_file=tuple(meshes), **WINDOW), Run(LOG))


@pytest.mark.slow
@pytest.mark.parametrize("lean_mm", [1.2, -3.8])
def test_bare_oblique_cells_pass_everything(lean_mm: float, tmp_path: Path) -> None:
    """Whichever of its lattice's cells: no decay, all of the power, and the wavenumbers of a rectangular cell."""
    plain = attenuation(
        case({"pitch_x_mm": 5.0, "pitch_y_mm": 4.0, "rows": 2}, solve={"accuracy": 0.05}),
        files(tmp_path, 0.0, pillar=False, sizes=(1.2e-3,)),
    )
    found = attenuation(
        case(OBLIQUE, solve={"accuracy": 0.05}), files(tmp_path, lean_mm, pillar=False, sizes=(1.2e-3,))
    )
    assert found.points[0].frequency_hz == 60e3 and found.to_dict()["pitch_y_m"] == pytest.approx(4e-3)
    for point, other in zip(found.points, plain.points, strict=True):
        own, theirs = ([wave.ky_re_per_m for wave in each.waves if wave.db_per_row < 1e-6] for each in (point, other))
        assert own and sorted(map(abs, own)) == pytest.approx(sorted(map(abs, theirs)), rel=2e-3)
        assert point.db_per_row == pytest.approx(0.0, abs=1e-6)
        assert point.taken_db == pytest.approx(0.0, abs=0.05)


def test_cells_that_lean_otherwise_and_other_lattices_are_refused_in_one_line(tmp_path: Path) -> None:
    (file,) = files(tmp_path, 1.2, pillar=False, sizes=(2e-3,))
    turned = case({"a1_mm": [4.0, 3.0], "a2_mm": [-3.1, 4.0001], "rows": 2})
    for scene, words in (
        (case(), r"its upper side lies 1.2 mm further along x than the lower one, but rows of the lattice are shifted"),
        (turned, r"array.a2_mm: attenuation needs a lattice with rows along x"),
    ):
        with pytest.raises(InputError, match=words) as fault:
            attenuation(scene, [file])
        assert len(fault.value.lines) == 1
    zone = {"length_mm": 60.0, "width_mm": 12.0, "nodal_lines": 4}
    (leaning,) = files(tmp_path, 2.5, pillar=False, sizes=(2e-3,))
    with pytest.raises(InputError, match="broadband needs a square or rectangular lattice") as fault:
        ask(case(STAGGERED | {"extension_mm": 8.0}, zone=zone),
            MeshBroadband(mesh_file=(leaning,), band_kHz=(60.0, 61.0), points=2), Run(LOG))  # fmt: skip
    assert len(fault.value.lines) == 1


@pytest.mark.slow
@pytest.mark.parametrize("array", [STAGGERED, OBLIQUE], ids=["staggered", "oblique"])
def test_rows_of_a_parallelogram_stop_what_other_cells_of_the_lattice_stop(
    array: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two panels half a pitch wide, or one parallelogram that leans to the other side: within the sum of the bars."""
    scene, window = case(array, solve={"accuracy": 0.05}), WINDOW | {"band_kHz": (50.0, 55.0), "points": 3}
    ours = ask(scene, Attenuation(**window), Run(LOG))
    if array is STAGGERED:
        monkeypatch.setattr("pipeline.planning.model_choice._is_in_one_cell", lambda _: True)
    else:
        monkeypatch.setattr("pipeline.planning.model_choice.row_vectors", lambda *_: ((5e-3, 0.0), (-3.8e-3, 4e-3)))
    own = ask(scene, Attenuation(**window), Run(LOG))
    assert any((point.db_per_row or 0.0) > 1.0 for point in ours.points)
    for one, two in zip(ours.points, own.points, strict=True):
        for level, its, bar, other in (
            (one.db_per_row, two.db_per_row, one.db_error, two.db_error),
            (one.taken_db, two.taken_db, one.taken_error_db, two.taken_error_db),
        ):
            assert None not in (level, its, bar, other)
            assert abs(level - its) <= bar + other  # type: ignore[operator]


@pytest.mark.slow
@pytest.mark.parametrize("lean_mm", [2.5, -2.5])
def test_own_oblique_cells_have_the_decay_of_shifted_rows(lean_mm: float, tmp_path: Path) -> None:
    """Panels half a pitch wide, a row of two of them, against one parallelogram: within the sum of the bars."""
    ours = ask(case(), Attenuation(**WINDOW), Run(LOG))
    own = attenuation(case(), files(tmp_path, lean_mm))
    assert any((point.db_per_row or 0.0) > 1.0 for point in ours.points)
    for one, two in zip(ours.points, own.points, strict=True):
        if one.db_per_row is None or two.db_per_row is None or one.db_error is None or two.db_error is None:
            continue
        assert abs(one.db_per_row - two.db_per_row) <= one.db_error + two.db_error + 1e-6
        if None not in (one.taken_db, two.taken_db, one.taken_error_db, two.taken_error_db):
            assert abs(one.taken_db - two.taken_db) <= one.taken_error_db + two.taken_error_db  # type: ignore[operator]
