"""Answers of the page's program, what it keeps, and what it refuses."""

from __future__ import annotations

import http.client
import json
import math
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from geometry.tiling import Panel
from pipeline.case.model import Case, load_case
from pipeline.errors import InputError
from pipeline.explore import answer
from pipeline.explore import server as served_module
from pipeline.explore.answer import BATCH, PLATES, Bar, Candidate, Explorer, apart, compute, read_design
from pipeline.explore.server import BackgroundExplorer, Server
from pipeline.logs import TerminalLog, WarningLog
from pipeline.models import parametric
from pipeline.models.cell_cache import SUFFIX
from pipeline.models.live_column import (
    FACE,
    INNER,
    TIED,
    Detuned,
    LiveCell,
    LivePlate,
    LiveReductions,
    boundary_error,
    end_layer,
)
from pipeline.models.parametric import (
    ACCURACY,
    CellModelCache,
    MeshTable,
    corner_weights,
    off_by,
    require_box,
    sizes_of,
    with_sizes,
)
from pipeline.planning import mesh_rules
from solvers.analytic.predesign import free_kx_per_m
from solvers.fem.assembly import Scale, assemble
from solvers.measures.confinement import Confinement
from solvers.parametric.affine import HEIGHT, AffineCell, DesignBox
from solvers.parametric.bands import INNER as INNER_OF_BANDS
from solvers.parametric.bands import bands
from solvers.parametric.cell import ParametricCell
from solvers.plates.column import Column
from solvers.superelement.cell import Cell
from solvers.superelement.lattice import ReducedLattice
from solvers.superelement.reduction import reduce_cell
from solvers.waves.branches import label_of
from solvers.waves.gaps import complete_gaps
from studies.live import BesidePlate
from tests.helpers.exploring import OFFLINE, SMALL, served, small_explorer

