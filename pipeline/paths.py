"""Where the checkout's folders are."""

from __future__ import annotations

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RESULTS = Path(os.environ.get("ANTINODE_RESULTS") or ROOT / "results")
STUDIES = ROOT / "studies"
REFERENCE = ROOT / "results" / "reference"
