"""Pictures of the site, each made by a command: the gallery's examples and the figures of the explanations.

Pictures of unchanged sources are kept below build/docs.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.records.store import code_hash

SITE = Path(__file__).resolve().parent
ROOT = SITE.parents[1]
FIGURES = ("superelement", "superelement-convergence", "error-bars")


@dataclass(frozen=True)
class Figure:
    """A number of an example's JSON document, and an independent value that it must meet within the bars of both."""

    of: str
    value: float
    error: float  # relative, of the independent value
    by: str
    bar: str = ""  # the example's own relative error bar in the same document; none: the number has no mesh
    command: str = ""  # where the example's own has no JSON document
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

    @property
    def file(self) -> str:
        """The picture's name on the site."""
        return f"{self.name}{Path(self.picture).suffix}"

    @property
    def checked(self) -> str:
        """The figure in a line of the gallery."""
        if self.figure is None:
            return ""
        return f"Checked figure: `{self.figure.of}` is {self.figure.value:.5g} by {self.figure.by}.\n"


def examples() -> list[Example]:
    """The examples of gallery.toml."""
    listed = tomllib.loads((SITE / "gallery.toml").read_text())["example"]
    return [Example(**{**each, "figure": Figure(**each["figure"]) if "figure" in each else None}) for each in listed]


def number(document: Any, path: str) -> float:
    """The number at a dotted path of a JSON document; a list's element by its place from 0 or by its `label`."""
    for step in path.split("."):
        if isinstance(document, dict):
            document = document[step]
        elif step.isdigit():
            document = document[int(step)]
        else:
            document = next(each for each in document if each["label"] == step)
    return float(document)


def figure_examples() -> list[Example]:
    """Figures of the explanations, as commands."""
    return [Example(name, name, f"{name}.svg", f"python docs/site/figures.py {name}", "") for name in FIGURES]


def made(example: Example, cache: Path) -> float:
    """Make an example's picture unless the cache has it; the processor seconds that its command took."""
    sources = hashlib.sha256(
        f"{code_hash()} {example.command} {(SITE / 'figures.py').read_text()}".encode()
    ).hexdigest()
    picture, note = cache / example.file, cache / f"{example.name}.json"
    if note.exists() and picture.exists() and (known := json.loads(note.read_text()))["sources"] == sources:
        return float(known["seconds"])
    with tempfile.TemporaryDirectory() as folder:
        for name in ("examples", "studies", "docs"):
            (Path(folder) / name).symlink_to(ROOT / name)
        seconds = run(example.command, Path(folder))
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


def gallery_page(cache: Path) -> Iterator[str]:
    """Lines of the gallery: title, picture, words, command and time of each example."""
    for example in examples():
        seconds = made(example, cache)
        print(f"{example.name}: {seconds:.1f} s", flush=True)
        yield f"## {example.title}\n\n![{example.title}](pictures/gallery/{example.file})\n\n{example.text}\n"
        yield f"```sh\n{example.command}\n```\n\n{example.checked}\n{max(seconds, 1.0):.0f} s of one processor.\n"
