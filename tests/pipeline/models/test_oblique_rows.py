"""Rows along any two vectors: attenuation and confinement against those of shifted rows, and bare plate; own cells, too."""

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
from pipeline.models.broadband import checked
from pipeline.questions.attenuation import Attenuation, AttenuationResult, MeshAttenuation
from pipeline.questions.broadband import Broadband, BroadbandResult, MeshBroadband
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


def files(folder: Path, lean_mm: float, pillar: bool = True, sizes: tuple[float, ...] = (1.4e-3, 0.7e-3)) -> list[str]:
    """Meshes of the cell between (5, 0) and (lean, 4) mm, with or without the pillar; of two, one is finer everywhere."""
    design = case().design
    edges = ((5e-3, 0.0), (1e-3 * lean_mm, 4e-3))
    panel = Panel((0.0, 0.0), (0.0, 0.0), (0.0, 0.0) if pillar else None, edges_m=edges)
    found = []
    for number, size in enumerate(sizes):
        least = 1 if number + 1 < len(sizes) else 2
        settings = HexSettings(2, size, 0, least=least, through=least)
        mesh = oblique_mesh(panel, design.stack, design.pillar, settings).mesh
        whole = replace(mesh, regions={"plate": np.arange(len(mesh.cells))})
        found.append(written(whole, folder / f"{lean_mm}-{number}.msh"))
    return found


def attenuation(scene: Case, meshes: list[str], **own: Any) -> AttenuationResult:
    return ask(scene, MeshAttenuation(mesh_file=tuple(meshes), **WINDOW | own), Run(LOG))


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
    """Panels half a pitch wide, a row of two of them, against one parallelogram: within the sum of the bars.

    Above 60 kHz, where a narrow resonance of the pillars moves further on such coarse meshes than two of them show.
    """
    above: dict[str, Any] = {"band_kHz": (70.0, 110.0), "points": 5}
    ours = ask(case(), Attenuation(**WINDOW | above), Run(LOG))
    own = attenuation(case(), files(tmp_path, lean_mm), **above)
    assert any((point.db_per_row or 0.0) > 1.0 for point in ours.points)
    for one, two in zip(ours.points, own.points, strict=True):
        if one.db_per_row is None or two.db_per_row is None:
            continue
        assert one.db_error is not None and two.db_error is not None
        assert abs(one.db_per_row - two.db_per_row) <= one.db_error + two.db_error + 1e-6
        if None not in (one.taken_db, two.taken_db, one.taken_error_db, two.taken_error_db):
            assert abs(one.taken_db - two.taken_db) <= one.taken_error_db + two.taken_error_db  # type: ignore[operator]


# -- a zone between shifted rows ---------------------------------------------------------------------------------------

ZONE = {"length_mm": 60.0, "width_mm": 12.0, "nodal_lines": 4}
DRIVEN: dict[str, Any] = {"band_kHz": (20.0, 55.0), "points": 8}


def zoned(array: dict[str, Any], **own: Any) -> Case:
    return case({"extension_mm": 8.0} | array, **{"zone": ZONE, "solve": {"accuracy": 0.05}} | own)


def assert_alike(ours: BroadbandResult, own: BroadbandResult) -> None:
    """Confinement and attenuation over frequency, and the target mode, within the sums of both bars."""
    assert max(point.taken_db or 0.0 for point in ours.points) > 10.0
    for one, two in zip(ours.points, own.points, strict=True):
        for name, bar in (("confinement_db", "confinement_error_db"), ("taken_db", "taken_error_db")):
            assert abs(getattr(one, name) - getattr(two, name)) <= getattr(one, bar) + getattr(two, bar)
    assert ours.target_hz and own.target_hz and ours.target_db and own.target_db
    assert ours.target_error and own.target_error and ours.target_error_db and own.target_error_db
    assert abs(own.target_hz / ours.target_hz - 1.0) <= ours.target_error + own.target_error
    assert abs(own.target_db - ours.target_db) <= ours.target_error_db + own.target_error_db


