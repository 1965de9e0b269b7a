"""The page of `antinode explore` in headless Chromium: dragged, typed into, sent on, left without its program."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.case.model import load_case
from pipeline.explore import offline
from pipeline.explore.answer import Explorer
from pipeline.paths import ROOT
from solvers.parametric.affine import as_sizes
from tests.helpers.exploring import served, small_explorer

WAIT_S = 60.0  # a busy machine answers a design in seconds
READY = "document.querySelectorAll('#numbers .card').length > 3 && !document.body.classList.contains('stale')"


def until(page: Any, expression: str) -> None:
    """Ask until it holds; the page's policy forbids the browser's own waiting, which evaluates text in the page."""
    end = time.monotonic() + WAIT_S
    while not page.evaluate(expression):
        assert time.monotonic() < end, expression
        page.wait_for_timeout(50)


@pytest.fixture(scope="module")
def explorer(playwright: Any, tmp_path_factory: pytest.TempPathFactory) -> Explorer:
    return small_explorer(tmp_path_factory.mktemp("explore"))


@pytest.fixture(scope="module")
def address(explorer: Explorer) -> Iterator[str]:
    with served(explorer) as server:
        yield server.address


@pytest.fixture
def opened(browser: Any, address: str) -> Iterator[Callable[..., Any]]:
    contexts = []

    def open_page(more: str = "", **settings: Any) -> Any:
        context = browser.new_context(**{"viewport": {"width": 900, "height": 900}, **settings})
        contexts.append(context)
        page = context.new_page()
        page.faults = []
        page.on("pageerror", lambda fault: page.faults.append(str(fault)))
        page.on(
            "request", lambda request: page.faults.append(request.url) if not request.url.startswith(address) else None
        )
        page.goto(address + more)
        until(page, READY)
        return page

    yield open_page
    for context in contexts:
        context.close()


def number(page: Any, name: str) -> float:
    """The number of a headline card."""
    text = page.locator(".card", has=page.get_by_text(name, exact=True)).locator("dd").inner_text()
    match = re.search(r"-?\d+\.\d+", text)
    assert match
    return float(match[0])


def drag(page: Any, name: str, value: float) -> None:
    """A slider dragged to a value by keys, as a person without a mouse does it, one step a press."""
    slider = page.locator(f"#{name}-range")
    slider.focus()
    steps = round((value - float(slider.input_value())) / float(slider.get_attribute("step")))
    for _ in range(abs(steps)):
        page.keyboard.press("ArrowRight" if steps > 0 else "ArrowLeft")
    until(page, READY)


def test_a_dragged_slider_changes_the_numbers(opened: Callable[..., Any]) -> None:
    page = opened()
    before, path = number(page, "Target frequency"), page.locator("#bands path.line").first.get_attribute("d")
    drag(page, "height", 6.7)
    until(page, f"document.querySelector('.card dd').textContent.split(' ')[0] != '{before:.2f}'")
    assert number(page, "Target frequency") < before  # a taller pillar resonates lower and takes the mode along
    assert page.locator("#bands path.line").first.get_attribute("d") != path
    assert page.locator("#bands path.before").count() > 0
    assert "height=6.7" in page.url
    assert not page.faults


@pytest.mark.slow
def test_the_address_brings_the_design_back(opened: Callable[..., Any]) -> None:
    page = opened("#height=6.6&pitch=4.2&rows=2&colour=blue&side=")
    assert page.locator("#height-number").input_value() == "6.6"
    assert page.locator("#side-number").input_value() == "2"
    assert not page.faults


@pytest.mark.slow
def test_undo_pins_and_what_does_not_fit(opened: Callable[..., Any]) -> None:
    page = opened()
    page.locator("#pin").click()
    assert page.locator("#pins tbody tr").count() == 1 and page.locator("#pinned").is_visible()
    page.locator("#height-number").fill("8.5")
    until(page, "document.querySelector('#said').className == 'bad'")
    assert "height = 8.5 mm" in page.locator("#said").inner_text()
    assert page.evaluate("document.body.classList.contains('stale')"), "the figures are another design's"
    page.locator("#undo").click()
    until(page, "document.querySelector('#said').className != 'bad'")
    assert page.locator("#height-number").input_value() == "6.3"
    page.locator("#redo").click()
    until(page, "document.querySelector('#said').className == 'bad'")
    assert page.locator("#height-number").input_value() == "8.5" and page.locator("#redo").is_disabled()
    assert not page.faults


@pytest.mark.slow
def test_the_plate_is_drawn_as_it_is_dragged(opened: Callable[..., Any]) -> None:
    page = opened()
    feet = "document.querySelector('#plate path.pillars').getAttribute('d').split('M').length - 1"
    case = load_case(ROOT / "examples" / "small.toml")
    assert page.evaluate(feet) == len(case.design.pillar_centres())
    page.locator("#rows-number").fill("2")
    until(page, f"{feet} == {2 * len(case.design.pillar_centres())}")  # drawn before the answer is here
    assert "56.0 × 42.0 mm" in page.locator("#plate").text_content()
    until(page, READY)
    signs = page.evaluate("[...document.querySelectorAll('#along stop')].map((stop) => stop.getAttribute('class'))")
    assert sum(one != other for one, other in pairwise(signs)) == case.design.nodal_lines
    shown = page.locator("#bands").get_attribute("aria-label")
    page.locator("#whole").check()
    assert page.locator("#bands").get_attribute("aria-label") != shown and not page.faults


@pytest.mark.slow
def test_bands_have_the_colour_of_what_moves_and_go_on_through_crossings(
    opened: Callable[..., Any], explorer: Explorer
) -> None:
    """A flexural wave begins as one and ends in the pillar's resonance; the mass that a plate carries follows the sliders."""
    page = opened("#side=2.1&height=6.8&pitch=4.3&thickness=1.9")
    kinds = page.evaluate("[[1, 0], [4, 0], [4, 1], [0, 0]].map(([point, band]) => motionOf(state.shown, point, band))")
    assert kinds == ["flexural", "pillar", "pillar", None]
    assert {"flexural", "plane", "pillar"} == set(
        page.evaluate("[...document.querySelectorAll('#bands path.line')].map((line) => line.classList[1])")
    )
    assert page.locator(".keys li").all_text_contents() == ["flexural", "in plane", "pillar"]
    own = {name: float(page.locator(f"#{name}-number").input_value()) for name in explorer.scene.limits}
    design = explorer.scene.at(own).design
    assert design.pillar is not None
    plate_kg = design.stack.mass_kg_m2 * design.pitch_x_m * design.pitch_y_m
    assert page.evaluate("carried(state.shown.design)") == pytest.approx(design.pillar.mass_kg / plate_kg, rel=1e-12)
    crossing = "[0, 1, 2].map((band) => following({ sector: [[0, 1, 0], [1, 0, 0]] }, 0, band))"
    assert page.evaluate(crossing) == [1, 0, 2]
    assert page.evaluate(crossing.replace("[1, 0, 0]", "[3, 2, 3]")) == [0, 1, 2]  # the path turns
    assert page.evaluate(crossing.replace("[1, 0, 0]", "[1, 1, 0]")) == [2, 0, -1] and not page.faults


