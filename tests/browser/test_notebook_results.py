"""Results as a notebook shows them: their frames move, answer the pointer, and ask for nothing from elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import antinode
from tests.helpers import synthetic

SMALL = Path(__file__).resolve().parents[2] / "examples" / "small.toml"


@pytest.fixture
def pillar() -> Any:
    return antinode.load(SMALL, accuracy=0.1).modes(part="pillar", count=3)


def as_cell(folder: Path, *results: Any) -> Path:
    """Write the page of a cell whose outputs are these results."""
    page = folder / "cell.html"
    page.write_text(f"<!DOCTYPE html><html><body>{''.join(each._repr_html_() for each in results)}</body></html>")
    return page


def test_modes_move_and_their_neighbours_can_be_chosen(visit: Callable[..., Any], pillar: Any, tmp_path: Path) -> None:
    seen = visit(as_cell(tmp_path, pillar))
    frame = seen.page.frame_locator("iframe")
    canvas = frame.locator("canvas")
    canvas.scroll_into_view_if_needed()
    frame.locator('canvas[data-frames]:not([data-frames="1"])').wait_for(state="attached")
    names = frame.locator("select option").all_text_contents()
    assert len(names) == len(pillar) and all(name.startswith("pillar: ") and "mode" in name for name in names)
    frame.locator("select").select_option(index=2)
    frame.get_by_text(names[2].removeprefix("pillar: ").partition(",")[0] + ".").first.wait_for()
    assert not seen.faults and all(url.startswith(("file:", "data:", "blob:", "about:")) for url in seen.query)


def test_bands_answer_the_pointer_in_the_place_of_their_still_picture(
    visit: Callable[..., Any], tmp_path: Path
) -> None:
    seen = visit(as_cell(tmp_path, synthetic.bands(0.004)))
    frame = seen.page.frame_locator("iframe")
    frame.locator("#dispersion-all").click()
    wave = frame.locator("#dispersion-diagram .wave").nth(40)
    wave.wait_for()
    wave.hover(force=True)
    assert "rad/m" in frame.locator(".tip").inner_text() and not seen.page.locator("img").is_visible()
    assert not seen.faults


@pytest.mark.slow
def test_a_driven_plate_moves(visit: Callable[..., Any], tmp_path: Path) -> None:
    patch = antinode.Patches(material="pz26", size_mm=(8.0, 3.0, 0.3), centres_mm=[(0.0, 0.0)])
    driven = antinode.load(SMALL, accuracy=0.1, patches=patch).response((33.0, 36.0), points=5)
    frame = visit(as_cell(tmp_path, driven)).page.frame_locator("iframe")
    frame.locator('canvas[data-frames]:not([data-frames="1"])').wait_for(state="attached")
    assert frame.locator("select option").all_text_contents()[0].startswith("the driven plate: 3")


def test_a_result_read_from_a_file_is_a_still_picture(pillar: Any, tmp_path: Path) -> None:
    """Its shapes are not in the document."""
    again = antinode.open(pillar.save(tmp_path / "modes.json"))
    assert "<iframe" in pillar._repr_html_() and "<iframe" not in again._repr_html_() and "<img" in again._repr_html_()
