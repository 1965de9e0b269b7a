"""Tables for people: units in the head, few digits, the answer marked."""

from __future__ import annotations

from pipeline.records.reading import filled, reading_markdown, reading_table


def test_frequencies_are_in_khz_with_units_in_the_head_and_the_answer_is_starred() -> None:
    head = ("frequency_hz", "symmetry", "zone_share", "confinement_db", "mac")
    rows = [[30056.0123, "SS", 0.6275161, -0.0170816, 5.26595e-06], [34492.64, "SS", 0.953743, None, 0.987795]]
    assert reading_table(head, rows, [1]).splitlines() == [
        "  frequency (kHz)  symmetry  zone share  confinement (dB)        mac",
        "           30.056        SS      0.6275               0.0  5.266e-06",
        "*          34.493        SS      0.9537                 -     0.9878",
    ]


def test_without_an_answer_there_is_no_column_of_stars() -> None:
    assert reading_table(("label", "band_1_hz", "db_per_row"), [["G", 0.0, 5.5]]).splitlines() == [
        "label  band 1 (kHz)  decay per row (dB)",
        "    G         0.000                5.50",
    ]


def test_columns_that_mean_nothing_here_are_left_out() -> None:
    head, rows = filled(("frequency_hz", "mac", "confinement_db"), [[1.0, None, 2.0], [3.0, None, None]])
    assert head == ["frequency_hz", "confinement_db"] and rows == [[1.0, 2.0], [3.0, None]]
    assert filled(("frequency_hz",), []) == (["frequency_hz"], [])


def test_residuals_are_left_to_files() -> None:
    assert filled(("frequency_hz", "residual"), [[1.0, 1e-16]]) == (["frequency_hz"], [[1.0]])


def test_a_row_that_names_its_own_figure_is_read_in_that_figures_unit() -> None:
    rows = [["zone", "clamped_hz", 39084.25], ["zone", "clamped_hz_error", 0.0091], ["zone", "nodal_lines", 4]]
    assert reading_markdown(("part", "quantity", "value"), rows).splitlines()[2:] == [
        "| zone | clamped sides (Mindlin) (kHz) | 39.084 |",
        "| zone | clamped sides (Mindlin): expected error | 0.0091 |",
        "| zone | nodal lines | 4 |",
    ]


def test_markdown_has_the_same_words_and_a_dash_for_nothing() -> None:
    assert reading_markdown(("confinement_db", "case"), [[11.62, "a|b"], [None, "c"]]) == (
        "| confinement (dB) | case |\n| --- | --- |\n| 11.6 | a\\|b |\n| - | c |\n"
    )


def test_words_of_other_fields_have_their_units() -> None:
    head = ("gain_n_m", "reached_95_s", "mass_g", "zone_rms_m_per_N", "band_khz")
    assert reading_table(head, [[1e7, 1.98e-3, 12.1, 2.2e-8, 1.5]]).splitlines() == [
        "gain K' (N/m)  95 % reached (ms)  mass (g)  zone (nm/N)  stop band (kHz)",
        "        1e+07              1.980      12.1           22              1.5",
    ]