@pytest.mark.slow
def test_the_band_diagram_is_zoomed_and_moved(opened: Callable[..., Any]) -> None:
    """By wheel about the pointer, by dragging, keys and buttons; lines end at the frame."""
    page = opened()
    svg, seen = page.locator("#bands"), "view && [...view.x, ...view.y]"
    assert page.evaluate(seen) is None
    svg.scroll_into_view_if_needed()
    box = svg.bounding_box()
    assert box
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 0.3 * box["height"])
    own = page.evaluate("Object.values(limits(state.shown, arc(state.shown.bands.labels)).own).flat()")
    at = page.evaluate(
        "([x, y]) => { const svg = $('bands').getBoundingClientRect(), unit = svg.width / WIDTH, f = state.frame;"
        " return [(x * svg.width / unit - f.left) / f.width, 1 - (y * svg.height / unit - f.top) / f.height]; }",
        [0.6, 0.3],
    )
    page.mouse.wheel(0, -400)
    until(page, "view !== null")
    now = page.evaluate(seen)
    for place, low, high, before_low, before_high in zip(at, now[::2], now[1::2], own[::2], own[1::2], strict=True):
        assert high - low == pytest.approx(1.0015**-400 * (before_high - before_low))
        pixel = (before_high - before_low) / page.evaluate("state.frame.height * $('bands').clientWidth / WIDTH")
        assert low + place * (high - low) == pytest.approx(before_low + place * (before_high - before_low), abs=pixel)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.4 * box["height"])
    page.mouse.up()
    moved = page.evaluate(seen)
    assert moved[0] > now[0] and moved[2] > now[2]  # what was held goes with the pointer
    assert moved[1] - moved[0] == pytest.approx(now[1] - now[0])
    inside, frame = page.evaluate(
        "[$('bands').querySelector('clipPath rect'), $('bands').querySelector('rect.frame')]"
        ".map((rect) => ['x', 'y', 'width', 'height'].map((name) => rect.getAttribute(name)))"
    )
    assert inside == frame
    assert page.evaluate("[...$('bands').querySelectorAll('path')].every((path) => path.closest('[clip-path]'))")
    svg.focus()
    page.keyboard.press("0")
    assert page.evaluate(seen) is None
    page.keyboard.press("+")
    page.keyboard.press("ArrowUp")
    assert page.evaluate("view.y[0]") > page.evaluate("view.x[0]") > 0.0
    page.locator("#again").click()
    assert page.evaluate(seen) is None
    page.locator("#closer").click()
    page.locator("#farther").click()
    assert page.evaluate(seen) is None and not page.faults


