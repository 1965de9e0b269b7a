"""The page of `antinode explore` in headless Chromium: dragged, typed into, sent on, left without its program."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pipeline.explore.answer import Explorer
from pipeline.paths import ROOT
from tests.helpers.exploring import served, small_explorer

WAIT = 60_000  # ms: a busy machine answers a design in seconds
READY = "document.querySelectorAll('#numbers .card').length > 3 && !document.body.classList.contains('stale')"


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
        page.on("request", lambda asked: page.faults.append(asked.url) if not asked.url.startswith(address) else None)
        page.goto(address + more)
        page.wait_for_function(READY, timeout=WAIT)
        return page

    yield open_page
    for context in contexts:
        context.close()


def number(page: Any, name: str) -> float:
    """The number of a headline card."""
    text = page.locator(".card", has_text=name).locator("dd").inner_text()
    found = re.search(r"-?\d+\.\d+", text)
    assert found
    return float(found[0])


def drag(page: Any, name: str, value: float) -> None:
    """A slider dragged to a value by keys, as a person without a mouse does it, one step a press."""
    slider = page.locator(f"#{name}-range")
    slider.focus()
    steps = round((value - float(slider.input_value())) / float(slider.get_attribute("step")))
    for _ in range(abs(steps)):
        page.keyboard.press("ArrowRight" if steps > 0 else "ArrowLeft")
    page.wait_for_function(READY, timeout=WAIT)


def test_a_dragged_slider_changes_the_numbers(opened: Callable[..., Any]) -> None:
    page = opened()
    before, path = number(page, "Wanted frequency"), page.locator("#bands path.line").first.get_attribute("d")
    drag(page, "height", 6.7)
    page.wait_for_function(
        f"document.querySelector('.card dd').textContent.split(' ')[0] != '{before:.2f}'", timeout=WAIT
    )
    assert number(page, "Wanted frequency") < before  # a taller pillar resonates lower and takes the mode along
    assert page.locator("#bands path.line").first.get_attribute("d") != path
    assert page.locator("#bands path.before").count() > 0
    assert "height=6.7" in page.url
    assert not page.faults


def test_the_address_brings_the_design_back(opened: Callable[..., Any]) -> None:
    page = opened("#height=6.6&pitch=4.2&rows=2&colour=blue&side=")
    assert page.locator("#height-number").input_value() == "6.6"
    assert page.locator("#side-number").input_value() == "2"
    assert not page.faults


def test_undo_pins_and_what_does_not_fit(opened: Callable[..., Any]) -> None:
    page = opened()
    page.locator("#pin").click()
    assert page.locator("#pins tbody tr").count() == 1
    page.locator("#height-number").fill("8.5")
    page.wait_for_function("document.querySelector('#said').className == 'bad'", timeout=WAIT)
    assert "height = 8.5 mm" in page.locator("#said").inner_text()
    page.locator("#undo").click()
    page.wait_for_function("document.querySelector('#said').className != 'bad'", timeout=WAIT)
    assert page.locator("#height-number").input_value() == "6.3"
    assert not page.faults


def test_a_phone_in_the_dark_needs_no_sideways_scrolling(opened: Callable[..., Any]) -> None:
    page = opened(viewport={"width": 360, "height": 740}, color_scheme="dark", reduced_motion="reduce")
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 25, 30)"
    assert not page.faults


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
        page.wait_for_function(READY, timeout=WAIT)
        process.kill()
        process.wait()
        page.locator("#height-number").fill("6.5")
        page.wait_for_function("document.querySelector('#said').className == 'bad'", timeout=WAIT)
        assert "has ended" in page.locator("#said").inner_text()
        assert "height=6.5" in page.url
        page.close()