OWN = {"height": 6.3, "side": 2.0, "pitch": 4.0, "thickness": 2.0, "rows": 1.0, "extension": 5.0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cells")


@pytest.fixture(scope="module")
def explorer(folder: Path) -> Explorer:
    return small_explorer(folder)


@pytest.fixture(scope="module")
def server(explorer: Explorer) -> Iterator[Server]:
    with served(explorer) as started:
        yield started


@pytest.mark.slow
def test_the_scene_starts_with_the_file(explorer: Explorer) -> None:
    assert explorer.scene.own() == OWN


@pytest.mark.slow
def test_a_kept_model_is_the_one_made(explorer: Explorer, folder: Path) -> None:
    (kept,) = folder.glob(f"*{SUFFIX}")
    cache = CellModelCache(folder)
    again = cache.get_model(kept.name.split("-")[1])
    assert again is not None
    sizes = (2e-3, 6.3e-3, 2e-3, 4e-3)
    one, other = (bands(model.cell, model.bases, sizes) for model in (explorer.model, again))
    assert (one.frequency_hz == other.frequency_hz).all() and (one.error == other.error).all()


@pytest.mark.slow
def test_the_bases_say_how_far_they_are_and_small_solves_have_one_thread(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Threads of BLAS on thousands of small matrices only wait for each other."""
    case, threads, gather = load_case(SMALL), list[int](), parametric.band_bases

    def watched(*given: Any) -> Any:
        threads.extend(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")
        return gather(*given)

    monkeypatch.setattr(parametric, "band_bases", watched)
    parametric._made(case, parametric._for_case(OFFLINE, case), TerminalLog())
    said = capsys.readouterr().err
    places = [said.index(f"symmetry class {number} of 5 done") for number in range(1, 6)]
    assert said.index("takes some minutes") < places[0] and places == sorted(places) and set(threads) == {1}


def test_a_damaged_model_counts_as_absent(folder: Path, explorer: Explorer, tmp_path: Path) -> None:
    (kept,) = folder.glob(f"*{SUFFIX}")
    data = bytearray(kept.read_bytes())
    data[len(data) // 2] ^= 0xFF
    (tmp_path / kept.name).write_bytes(data)
    assert CellModelCache(tmp_path).get_model(kept.name.split("-")[1]) is None
    (tmp_path / kept.name).write_bytes(data[: len(data) // 2])
    assert CellModelCache(tmp_path).get_model(kept.name.split("-")[1]) is None


def test_bands_and_gaps_are_those_of_the_design(explorer: Explorer) -> None:
    given = OWN | {"height": 6.6, "pitch": 4.2}
    answer = explorer.answer(given)["bands"]
    lattice = ReducedLattice(explorer.model.cell.at((2e-3, 6.6e-3, 2e-3, 4.2e-3), INNER))
    x = lattice.frequencies(np.array([np.pi / 4.2e-3, 0.0]), 10)
    assert answer["frequency_hz"][4] == pytest.approx(x.tolist(), rel=0.01)
    assert answer["labels"][4] == "X"
    gaps = complete_gaps(np.array(answer["frequency_hz"]))
    assert [gap["lower_band"] for gap in answer["gaps"]] == [gap.lower_band for gap in gaps]
    assert all(gap["error"] > 0.0 for gap in answer["gaps"])


def test_shares_of_a_wave_are_those_of_the_cell_and_of_a_heavier_pillar(explorer: Explorer) -> None:
    """Bending as `waves.branches` has it of the joined cell, up to the turn that a too high frequency allows: the root of its
    excess. The pillar by Hellmann and Feynman: one denser by a fraction lowers w^2 by its share of the kinetic energy times
    that; differences to second order, and within the bands' own error.
    """
    cell, bases, sizes = explorer.model.cell, explorer.model.bases, (2e-3, 6.6e-3, 2e-3, 4.2e-3)
    found, joined = bands(cell, bases, sizes), ReducedLattice(cell.at(sizes, INNER_OF_BANDS))
    assert np.isnan(found.pillar[0, :3]).all() and np.isfinite(found.flexural[1:-1]).all()
    for point in (2, 4, 6, 10):
        wavevector = bases.fractions[point] * np.pi / sizes[3]
        waves = joined.waves(wavevector, bases.count)
        labels = label_of(joined.cell, waves.dofs, np.tile(wavevector[:, None], bases.count))
        turn = 2.0 * np.sqrt(np.abs(found.frequency_hz[point] / waves.frequency_hz - 1.0)) + 1e-6
        off = np.abs(found.flexural[point] - [label.flexural_share for label in labels])
        assert (off <= turn).all() and turn[:5].max() < 0.01
    more = 1e-3
    lower, higher = (bands(denser(cell, change), bases, sizes).frequency_hz for change in (-more, more))
    share = np.log(lower / higher)[1:-1] / more
    assert np.abs(share - found.pillar[1:-1]).max() <= more + 2.0 * found.error.max()
    assert 0.2 < found.pillar[1:-1].min() < 0.5 and found.pillar[1:-1].max() > 0.99


def denser(cell: ParametricCell, change: float) -> ParametricCell:
    """The cell with a pillar denser by a fraction."""
    factors = [1.0 + change * (block.mass_exponents[:, HEIGHT, None, None] > 0) for block in cell.blocks]
    return replace(
        cell,
        blocks=tuple(replace(own, mass=f * own.mass) for own, f in zip(cell.blocks, factors, strict=True)),
    )


def test_no_figure_of_the_mesh_is_told_where_none_was_measured(explorer: Explorer) -> None:
    answer = explorer.answer(OWN)
    assert all(bar > 0.0 for bar in answer["bands"]["mesh_error"])
    largest = max(bar + own for bar, own in zip(answer["bands"]["mesh_error"], answer["bands"]["error"], strict=True))
    assert all(0.0 < gap["error"] <= largest for gap in answer["bands"]["gaps"])
    unknown = Explorer(explorer.scene, replace(explorer.model, mesh=None)).answer(OWN)
    assert unknown["bands"]["mesh_error"] is None and {gap["error"] for gap in unknown["bands"]["gaps"]} <= {None}
    assert answer["plate"]["frequency_error"] > unknown["plate"]["frequency_error"] > 0.0


def test_a_levels_bar_holds_what_zone_and_rows_may_be_off_by_against_each_other(explorer: Explorer) -> None:
    """The bar covers the level at every change within the frequency's error, and grows with that error."""
    case = load_case(SMALL)
    live = LivePlate(case, LiveCell(explorer.model.cell), {}, mesh_rules.target_window_hz(case.design))
    bars = []
    for mesh in (0.0, 0.01, 0.03):
        plate = explorer.plate(case, lambda hz: mesh)  # noqa: B023  called before mesh changes
        error = boundary_error(case.design) + end_layer(case.design) / 2.0 + mesh
        for change in (-error, error):
            for sign in (1.0, -1.0):
                found = live.verdict(change, sign * change)
                level = found.level.confinement_db[found.verdict.index]
                assert abs(level - plate["confinement_db"]) <= plate["confinement_error_db"]
        assert plate["frequency_error"] >= error
        bars.append(plate["confinement_error_db"])
    assert bars == sorted(bars) and bars[0] < bars[2]


def detuned(frequency_hz: list[float], strength: list[float], level_db: list[float]) -> Detuned:
    """A live plate's answer in which three clear modes share the target shape."""
    columns = [np.array(column) for column in (frequency_hz, strength, level_db)]
    ones = np.ones(len(strength))
    level = Confinement(ones, columns[2], ones, np.full(len(strength), np.nan), columns[1])
    live = LivePlate.__new__(LivePlate)
    live.searched, live.top_hz = (20e3, 50e3), 60e3
    live.modes = SimpleNamespace(detuned=lambda zone, rows: (columns[0], np.eye(len(ones)), level))  # type: ignore[assignment]
    return live.verdict()


def test_modes_whose_weights_may_change_places_are_named_each_with_its_bars() -> None:
    """Of weights 0.30, 0.29 and 0.15 the best leads the second by less than half as much: they may change places."""
    own = detuned([30e3, 44e3, 48e3], [0.29, 0.30, 0.15], [3.0, 8.0, 20.0])
    assert own.verdict.index == 1 and own.tied == (1, 0)
    bar = Bar.over([own], own, 0.02)
    assert bar.frequency == pytest.approx(0.02) and bar.status == "split"
    assert bar.confinement.half_db == pytest.approx(TIED) and bar.extension.half_db is None
    (other,) = bar.others
    assert astuple(other) == pytest.approx((30e3, 0.02, 3.0, TIED))
    assert "may also be that at 30.0 kHz" in bar.warnings()[-1]


def test_what_one_mode_becomes_under_changes_is_one_candidate() -> None:
    assert [list(group) for group in apart(np.array([44e3, 30e3, 43.5e3, 30.2e3, 44.4e3]), 0.02)] == [[1, 3], [0, 2, 4]]
    other = Candidate.over(np.array([29e3, 31e3]), np.array([3.0, 5.0]), 0.02)
    assert astuple(other) == pytest.approx((30e3, 1.0 / 30.0 + 0.02, 4.0, 1.0 + TIED))
    alone = detuned([30e3, 44e3, 48e3], [0.10, 0.60, 0.10], [3.0, 8.0, 20.0])
    single = Bar.over([alone], alone, 0.02)
    assert alone.tied == (1,) and single.frequency == 0.02 and single.others == ()


def test_the_live_mode_is_searched_where_every_commands_is() -> None:
    """From the zone's frequency rigid across upwards, with what all modes that are not known may carry together."""
    low = detuned([21e3, 44e3], [0.60, 0.20], [3.0, 8.0])
    assert low.verdict.index == 0 and low.verdict.status == "single"
    assert detuned([19e3, 44e3], [0.60, 0.20], [3.0, 8.0]).verdict.index == 1
    assert detuned([44e3], [0.55], [3.0]).verdict.status == "split", "0.45 may lie elsewhere"


def test_a_mode_of_the_passive_plate_near_the_target_one_is_said(explorer: Explorer) -> None:
    """Of extensions from 5 to 40 mm some resonate near the target mode: these are said, with the levels between."""
    said = set()
    for extension in np.arange(5.0, 41.0, 5.0):
        plate = explorer.plate(explorer.scene.at(OWN | {"extension": float(extension)}))
        warned = [text for text in plate["warnings"] if "a mode of the passive plate" in text]
        assert len(warned) == (plate["near_hz"] is not None)
        said.add(plate["near_hz"] is None)
        if len(said) == 2:
            break
    assert said == {True, False}


@pytest.mark.parametrize("name", ["rows", pytest.param("extension", marks=pytest.mark.slow)])
def test_the_ends_of_the_sliders_answer(explorer: Explorer, name: str) -> None:
    """A last row cut by the plate's edge, no rows, no extension: `antinode modes` solves these plates, too."""
    limit = explorer.scene.limits[name]
    for value in (limit.low, limit.low + limit.step, limit.high):
        plate = explorer.plate(explorer.scene.at(OWN | {name: value}))
        assert plate["frequency_hz"] > 0.0 and "why_not" not in plate


@pytest.mark.parametrize("extension", [0.0, 5.0])
def test_a_live_plate_is_measured_over_its_whole_touch_face(explorer: Explorer, extension: float) -> None:
    """Half the zone and half the passive face, whether the last row's cell is a base or meshed because the edge cuts it."""
    case = explorer.scene.at(OWN | {"extension": extension})
    design = case.design
    live = LivePlate(case, LiveCell(explorer.model.cell), {}, mesh_rules.target_window_hz(design))
    zone, passive, beyond = live.plate.faces.areas
    assert zone == pytest.approx(design.length_m * design.width_m / 2.0)
    assert passive == pytest.approx(design.length_m * (design.half_span_m - design.width_m / 2.0))
    assert beyond == pytest.approx(design.length_m * extension * 1e-3, abs=1e-9 * passive)


def test_between_the_corners_the_error_is_a_product_of_powers_of_the_sizes() -> None:
    """A table of such a product gives it back everywhere, and every corner its own."""

    def error(t: float, h: float, a: float, p: float) -> float:
        least = max(box.low[3] - a, box.clearance_m)
        return float(1e-9 * t**-0.7 * h**0.3 * a**-0.2 * ((p - a) / least) ** 0.4)

    box = DesignBox((1e-3, 4e-3, 1e-3, 3e-3), (3e-3, 9e-3, 1.2e-3, 8e-3))
    measured = np.array([[error(*sizes)] for sizes in box.spread(0)])
    table = MeshTable(box, measured, 1.5, 0.5 * measured)
    for sizes in (*box.spread(0)[::5], (1.7e-3, 6e-3, 1e-3, 5e-3), (2.5e-3, 8e-3, 1.2e-3, 3.3e-3)):
        assert np.argmax(corner_weights(box, sizes)) >= 0 and corner_weights(box, sizes).sum() == pytest.approx(1.0)
        assert box.sample(box.unit(sizes))[0] == pytest.approx(sizes)
        assert table.at(sizes)[0] == pytest.approx(1.5 * error(*sizes), rel=1e-9)
        assert table.overestimate(sizes)[0] == pytest.approx(0.5 * error(*sizes), rel=1e-9)


@pytest.mark.slow
def test_the_table_holds_what_plain_reductions_are_apart_and_more_between(
    explorer: Explorer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plain reduction that is known: the margin is what the designs between the corners need."""
    cell, bases = explorer.model.cell, explorer.model.bases
    middle = cell.box.middle

    def apart(task: Any) -> np.ndarray:
        """High by 0.2 % in the corners, give or take 0.1 % from wavevector to wavevector, and by 0.8 % between; bars 0.1 %."""
        high = 8e-3 if task[0].design.thickness_m == pytest.approx(middle[0]) else 2e-3
        spread = np.array([-1e-3, 0.0, 1e-3])[:, None]
        return np.array([np.full((3, 10), high) + spread, np.full((3, 10), 1e-3)])

    monkeypatch.setattr(parametric, "off_by", apart)
    table = parametric.mesh_table(explorer.scene.case, cell, bases, [middle], map)
    assert table is not None and table.high == pytest.approx(np.full((16, 10), 2e-3))
    assert table.corners == pytest.approx(np.full((16, 10), 2e-3)) and table.margin == pytest.approx(4.0)
    assert table.at(middle) == pytest.approx(np.full(10, 8e-3)), "0.8 + 0.1 + 0.1 less the 0.2 taken"
    corrected = replace(explorer.model, mesh=table).bands(middle).frequency_hz
    assert corrected == pytest.approx(bands(cell, bases, middle).frequency_hz / 1.002)
    monkeypatch.setattr(parametric, "off_by", lambda task: np.full((2, 3, 10), np.nan))
    assert parametric.mesh_table(explorer.scene.case, cell, bases, [middle], map) is None


@pytest.mark.slow
def test_the_mesh_of_the_small_model_is_off_by_what_its_table_says(explorer: Explorer) -> None:
    """One corner against a plain reduction, whose own bar is part of what is told."""
    cell, bases = explorer.model.cell, explorer.model.bases
    sizes = cell.box.spread(0)[5]
    at = [number for number, label in enumerate(bases.labels) if label][:3]
    computed_hz = bands(cell, bases, sizes).frequency_hz[at]
    case = parametric.with_sizes(explorer.scene.case, sizes, 0.03, 10)
    twice = np.tile(bases.fractions[at] * np.pi / sizes[3], (2, 1))
    both = parametric.off_by((case, twice, np.vstack([computed_hz, 1.05 * computed_hz])))
    off, worse = both[:, :3], both[:, 3:]
    (high, bar), moving = off, np.isfinite(off[0])
    assert both.shape == (2, 6, 10) and moving[1:].all() and not moving[0].all(), "at rest nothing is told"
    assert (high[moving] > 0.0).all() and high[moving].max() < 0.1 and (bar[moving] > 1e-5).all()
    assert worse[0][moving] == pytest.approx(high[moving] + 0.05 * (1.0 + high[moving]))


class OwnMesh(LiveReductions):
    """The same column with each pillar's cell meshed and reduced for itself, on the topology of the bases."""

    def cell(self, panel: Panel) -> Cell:
        if panel.foot is None:
            return super().cell(panel)
        assert self.pillar is not None
        sizes = (self.stack.thickness_m, self.pillar.height_m, self.pillar.base_m, panel.high[0] - panel.low[0])
        affine = AffineCell(OFFLINE.box, OFFLINE.mesh, self.stack.material, self.pillar.material)
        mesh = replace(affine.mesh, nodes=affine.plan(affine.mesh.nodes, sizes), spans=None)
        materials = {"plate": self.stack.material, "pillar": self.pillar.material}
        scale = Scale.of(self.stack.thickness_m, self.stack.material)
        return reduce_cell(assemble(mesh, materials, scale), FACE, 3e6, (0, 1))


@pytest.mark.slow
def test_an_estimate_is_that_of_a_column_from_its_own_mesh(explorer: Explorer) -> None:
    case = load_case(SMALL)
    answer = explorer.estimate(case)
    window = mesh_rules.target_window_hz(case.design)
    reductions = OwnMesh(LiveCell(explorer.model.cell), case.design, {}, window[1])
    modes = Column(case.design, reductions, free_kx_per_m(case.design)).modes(*window)
    at = modes.confinement.target.index
    assert at is not None
    twice_the_bar = 2e-3  # of the coarse bases
    assert answer["frequency_hz"] == pytest.approx(modes.frequency_hz[at], rel=twice_the_bar)
    assert answer["confinement_db"] == pytest.approx(modes.confinement.confinement_db[at], abs=0.1)


def test_the_profile_is_a_shape_across_the_plate(explorer: Explorer) -> None:
    answer = explorer.answer(OWN)["plate"]
    places, level = answer["profile"]["y_mm"], answer["profile"]["level"]
    assert max(level) == 1.0 and places == sorted(places) and places[-1] < answer["half_span_mm"]


def coarse_error(explorer: Explorer, case: Case) -> Callable[[float], float]:
    """What the mesh of the small bases puts a cell's bands that reach down to a frequency off by: against plain reductions."""
    bases, sizes = explorer.model.bases, sizes_of(case.design)
    at = [number for number, label in enumerate(bases.labels) if label][:3]
    band_hz = bands(explorer.model.cell, bases, sizes).frequency_hz[at]
    plain = with_sizes(case, sizes, ACCURACY, bases.count)
    high, bar = off_by((plain, bases.fractions[at] * np.pi / sizes[3], band_hz))
    return lambda hz: float(np.nanmax((np.abs(high) + bar)[:, band_hz.min(axis=0) <= hz]))


@pytest.mark.slow
@pytest.mark.parametrize(
    "change", [{}, {"rows": 2.0, "extension": 20.0}, {"height": 6.9, "pitch": 4.4, "extension": 12.0}]
)
def test_the_live_plate_lies_within_its_bars(explorer: Explorer, change: dict[str, float]) -> None:
    """Against the assembled plate, which has meshes and degrees of its own, and a bar."""
    given = OWN | change
    case = explorer.scene.at(given)
    live = explorer.plate(case, coarse_error(explorer, case))
    real = compute(explorer.scene, given, WarningLog())
    assert BesidePlate.of(live, real).within


def test_decay_follows_the_pillars(explorer: Explorer) -> None:
    """A wave passes at 0 dB or decays; another height moves the pillars' resonance and with it the decay."""
    one, other = (explorer.answer(OWN | {"height": height})["rows"] for height in (6.1, 6.9))
    assert one["kx_per_m"] == pytest.approx(load_case(SMALL).target_kx_per_m)
    known = [value for value in one["db_per_row"] if value is not None]
    assert min(known) >= 0.0
    assert one["db_per_row"] != other["db_per_row"]


def test_a_decay_is_drawn_smoothly_up_to_its_edges() -> None:
    """A stop band's edge, where the decay is a root: the error of a chord over a step h is at most root(h) / 4."""
    hz, db = answer._bisected((0.0, 24.0), lambda f: 10.0 * math.sqrt(max(0.0, (f - 7.3) / 16.7)))
    assert len(hz) <= 49 and np.all(np.diff(hz) > 0.9 / answer.NARROW)
    fine = np.linspace(7.3, 24.0, 4001)
    off = np.abs(np.interp(fine, hz, np.array(db, dtype=float)) - 10.0 * np.sqrt((fine - 7.3) / 16.7))
    assert off[fine > 8.0].max() < 0.05 and off.max() < 10.0 * math.sqrt(2.0 / answer.NARROW / 16.7)
    assert len(answer._bisected((0.0, 24.0), lambda f: 0.2 * f)[0]) == answer.POINTS


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"height": 30.0}, "pillar.height_mm = 30"),
        ({"side": "2"}, "pillar.side_mm must be a number"),
        ({"rows": 1.5}, "whole number"),
        ({"pitch": float("nan")}, "array.pitch_mm must be a number"),
        ({"colour": 1.0}, "a design has the numbers"),
    ],
)
def test_a_design_that_is_none_is_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_design(OWN | change)


