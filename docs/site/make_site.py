"""The documentation site: `make docs`, or `python docs/site/make_site.py [FOLDER]` (default: build/docs/site).

The site has the pages of docs/, the library's completed with its docstrings, and pictures made by commands; nothing is
written into docs/, and no network is needed. Exit code 4, with one line per fault, for dead links, unreadable docstrings and
public names missing from their page.
"""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os.path import normpath, relpath
from pathlib import Path

import pictures
import reference
from sphinx.application import Sphinx
from sphinx.util.docutils import docutils_namespace
from sphinx.util.inventory import InventoryFile

import antinode

ROOT = Path(__file__).resolve().parents[2]
WORK = ROOT / "build" / "docs"
CHECK_FAILED = 4


def pages(source: Path, with_pictures: bool = True) -> None:
    """Write every page of the site into a folder: those of docs/, completed."""
    shutil.rmtree(source, ignore_errors=True)
    shutil.copytree(ROOT / "docs", source, ignore=shutil.ignore_patterns("site", "__pycache__"))
    shutil.copy(ROOT / "CHANGELOG.md", source / "changelog.md")
    for page in source.rglob("*.md"):
        text = _within(page.read_text(encoding="utf-8"), page.parent.relative_to(source))
        page.write_text("\n".join([text, *(_contents(text) if page.name == "index.md" else ())]), encoding="utf-8")
    if with_pictures:
        (source / "gallery.md").write_text("\n".join(pictures.gallery_page(WORK / "pictures")), encoding="utf-8")
        for figure in pictures.figure_examples():
            pictures.made(figure, WORK / "pictures")
    with (source / "reference" / "library.md").open("a", encoding="utf-8") as page:
        page.write("\n" + "\n".join(reference.library()) + "\n")
    if with_pictures:
        shutil.copytree(
            WORK / "pictures",
            source / "pictures" / "gallery",
            ignore=shutil.ignore_patterns("*.json"),
            dirs_exist_ok=True,
        )


def _within(text: str, folder: Path) -> str:
    """Keep the words of links that leave docs/, which the repository can follow and the site cannot."""

    def kept(link: re.Match[str]) -> str:
        if normpath(folder / link[2]) == "../CHANGELOG.md":
            return f"[{link[1]}]({relpath('changelog.md', folder)})"
        leaves = normpath(folder / link[2]).startswith("..") and "://" not in link[2]
        return link[1] if leaves else link[0]

    return re.sub(r"(?<!!)\[([^]]*)\]\(([^)#\s]+)(?:#[^)]*)?\)", kept, text)


def _contents(text: str) -> Iterator[str]:
    """Write the tables of contents that Sphinx needs: the links of a page's lists, under the headings of its lists."""
    for part in re.split(r"^### ", text, flags=re.MULTILINE):
        names = re.findall(r"^\* \[[^]]*\]\((\S+)\.md\)$", part, re.MULTILINE)
        caption = [f":caption: {part.splitlines()[0]}"] if not part.startswith("#") else []
        if names:
            yield from ("```{toctree}", ":hidden:", *caption, "", *names, "```", "")


def build(source: Path, target: Path) -> list[str]:
    """Build the site and return its faults."""
    trees = WORK / "doctrees"
    with docutils_namespace(), _public_names():
        site = Sphinx(source, Path(__file__).parent, target, trees, "html", freshenv=True, status=None)
        site.build()
    faults = [f"{site._warncount} warnings of Sphinx, above"] if site._warncount else []
    with (target / "objects.inv").open("rb") as file:
        inventory = InventoryFile.load(file, "", lambda base, name: name)
    known = {name for kind, entries in inventory.items() if kind.startswith("py:") for name in entries}
    faults += [f"{name}: public, and not on the library's page" for name in sorted(reference.public_names() - known)]
    return faults + [
        f"{key}: no meaning in keys.toml or fields.toml of docs/site, or no such key" for key in reference.unexplained()
    ]


@contextmanager
def _public_names() -> Iterator[None]:
    """Give every class its public name: autodoc lists a class of another name as an alias, without its members."""
    classes = {name: thing for name in reference.OWN if isinstance(thing := getattr(antinode, name), type)}
    own = {name: thing.__name__ for name, thing in classes.items()}
    try:
        for name, thing in classes.items():
            thing.__name__ = name
        yield
    finally:
        for name, thing in classes.items():
            thing.__name__ = own[name]


def main(words: Sequence[str]) -> int:
    """Build; exit code 0, or 4 with a line for each fault."""
    target = Path(words[0]).resolve() if words else WORK / "site"
    pages(WORK / "source")
    faults = build(WORK / "source", target)
    print("\n".join(faults) if faults else f"{target / 'index.html'}")
    return CHECK_FAILED if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
