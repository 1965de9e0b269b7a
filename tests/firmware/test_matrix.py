"""Identification of six channels as the client reports it: matrix, coherence, margins, time."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from firmware.client import matrix
from firmware.client.client import BoardError, Client, Refused
from firmware.emulate.plant import Beam
from firmware.mode_table import ModeTable, Pattern, Shape, to_bytes
from firmware.protocol import FAULT, IDENTIFY, IDLE, RUN, Fault
from tests.helpers.hosted_boards import HostedSix, RigPort

QUICK = Beam(noise=1e-3, quality_factor=15.0)


def board_of(beam: Beam, tau_s: float | None = None) -> tuple[HostedSix, Client]:
    shape = Shape(2400.0, tau_s or beam.slowest_s, (Pattern("all", (1.0,) * 6),))
    board = HostedSix(to_bytes(ModeTable(40e3, bytes(16), (), shapes=(shape,))), beam)
    board.run(5e-3)
    return board, Client(RigPort(board))


def measured(board: HostedSix, client: Client) -> matrix.Matrix:
    if board.state != IDENTIFY:
        client.identify()
    while client.status().state == "identify":
        board.run(0.05)
    return matrix.read(client)


@pytest.mark.slow
@pytest.mark.parametrize("largest", [0.5, 0.05])
def test_the_client_reports_what_the_matrix_rests_on(core, tmp_path: Path, largest: float) -> None:
    """A plate that answers weakly is driven harder; a glance finds that out, and no settled dwell is lost."""
    beam = dataclasses.replace(QUICK, largest=largest)
    board, client = board_of(beam)
    with pytest.raises(Refused, match="refused in the present state"):
        client.column(0)
    begun = client.port.elapsed_s
    found = measured(board, client)
    true = beam.structure.sampled_matrix(2400.0)
    assert np.abs(found.responses - true).max() < 0.01 * np.abs(true).max()
    assert 0.95 < found.coherent < 1.0 and found.coherence.shape == (6, 6)
    assert found.seconds == pytest.approx(board.app.probed_s, rel=1e-6)
    assert found.seconds < 1.15 * found.least_s
    assert found.seconds < client.port.elapsed_s - begun + 7.0
    matrix.judge(found)
    assert found.phase_deg > 65.0 and found.gain_db > 9.0 and "least possible" in matrix.describe(found)
    matrix.draw(tmp_path / "a.svg", found)
    assert (tmp_path / "a.svg").stat().st_size > 5000
    with pytest.raises(Refused):
        client.column(6)


def test_noise_shows_as_a_lack_of_coherence(core) -> None:
    """The means of eight windows scatter as the coherence says."""
    beam = dataclasses.replace(QUICK, noise=6e-3)
    board, client = board_of(beam)
    found = measured(board, client)
    spread2 = np.abs(found.responses) ** 2 * (1.0 / found.coherence - 1.0) / (matrix.AVERAGED - 1)
    wrong2 = np.abs(found.responses - beam.structure.sampled_matrix(2400.0)) ** 2
    assert 0.4 < wrong2.sum() / spread2.sum() < 2.5
    assert found.coherent < 0.9999


def radius(turned_gain: complex, distance: float, passed: float) -> float:
    """Spectral radius of one mode under its integral, window by window."""
    p = np.exp((1j * distance - 1.0) * passed)
    state = np.array([[p, 1.0 - p], [-turned_gain * p, 1.0 - turned_gain * (1.0 - p)]])
    return float(np.abs(np.linalg.eigvals(state)).max())


@pytest.mark.parametrize("passed", [2e-3, 0.03, 0.5])
def test_margins_are_those_of_the_loop_step_by_step(passed: float) -> None:
    """Where the stated margin ends, the recursion of some mode begins to grow."""
    gain = 0.3 * passed / (1.0 + passed)
    phase_deg, gain_db = matrix.margins(gain, passed, 0.0)
    distances = np.geomspace(1e-2, 3.0 / passed, 400)
    for share, grows in ((0.99, False), (1.02, True)):
        by_gain = max(radius(gain * 10.0 ** (share * gain_db / 20.0), d, passed) for d in distances)
        turned = gain * np.exp(-1j * np.radians(share * phase_deg))
        by_phase = max(radius(turned, side * d, passed) for d in distances for side in (-1.0, 1.0))
        assert (by_gain > 1.0) == grows and (by_phase > 1.0) == grows
    assert matrix.margins(gain, passed, 0.1)[0] == pytest.approx(phase_deg - np.degrees(np.arcsin(0.1)))
    assert matrix.margins(gain, passed, 1.0)[1] == -np.inf


@pytest.mark.slow
@pytest.mark.parametrize(("turn_deg", "gain_db"), [(60.0, 0.0), (-60.0, 0.0), (0.0, 8.0)])
def test_the_board_stands_what_the_margins_say(core, turn_deg: float, gain_db: float) -> None:
    """The stored matrix is wrong by nearly the margin: the pattern still settles."""
    board, client = board_of(QUICK)
    found = measured(board, client)
    assert found.phase_deg > abs(turn_deg) and found.gain_db > gain_db
    wrong = 10.0 ** (-gain_db / 20.0) * np.exp(1j * np.radians(turn_deg))
    assert board.lib.an_six_start(board.app, 0, 0.05)
    board.run(5e-3)
    for job in board.app.slow.jobs:
        job.patience = 2**30  # the model is wrong on purpose
        for z in job.inverse:
            own = complex(z.re, z.im) / wrong
            z.re, z.im = own.real, own.imag
    board.run(1.5)
    assert board.state == RUN
    assert np.abs(board.measured - 0.05).max() < 0.1 * 0.05


ERROR2_MAX = 0.0475  # AN_ERROR2_MAX


def spoilt(board: HostedSix, client: Client, coherence: float) -> matrix.Matrix:
    """A matrix whose sensors have been incoherent: the misfit of the last dwell alone would pass."""
    client.identify()
    spoil(board, client, coherence)
    return measured(board, client)


def spoil(board: HostedSix, client: Client, coherence: float) -> None:
    """Replace the coherence of the sensors once the matrix is being verified; a silent host would stop the board."""
    while not board.app.verifying:
        assert client.status().state == "identify"
        board.run(0.02)
    board.app.coherence = [coherence] * 36


def test_what_the_client_refuses_is_held_by_no_start(core) -> None:
    board, client = board_of(QUICK)
    found = spoilt(board, client, 0.85)
    assert board.state == IDLE and board.app.base.measured == 0 and not found.status.identified
    assert found.status.misfit < 0.02 and found.coherent == pytest.approx(0.85)
    with pytest.raises(BoardError, match="nothing is held: `identify`, `pattern` and the button B1 measure again"):
        matrix.judge(found)
    client.pattern(0, 0.05)
    assert board.state == IDENTIFY
    spoil(board, client, 0.85)
    while board.state == IDENTIFY:
        client.status()
        board.run(0.02)
    assert board.state == FAULT and board.faults == Fault.IDENTIFY and board.at_rest


def test_the_board_allows_as_much_error_as_the_margins(core) -> None:
    """They are least for the longest time constant."""
    phase_deg, gain_db = matrix.margins(3e-5, 1e-4, math.sqrt(ERROR2_MAX))
    assert phase_deg == pytest.approx(matrix.PHASE_LEAST_DEG, abs=0.1) and gain_db > matrix.GAIN_LEAST_DB
    board, client = board_of(QUICK)
    incoherent = 1e-3 / spoilt(board, client, 1.0 / 1.001).noise ** 2  # 1 / coherence - 1 for an error of 1
    for error2, fit in ((0.95 * ERROR2_MAX, True), (1.05 * ERROR2_MAX, False)):
        found = spoilt(board, client, 1.0 / (1.0 + error2 * incoherent))
        assert found.status.misfit**2 < 0.02 * ERROR2_MAX and found.status.identified == fit
        assert (found.status.state, board.faults) == ("idle", 0)


@pytest.mark.parametrize(("field", "words"), [("coherence", "coherence 0.50, at least 0.9"), ("misfit", "margin")])
def test_a_matrix_unfit_to_hold_is_refused_in_one_line(core, field: str, words: str) -> None:
    board, client = board_of(QUICK)
    found = measured(board, client)
    changed = {"coherence": {"coherence": np.full((6, 6), 0.5)}, "misfit": {"phase_deg": 40.0}}[field]
    with pytest.raises(BoardError) as raised:
        matrix.judge(dataclasses.replace(found, **changed))
    assert words in str(raised.value) and "\n" not in str(raised.value)