def test_sizes_beyond_the_bases_are_refused_by_name(explorer: Explorer) -> None:
    with pytest.raises(InputError, match="height = 8 mm: must lie between 6 and 7 mm"):
        explorer.answer(OWN | {"height": 8.0})


def test_other_pillars_are_refused() -> None:
    case = load_case(SMALL)
    assert case.design.pillar is not None
    filleted = replace(case.design.pillar, fillet_m=2e-4)
    design = replace(case.design, pillar=filleted, pitch_y_m=9e-3)
    with pytest.raises(InputError) as refused:
        require_box(replace(case, design=design))
    assert len(refused.value.lines) == 2


def request(
    server: Server, method: str, path: str, body: bytes | None = None, **headers: str
) -> tuple[int, str, dict[str, str]]:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    connection.request(method, path, body, {"Host": f"127.0.0.1:{server.port}"} | headers)
    response = connection.getresponse()
    return response.status, response.read().decode(), {name.lower(): value for name, value in response.getheaders()}


def error(text: str) -> str:
    said = json.loads(text)["error"]
    assert "\n" not in said and said
    return str(said)


def test_the_page_and_its_files_are_under_the_token(server: Server) -> None:
    for name, start in (
        ("", "<!DOCTYPE html>"),
        ("explore.js", '"use strict"'),
        ("figures.js", '"use strict"'),
        ("explore.css", ":root"),
    ):
        status, text, headers = request(server, "GET", f"/{server.token}/{name}")
        assert (status, text.startswith(start)) == (200, True)
        assert "default-src 'none'" in headers["content-security-policy"]
    for path in (
        "/",
        "/explore.js",
        f"/{server.token[:-1]}x/",
        f"/{server.token}/../scene",
        f"/{server.token}/server.py",
    ):
        status, text, _ = request(server, "GET", path)
        assert status == 404 and error(text)


