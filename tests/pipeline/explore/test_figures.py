"""The page writes figures by the rule of `pipeline.quantity`."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from pipeline import quantity
from pipeline.paths import ROOT

PAGE = ROOT / "pipeline" / "explore" / "page" / "figures.js"
NODE = shutil.which("node")


@pytest.mark.skipif(NODE is None, reason="needs node, which runs the page's own functions")
def test_the_page_writes_figures_as_python_does() -> None:
    assert NODE
    rule = PAGE.read_text(encoding="utf-8")
    pairs = [(219.3012, 6.6e-4), (33494.12, 3.3e-3), (1.0566e6, 4e-2), (33494.12, None), (999.6, 1.2), (56873.8, 4e-1)]
    pairs += [(50.0, 0.0), (1.2345e-9, None), (2.0e12, 1e-3)]
    levels = [(12.2519, 0.03), (12.2519, 4.2), (-0.61, 0.96), (12.2519, None), (-0.04, None), (-3.4, 12.0)]
    shares, ends = [1.13e-3, 1.2e-6, 0.0496, 0.31], (519.21, 548.77, 4e-3)
    script = f"{rule}; const [f, l, s, e] = {json.dumps([pairs, levels, shares, ends])};"
    script += (
        "const texts = [f.map((p) => frequency(...p)), l.map((p) => level(...p)), s.map(percent), interval(...e)];"
    )
    script += "console.log(JSON.stringify(texts))"
    done = subprocess.run([NODE, "-e", script], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [
        [quantity.frequency(*pair) for pair in pairs],
        [quantity.level(*pair) for pair in levels],
        [quantity.percent(share) for share in shares],
        quantity.interval(*ends, ends[-1]),
    ]
