"""No violation that axe-core finds, on the pages that people open first: home, gallery, a study's report, the explorer."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from pipeline.paths import ROOT
from tests.helpers.exploring import served, small_explorer

SITE = ROOT / "docs" / "site"
FOUND = find_spec("axe_playwright_python")
needs_axe = pytest.mark.skipif(
    FOUND is None, reason="axe-core is not installed (package axe-playwright-python, pip extra dev)"
)
WIDTHS, SCHEMES = (1440, 390), ("light", "dark")
EVERY = [pytest.param(width, scheme, id=f"{width}-{scheme}") for width in WIDTHS for scheme in SCHEMES]
READY = "document.querySelectorAll('#numbers .card').length > 3 && !document.body.classList.contains('stale')"


@pytest.fixture
def faults(browser: Any) -> Iterator[Callable[..., list[str]]]:
    """What axe-core finds on a page: a line for each rule and element."""
    contexts = []

    def look(address: str, width: int, scheme: str, ready: str = "true") -> list[str]:
        assert FOUND is not None and FOUND.origin is not None
        settings: dict[str, Any] = {"viewport": {"width": width, "height": 900}, "color_scheme": scheme}
        context = browser.new_context(**settings, bypass_csp=True)  # axe is a script that the page did not bring
        contexts.append(context)
        page = context.new_page()
        page.goto(address)
        page.wait_for_function(ready, timeout=60_000)
        page.add_script_tag(path=str(Path(FOUND.origin).parent / "axe.min.js"))
        rules = page.evaluate("axe.run().then((found) => found.violations)")
        return [f"{rule['id']}: {node['html'][:160]}" for rule in rules for node in rule["nodes"]]

    yield look
    for context in contexts:
        context.close()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Home and gallery built as `make docs` builds them, without the pages that they lead to."""
    folder = tmp_path_factory.mktemp("site")
    sys.path.insert(0, str(SITE))
    try:
        make_site = pytest.importorskip("make_site", reason="Sphinx is not installed (pip extra docs)")
    finally:
        sys.path.remove(str(SITE))
    (folder / "source").mkdir()
    for name in ("index.md", "gallery.md"):
        shutil.copy(ROOT / "docs" / name, folder / "source" / name)
    shutil.copytree(ROOT / "docs" / "pictures", folder / "source" / "pictures")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(make_site, "WORK", folder)
        make_site.build(folder / "source", folder / "site")
    return folder / "site"


@pytest.mark.slow
@needs_axe
@pytest.mark.parametrize(("width", "scheme"), EVERY)
@pytest.mark.parametrize("name", ["index", "gallery"])
def test_home_and_gallery(faults: Callable[..., list[str]], site: Path, name: str, width: int, scheme: str) -> None:
    assert faults((site / f"{name}.html").as_uri(), width, scheme) == []


@pytest.mark.slow
@needs_axe
@pytest.mark.parametrize(("width", "scheme"), EVERY)
def test_a_report(faults: Callable[..., list[str]], study: Path, width: int, scheme: str) -> None:
    assert faults(study.as_uri(), width, scheme) == []


@pytest.mark.slow
@needs_axe
def test_the_explorer(faults: Callable[..., list[str]], tmp_path: Path) -> None:
    with served(small_explorer(tmp_path)) as server:
        for width in WIDTHS:
            for scheme in SCHEMES:
                assert faults(server.address, width, scheme, READY) == [], (width, scheme)


@needs_axe
def test_a_fault_is_found(faults: Callable[..., list[str]], tmp_path: Path) -> None:
    """A picture without words, and grey on grey."""
    page = tmp_path / "page.html"
    page.write_text(
        "<html lang=en><title>t</title><main><h1>t</h1><img src=x><p style='color:#aaa'>faint</main></html>"
    )
    assert {fault.partition(":")[0] for fault in faults(page.as_uri(), 390, "light")} == {"image-alt", "color-contrast"}