def test_another_host_or_origin_is_refused(server: Server) -> None:
    path = f"/{server.token}/scene"
    foreign = (
        {"Host": "example.org"},
        {"Host": f"127.0.0.1.example.org:{server.port}"},
        {"Origin": "http://example.org"},
        {"Origin": "null"},
    )
    for headers in foreign:
        status, text, _ = request(server, "GET", path, None, **headers)
        assert status == 403 and "own machine" in error(text)
    assert request(server, "GET", path, Origin=f"http://127.0.0.1:{server.port}")[0] == 200


HUGE = b"9" * 400


@pytest.mark.parametrize("path", ["answer", "case", "full"])
@pytest.mark.parametrize("name", OWN)
def test_a_number_of_four_hundred_digits_is_refused_by_name(server: Server, path: str, name: str) -> None:
    body = json.dumps(OWN | {name: 0.125}).encode().replace(b"0.125", HUGE)
    status, text, headers = request(server, "POST", f"/{server.token}/{path}", body)
    assert status == 400 and error(text) and "content-security-policy" in headers


@pytest.mark.parametrize(
    "headers",
    [
        {"Content-Encoding": "gzip"},
        {"Content-Encoding": "deflate"},
        {"Content-Type": "application/json; charset=klingon"},
        {"Content-Type": "application/json; charset=utf-7"},
        {"Content-Type": "application/json; charset=base64"},
        {"Content-Type": "application/json; charset=\u00ff"},
    ],
)
def test_odd_encodings_and_charsets_are_one_line_with_the_headers(server: Server, headers: dict[str, str]) -> None:
    """JSON is UTF-8 whatever charset is named; what claims to be compressed and is not is refused."""
    status, text, answered = request(server, "POST", f"/{server.token}/case", json.dumps(OWN).encode(), **headers)
    assert "content-security-policy" in answered
    assert (status == 400 and error(text)) if "Content-Encoding" in headers else status == 200


