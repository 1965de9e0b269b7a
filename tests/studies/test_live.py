"""Live answers next to assembled plates: what counts as within, and which designs are drawn."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from studies.live import FRAMES, PICTURE, BesidePlate, drawn, page_hash, summary

LIVE = {
    "frequency_hz": 40e3,
    "frequency_error": 0.02,
    "confinement_db": 6.0,
    "confinement_error_db": 1.0,
    "near_hz": None,
    "others": [],
}
REAL = {"frequency_hz": 39e3, "frequency_error": 0.01, "confinement_db": 7.0, "confinement_error_db": 0.5}


def test_both_bars_count_each_of_its_own_figure() -> None:
    one = BesidePlate.of(LIVE, REAL)
    assert one.ratios == pytest.approx((1e3 / (0.02 * 40e3 + 0.01 * 39e3), 1.0 / 1.5)) and one.within
    assert not BesidePlate.of(LIVE, REAL | {"confinement_db": 7.6}).within
    assert "1 of 1 frequencies and 1 levels" in summary([one]) and "median bar of a level: 1.00 dB" in summary([one])


def test_a_mode_that_the_plate_lacks_is_outside() -> None:
    lacking = BesidePlate.of(LIVE, {"why_not": "no mode of the target shape in the window"})
    assert not lacking.within and "1 plates lack the mode" in summary([lacking])


def test_a_plate_is_within_by_the_mode_that_the_live_answer_names_beside_its_own() -> None:
    other = {name: LIVE[name] for name in ("frequency_error", "confinement_error_db")}
    named = LIVE | {"others": [other | {"frequency_hz": 52e3, "confinement_db": 3.0}]}
    real = REAL | {"frequency_hz": 52.5e3, "confinement_db": 3.5}
    assert not BesidePlate.of(LIVE, real).within and BesidePlate.of(named, real).within
    assert not BesidePlate.of(named, real | {"confinement_db": 7.0}).within, "the level is that of the same mode"


def test_designs_are_drawn_from_all_of_the_cloud() -> None:
    """Of a sequence whose every sixteenth member is alike: no such stride."""
    limits = {"rows": SimpleNamespace(key="array.rows"), "pitch": SimpleNamespace(key="array.pitch_mm")}
    own = {"rows": 1.0, "pitch": 4.0}
    scene = SimpleNamespace(limits=limits, own=lambda: dict(own))
    explorer = SimpleNamespace(cloud_designs=[{"rows": float(n % 16)} for n in range(2000)], scene=scene)
    every = [design["rows"] for design in drawn(explorer, 40, {})]  # type: ignore[arg-type]
    assert len(every) == 120 and len(np.unique(every)) == 16
    swept = list(drawn(explorer, 40, {"array.rows": [1, 2], "array.pitch_mm": [5]}))  # type: ignore[arg-type]
    assert swept == [{"rows": 1.0, "pitch": 5.0}, {"rows": 2.0, "pitch": 5.0}]


def test_the_moving_picture_is_of_the_present_page() -> None:
    """Its comment holds the hash of the page's files; `python -m studies.live picture` makes it again."""
    with Image.open(PICTURE) as picture:
        assert picture.info["comment"].decode() == page_hash(), "python -m studies.live picture"
        assert picture.n_frames >= FRAMES
    assert PICTURE.stat().st_size < 2_000_000
