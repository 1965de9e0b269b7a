"""Tables for people: units in the head, few digits, the answer marked."""

from __future__ import annotations

from dataclasses import replace

import pytest

from pipeline.records.outputs import filled, reading_markdown, reading_table
from tests.helpers.synthetic import peak


def test_frequencies_have_the_digits_of_their_bars_and_the_answer_is_starred() -> None:
    head = ("frequency_hz", "error", "symmetry", "confinement_db", "confinement_error_db", "mac")
    rows = [[30056.0123, 2e-3, "SS", -0.0170816, 1.2, 5.26595e-06], [34492.64, None, "SS", 11.6123, 0.04, 0.987795]]
    assert reading_table(head, rows, [1]).splitlines() == [
        "  frequency (kHz)  ± error (%)  symmetry  confinement (dB)  ± confinement (dB)       mac",
        "            30.06         0.20        SS               0.0                 1.2  5.27e-06",
        "*            34.5            -        SS             11.61                0.04     0.988",
    ]


def test_bands_share_a_unit_and_their_bars_stand_in_files_alone() -> None:
    head = ("label", "band_1_hz", "band_2_hz", "band_1_error", "band_2_error")
    rows = [["G", 0.0, 548.771, 0.0, 4e-3], ["X", 219.3012, 840.1, 6.6e-4, 4e-3]]
    assert reading_table(head, rows).splitlines() == [
        "label  band 1 (Hz)  band 2 (Hz)",
        "    G            0        548.8",
        "    X       219.30        840.1",
    ]


def test_what_was_asked_for_is_shown_as_it_was_asked() -> None:
    assert reading_table(("frequency_hz", "db_per_row", "db_error"), [[33333.333, 5.5, 0.123]]).splitlines() == [
        "frequency (kHz)  attenuation per row (dB)  ± attenuation per row (dB)",
        "        33.3333                      5.50                        0.12",
    ]


def test_columns_that_mean_nothing_here_are_left_out() -> None:
    head, rows = filled(("frequency_hz", "mac", "confinement_db"), [[1.0, None, 2.0], [3.0, None, None]])
    assert head == ["frequency_hz", "confinement_db"] and rows == [[1.0, 2.0], [3.0, None]]
    assert filled(("frequency_hz",), []) == (["frequency_hz"], [])


def test_no_estimate_of_any_row_leaves_three_digits_and_no_column() -> None:
    """As one row without an estimate among others: what is not known adds no digits."""
    head, rows = ("frequency_hz", "error", "mac"), [[33494.12, None, 0.9], [841.37, None, 0.8]]
    assert reading_markdown(head, rows).splitlines() == [
        "| frequency (kHz) | mac |",
        "| --- | --- |",
        "| 33.5 | 0.900 |",
        "| 0.841 | 0.800 |",
    ]
    assert reading_table(*filled(head, rows)) == reading_table(head, rows)


def test_residuals_are_left_to_files() -> None:
    assert filled(("frequency_hz", "residual"), [[1.0, 1e-16]]) == (["frequency_hz"], [[1.0]])


def test_a_row_that_names_its_own_figure_is_read_in_that_figures_unit() -> None:
    """By theory, with as many digits as its expected error allows, or few."""
    rows = [["zone", "clamped_hz", 39084.25], ["zone", "clamped_hz_error", 0.0091], ["zone", "nodal_lines", 4]]
    rows += [["zone", "pinned_hz", 39084.25], ["pillar", "height_mm", 6.9912]]
    assert reading_markdown(("part", "quantity", "value"), rows).splitlines()[2:] == [
        "| zone | clamped sides (Mindlin) (kHz) | 39.1 |",
        "| zone | clamped sides (Mindlin): expected error (%) | 0.91 |",
        "| zone | nodal lines | 4 |",
        "| zone | pinned sides (Mindlin) (kHz) | 39.1 |",
        "| pillar | height (mm) | 6.99 |",
    ]


def test_markdown_has_the_same_words_and_a_dash_for_nothing() -> None:
    assert reading_markdown(("confinement_db", "case"), [[11.62, "a|b"], [None, "c"]]) == (
        "| confinement (dB) | case |\n| --- | --- |\n| 11.6 | a\\|b |\n| - | c |\n"
    )


def test_words_of_other_fields_have_their_units() -> None:
    head = ("gain_n_m", "reached_95_s", "mass_g", "zone_rms_m_per_N", "band_khz")
    assert reading_table(head, [[1e7, 1.98e-3, 12.1, 2.2e-8, 1.5]]).splitlines() == [
        "gain K' (N/m)  95 % reached (ms)  mass (g)  zone (nm/N)  stop band (kHz)",
        "        1e+07               1.98      12.1         22.0             1.50",
    ]


def test_a_quality_factor_s_bar_is_in_its_own_unit() -> None:
    head = ("quality_factor", "quality_error")
    assert reading_table(head, [[300.4, 0.08], [58.31, 2.0]]).splitlines() == [
        "quality factor  ± quality factor",
        "        300.40              0.08",
        "          58.3               2.0",
    ]


@pytest.mark.parametrize(
    ("error", "drive"),
    [(0.01, "25.00 ± 0.25 V for 1 um, for the given damping"), (None, "25.0 V for 1 um, no error estimate")],
)
def test_a_peak_names_the_drive_for_a_micrometre(error: float | None, drive: str) -> None:
    own = replace(peak(32e3, 15.0, zone_rms=4e-8), height_error=error)
    assert drive in own.line("peak")
    still = replace(own, zone_rms_m_per_V=0.0)
    assert still.volts_per_um is None and "for 1 um" not in still.line("peak")
