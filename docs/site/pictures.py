"""Pictures of the site, each made by a command: the gallery's examples and the figures of the explanations.

Pictures of unchanged sources are kept below build/docs. `python docs/site/pictures.py [NAME ...]` makes the thumbnails that
the repository keeps, of all examples or of those named, and writes docs/gallery.md.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from math import ceil
from pathlib import Path
from typing import Any

from PIL import Image, ImageChops, ImageOps

from pipeline.records.store import SHOWING, code_hash

SITE = Path(__file__).resolve().parent
ROOT = SITE.parents[1]
FIGURES = ("superelement", "superelement-convergence", "error-bars", "decay-band")
PAGE, THUMBNAILS = ROOT / "docs" / "gallery.md", ROOT / "docs" / "pictures" / "gallery"
TILE, FRAME = (480, 330), 8  # pixels of a thumbnail, and of the white about a picture
NARROW = """{python} -c 'import runpy, sys
from pipeline.cli import main
from pipeline.plots import style
style.WIDTH_IN = 5.2
program, *words = sys.argv[1:]
sys.exit(main.main(words) if program == "antinode" else runpy.run_path(words[0]) and 0)' """  # letters stay readable
INTRODUCTION = """\
# Gallery

Each example is one file of `examples/`, at most forty lines long, and shows one feature. Its command makes its picture.
Where a figure is given, the tests compare the example's own with it: it comes from a closed form, another mesh, another
method or another command. Run the commands in the folder of the checkout; they write into the current folder.
[Published band diagrams](papers.md) have case files of their own.
"""


@dataclass(frozen=True)
class Figure:
    """A number of an example's document, and an independent value that it must meet within the bars of both.

    The document is the command's JSON, the names of a script, or the rows of a study's table.
    """

    of: str
    value: float
    error: float  # relative, of the independent value
    by: str
    bar: str = ""  # the example's own relative error bar in the same document; none: the number has no mesh
    over: str = ""  # another number of the document, by which it is divided
    command: str = ""  # where the example's own has no such document
    quick: bool = False  # run by `make test`, the others by `make slow`


@dataclass(frozen=True)
class Example:
    """One worked example: a command, the picture that it writes, and a figure to check."""

    name: str
    title: str
    picture: str
    command: str
    text: str
    figure: Figure | None = None
    section: str = ""  # heading of the gallery that begins with this example

    @property
    def path(self) -> str:
        """The example's file; its name begins with the example's number."""
        found = next((name for word in self.command.split() if Path(name := word).stem == self.name), "")
        return found or f"examples/{self.name}.toml"

    @property
    def heading(self) -> str:
        """Number and title."""
        return f"{self.name[:2]} {self.title}"

    @property
    def file(self) -> str:
        """The picture's name on the site."""
        return f"{self.name}{Path(self.picture).suffix}"

    @property
    def checked(self) -> str:
        """The figure in a line of the gallery."""
        if self.figure is None:
            return ""
        of = f"`{self.figure.of}`" + (f" over `{self.figure.over}`" if self.figure.over else "")
        return f"Checked figure: {of} is {self.figure.value:.5g} by {self.figure.by}.\n"


def examples() -> list[Example]:
    """The examples of gallery.toml."""
    listed = tomllib.loads((SITE / "gallery.toml").read_text())["example"]
    return [Example(**{**each, "figure": Figure(**each["figure"]) if "figure" in each else None}) for each in listed]


def number(document: Any, path: str) -> float:
    """The number at a dotted path of a JSON document or of a script's names; a list's element by its place or `label`.

    Several paths with ` + ` between them are added.
    """
    if " + " in path:
        return sum(number(document, each) for each in path.split(" + "))
    for step in path.split("."):
        if isinstance(document, dict):
            document = document[step]
        elif hasattr(document, step):
            document = getattr(document, step)
        elif step.isdigit():
            document = document[int(step)]
        else:
            document = next(each for each in document if each["label"] == step)
    return float(document)


def figure_examples() -> list[Example]:
    """Figures of the explanations and of the tutorials, as commands."""
    drawn = [Example(name, name, f"{name}.svg", f"python docs/site/figures.py {name}", "") for name in FIGURES]
    listed = tomllib.loads((SITE / "gallery.toml").read_text())["page"]
    return drawn + [Example(each["name"], each["name"], each["picture"], each["command"], "") for each in listed]


@cache
def _drawing() -> bytes:
    """The files that draw and word a picture, which `code_hash` leaves out."""
    files = {path for pattern in (*SHOWING, "docs/site/figures.py") for path in ROOT.glob(pattern) if path.is_file()}
    return b" ".join(path.read_bytes() for path in sorted(files))


