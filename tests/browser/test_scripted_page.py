"""The page of a scripted study has the same tables."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pipeline.report.html import Page, Section, Table, write_page

Visits = Callable[..., Any]
ROWS = [["b", 2.0], ["a", 1.5e-4], ["c", None], ["d", 10.0], ["e", 3.0], ["f", 4.0]]


def test_its_tables_sort_and_filter(visit: Visits, tmp_path: Path) -> None:
    page = Page([Section("Errors", ["words"], [Table("t", ["name", "error"], ROWS)])])
    *_, html = write_page(tmp_path, "n", "Title", "Lead", page)
    seen = visit(html)
    heading = seen.page.locator("#table-t th").nth(1)
    rows = "[...document.querySelectorAll('#table-t tbody tr')]"
    order = f"{rows}.filter((r) => !r.hidden).map((r) => r.cells[0].textContent).join('')"
    heading.locator("button").focus()
    seen.page.keyboard.press("Enter")
    assert seen.page.evaluate(order) == "abefdc" and heading.get_attribute("aria-sort") == "ascending"
    seen.page.keyboard.press("Enter")
    assert seen.page.evaluate(order) == "dfebac"
    seen.page.locator('[data-filter="table-t"]').fill("error>2.5")
    assert seen.page.evaluate(order) == "dfe" and seen.faults == []
