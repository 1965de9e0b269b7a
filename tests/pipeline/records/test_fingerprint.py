import shutil
from pathlib import Path

import numpy as np
import pytest

from pipeline.records import store


def test_hash_ignores_order_and_number_types_but_no_value():
    one = store.input_hash({"a": 1.5, "b": [1, 2], "c": {"d": None}})
    assert one == store.input_hash({"c": {"d": None}, "b": (1, 2), "a": np.float64(1.5)})
    assert one != store.input_hash({"a": np.nextafter(1.5, 2), "b": [1, 2], "c": {"d": None}})
    assert store.plain({"x": np.array([1.0, np.nan])}) == {"x": [1.0, None]}


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    for folder in store.COMPUTING_FOLDERS:
        shutil.copytree(store.ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_any_edit_of_what_computes_changes_the_hash_and_none_of_what_shows(checkout: Path):
    before = store.code_hash(checkout)
    assert before == store.code_hash()  # the place of the checkout does not matter
    (checkout / "pipeline/records/tables.py").write_text("edited")
    (checkout / "pipeline/plots/extra.py").write_text("new")
    assert store.code_hash(checkout) == before
    (checkout / "pipeline/a_new_step.py").write_text("")
    added = store.code_hash(checkout)
    (checkout / "geometry/layout.py").write_text("edited")
    edited = store.code_hash(checkout)
    with (checkout / "solvers/accuracy/calibration.csv").open("a") as file:
        file.write("another row\n")
    assert len({before, added, edited, store.code_hash(checkout)}) == 4


def test_every_module_that_computes_is_counted():
    counted = {path.relative_to(store.ROOT).as_posix() for path in store.computing_sources()}
    assert {"geometry/layout.py", "solvers/errors.py", "pipeline/records/store.py"} <= counted
    assert not {"pipeline/batch/runner.py", "pipeline/records/tables.py", "pipeline/report/page.py"} & counted


def test_the_reason_names_the_package():
    mark = store.current_fingerprint()
    record = {"code_hash": mark.code_hash, "versions": dict(mark.versions)}
    assert mark.differs_from(record) is None
    record["versions"]["scipy"] = "1.0"
    assert mark.differs_from(record) == f"scipy was 1.0, is {mark.versions['scipy']}"
    assert "sources changed" in mark.differs_from({**record, "code_hash": "0"})