@pytest.mark.slow
def test_figures_of_another_design_are_grey_and_still_while_it_computes(opened: Callable[..., Any]) -> None:
    page = opened()
    held: list[Any] = []
    look = (
        "[...document.querySelectorAll('.cards, #decay, .swing')].map((each) => getComputedStyle(each))"
        ".map((style) => [style.filter, style.animationName])"
    )
    moving = [["none", "none"], ["none", "none"], ["none", "swing"]]
    assert sorted(page.evaluate(look)) == moving and page.locator("#said").inner_text() == ""
    page.route("**/answer", lambda route: held.append(route))
    page.locator("#rows-number").fill("2")
    until(page, "document.querySelector('#said').textContent.startsWith('computing')")
    assert "56.0 × 42.0 mm" in page.locator("#plate").text_content()  # the new plate, with the old motion
    assert page.evaluate(look) == [["grayscale(1)", "none"]] * 3
    held.pop().continue_()
    until(page, READY)
    assert sorted(page.evaluate(look)) == moving and page.locator("#said").inner_text() == ""
    page.locator("#moves").uncheck()
    assert page.evaluate("getComputedStyle(document.querySelector('.swing')).animationName") == "none"
    assert "antinode response" in page.locator("main").inner_text() and page.locator("#patched").is_visible()
    assert not page.faults


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 700, 1000, 1440])
def test_no_letter_is_smaller_than_eleven_pixels(opened: Callable[..., Any], width: int) -> None:
    page = opened(viewport={"width": width, "height": 900})
    page.evaluate(
        "cloud.points = [{ frequency_hz: 3e4, confinement_db: 12, mass_g: 9, design: state.design }];"
        "cloud.count = 1; drawCloud(); state.pins.push(state.shown); drawPins(); drawCloud()"
    )
    sizes = page.evaluate(
        "[...document.querySelectorAll('body *')].filter((each) => each.getClientRects().length"
        " && [...each.childNodes].some((node) => node.nodeType === 3 && node.data.trim()))"
        ".map((each) => [parseFloat(getComputedStyle(each).fontSize)"
        " * (each.ownerSVGElement ? each.ownerSVGElement.clientWidth / WIDTH : 1), each.textContent])"
    )
    assert min(sizes)[0] >= 11.0, min(sizes)
    assert len(sizes) > 80 and page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.slow
