"""A study's page as people use it: pointer, keyboard, phone, dark, print, without scripts and without WebGL."""

from __future__ import annotations

import json
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.helpers import synthetic

Visits = Callable[..., Any]
CANVAS = '[data-viewer="plate"] canvas'
WAVES = '[data-viewer="waves"]'


def moving(page: Any, viewer: str = '[data-viewer="plate"]') -> Any:
    """The canvas of a viewer once it has drawn."""
    canvas = page.locator(f"{viewer} canvas")
    canvas.scroll_into_view_if_needed()
    page.wait_for_function("(it) => Number(it.dataset.frames) > 0", arg=canvas.element_handle())
    return canvas


def frames(canvas: Any) -> int:
    return int(canvas.get_attribute("data-frames"))


def column(page: Any, number: int) -> list[str]:
    rows = "[...document.querySelectorAll('#cases-table tbody tr')]"
    script = f"(n) => {rows}.filter((r) => !r.hidden).map((r) => r.cells[n].textContent)"
    return page.evaluate(script, number)


def sort_by(page: Any, number: int, direction: str) -> None:
    """Press a column's heading and wait: a press may reach the page after the driver's call is over."""
    page.locator("#cases-table th").nth(number).locator("button").click()
    wait_for_sort(page, number, direction)


def wait_for_sort(page: Any, number: int, direction: str) -> None:
    heading = page.locator("#cases-table th").nth(number).element_handle()
    sorted_so = "([it, direction]) => it.getAttribute('aria-sort') === direction"
    page.wait_for_function(sorted_so, arg=[heading, direction])


def wait_for_drawing(page: Any) -> None:
    """Wait until what was asked for is on the screen."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def zoomed(page: Any, times: float) -> None:
    """Wait until the diagram is drawn enlarged by so much: input may reach the page after the driver's call is over."""
    svg = page.locator("#dispersion-diagram svg").element_handle()
    page.wait_for_function("([it, times]) => Math.abs(it.dataset.zoom - times) < 0.006", arg=[svg, times])


def whole_diagram(page: Any) -> None:
    """Show all bands of the diagram, which opens where the target mode lies."""
    page.locator("#dispersion-all").click()
    zoomed(page, 1.0)


def place_of_wave(page: Any, number: int) -> tuple[float, float]:
    """Where on the screen a wave's mark is."""
    page.locator("#dispersion-diagram").scroll_into_view_if_needed()
    wait_for_drawing(page)
    box = page.locator("#dispersion-diagram .wave").nth(number).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_it_loads_without_a_fault_and_asks_for_nothing_else(visit: Visits, study: Path) -> None:
    seen = visit(study)
    moving(seen.page)
    for fold in seen.page.locator("details").all():
        fold.evaluate("(it) => { it.open = true; }")
    seen.page.evaluate("scrollTo(0, document.body.scrollHeight)")
    seen.page.wait_for_timeout(300)
    assert seen.faults == []
    assert [url for url in seen.query if not url.startswith("data:")] == [study.as_uri()[:80]]
    broken = "[...document.images].filter((i) => i.complete && !i.naturalWidth).length"
    assert seen.page.evaluate(broken) == 0


@pytest.mark.slow
def test_a_press_on_a_heading_sorts_by_pointer_and_by_keyboard(visit: Visits, study: Path) -> None:
    page = visit(study).page
    heading = page.locator("#cases-table th").nth(1)
    assert column(page, 1) == ["4", "6", "12"]
    heading.locator("button").focus()
    page.keyboard.press("Enter")
    wait_for_sort(page, 1, "ascending")
    page.keyboard.press("Space")
    wait_for_sort(page, 1, "descending")
    assert column(page, 1) == ["12", "6", "4"]
    sort_by(page, 0, "ascending")
    assert heading.get_attribute("aria-sort") is None


@pytest.mark.slow
def test_what_has_no_value_stays_last_in_both_directions(visit: Visits, study: Path) -> None:
    page = visit(study).page
    names = page.locator("#cases-table th").all_inner_texts()
    number = next(i for i, name in enumerate(names) if name.startswith("confinement"))
    for direction in ("ascending", "descending"):  # the case without a value comes first
        sort_by(page, 1, direction)
    assert column(page, number)[0] == ""
    for direction in ("ascending", "descending"):
        sort_by(page, number, direction)
        assert column(page, number)[-1] == ""


