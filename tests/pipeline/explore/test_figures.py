"""The page writes figures by the rule of `pipeline.quantity`."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from pipeline import quantity
from pipeline.paths import ROOT

PAGE = ROOT / "pipeline" / "explore" / "page" / "explore.js"
BEGIN, END = "const exponent", "const ofBar"
NODE = shutil.which("node")


@pytest.mark.skipif(NODE is None, reason="needs node, which runs the page's own functions")
def test_the_page_writes_figures_as_python_does() -> None:
    assert NODE
    text = PAGE.read_text(encoding="utf-8")
    rule = text[text.index(BEGIN) : text.index(END)]
    pairs = [(219.3012, 6.6e-4), (33494.12, 3.3e-3), (1.0566e6, 4e-2), (33494.12, None), (999.6, 1.2), (56873.8, 4e-1)]
    levels = [(12.2519, 0.03), (12.2519, 4.2), (-0.61, 0.96), (12.2519, None)]
    script = f"{rule}; const [f, l] = {json.dumps([pairs, levels])};"
    script += "console.log(JSON.stringify([f.map((p) => frequency(...p)), l.map((p) => level(...p))]))"
    done = subprocess.run([NODE, "-e", script], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [
        [quantity.frequency(*pair) for pair in pairs],
        [quantity.level(*pair) for pair in levels],
    ]
