"""The floors of docs/architecture.md from the project's own imports: `python -m studies.floors` writes picture and table."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pipeline.paths import ROOT

PACKAGES = ("antinode", "geometry", "solvers", "pipeline", "studies", "firmware")
PAGE, PICTURE = ROOT / "docs/architecture.md", ROOT / "docs/pictures/floors.svg"
BEGIN, END = "<!-- folders: written by python -m studies.floors -->", "<!-- end of folders -->"
COLOURS = {
    "antinode": "#f4cccc",
    "geometry": "#d9e8d3",
    "solvers": "#cfe1f2",
    "pipeline": "#f6e3c5",
    "studies": "#eadcf0",
    "firmware": "#eeeeee",
}
WIDTH, HEIGHT, GAP = 2.05, 0.42, 0.95  # of a box, inches; from floor to floor

Arrows = dict[str, set[str]]


def folders() -> dict[str, list[str]]:
    """Folders of sources with their modules."""
    result = defaultdict(list)
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*.py")):
            if "build" not in file.relative_to(ROOT).parts:
                result[".".join(file.relative_to(ROOT).parent.parts)].append(file.stem)
    return {name: [each for each in modules if each != "__init__"] for name, modules in sorted(result.items())}


def arrows(names: Iterable[str]) -> Arrows:
    """Imports between folders, from the graph that import-linter uses."""
    from grimp import build_graph

    graph, known, result = build_graph(*PACKAGES), set(names), defaultdict(set)
    for module in graph.modules:
        for other in graph.find_modules_directly_imported_by(module):
            start, end = _folder(module, known), _folder(other, known)
            if start != end:
                result[start].add(end)
    for folder, below in result.items():  # a part that its own folder stands on: its arrow back up is left out
        if folder in result.get(_parent(folder), ()):
            below.discard(_parent(folder))
    return result


def floors(names: Iterable[str], imports: Arrows) -> dict[str, int]:
    """The floor of each folder: 0 imports none, any other stands one above the highest that it imports."""
    level: dict[str, int] = {}

    def of(name: str) -> int:
        if name not in level:
            level[name] = 1 + max((of(other) for other in imports.get(name, ())), default=-1)
        return level[name]

    return {name: of(name) for name in names}


def sentence(name: str) -> str:
    """First line of a folder's docstring."""
    text = ast.get_docstring(ast.parse((ROOT / name.replace(".", "/") / "__init__.py").read_text()))
    return (text or "").splitlines()[0]


def table(names: Iterable[str]) -> str:
    """Table with one line per folder: its sentence."""
    rows = [f"| `{name.replace('.', '/')}/` | {sentence(name)} |" for name in names]
    return "\n".join(["| folder | content |", "|---|---|", *rows])


def draw(modules: dict[str, list[str]], imports: Arrows, place: Path) -> None:
    """Folders as boxes, one line per floor; an arrow to each imported folder that no other arrow reaches already.

    Firmware stands alone: it is one box.
    """
    from matplotlib.figure import Figure

    alone = [name for name in modules if name.startswith("firmware")]
    modules = {name: all for name, all in modules.items() if name not in alone} | {
        "firmware": [each for name in alone for each in modules[name]]
    }
    imports = {
        name: {"firmware" if other in alone else other for other in others}
        for name, others in imports.items()
        if name not in alone
    }
    level = floors(modules, imports)
    lines: dict[int, list[str]] = defaultdict(list)
    for name in modules:
        lines[level[name]].append(name)
    widest = max(len(line) for line in lines.values())
    figure = Figure(figsize=(1.12 * WIDTH * widest, GAP * len(lines)))
    axes = figure.add_axes((0, 0, 1, 1))
    at = {name: _place(i, len(line), widest, floor) for floor, line in lines.items() for i, name in enumerate(line)}
    for name, others in _shortest(imports).items():
        for other in others:
            _arrow(axes, at[name], at[other])
    for name, (x, y) in at.items():
        axes.text(
            x, y, f"{name.replace('.', '/')} ({len(modules[name])})", ha="center", va="center", fontsize=8,
            bbox={"boxstyle": "round,pad=0.35", "fc": COLOURS[name.split(".")[0]], "ec": "#555555", "lw": 0.6},
        )  # fmt: skip
    axes.set(xlim=(0, 1.12 * WIDTH * widest), ylim=(-GAP / 2, GAP * (len(lines) - 0.5)))
    axes.axis("off")
    figure.savefig(place, metadata={"Date": None})


def main() -> None:
    """Write the picture, and the table into the page between its two marks."""
    import matplotlib

    # the same bytes from the same imports
    matplotlib.rcParams.update({"svg.hashsalt": "floors", "svg.fonttype": "none"})
    modules = folders()
    draw(modules, arrows(modules), PICTURE)
    page = PAGE.read_text()
    before, _, rest = page.partition(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}\n{table(modules)}\n{END}{rest.partition(END)[2]}")


def _parent(folder: str) -> str:
    return folder.rpartition(".")[0]


def _folder(module: str, known: set[str]) -> str:
    return module if module in known else module.rpartition(".")[0]


def _place(index: int, count: int, widest: int, floor: int) -> tuple[float, float]:
    return 1.12 * WIDTH * (index + 0.5 + (widest - count) / 2.0), GAP * floor


def _shortest(imports: Arrows) -> Arrows:
    """The arrows without those that a longer way already shows."""

    def below(name: str) -> set[str]:
        return set().union(*(({other} | below(other)) for other in imports.get(name, ())))

    return {n: {o for o in others if not any(o in below(p) for p in others if p != o)} for n, others in imports.items()}


def _arrow(axes: Any, start: tuple[float, float], end: tuple[float, float]) -> None:
    line = {"arrowstyle": "-|>", "color": "#999999", "lw": 0.7, "shrinkA": 9, "shrinkB": 9}
    axes.annotate("", xy=end, xytext=start, arrowprops=line, zorder=0)


if __name__ == "__main__":
    main()
