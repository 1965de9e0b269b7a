"""The thesis' hand-tuned design against what a search finds at equal rows, by the assembled plate and by the whole solid mesh.

`python -m studies.benchmarks.search` searches pillar height and pitch of the plate with three rows and prints both designs
by both models. Evaluations are kept: a second run goes on where the first one stopped.
"""

from __future__ import annotations

from pipeline.cli.main import main
from pipeline.paths import STUDIES

ARGUMENTS = (
    "search", str(STUDIES / "three-rows.toml"), "--vary", "pillar.height_mm=5:8", "--vary", "array.pitch_mm=4:8",
    "--goal", "confinement", "--set", "solve.accuracy=0.01", "--verify-with", "solid",
)  # fmt: skip

if __name__ == "__main__":
    raise SystemExit(main(ARGUMENTS))
