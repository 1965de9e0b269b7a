"""The notebooks of examples/notebooks, run as Jupyter would, in folders of their own."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
COARSELY = "import pytest; from tests.helpers.coarse_cells import mesh_coarsest; mesh_coarsest(pytest.MonkeyPatch())"


@pytest.mark.parametrize("place", NOTEBOOKS, ids=lambda place: place.stem)
def test_a_notebook_answers_on_coarse_plates(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_it_runs(place, tmp_path, monkeypatch, COARSELY)


@pytest.mark.slow
@pytest.mark.parametrize("place", NOTEBOOKS, ids=lambda place: place.stem)
def test_a_notebook_runs(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_it_runs(place, tmp_path, monkeypatch)


def assert_it_runs(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: str = "") -> None:
    """And shows a picture; `first`: what its kernel does before."""
    import nbformat
    from nbclient import NotebookClient

    shutil.copy(ROOT / "examples" / "small.toml", tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("ANTINODE_RESULTS", str(tmp_path / "results"))
    book = nbformat.read(place, as_version=4)
    if first:
        book.cells.insert(0, nbformat.v4.new_code_cell(first))
    NotebookClient(book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)


def test_notebooks_are_stored_without_results() -> None:
    assert len(NOTEBOOKS) == 3
    for place in NOTEBOOKS:
        cells = [cell for cell in json.loads(place.read_text())["cells"] if cell["cell_type"] == "code"]
        assert not any(cell["outputs"] or cell["execution_count"] for cell in cells), place.name
