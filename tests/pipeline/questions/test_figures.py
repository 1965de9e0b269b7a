"""Figures of documents: drawn by the same panels as the report's, into axes that are given or new."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import antinode
from pipeline.models.answer_parts import SampleRecord
from pipeline.plots import style
from pipeline.quantity import KHZ, NM, frequency
from pipeline.questions.modes import ModesResult
from pipeline.questions.predesign import PredesignResult
from pipeline.questions.tolerance import ToleranceResult
from tests.helpers import synthetic

PLATE = "examples/small.toml"
RESPONSE, BANDS, ROWS = synthetic.response(12.0), synthetic.bands(0.004), synthetic.attenuation(3)


def tolerance() -> ToleranceResult:
    """Three plates, one of which lost its mode."""
    plates = [(31e3, 12.0, "single"), (31.5e3, 10.0, "single"), (None, None, "none")]
    nominal, *samples = (
        SampleRecord(peak_hz=tone, zone_rms=None, confinement_db=level, quality_factor=None, tracking=word)
        for tone, level, word in plates
    )
    counts: dict[str, Any] = {"pillars": 4, "dofs": 9, "lost": 1, "split": 0, "confined": 1}
    statistics = dict.fromkeys(("peak_hz", "peak_shift_hz", "confinement_db"))
    texts: dict[str, Any] = {"tolerance": {}, "drive": "patches", "rms_unit": "m/V", "space_check": {}}
    return ToleranceResult(nominal=nominal, samples=samples, **counts, **statistics, **texts)


def test_a_response_shows_zone_and_passive_face_in_nm_per_volt_over_khz() -> None:
    axes = RESPONSE.plot()
    zone = next(line for line in axes.lines if line.get_label() == "zone")
    assert np.allclose(zone.get_xdata(), np.array(RESPONSE.frequency_hz) / KHZ)
    assert np.allclose(zone.get_ydata(), np.array(RESPONSE.zone_rms_m_per_V) / NM)
    assert not axes.collections  # no bars, no bands
    half = [0.5 * each for each in RESPONSE.zone_rms_m_per_V]
    half[0] *= 4.0
    (band,) = replace(RESPONSE, zone_rms_error_m_per_V=half).plot().collections
    ends = band.get_paths()[0].get_extents()
    assert ends.ymin > 0.0 and ends.ymax >= 1.5 * max(RESPONSE.zone_rms_m_per_V) / NM * (1.0 - 1e-9)
    assert "(nm/V)" in axes.get_ylabel() and "passive face" in axes.get_legend_handles_labels()[1]


def test_bands_go_over_the_path_to_scale_with_their_gaps_shaded() -> None:
    axes = BANDS.plot()
    assert axes.get_ylabel() == "frequency (kHz)" and len(axes.texts) == len(BANDS.gaps)
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["Γ", "X", "M", "Γ"]


def test_the_kinds_of_waves_are_told_beneath_the_bands_and_hide_none() -> None:
    kinds = ["flexural", "shear", "longitudinal", *["pillar"] * 7]
    marked = {"plate_polarisation": ["flexural"] * 10, "polarisation": kinds}
    points = [replace(point, **marked) for point in BANDS.points]
    axes = replace(BANDS, points=points).plot()
    axes.figure.draw_without_rendering()
    legend, ticks = axes.get_legend(), axes.xaxis.get_tightbbox()
    assert len(legend.get_texts()) > 1 and legend.get_window_extent().y1 <= ticks.y0


def test_attenuation_shows_the_least_attenuated_flexural_wave() -> None:
    axes = ROWS.plot()
    (line,) = axes.lines
    assert np.allclose(np.transpose(line.get_data()), ROWS.decay / (KHZ, 1.0))


def test_samples_of_a_tolerance_lie_at_their_peaks_and_lost_ones_are_left_out() -> None:
    axes = tolerance().plot()
    samples, nominal = axes.lines[:2]
    assert samples.get_xydata().tolist() == [[31.5, 10.0]] and nominal.get_xydata().tolist() == [[31.0, 12.0]]


def test_given_axes_are_drawn_into() -> None:
    axes = ROWS.plot()
    assert RESPONSE.plot(axes) is axes


@pytest.mark.slow
def test_the_target_mode_is_drawn_from_above_next_to_the_modes_with_its_nodal_lines() -> None:
    zone = antinode.load(PLATE, accuracy=0.1).modes(part="zone", near_kHz=35.0, count=4)
    assert zone.target is not None
    tones, face = zone.as_figure().axes
    assert crossings(face) == 4 and frequency(zone.target.frequency_hz) in face.get_title("left")
    starred = tones.lines[-1].get_xydata()
    assert starred.tolist() == [[zone.target.index + 1, zone.target.frequency_hz / KHZ]]
    assert zone.plot(style.panels(3.0)[1]).figure.axes[1:] == []  # given axes get no neighbour
    assert len(ModesResult.from_document(zone.to_dict()).as_figure().axes) == 1  # a document has no shapes


def test_a_pillar_is_drawn_as_its_modes_bend_it() -> None:
    pillar = antinode.load(PLATE, accuracy=0.1).modes(part="pillar", count=3)
    bodies = pillar.as_figure().axes[1].collections
    assert len(bodies) == 3
    pair = sorted(map(width, bodies[:2]))  # along y and along x
    assert pair == pytest.approx([leaning(1.0), leaning(1.6)], rel=0.01)


def test_theory_draws_its_target_shape_and_the_pillars_first_bending() -> None:
    sizes = antinode.load(PLATE).predesign()
    face, pillar = sizes.as_figure().axes[1].child_axes
    assert crossings(face) == 4 and frequency(sizes.zone_hz) in face.get_title("left")
    (body,) = pillar.collections
    assert width(body) == pytest.approx(leaning(1.6), rel=1e-6)
    assert len(PredesignResult.from_document(sizes.to_dict()).as_figure().axes) == 1


def crossings(face: Any) -> int:
    """Changes of the sign of u_z along the centre line of a face."""
    mesh = face.collections[0]
    places, uz = mesh.get_datalim(face.transData), mesh.get_array()
    x, y = mesh._triangulation.x, mesh._triangulation.y
    assert places.width == pytest.approx(56.0)
    centre = np.flatnonzero(np.abs(y - y[np.abs(y).argmin()]) < 1e-6)
    along = uz[centre[np.argsort(x[centre])]]
    return int(np.sum(np.diff(np.sign(along[np.abs(along) > 1e-3])) != 0))


def width(body: Any) -> float:
    """Width of a drawn body, mm."""
    corners = np.concatenate([path.vertices for path in body.get_paths()])
    return float(np.ptp(corners[:, 0]))


def leaning(share: float) -> float:
    """Width, mm, of the plate's pillar, 2 x 2 x 6.3 mm, seen from (1, -1.6), with its tip 0.12 of its height aside."""
    return float((2.0 * (1.0 + 1.6) + 0.12 * 6.3 * share) / np.hypot(1.0, 1.6))
