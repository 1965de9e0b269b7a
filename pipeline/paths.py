"""Folders of the checkout."""

from __future__ import annotations

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
IS_CHECKOUT = (ROOT / "pyproject.toml").is_file()  # an installed wheel stores results in the current folder
RESULTS = Path(os.environ.get("ANTINODE_RESULTS") or (ROOT if IS_CHECKOUT else Path.cwd()) / "results")
STUDIES = ROOT / "studies"
REFERENCE = ROOT / "results" / "reference"