def made(example: Example, cache: Path, before: str = "") -> float:
    """Make an example's picture unless the cache has it; the processor seconds that its command took, with words before it."""
    command = before + example.command
    named = [path.read_bytes() for word in command.split() if (path := ROOT / word).is_file()]
    sources = hashlib.sha256(b" ".join([code_hash().encode(), command.encode(), _drawing(), *named])).hexdigest()
    picture, note = cache / example.file, cache / f"{example.name}.json"
    if note.exists() and picture.exists() and (known := json.loads(note.read_text()))["sources"] == sources:
        return float(known["seconds"])
    with tempfile.TemporaryDirectory() as folder:
        for name in ("examples", "studies", "docs"):
            (Path(folder) / name).symlink_to(ROOT / name)
        seconds = run(command, Path(folder))
        cache.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(Path(folder) / example.picture, picture)
    note.write_text(json.dumps({"sources": sources, "seconds": seconds}))
    return seconds


def run(command: str, folder: Path) -> float:
    """Run a command line in a folder of its own; its processor seconds. Raises RuntimeError on failure."""
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    environment |= {"PYTHONPATH": paths, "ANTINODE_RESULTS": str(folder / "results"), "MPLBACKEND": "Agg"}
    environment |= {"XDG_STATE_HOME": str(folder / "state")}  # a study's name is not remembered beyond
    before = sum(os.times()[2:4])  # of ended children: what else the machine does is not counted
    done = subprocess.run(command, shell=True, cwd=folder, env=environment, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{command}: exit code {done.returncode}\n{done.stderr[-2000:]}")
    return sum(os.times()[2:4]) - before


def gallery_page(cache: Path | None = None) -> Iterator[str]:
    """Lines of the gallery: thumbnails by subject, then words, command and figure of each; with a cache, its pictures, too."""
    yield INTRODUCTION
    for group in sections():
        yield f"## {group[0].section}\n"
        yield from _grid(group)
        for example in group:
            yield f"\n### {example.heading}\n\n`{example.path}`. {example.text}\n"
            seconds = 0.0 if cache is None else made(example, cache)
            if cache is not None:
                print(f"{example.name}: {seconds:.1f} s", flush=True)
                yield f"![{example.title}](pictures/gallery/{example.file})\n"
            yield f"```sh\n{example.command}\n```\n"
            yield from filter(None, [example.checked])
            if cache is not None:
                yield f"{max(seconds, 1.0):.0f} s of one processor.\n"


def sections() -> list[list[Example]]:
    """The examples by section, each of which begins with one that has a heading for it."""
    grouped: list[list[Example]] = []
    for example in examples():
        if example.section:
            grouped.append([])
        grouped[-1].append(example)
    return grouped


def _grid(group: Sequence[Example]) -> Iterator[str]:
    """A table of thumbnails, three in a row; its first row is the heading that Markdown wants, so all rows are as bold."""
    for start in range(0, len(group), 3):
        row = group[start : start + 3]
        cells = [_tile(each) for each in row] + [""] * (3 - len(row))
        yield f"| {' | '.join(cells)} |"
        if start == 0:
            yield "|:---|:---|:---|"


def _tile(example: Example) -> str:
    link = f"(#{anchor(example.heading)})"
    if not (THUMBNAILS / f"{example.name}.png").exists():
        return f"[{example.heading}]{link}"
    return f"[![{example.title}](pictures/gallery/{example.name}.png)]{link}<br>**{example.heading}**"


def anchor(heading: str) -> str:
    """The address of a heading within its page, as GitHub and MyST make it."""
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


def bitmap(drawing: Path) -> Path:
    """Draw an SVG file into a PNG file of its own size next to it, by Chromium."""
    size = re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"', drawing.read_text())
    assert size, f"{drawing}: no size in points"
    pixels = ",".join(str(ceil(float(each) * 4 / 3)) for each in size.groups())
    target = drawing.with_suffix(".png")
    words = ["--headless", "--no-sandbox", "--hide-scrollbars", f"--window-size={pixels}", f"--screenshot={target}"]
    subprocess.run(["chromium", *words, drawing.as_uri()], check=True, capture_output=True)
    return target


def thumbnail(picture: Path, target: Path) -> None:
    """Write a picture that fits into a tile: the first frame of a film, of the largest motion; few colours, a small file."""
    with Image.open(picture) as opened:
        whole = opened.convert("RGB")
    drawn = ImageChops.difference(whole, Image.new("RGB", whole.size, "white")).getbbox()
    framed = ImageOps.expand(whole.crop(drawn), FRAME, "white")
    small = ImageOps.pad(framed, TILE, Image.Resampling.LANCZOS, color="white")
    small.quantize(64).save(target, optimize=True)


def refresh(names: Sequence[str]) -> None:
    """Make the thumbnails of some examples, or of all, by their commands on a narrower page, and write the gallery's page."""
    for example in examples():
        if example.name in names or not names:
            with tempfile.TemporaryDirectory() as folder:
                picture = Path(folder) / example.file
                whole = THUMBNAILS.parent / example.picture  # that a page shows; drawings of its name are of studies
                if whole.exists() and whole.suffix != ".svg":
                    made(example, Path(folder))
                    shutil.copyfile(picture, whole)
                made(example, Path(folder), NARROW.format(python=sys.executable))
                thumbnail(bitmap(picture) if picture.suffix == ".svg" else picture, THUMBNAILS / f"{example.name}.png")
    PAGE.write_text("\n".join(gallery_page()), encoding="utf-8")


if __name__ == "__main__":
    refresh(sys.argv[1:])
