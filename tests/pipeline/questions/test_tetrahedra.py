"""The tetrahedral cross-check: a narrow window that is widened until the mode is in it, and a verdict that can say no."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest

from pipeline.case.model import load_case
from pipeline.models import cross_check, modes, target
from pipeline.paths import ROOT
from pipeline.planning.mesh_rules import PLATE_TETRAHEDRA
from pipeline.planning.model_choice import Expected
from solvers.fem.eigen import Count, PlainPencil
from solvers.superelement.plate import AssembledPlate
from tests.helpers.recording_log import RecordingLog

TARGET_HZ, STRENGTH = 36e3, 0.3


def row(frequency_hz: float, strength: float) -> Any:
    return SimpleNamespace(frequency_hz=frequency_hz, strength=strength, zone_share=0.8, mac=0.9)


SPECTRUM = [row(34.2e3, 0.01), row(34.8e3, 0.02), row(TARGET_HZ, STRENGTH), row(38e3, 0.05)]


class Spectrum:
    """Rows between two frequencies, and how often they were asked for."""

    def __init__(self) -> None:
        self.asked: list[tuple[float, float]] = []

    def __call__(self, low_hz: float, high_hz: float) -> tuple[tuple[Any, ...], Count]:
        self.asked.append((low_hz, high_hz))
        inside = tuple(each for each in SPECTRUM if low_hz <= each.frequency_hz <= high_hz)
        return inside, Count(low_hz, high_hz, len(inside), len(inside))


@pytest.mark.parametrize(("window", "widened"), [((34e3, 35e3), True), ((34.5e3, 36.5e3), False), ((30e3, 31e3), True)])
def test_a_window_without_the_expected_mode_is_widened_until_it_holds_it(
    window: tuple[float, float], widened: bool
) -> None:
    """A weak mode of the right shape lies in the first window: it does not pass for the one expected."""
    solve = Spectrum()
    rows, known = solve(*window)
    result = target.look_about(Expected(35e3, 0.28), known, rows, solve)
    assert result.row is SPECTRUM[2]
    assert (len(solve.asked) > 1) == widened
    assert result.count and result.count.expected == len(result.rows) and result.low_hz <= TARGET_HZ <= result.high_hz
    spans = sorted(solve.asked)
    assert all(before[1] == after[0] for before, after in pairwise(spans)), "no part solved twice"


@pytest.mark.parametrize(("share", "agrees"), [(0.019, True), (-0.019, True), (0.023, False), (-0.023, False)])
def test_tetrahedra_agree_within_both_bars(share: float, agrees: bool) -> None:
    log = RecordingLog()
    assert cross_check._agrees(TARGET_HZ * (1.0 + share), TARGET_HZ, 0.001, 0.02, log) is agrees
    assert ("CROSS_CHECK" in log.warnings) is not agrees


def test_what_tetrahedra_do_not_tell_counts_as_all_that_they_may_miss() -> None:
    with_bar, without_bar = (SimpleNamespace(target_row=SimpleNamespace(error=bar)) for bar in (0.007, None))
    assert cross_check._own_bar(with_bar) == 0.007
    assert (
        cross_check._own_bar(without_bar) == cross_check.excess(PLATE_TETRAHEDRA)
        and 0.03 < cross_check._own_bar(without_bar) < 0.1
    )


@pytest.mark.slow  # 12 s of processor: a plate reduced, and one meshed whole by tetrahedra
def test_a_superelement_broken_on_purpose_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    case = load_case(ROOT / "examples" / "small.toml", [])
    right = AssembledPlate.pencil

    def tet_check(log: RecordingLog) -> Any:
        ours = modes.solve_modes(case, modes.Request("plate", symmetry=case.target_symmetry), log)
        assert ours.target and ours.target.row and ours.target.row.error
        return cross_check.compared(case, ours, ours.target.row, ours.target.row.error, log)[2]

    same = tet_check(RecordingLog())
    assert same and same["agrees"]

    def broken(self: AssembledPlate) -> PlainPencil:
        pencil = right(self)
        return PlainPencil(0.85 * pencil.stiffness, pencil.mass, pencil.scale, pencil.rigid_count)

    monkeypatch.setattr(AssembledPlate, "pencil", broken)
    log = RecordingLog()
    other = tet_check(log)
    assert ("CROSS_CHECK" in log.warnings and not other["agrees"]) if other else "NO_MODE" in log.warnings