def test_a_curve_is_smooth_and_stays_between_its_points(opened: Callable[..., Any]) -> None:
    """A cubic whose slopes are off by s is off by at most 4/27 s h at each end. Harmonic means of a square's slopes at x = 11
    to 13 are off by a quarter of their difference's square over their mean, 1/11 at most; lines would be off by h^2/4.
    """
    page = opened()
    draw = (
        "([xs, ys]) => { const inside = document.createElementNS(NS, 'g'); $('decay').append(inside);"
        " curve({ x: (v) => 1000 * v, y: (v) => 1000 * v, inside }, 'line', xs, ys); const path = inside.firstChild;"
        " const all = Array.from({ length: 801 }, (_, i) => path.getPointAtLength(path.getTotalLength() * i / 800));"
        " inside.remove(); return all.map((point) => [point.x / 1000, point.y / 1000]); }"
    )
    at = np.arange(10.0, 15.0)
    x, y = np.array(page.evaluate(draw, [at.tolist(), (at**2).tolist()])).T
    middle = (x > 11.0) & (x < 13.0)
    assert middle.sum() > 100 and np.abs(y - x**2)[middle].max() < 8.0 / 27.0 / 11.0 < 1.0 / 4.0
    _, y = np.array(page.evaluate(draw, [[0.0, 1.0, 1.1, 2.0, 3.0], [0.0, 0.0, 5.0, 5.2, 0.0]])).T
    assert y.min() >= -1e-3 and y.max() <= 5.2 + 1e-3
    assert not page.faults


def test_a_phone_in_the_dark_needs_no_sideways_scrolling(opened: Callable[..., Any]) -> None:
    page = opened(viewport={"width": 360, "height": 740}, color_scheme="dark", reduced_motion="reduce")
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 25, 30)"
    assert not page.faults


@pytest.mark.slow
def test_a_page_whose_program_has_ended_says_so(browser: Any, explorer: Explorer, tmp_path: Path) -> None:
    """The server in a process of its own, killed under the page."""
    code = (
        "import sys; from pathlib import Path; from tests.helpers.exploring import small_explorer;"
        "from pipeline.explore.server import Server, serve;"
        "serve(Server(small_explorer(Path(sys.argv[1]))), 0, lambda a: print(a, flush=True))"
    )
    words = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        page = browser.new_page()
        page.goto(process.stdout.readline().strip())
        until(page, READY)
        process.kill()
        process.wait()
        page.locator("#height-number").fill("6.5")
        until(page, "document.querySelector('#said').className == 'bad'")
        assert "has ended" in page.locator("#said").inner_text()
        assert "height=6.5" in page.url
        page.close()


@pytest.mark.slow
def test_a_dot_of_the_cloud_sets_the_sliders(opened: Callable[..., Any]) -> None:
    """The design is the dot's; its level is that of the finite plate, where the dot has a column's estimate."""
    page = opened()
    page.locator("#gather").click()
    until(page, "document.querySelectorAll('#by-frequency .dot.front').length > 0 && cloud.points.length > 4")
    page.locator("#gather").click()
    until(page, "!cloud.running")
    dot = page.locator("#by-mass .dot.front").first
    target = dot.locator("title").text_content().split(" dB")[0]
    dot.focus()
    page.keyboard.press("Enter")
    chosen = f"cloud.points.find((point) => level(point.confinement_db, null) === '{target} dB').design"
    until(page, f"{READY} && Object.entries({chosen}).every(([name, value]) => state.shown.design[name] === value)")
    assert page.locator("#pins tbody tr").count() == 0 and not page.faults


@pytest.mark.slow
def test_the_decay_band_is_where_all_rows_together_take_ten_decibels(opened: Callable[..., Any]) -> None:
    """Its edges lie between points, where the line through both crosses 10 dB over the rows; null is too steep to follow."""
    page = opened()

    def band(rows: int, levels: list[float | None], target: float = 25e3) -> list[str]:
        tones = [10e3, 20e3, 30e3, 40e3]
        found = {"design": {"rows": rows}, "rows": {"frequency_hz": tones, "db_per_row": levels}}
        return page.evaluate("(found) => decayBand(found)", {**found, "plate": {"frequency_hz": target}})

    assert band(2, [0.0, 10.0, 10.0, 0.0]) == ["15.0 to 35.0 kHz", "2 rows take at least 10 dB"]
    assert band(4, [0.0, 10.0, 10.0, 0.0])[0] == "12.5 to 37.5 kHz"
    assert band(1, [0.0, 9.0, 9.9, 0.0])[0] == "none" and band(0, [0.0, 10.0, 10.0, 0.0])[0] == "none"
    assert band(1, [12.0, 0.0, 20.0, None], 11e3)[0] == "10.0 to 11.7 kHz"  # the one about the target mode
    assert band(1, [12.0, 0.0, 20.0, None], 19e3)[0] == "25.0 to 40.0 kHz"  # else the widest
    assert band(1, [12.0, 12.0, None, 12.0]) == ["10.0 to 40.0 kHz", "the row takes at least 10 dB, or more widely"]


