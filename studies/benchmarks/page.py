"""How long a stored study's page takes to open in headless Chromium, and how large it is.

    python -m studies.benchmarks.page [STUDY]

Medians of five cold loads: until the page's load event, until the first mode shape was drawn. Graphics are computed
in software, as on a machine without a graphics card.
"""

from __future__ import annotations

import shutil
import statistics
import sys
from pathlib import Path
from typing import Any

from pipeline import paths

REPEATS = 5
ARGUMENTS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
LOADED = "performance.getEntriesByType('navigation')[0].loadEventEnd"
SHAPES = '[data-viewer="plate"]'
DRAWN = "() => Number(document.querySelector('[data-viewer=plate] canvas').dataset.frames) > 0 && performance.now()"


def measure(page_file: Path, browser: Any) -> tuple[float, float | None]:
    """Seconds until loaded, and until the first mode shape stands (None when the page has none)."""
    context = browser.new_context(viewport={"width": 1200, "height": 800}, reduced_motion="reduce")
    page = context.new_page()
    page.goto(page_file.as_uri())
    loaded, shape = page.evaluate(LOADED), None
    if page.locator(SHAPES).count():
        page.locator(SHAPES).scroll_into_view_if_needed()
        shape = page.wait_for_function(DRAWN).json_value() / 1e3
    context.close()
    return loaded / 1e3, shape


def main(study: str) -> int:
    """Print what was measured; say what is missing where it cannot be."""
    page_file = paths.RESULTS / study / "report.html"
    chromium = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError:
        print("not measured: the package playwright is not installed (pip extra dev)")
        return 0
    if not chromium or not page_file.exists():
        print(
            f"not measured: {'no Chromium on this machine' if not chromium else f'no page yet: antinode run {study}'}"
        )
        return 0
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=list(ARGUMENTS))
        measured = [measure(page_file, browser) for _ in range(REPEATS)]
        browser.close()
    print(
        f"{study}: {page_file.stat().st_size / 1e6:.1f} MB, loaded in {statistics.median(t for t, _ in measured):.2f} s"
    )
    shapes = [shape for _, shape in measured if shape is not None]
    if shapes:
        print(f"first mode shape after {statistics.median(shapes):.2f} s")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1] if len(sys.argv) > 1 else "rows"))