@pytest.mark.slow
@pytest.mark.parametrize("stagger", [True, False], ids=["shifted", "in line"])
def test_parallelograms_confine_as_the_cells_of_rows_along_x(stagger: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows in line and shifted by half a pitch, of their own panels and of cells along two vectors."""
    scene = zoned(STAGGERED | {"stagger": stagger})
    ours = ask(scene, Broadband(**DRIVEN), Run(LOG))
    monkeypatch.setattr("pipeline.models.broadband.by_rows", in_parallelograms)
    assert_alike(ours, ask(scene, Broadband(**DRIVEN), Run(LOG)))


def in_parallelograms(scene: Case) -> Case:
    (along, _), (_, distance) = scene.design.lattice.vectors_m
    shift = 0.5 * along if scene.design.stagger else 0.0
    return replace(scene, design=replace(scene.design, stagger=False, oblique_m=((along, 0.0), (shift, distance))))


@pytest.mark.slow
def test_own_leaning_cells_pass_what_shifted_rows_pass(tmp_path: Path) -> None:
    """Rows of own cells begin half a cell further from the zone, which leaves the power through them as it is."""
    ours = ask(zoned(STAGGERED), Broadband(**DRIVEN), Run(LOG))
    own = ask(zoned(STAGGERED), MeshBroadband(mesh_file=tuple(files(tmp_path, 2.5)), **DRIVEN), Run(LOG))
    assert max(point.taken_db or 0.0 for point in own.points) > 10.0 and own.target_hz
    for one, two in zip(ours.points, own.points, strict=True):
        assert one.taken_error_db and two.taken_error_db and two.confinement_error_db
        assert abs(one.taken_db - two.taken_db) <= one.taken_error_db + two.taken_error_db  # type: ignore[operator]


SAME_ROWS = OBLIQUE | {"a1_mm": [-6.2, -4.0], "a2_mm": [11.2, 4.0]}


def test_any_vectors_of_a_lattice_give_the_same_rows_and_a_single_one_is_not_shifted() -> None:
    one, other = checked(zoned(OBLIQUE)), checked(zoned(SAME_ROWS))
    assert one.oblique_m == pytest.approx(np.array([[5e-3, 0.0], [1.2e-3, 4e-3]]), rel=1e-12)
    assert other.oblique_m == pytest.approx(np.array(one.oblique_m), rel=1e-12, abs=1e-15)
    assert (one.pitch_x_m, one.pitch_y_m) == pytest.approx((5e-3, 4e-3), rel=1e-12)
    single = checked(zoned(OBLIQUE | {"rows": 1, "extension_mm": 0.0}))
    assert single == checked(zoned({"pitch_x_mm": 5.0, "pitch_y_mm": 4.0, "rows": 1, "extension_mm": 0.0}))


def test_shifted_rows_of_wide_pillars_have_oblique_cells_where_there_are_several() -> None:
    wide = {"pillar": {"shape": "square", "side_mm": 2.6, "height_mm": 4.0}}
    assert checked(zoned(STAGGERED, **wide)).oblique_m == ((5e-3, 0.0), (2.5e-3, 4e-3))
    assert checked(zoned(STAGGERED | {"rows": 1}, **wide)).oblique_m is None
    assert checked(zoned(STAGGERED)).oblique_m is None


@pytest.mark.slow
@pytest.mark.usefixtures("coarsest_here")
def test_any_vectors_of_a_lattice_give_the_same_figures() -> None:
    figures = [
        ask(zoned(array), Broadband(band_kHz=(40.0, 50.0), points=2), Run(LOG)) for array in (OBLIQUE, SAME_ROWS)
    ]
    assert figures[0].confinement_db == pytest.approx(figures[1].confinement_db, rel=1e-9)
    levels = [each.taken_db(50e3) for each in figures]
    assert levels[0] == pytest.approx(levels[1], rel=1e-9) and levels[0] > 1.0


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ({"array": OBLIQUE | {"extension_mm": 0.5}}, r"array.extension_mm = 0.5: must be at least 1 for oblique cells"),
        (
            {"array": OBLIQUE | {"a2_mm": [1.2, 12.0], "extension_mm": 8.0}},
            r"zone.width_mm = 12: must be above 13.3333 for oblique cells, whose pillars are in their middle",
        ),
        ({"array": {"a1_mm": [5.0, 1.0], "a2_mm": [1.23, 4.01], "rows": 2}}, "has no rows along x: turn its"),
        ({"pillar": {"shape": "square", "side_mm": 2.0, "height_mm": 4.0, "fillet_mm": 0.1}}, "hexahedra can follow"),
    ],
)
def test_plates_that_cut_oblique_cells_short_are_refused_in_one_line(own: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as fault:
        Broadband().suited(zoned(**{"array": OBLIQUE} | own))
    assert len(fault.value.lines) == 1