def test_a_fault_of_the_program_is_one_line_with_the_headers(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server.explorer, "answer", lambda given: 1 / 0)
    status, text, headers = request(server, "POST", f"/{server.token}/answer", json.dumps(OWN).encode())
    assert status == 500 and "ZeroDivisionError" in error(text) and "content-security-policy" in headers


@pytest.mark.parametrize("body", [b"", b"{", b"\xff\xfe", b"[]", b"null", b'{"height": 1e999}', b"[" * 4000])
def test_garbage_is_refused_with_one_line(server: Server, body: bytes) -> None:
    for path in ("answer", "case", "full"):
        status, text, _ = request(server, "POST", f"/{server.token}/{path}", body)
        assert status == 400 and error(text)


def test_a_long_request_is_refused(server: Server) -> None:
    status, text, _ = request(server, "POST", f"/{server.token}/answer", b" " * 100_000)
    assert status == 413 and "at most" in error(text)


def test_bytes_that_are_no_request_leave_the_server_alive(server: Server) -> None:
    import socket

    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as raw:
        raw.sendall(b"\x16\x03\x01 nothing of http\r\n\r\n")
        raw.recv(1000)
    assert request(server, "GET", f"/{server.token}/scene")[0] == 200


def test_two_pages_at_once_have_each_its_answer(server: Server) -> None:
    designs = [OWN | {"height": height} for height in (6.2, 6.8)]

    def answer_of(design: dict[str, float]) -> Any:
        return json.loads(request(server, "POST", f"/{server.token}/answer", json.dumps(design).encode())[1])

    with ThreadPoolExecutor(4) as pages:
        answers = list(pages.map(answer_of, designs))
    assert [each["design"] for each in answers] == designs
    assert len({json.dumps(each["bands"]["frequency_hz"]) for each in answers}) == len(designs)


