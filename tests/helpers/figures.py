"""Figures before they become files, for tests to inspect."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.plots import style


def collected(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Any]]:
    """Collect name and figure of everything saved from now on."""
    figures: list[tuple[str, Any]] = []
    save = style.save

    def kept(report_figure: style.ReportFigure, folder: Any) -> style.StoredFigure:
        figures.append((report_figure.name, report_figure.figure))
        assert len(report_figure.alt) > 20, f"{report_figure.name} needs words for who cannot see it"
        return save(report_figure, folder)

    monkeypatch.setattr(style, "save", kept)
    return figures


def assert_labelled_with_data(name: str, figure: Any) -> None:
    """Check that all axes show finite, varying data, and that the figure labels its quantities."""
    assert any(axes.get_xlabel() for axes in figure.axes) and any(axes.get_ylabel() for axes in figure.axes), name
    for axes in figure.axes:
        values = [np.asarray(line.get_ydata(), dtype=float) for line in axes.lines]
        values += [
            np.asarray(part.get_array(), dtype=float).ravel()
            for part in axes.collections
            if part.get_array() is not None
        ]
        values += [np.asarray(image.get_array(), dtype=float).ravel() for image in axes.images]
        values += [np.array([bar.get_height() for bar in axes.patches])] if axes.patches else []
        finite = np.concatenate([each[np.isfinite(each)] for each in values]) if values else np.empty(0)
        assert finite.size and np.ptp(finite) > 0.0, f"{name}: axes '{axes.get_title()}' show nothing"