@pytest.mark.slow
def test_the_cloud_keeps_to_a_window_of_frequencies(opened: Callable[..., Any]) -> None:
    """Dots of both pictures, and the front among them, are those of the designs in it; an empty end is open."""
    page = opened()
    page.locator("#gather").click()
    until(page, "cloud.points.filter((point) => point.confinement_db >= 0).length > 6")
    page.locator("#gather").click()
    until(page, "document.querySelector('#gather').textContent === 'Go on'")
    points = page.evaluate("cloud.points.filter((point) => point.confinement_db >= 0)")
    tones = sorted(point["frequency_hz"] for point in points)
    low, high = (tones[1] + tones[2]) / 2e3, (tones[-2] + tones[-1]) / 2e3

    def shown(lowest: str, highest: str) -> list[int]:
        page.locator("#lowest").fill(lowest)
        page.locator("#highest").fill(highest)
        return [page.locator(f"#{name} .dot").count() for name in ("by-frequency", "by-mass")]

    inside = sum(1e3 * low <= tone <= 1e3 * high for tone in tones)
    assert shown("", "") == [len(tones)] * 2 and 0 < inside < len(tones)
    assert shown(f"{low}", f"{high}") == [inside] * 2
    count = page.evaluate("cloud.count")
    assert page.locator("#gathered").inner_text().startswith(f"{inside} of {count} designs shown")
    best = max((p for p in points if 1e3 * low <= p["frequency_hz"] <= 1e3 * high), key=lambda p: p["confinement_db"])
    named = page.locator("#by-mass .dot.front title").all_text_contents()
    assert any(name.startswith(page.evaluate(f"level({best['confinement_db']}, null)")) for name in named)
    assert shown(f"{low}", "") == [len(tones) - 2] * 2 and shown(f"{high}", f"{low}") == [0, 0]
    assert shown("", "") == [len(tones)] * 2 and not page.faults
    levels = sorted(page.evaluate("cloud.points.map((point) => point.confinement_db)"))
    page.locator("#confined").fill(f"{(levels[-3] + levels[-2]) / 2.0}")
    assert page.locator("#by-mass .dot").count() == 2
    assert page.locator("#gathered").inner_text().startswith(f"2 of {count} designs shown")
    page.locator("#confined").fill("")
    assert page.locator("#by-mass .dot").count() == len(levels), "levels below 0 dB are drawn where they are asked for"


@pytest.fixture(scope="module")
def exported(explorer: Explorer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("offline") / "explorer.html"
    path.write_text(offline.page(explorer), encoding="utf-8")
    return path


@pytest.mark.slow
def test_the_exported_page_has_pythons_numbers(browser: Any, exported: Path, explorer: Explorer) -> None:
    """Bands, decay, column and shape of random designs, to 1e-4 of each; nothing asked of any network."""
    _compare(browser, exported, explorer, 3)


@pytest.mark.slow
def test_the_exported_page_of_round_pillars_has_pythons_numbers(browser: Any, tmp_path: Path) -> None:
    """A block wider than the pillar grows with it; the case that is saved has the shape's own key."""
    round_ones = small_explorer(tmp_path, "pillar.shape=round", "pillar.diameter_mm=2")
    path = tmp_path / "explorer.html"
    path.write_text(offline.page(round_ones), encoding="utf-8")
    saved = _compare(browser, path, round_ones, 1)
    (tmp_path / "saved.toml").write_text(saved)
    pillar = load_case(tmp_path / "saved.toml").design.pillar
    assert pillar is not None and pillar.shape == "round" and pillar.base_m == pytest.approx(2e-3)


@pytest.mark.slow
def test_the_exported_page_of_hexagonal_pillars_has_pythons_numbers(browser: Any, tmp_path: Path) -> None:
    """Four classes and a path around a quarter of the zone; across corners the pillar is wider than its width says."""
    hexagons = small_explorer(tmp_path, "pillar.shape=hexagonal")
    assert [label for label in hexagons.model.bases.labels if label] == ["G", "X", "M", "Y", "G"]
    path = tmp_path / "explorer.html"
    path.write_text(offline.page(hexagons), encoding="utf-8")
    _compare(browser, path, hexagons, 3)
    page = browser.new_page()
    page.goto(path.as_uri())
    until(page, READY)
    assert page.locator("#path").text_content() == "Γ–X–M–Y–Γ"
    labels, places = page.evaluate("() => [state.shown.bands.labels, arc(state.shown.bands.labels)]")
    assert [at for at, label in zip(places, labels, strict=True) if label] == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0])
    page.close()