def test_a_closed_tab_costs_nobody_else_an_answer(server: Server) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    connection.request("POST", f"/{server.token}/answer", json.dumps(OWN), {"Host": f"127.0.0.1:{server.port}"})
    connection.close()
    status, text, _ = request(server, "POST", f"/{server.token}/answer", json.dumps(OWN).encode())
    assert status == 200 and json.loads(text)["design"] == OWN


def test_the_case_saved_is_the_design(server: Server, tmp_path: Path) -> None:
    design = OWN | {"height": 6.45, "rows": 2.0}
    status, text, _ = request(server, "POST", f"/{server.token}/case", json.dumps(design).encode())
    assert status == 200
    assert tomllib.loads(text)["pillar"]["height_mm"] == 6.45
    (tmp_path / "saved.toml").write_text(text, encoding="utf-8")
    case = load_case(tmp_path / "saved.toml")
    assert case.design.rows == 2 and case.design.pillar is not None
    assert case.design.pillar.height_m == pytest.approx(6.45e-3)


def slow_plate(scene: Any, design: Any, log: Any) -> dict[str, Any]:
    """A solve that never ends."""
    with log.step("solve"):
        time.sleep(600.0)
    return {}


def quick_plate(scene: Any, design: Any, log: Any) -> dict[str, Any]:
    log.info("solved")
    return {"frequency_hz": design["height"]}