@pytest.mark.slow
def test_the_filter_takes_words_and_comparisons(visit: Visits, study: Path) -> None:
    page = visit(study).page
    field = page.locator('[data-filter="cases-table"]')
    for words, left in (
        ("failed", ["12"]),
        ("confinement>10", ["4"]),
        ("array.pitch_mm<=6 ok", ["4", "6"]),
        ("pitch_mm <= 6 and confinement>10", ["4"]),
        ("confinement (dB) > 10, array.pitch_mm <= 6", ["4"]),
        ("ok confinement > 10", ["4"]),
        ("", ["4", "6", "12"]),
    ):
        field.fill(words)
        assert column(page, 1) == left, words
        assert page.locator('[data-shown="cases-table"]').inner_text() == f"{len(left)} of 3 shown"
    field.fill("colour > 3")
    assert "no column begins with “colour”" in page.locator('[data-shown="cases-table"]').inner_text()
    assert page.locator('section#table a[href="table.csv"]').is_visible()


@pytest.mark.slow
def test_a_mode_moves_and_stops_by_keyboard(visit: Visits, study: Path) -> None:
    page = visit(study).page
    canvas = moving(page)
    assert not page.get_by_text("need JavaScript").count()
    start, first = frames(canvas), canvas.screenshot()
    page.wait_for_function("([it, n]) => Number(it.dataset.frames) > n + 3", arg=[canvas.element_handle(), start])
    assert canvas.screenshot() != first
    canvas.focus()
    page.keyboard.press("Space")
    assert page.locator('[data-viewer="plate"]').get_attribute("data-state") == "paused"
    wait_for_drawing(page)
    still, visible = frames(canvas), canvas.screenshot()
    page.wait_for_timeout(250)
    assert frames(canvas) == still and canvas.screenshot() == visible
    page.keyboard.press("ArrowLeft")
    wait_for_drawing(page)
    turned = canvas.screenshot()
    assert turned != visible
    page.keyboard.press("+")
    wait_for_drawing(page)
    assert canvas.screenshot() != turned


@pytest.mark.slow
def test_the_touch_face_is_seen_from_below_to_scale(visit: Visits, study: Path) -> None:
    page = visit(study, reduced_motion="reduce").page
    canvas = moving(page)
    page.locator('[data-viewer="plate"]').get_by_role("button", name="Touch face").click()
    wait_for_drawing(page)
    picture = np.asarray(Image.open(BytesIO(canvas.screenshot())).convert("RGB"), dtype=int)
    across, along = (
        np.ptp(np.flatnonzero((picture != picture[3, 3]).any(axis=2)[3:-3, 3:-3].any(axis=side))) for side in (1, 0)
    )
    plate = synthetic.record_of(study.parent / "pitch_mm=4,rows=1").design
    assert along / across == pytest.approx(plate.half_length_m / plate.half_span_m, rel=0.03)


@pytest.mark.slow
def test_another_shape_is_another_picture_with_other_words(visit: Visits, study: Path) -> None:
    page = visit(study, reduced_motion="reduce").page
    canvas = moving(page)
    words, visible = canvas.get_attribute("aria-label"), canvas.screenshot()
    assert page.locator('[data-viewer="plate"] option').count() > 1
    page.locator('[data-viewer="plate"] select').select_option(index=1)
    wait_for_drawing(page)
    assert canvas.get_attribute("aria-label") != words and canvas.screenshot() != visible


@pytest.mark.slow
def test_who_wants_less_motion_gets_none_until_asked_for(visit: Visits, study: Path) -> None:
    page = visit(study, reduced_motion="reduce").page
    canvas = moving(page)
    wait_for_drawing(page)
    still = frames(canvas)
    page.wait_for_timeout(250)
    assert frames(canvas) == still
    button = page.locator('[data-viewer="plate"] button[data-do="play"]')
    assert button.inner_text() == "Play" and button.get_attribute("aria-pressed") == "false"
    button.click()
    page.wait_for_function("([it, n]) => Number(it.dataset.frames) > n + 3", arg=[canvas.element_handle(), still])


