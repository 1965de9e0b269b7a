"""The model that an exported page holds, run by node: its numbers and its texts are Python's."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from pipeline.explore import offline
from pipeline.explore.answer import Explorer
from pipeline.models.live_column import boundary_error, end_layer
from tests.helpers.exploring import small_explorer

NODE = shutil.which("node")
SINGLE = 1e-4  # the page holds single precision
LEVELS = "confinement_db", "confinement_error_db", "extension_db", "extension_error_db"
ASK = """
const { document, numbers, designs } = JSON.parse(require("fs").readFileSync(0, "utf8"));
unpacked(numbers).then((values) => {
  model = placed(document, values);
  console.log(JSON.stringify(designs.map((design) => answered("answer", design))));
});
"""


def answers(explorer: Explorer, designs: list[dict[str, float]], script: Path) -> list[dict[str, Any]]:
    """The worker's own text answers the designs, without a browser."""
    assert NODE
    numbers = offline._Numbers()
    document = offline.model_document(explorer, numbers)
    given = json.dumps({"document": document, "numbers": numbers.text(), "designs": designs})
    script.write_text(offline.worker() + ASK, encoding="utf-8")
    done = subprocess.run([NODE, str(script)], input=given, capture_output=True, text=True, check=True)
    answered: list[dict[str, Any]] = json.loads(done.stdout)
    return answered


@pytest.fixture(scope="module")
def explorer(tmp_path_factory: pytest.TempPathFactory) -> Explorer:
    """Round pillars, whose square blocks the edges of the zone and of the rows cut."""
    return small_explorer(tmp_path_factory.mktemp("round"), "pillar.shape=round", "pillar.diameter_mm=2")


def require_areas(plate: dict[str, Any], explorer: Explorer, given: dict[str, float], rel: float) -> None:
    """10^(dB/10) (1 - s) / s = A_passive / A_zone of every motion, s the zone's share of the square."""
    design = explorer.scene.at(given).design
    share, active = plate["zone_share"], design.width_m / 2.0
    ratio = 10.0 ** (plate["confinement_db"] / 10.0) * (1.0 - share) / share
    assert ratio == pytest.approx((design.half_span_m - active) / active, rel=rel)


@pytest.mark.parametrize("change", [{}, {"side": 2.15, "extension": 9.0}, {"pitch": 4.35}])
def test_levels_are_of_the_zone_itself(explorer: Explorer, change: dict[str, float]) -> None:
    """Whole columns of cells, and plates that reach beyond them or cut them."""
    given = explorer.scene.own() | change
    require_areas(explorer.plate(explorer.scene.at(given)), explorer, given, 1e-9)


@pytest.mark.parametrize("extension", [0.0, 0.5])
def test_round_feet_at_the_plates_edge_have_an_answer(explorer: Explorer, extension: float) -> None:
    """An edge that touches the feet leaves elements no room: it is moved, and the bar holds what that may change."""
    given = explorer.scene.own() | {"extension": extension}
    design = explorer.scene.at(given).design
    plate, wider = (explorer.plate(explorer.scene.at(given | {"extension": e})) for e in (extension, extension + 0.5))
    moved_mm = plate["half_span_mm"] - 1e3 * design.half_span_m
    assert 0.0 <= moved_mm < 0.03 and (moved_mm > 0.0) == (extension == 0.0)
    assert (plate["extension_db"] is None) == (plate["extension_error_db"] is None) == (extension == 0.0)
    change = moved_mm / 0.5 * abs(plate["frequency_hz"] / wider["frequency_hz"] - 1.0)
    assert plate["frequency_error"] >= boundary_error(design) + end_layer(design) / 2.0 + change


@pytest.mark.skipif(NODE is None, reason="needs node, which runs the page's own model")
def test_an_exported_page_has_pythons_numbers_and_texts(explorer: Explorer, tmp_path: Path) -> None:
    """Designs with and without a mode of the passive plate near the wanted one, and without rows."""
    own = explorer.scene.own()
    designs = [own | {"extension": float(extension)} for extension in (5, 12)] + [own | {"rows": 0.0}]
    *told, cut = answers(explorer, [*designs, own | {"extension": 0.0}], tmp_path / "worker.js")
    assert cut["plate"]["why_not"].startswith("an extension below 1.00 mm cuts through the last rows' cells")
    near = set()
    for design, theirs in zip(designs, told, strict=True):
        ours = explorer.answer(design)
        plate, other = ours["plate"], theirs["plate"]
        assert theirs["warnings"] == ours["warnings"]
        assert other["status"] == plate["status"] and other["rivals"] == plate["rivals"]
        near.add(plate["near_hz"] is None)
        require_areas(other, explorer, design, 1e-9)
        for name in ("frequency_hz", "frequency_error", "mac", "near_hz", *LEVELS):
            assert other[name] == (plate[name] if plate[name] is None else pytest.approx(plate[name], rel=SINGLE))
    assert near == {True, False}
