"""How many files a reader meets who follows one command: `python -m tests.architecture.hops` lists them."""

from __future__ import annotations

import pytest

from tests.architecture.hops import functions_by_file

BOUND = 64


@pytest.mark.slow
def test_bands_of_a_small_plate_run_through_few_files() -> None:
    found = functions_by_file()
    assert {"pipeline/cli/main.py", "pipeline/questions/bands.py", "pipeline/models/bands.py"} <= found.keys()
    assert not {"antinode/__main__.py", "pipeline/paths.py"} & found.keys()  # bodies of modules alone
    assert len(found) <= BOUND, f"functions of {len(found)} files run: {', '.join(found)}"