@pytest.mark.slow
def test_without_webgl_a_still_picture_stands_in(visit_without_gl: Visits, study: Path) -> None:
    seen = visit_without_gl(study)
    viewer = seen.page.locator('[data-viewer="plate"]')
    viewer.scroll_into_view_if_needed()
    seen.page.wait_for_function("(it) => it.dataset.state === 'still'", arg=viewer.element_handle())
    image = viewer.locator(".stage img")
    assert image.is_visible() and len(image.get_attribute("alt")) > 60 and not viewer.locator("canvas").is_visible()
    assert "WebGL is not available" in viewer.locator(".about").inner_text() and seen.faults == []


@pytest.mark.slow
def test_the_diagram_tells_the_wave_under_the_pointer(visit: Visits, study: Path) -> None:
    page = visit(study).page
    whole_diagram(page)
    page.mouse.move(*place_of_wave(page, 9))  # the tenth wave at the first wavevector
    tip = page.locator("#dispersion-diagram .tip")
    data = json.loads(page.locator("#bands-data").inner_text())["cells"][0]
    said, shown = tip.inner_text(), data["shown"][0][9]  # with the digits of its error bar
    assert said.startswith("band 10") and shown in said and shown.endswith("kHz")
    assert float(shown.split()[0]) == pytest.approx(data["hz"][0][9] / 1e3, abs=0.05)
    assert "Γ" in said and "k = (0.0, 0.0) rad/m" in said and "flexural" in said and "450 m/s" in said
    page.mouse.move(0, 0)
    assert not tip.is_visible()


@pytest.mark.slow
def test_the_diagram_goes_by_keyboard(visit: Visits, study: Path) -> None:
    page = visit(study).page
    whole_diagram(page)
    page.locator("#dispersion-diagram svg").focus()
    for key in ("ArrowRight", "ArrowRight", "ArrowUp"):
        page.keyboard.press(key)
    said = page.locator("#dispersion-diagram .tip").inner_text()
    assert said.startswith("band 2") and "between Γ and X" in said and "shear" in said
    page.keyboard.press("+")
    zoomed(page, 1.5)
    page.keyboard.press("0")
    zoomed(page, 1.0)
    page.keyboard.press("Escape")
    assert not page.locator("#dispersion-diagram .tip").is_visible()


@pytest.mark.slow
def test_the_diagram_zooms_by_wheel_and_buttons_and_shades_its_gap(visit: Visits, study: Path) -> None:
    page = visit(study).page
    whole_diagram(page)
    waves = int(page.locator("#dispersion-diagram svg").get_attribute("data-waves"))
    page.mouse.move(*place_of_wave(page, 100))
    page.mouse.wheel(0, -100)
    zoomed(page, 1.25)
    page.locator("#dispersion-in").click()
    zoomed(page, 1.25 * 1.5)
    assert int(page.locator("#dispersion-diagram svg").get_attribute("data-waves")) < waves
    page.locator("#dispersion-all").click()
    zoomed(page, 1.0)
    small = page.locator("#dispersion-diagram rect.gap").bounding_box()["height"]
    page.locator("#dispersion-gap").click()
    wait_for_drawing(page)
    assert page.locator("#dispersion-diagram rect.gap").bounding_box()["height"] > 3 * small
    assert "163 to 176 kHz" in page.locator("#dispersion-diagram .gap-label").text_content()


def test_the_diagram_opens_where_the_target_mode_lies(visit: Visits, study: Path) -> None:
    page = visit(study).page
    data = json.loads(page.locator("#bands-data").inner_text())["cells"][0]
    highest = 1.04 * max(max(row) for row in data["hz"])
    zoomed(page, highest / (2.0 * data["target_hz"]))
    assert highest > 4.0 * data["target_hz"]
    line, frame = (
        page.locator(f"#dispersion-diagram {name}").bounding_box() for name in (".target-line", "rect.frame")
    )
    assert line["y"] == pytest.approx(frame["y"] + 0.5 * frame["height"], abs=1.5)


def test_the_diagram_is_there_before_the_first_frame(browser: Any, study: Path) -> None:
    """As in a tab opened in the background, where no animation frame comes."""
    context = browser.new_context()
    context.add_init_script("requestAnimationFrame = () => 1")
    page = context.new_page()
    page.goto(study.as_uri())
    assert page.locator("#dispersion-diagram .wave").count() > 100
    context.close()