def reported(server: Server, until: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The report of the full plate as soon as it is as asked."""
    for _ in range(300):
        state: dict[str, Any] = json.loads(request(server, "GET", f"/{server.token}/full")[1])
        if until(state):
            return state
        time.sleep(0.1)
    raise AssertionError(state)


@pytest.mark.slow
def test_one_full_plate_at_a_time_and_it_can_be_stopped(server: Server) -> None:
    """In a process of its own: the second solve never ends, and is ended."""
    path, body = f"/{server.token}/full", json.dumps(OWN).encode()
    assert request(server, "GET", path)[0] == 404
    server.full.solve = quick_plate
    assert request(server, "POST", path, body)[0] == 200
    state = reported(server, lambda state: not state["running"])
    assert state["result"] == {"frequency_hz": OWN["height"]} and state["lines"] == ["solved"]
    assert json.loads(request(server, "POST", f"{path}/stop", b"{}")[1]) == {"stopped": False}
    server.full.solve = slow_plate
    assert request(server, "POST", path, body)[0] == 200
    status, text, _ = request(server, "POST", path, body)
    assert status == 409 and "already" in error(text)
    assert reported(server, lambda state: bool(state["lines"]))["lines"] == ["solve ..."]
    assert json.loads(request(server, "POST", f"{path}/stop", b"{}")[1]) == {"stopped": True}
    state = reported(server, lambda state: not state["running"])
    assert state["result"]["why_not"] and state["lines"] == ["solve ..."]


def test_questions_of_clients_that_left_are_not_computed(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first waits in the solver's thread; those behind it leave, and the next one is answered at once."""
    go, begun, asked = threading.Event(), threading.Event(), []

    def answered(given: dict[str, float]) -> dict[str, Any]:
        asked.append(given["height"])
        begun.set()
        go.wait(20.0)
        return {"design": given}

    monkeypatch.setattr(server.explorer, "answer", answered)
    body, own = (lambda height: json.dumps(OWN | {"height": height})), {"Host": f"127.0.0.1:{server.port}"}
    clients = [http.client.HTTPConnection("127.0.0.1", server.port, timeout=60) for _ in range(4)]
    for number, client in enumerate(clients):
        client.request("POST", f"/{server.token}/answer", body(6.1 + 0.1 * number), own)
        assert begun.wait(20.0)
    assert request(server, "GET", f"/{server.token}/scene")[0] == 200  # the four have been read
    for client in clients[1:]:
        client.close()
    assert request(server, "GET", f"/{server.token}/scene")[0] == 200  # their ends, too
    go.set()
    assert request(server, "POST", f"/{server.token}/answer", body(6.9).encode())[0] == 200
    assert clients[0].getresponse().status == 200 and asked == [6.1, 6.9]


def test_a_port_in_use_is_said(server: Server) -> None:
    with pytest.raises(InputError, match=f"--port {server.port}"):
        served_module.listening(server.port)


@pytest.mark.slow
def test_plates_of_the_cloud_that_share_a_cell_are_those_asked_alone(explorer: Explorer) -> None:
    """Four plates have one cell: whatever is kept from one to the next, each is what it is by itself."""
    points = explorer.cloud(0, BATCH)
    cells = [tuple(point["design"][name] for name in ("thickness", "height", "side", "pitch")) for point in points]
    assert len(points) == BATCH and len(set(cells)) == BATCH // PLATES and cells == sorted(cells, key=cells.index)
    assert len({tuple(point["design"].values()) for point in points}) == BATCH
    for point in points[::-1]:
        alone = Explorer(explorer.scene, explorer.model)
        own = alone.estimate(alone.scene.at(point["design"]))
        assert {name: point[name] for name in own} == own


@pytest.mark.slow
def test_a_second_process_computes_parts_of_the_cloud_and_its_loss_is_made_up_for(explorer: Explorer) -> None:
    beside = BackgroundExplorer(explorer)
    try:
        cloud = beside.cloud(BATCH, BATCH)
        assert cloud == explorer.cloud(BATCH, BATCH)
        assert beside._workers is not None
        (process,) = beside._workers._processes.values()
        assert process.is_alive()
        process.kill()
        process.join()
        assert beside.cloud(BATCH, BATCH) == cloud
    finally:
        beside.close()
    assert not process.is_alive()
