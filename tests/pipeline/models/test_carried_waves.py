"""Evanescent waves that the boundary functions cannot carry are not listed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.case.model import Case, load_case
from pipeline.logs import TerminalLog
from tests.helpers.asked import attenuation_of
from tests.helpers.coarse_cells import put_in

CASE = """name = "d"
material = "aluminium"
plate = { thickness_mm = 1.5 }
zone = { length_mm = 18, width_mm = 10, nodal_lines = 2 }
pillar = { shape = "square", side_mm = 1.8, height_mm = 5.0 }
array = { pitch_x_mm = 5.0, pitch_y_mm = 4.0, rows = 2, extension_mm = 3.0 }
solve = { accuracy = ACCURACY }
"""


def case_of(folder: Path, accuracy: float) -> Case:
    file = folder / "d.toml"
    file.write_text(CASE.replace("ACCURACY", str(accuracy)))
    return load_case(file)


@pytest.mark.slow
def test_waves_listed_are_waves_of_richer_functions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At kx = 300 rad/m each listed wave is one of a row with more boundary functions on the same mesh."""
    put_in(monkeypatch)
    ours, finer = (
        attenuation_of(case_of(tmp_path, accuracy), TerminalLog(True), (50e3, 60e3), 300.0, 2)
        for accuracy in (0.03, 0.003)
    )
    for point, reference in zip(ours.points, finer.points, strict=True):
        assert len(point.waves) >= 3
        known = np.array([complex(abs(wave.ky_re_per_m), wave.ky_im_per_m) for wave in reference.waves])
        for wave in point.waves:
            k = complex(abs(wave.ky_re_per_m), wave.ky_im_per_m)
            assert np.abs(known - k).min() <= 0.02 * abs(k)