def _compare(browser: Any, exported: Path, explorer: Explorer, designs: int) -> str:
    """The page's answers of random designs beside Python's; the case file that it saves of its own design."""
    page = browser.new_page()
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url) if not request.url.startswith("blob:") else None)
    page.on("pageerror", lambda fault: requests.append(str(fault)))
    page.goto(exported.as_uri())
    until(page, READY)
    own = explorer.scene.own()
    sizes = as_sizes(explorer.model.cell.box.sample(np.random.default_rng(11).random((designs, 4))))
    for number, (thickness, height, side, pitch) in enumerate(sizes):
        lengths = {"thickness": thickness, "height": height, "side": side, "pitch": pitch}
        design = (
            own | {name: 1e3 * value for name, value in lengths.items()} | {"rows": float(number), "extension": 6.0}
        )
        ours, theirs = explorer.answer(design), page.evaluate("(design) => answer('answer', design)", design)
        highest = ours["bands"]["frequency_hz"][0][-1]
        for one, other in zip(ours["bands"]["frequency_hz"], theirs["bands"]["frequency_hz"], strict=True):
            assert other == pytest.approx(one, rel=1e-4, abs=1e-5 * highest)
        assert theirs["bands"]["gaps"] == [pytest.approx(gap, rel=1e-4) for gap in ours["bands"]["gaps"]]
        for name in (
            "confinement_db",
            "extension_db",
            "frequency_hz",
            "mac",
            "frequency_error",
            "confinement_error_db",
        ):
            assert theirs["plate"][name] == pytest.approx(ours["plate"][name], rel=1e-4)
        assert theirs["plate"]["profile"]["level"] == pytest.approx(ours["plate"]["profile"]["level"], abs=1e-4)
        known = [
            (one, other) for one, other in zip(ours["rows"]["db_per_row"], theirs["rows"]["db_per_row"], strict=True)
        ]
        assert all((one is None) == (other is None) for one, other in known)
        assert [other for _, other in known if other] == pytest.approx(
            [one for one, _ in known if one], rel=1e-4, abs=1e-4
        )
    assert page.evaluate("() => answer('cloud', { first: 3 })")[:4] == [
        one
        | {
            name: one[name] if one[name] is None else pytest.approx(one[name], rel=1e-4)
            for name in ("mass_g", "frequency_hz", "confinement_db")
        }
        for one in explorer.cloud(3, 4)
    ]
    saved = page.evaluate("(design) => ask('case', design)", own)
    assert requests == [exported.as_uri()]
    page.close()
    return str(saved)


@pytest.mark.slow
def test_the_exported_page_is_dragged_refuses_and_saves(browser: Any, exported: Path, tmp_path: Path) -> None:
    page = browser.new_page()
    page.goto(exported.as_uri() + "#rows=2")
    until(page, READY)
    assert page.locator("#full").is_hidden() and page.locator("#alone").is_visible()
    before = number(page, "Target frequency")
    drag(page, "height", 6.7)
    until(page, f"document.querySelector('.card dd').textContent.split(' ')[0] != '{before:.2f}'")
    assert number(page, "Target frequency") < before
    with page.expect_download() as download:
        page.locator("#save").click()
    download.value.save_as(tmp_path / "saved.toml")
    design = load_case(tmp_path / "saved.toml").design
    assert design.rows == 2 and design.pillar is not None and design.pillar.height_m == pytest.approx(6.7e-3)
    page.locator("#height-number").fill("7.5")
    until(page, "document.querySelector('#said').className == 'bad'")
    assert "height = 7.5 mm: must lie between 6 and 7 mm" in page.locator("#said").inner_text()
    page.close()
