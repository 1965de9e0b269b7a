"""docs/architecture.md says what the imports say."""

from __future__ import annotations

from xml.etree import ElementTree

from studies import floors


def test_the_page_lists_every_folder_with_its_sentence() -> None:
    page = floors.PAGE.read_text()
    between = page.partition(floors.BEGIN)[2].partition(floors.END)[0]
    assert between.strip() == floors.table(floors.folders()), "run `python -m studies.floors`"


def test_a_folder_stands_above_all_that_it_imports() -> None:
    imports = {"top": {"middle", "bottom"}, "middle": {"bottom"}}
    assert floors.floors(("bottom", "middle", "top"), imports) == {"bottom": 0, "middle": 1, "top": 2}


def test_the_picture_names_every_folder() -> None:
    """The committed picture holds its names as text, firmware as one box."""
    text = "".join(ElementTree.parse(floors.PICTURE).getroot().itertext())
    named = {name.replace(".", "/") for name in floors.folders() if not name.startswith("firmware")} | {"firmware"}
    assert {name for name in named if f"{name} (" not in text} == set()
