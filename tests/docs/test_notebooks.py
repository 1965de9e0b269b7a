"""The notebooks of examples/notebooks: their cells here on coarse plates, and as Jupyter runs them, in folders of their own."""

from __future__ import annotations

import ast
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

from firmware import build as builder

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


def cells(place: Path) -> list[dict[str, Any]]:
    """A notebook's cells of code."""
    return [cell for cell in json.loads(place.read_text())["cells"] if cell["cell_type"] == "code"]


def require_packages(place: Path) -> None:
    """Skip the notebook of the board where what builds and emulates its image is missing."""
    if place.stem != "table-to-board":
        return
    pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
    try:
        builder.toolchain()
    except builder.BuildError as missing:
        pytest.skip(str(missing))


def cell_outputs(sources: list[str]) -> Iterator[Any]:
    """Run cells one after the other; the value of each one that ends in an expression, as a notebook shows it."""
    names: dict[str, Any] = {"__name__": "__main__"}
    for source in sources:
        lines = ast.parse(source).body
        last = lines.pop() if isinstance(lines[-1], ast.Expr) else None
        exec(compile(ast.Module(lines, []), "cell", "exec"), names)
        if last is not None:
            yield eval(compile(ast.Expression(last.value), "cell", "eval"), names)


@pytest.mark.slow
@pytest.mark.parametrize("place", NOTEBOOKS, ids=lambda place: place.stem)
@pytest.mark.filterwarnings("ignore::antinode.AntinodeWarning")
def test_a_notebook_answers_on_coarse_plates(
    place: Path, coarsest_here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    require_packages(place)
    try:
        pages = [value._repr_html_() for value in cell_outputs(["".join(cell["source"]) for cell in cells(place)])
                 if hasattr(value, "_repr_html_")]  # fmt: skip
        assert pages and plt.get_fignums()
    finally:
        plt.close("all")


@pytest.mark.slow
@pytest.mark.parametrize("place", NOTEBOOKS, ids=lambda place: place.stem)
def test_a_notebook_runs(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And shows a picture."""
    require_packages(place)
    import nbformat
    from nbclient import NotebookClient

    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("ANTINODE_RESULTS", str(tmp_path / "results"))
    book = nbformat.read(place, as_version=4)
    NotebookClient(book, timeout=900, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)


def test_notebooks_are_stored_without_results_and_read_files_that_there_are() -> None:
    assert len(NOTEBOOKS) == 5
    for place in NOTEBOOKS:
        sources = "".join("".join(cell["source"]) for cell in cells(place))
        for name in re.findall(r'folder / "([^"]+\.toml)"', sources):
            assert (ROOT / "examples" / name).is_file(), f"{place.name}: {name}"
        assert not any(cell["outputs"] or cell["execution_count"] for cell in cells(place)), place.name