def test_marks_tell_polarisations_apart_without_colour(visit: Visits, study: Path) -> None:
    page = visit(study).page
    whole_diagram(page)
    kinds = "(name) => [...new Set([...document.querySelectorAll(`#dispersion-diagram .wave.${name}`)].map((m) => m.tagName))]"
    assert [page.evaluate(kinds, name) for name in ("flexural", "shear", "longitudinal")] == [
        ["circle"],
        ["rect"],
        ["path"],
    ]
    assert page.locator("#dispersion-diagram .wave.hollow").count() > 0
    legend = page.locator("#dispersion-legend").inner_text()
    assert "longitudinal" in legend and "mostly in the pillar" in legend and "target mode of the plate" in legend


@pytest.mark.slow
def test_a_click_on_a_wave_shows_its_shape_at_the_nearest_stored_point(visit: Visits, study: Path) -> None:
    seen = visit(study)
    page = seen.page
    assert not page.locator(WAVES).is_visible()
    whole_diagram(page)
    page.mouse.click(*place_of_wave(page, 2 * 10 + 2))  # third wavevector, third band
    assert "band 3 at Γ" in page.locator("#dispersion-note").inner_text()
    canvas = moving(page, WAVES)
    start = frames(canvas)
    page.wait_for_function("([it, n]) => Number(it.dataset.frames) > n + 3", arg=[canvas.element_handle(), start])
    assert "Wave of band 3 at Γ" in canvas.get_attribute("aria-label") and seen.faults == []


def test_bands_of_an_older_record_are_drawn_and_what_they_lack_is_told(visit: Visits, study: Path) -> None:
    seen = visit(study)
    page = seen.page
    page.locator("#dispersion-cell").select_option(index=1)
    wait_for_drawing(page)
    assert "polarisation: not stored in this record" in page.locator("#dispersion-legend").inner_text()
    page.mouse.click(*place_of_wave(page, 5))
    assert "antinode run stores them" in page.locator("#dispersion-note").inner_text() and seen.faults == []


@pytest.mark.slow
def test_everything_shown_has_words(visit: Visits, study: Path) -> None:
    page = visit(study).page
    moving(page)
    assert page.evaluate("[...document.images].filter((i) => !(i.alt.length > 60)).length") == 0
    assert (
        page.evaluate("[...document.querySelectorAll('canvas')].filter((c) => !c.getAttribute('aria-label')).length")
        == 0
    )
    lonely = """[...document.querySelectorAll('button, input, select, summary')]
        .filter((it) => !(it.textContent.trim() || it.labels?.length || it.getAttribute('aria-label'))).length"""
    assert page.evaluate(lonely) == 0


@pytest.mark.parametrize("width", [360, 768])
def test_a_phone_scrolls_in_one_direction_only(visit: Visits, study: Path, width: int) -> None:
    page = visit(study, viewport={"width": width, "height": 740}, is_mobile=True, has_touch=True).page
    for fold in page.locator("details").all():
        fold.evaluate("(it) => { it.open = true; }")
    page.wait_for_timeout(100)
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


def test_it_is_dark_where_dark_is_target(visit: Visits, study: Path) -> None:
    shade = (
        "getComputedStyle(document.body).backgroundColor.match(/\\d+/g).slice(0, 3).map(Number).reduce((a, b) => a + b)"
    )
    light, dark = (visit(study, color_scheme=scheme).page.evaluate(shade) for scheme in ("light", "dark"))
    assert light > 700 and dark < 120


@pytest.mark.slow
def test_it_prints_with_every_case_open_and_without_controls(visit: Visits, study: Path) -> None:
    page = visit(study).page
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    assert page.locator("details:not([open])").count() == 0
    assert not page.locator('[data-viewer="plate"]').is_visible() and not page.locator("nav").is_visible()
    assert page.locator("#dispersion-diagram svg").is_visible() and page.locator("#cases-table").is_visible()
    assert page.pdf().startswith(b"%PDF")


def test_without_scripts_words_tables_and_pictures_are_there(visit: Visits, study: Path) -> None:
    page = visit(study, java_script_enabled=False).page
    assert page.locator("#cases-table tbody tr").count() == 3
    assert page.locator("#summary .card").count() >= 4
    assert (
        page.get_by_text("The diagram needs JavaScript").is_visible()
        and page.get_by_text("Animated shapes need").first.is_visible()
    )
    assert all(image.get_attribute("src") for image in page.locator("img").all())
