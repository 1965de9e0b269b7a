"""Figures are drawn coarsely here: what is tested is that they are there and what they say."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from pipeline.plots import style


@pytest.fixture(autouse=True, scope="module")
def coarse() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "DPI", 40)
        patch.setattr(style, "SHOWN_PX", 240)
        yield
