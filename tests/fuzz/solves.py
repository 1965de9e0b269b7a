"""Small plates of drawn sizes, materials and models through the commands, in this process."""

from __future__ import annotations

import json
import random
import shlex
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

from pipeline.cli import main

SMALL = Path(__file__).parents[2] / "examples" / "small.toml"
COMMANDS = ("modes", "bands", "attenuation", "predesign", "modes --part pillar", "modes --part zone")
DRAWN = {
    "plate.thickness_mm": lambda draw: draw.choice((1e-3, 0.1, 0.5, 1.0, 2.0, 3.0, 6.0, 30.0)),
    "pillar.side_mm": lambda draw: draw.choice((0.01, 0.5, 1.0, 2.0, 3.0, 4.0)),
    "pillar.height_mm": lambda draw: draw.choice((1e-3, 0.5, 3.0, 6.3, 20.0, 1000.0)),
    "array.pitch_mm": lambda draw: draw.choice((2.0, 2.000001, 4.0, 9.0, 80.0)),
    "array.extension_mm": lambda draw: draw.choice((0.0, 1e-9, 0.5, 5.0, 30.0)),
    "array.rows": lambda draw: draw.choice((0, 1, 2)),
    "material": lambda draw: draw.choice(("steel", "pmma", "silicon", "glass")),
    "material.poisson": lambda draw: draw.choice((0.0, -0.9, 0.3, 0.4999)),
    "zone.nodal_lines": lambda draw: draw.choice((2, 3, 9, 40)),
    "solve.near_kHz": lambda draw: draw.choice((1e-3, 1.0, 31.0, 300.0, 1e6)),
    "solve.count": lambda draw: draw.choice((1, 2, 7)),
}


def draw_solve(draw: random.Random) -> bytes:
    """Words of a command."""
    words = [
        *shlex.split(draw.choice(COMMANDS)),
        str(SMALL.name),
        "--set",
        "solve.accuracy=0.1",
        "--set",
        "bands.points=2",
    ]
    for key in draw.sample(sorted(DRAWN), draw.randint(1, 4)):
        words += ["--set", f"{key}={DRAWN[key](draw)}"]
    return json.dumps(words).encode()


def read_solve(data: bytes) -> str:
    """Run the command; its exit code must be of the documented ones, and no exception one that nobody expected."""
    words = [str(SMALL) if word == SMALL.name else word for word in json.loads(data)]
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = main.main(words)
    assert code in (0, 2, 3, 5), code
    assert "unexpected" not in err.getvalue() and "Traceback" not in err.getvalue(), err.getvalue()
    return "read" if code == 0 else "refused"
