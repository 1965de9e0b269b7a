"""A study's page in headless Chromium, driven by Playwright; skipped with the reason where either is missing."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.plots import rendering
from pipeline.questions import study as asked
from pipeline.questions.bands import BandsResult
from pipeline.records import store
from pipeline.report import page
from tests.helpers import synthetic

CHROMIUM = next(
    (result for name in ("chromium", "chromium-browser", "google-chrome") if (result := shutil.which(name))), ""
)
SOFTWARE_GL = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
NO_GL = ("--no-sandbox", "--disable-3d-apis")


@dataclass
class Visit:
    """A page being looked at, with what its console complained of and what it asked the network for."""

    page: Any
    faults: list[str] = field(default_factory=list)
    query: list[str] = field(default_factory=list)


@pytest.fixture(scope="session")
def playwright() -> Iterator[Any]:
    driver = pytest.importorskip(
        "playwright.sync_api", reason="the package playwright is not installed (pip extra dev)"
    )
    if not CHROMIUM:
        pytest.skip("no Chromium on this machine (Debian package chromium)")
    with driver.sync_playwright() as started:
        yield started


@pytest.fixture(scope="session")
def browser(playwright: Any) -> Iterator[Any]:
    launched = playwright.chromium.launch(executable_path=CHROMIUM, args=list(SOFTWARE_GL))
    yield launched
    launched.close()


@pytest.fixture(scope="session")
def browser_without_gl(playwright: Any) -> Iterator[Any]:
    launched = playwright.chromium.launch(executable_path=CHROMIUM, args=list(NO_GL))
    yield launched
    launched.close()


@pytest.fixture
def visit(browser: Any) -> Iterator[Callable[..., Visit]]:
    """Opens a file in a context of its own."""
    yield from visits(browser)


@pytest.fixture
def visit_without_gl(browser_without_gl: Any) -> Iterator[Callable[..., Visit]]:
    yield from visits(browser_without_gl)


def visits(browser: Any) -> Iterator[Callable[..., Visit]]:
    contexts = []

    def open_page(path: Path, **settings: Any) -> Visit:
        context = browser.new_context(**{"viewport": {"width": 760, "height": 620}, **settings})
        contexts.append(context)
        page = context.new_page()
        seen = Visit(page)
        page.on("console", lambda said: seen.faults.append(said.text) if said.type == "error" else None)
        page.on("pageerror", lambda fault: seen.faults.append(str(fault)))
        page.on("request", lambda request: seen.query.append(request.url[:80]))
        page.goto(path.as_uri())
        return seen

    yield open_page
    for context in contexts:
        context.close()


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of an invented study whose first cell holds labels and shapes of its waves; the second is as of old."""
    folder = synthetic.put_study(tmp_path_factory.mktemp("browser") / "rows", pitches=(0.004, 0.006), rows=(1,))
    put_waves(folder / "pitch_mm=4,rows=1")
    asked.write_table(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rendering, "_faults", ["not looked at here"])
        return page.build(folder, max_figures=1)


def put_waves(case: Path) -> None:
    """Polarisations of every wave and shapes at the labelled wavevectors, as the present version stores them."""
    bands, arrays = synthetic.record_of(case).of(BandsResult), store.load_arrays(case)
    assert bands
    names = ("flexural", "shear", "longitudinal")
    text = []
    for number, point in enumerate(bands.points):
        count = len(point.frequencies_hz)
        plain = [names[band % 3] for band in range(count)]
        speeds = [None if number == 0 and band < 3 else (30.0 * band, 40.0 * band) for band in range(count)]
        whole = ["pillar" if band in (3, 4) else plain[band] for band in range(count)]
        waves = {"plate_polarisation": plain, "polarisation": whole, "group_velocity_m_s": speeds}
        text.append(replace(point, **waves))
    points, quads = synthetic.box(np.array([-2e-3, -2e-3, 0.0]), np.array([2e-3, 2e-3, 2e-3]), (4, 4, 2))
    shapes = np.zeros((3, 8, 2, len(points), 3), dtype=np.float16)
    for band in range(8):
        shapes[:, band, 0, :, 2] = np.cos((band + 1) * 400.0 * points[:, 0])
    waves = {"bands_points": points.astype(np.float32), "bands_quads": quads.astype(np.int32)}
    store.save_arrays(case, {**arrays, **waves, "bands_labels": np.array(["G", "X", "M"]), "bands_u": shapes})
    synthetic.change(case, bands=replace(bands, points=text))
