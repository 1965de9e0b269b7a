"""The envelope of the amplitude."""

from __future__ import annotations

import math

import numpy as np
import pytest

from firmware.client.client import Client
from firmware.closed_loop import held_plate
from tests.helpers.hosted_boards import Rig, RigPort

WINDOW_HZ = 5000.0


@pytest.fixture
def texture(core):
    made = core.ffi.new("an_texture *")
    core.lib.an_texture_init(made)
    return made


def test_plain_is_one(core, texture) -> None:
    assert [core.lib.an_texture_step(texture) for _ in range(3)] == [1.0, 1.0, 1.0]


def test_sine_swings_between_one_and_one_less_its_depth(core, texture) -> None:
    assert core.lib.an_texture_sine(texture, 50.0, 0.6, WINDOW_HZ)
    result = np.array([core.lib.an_texture_step(texture) for _ in range(1000)])
    expected = 1.0 - 0.3 * (1.0 - np.cos(2.0 * np.pi * 50.0 / WINDOW_HZ * np.arange(1, 1001)))
    assert np.abs(result - expected).max() < 1e-5


@pytest.mark.parametrize(("rate_hz", "depth"), [(-1.0, 0.5), (501.0, 0.5), (50.0, 1.1), (50.0, -0.1), (math.nan, 0.5)])
def test_sines_out_of_range_change_nothing(core, texture, rate_hz: float, depth: float) -> None:
    assert not core.lib.an_texture_sine(texture, rate_hz, depth, WINDOW_HZ)
    assert core.lib.an_texture_step(texture) == 1.0


def test_samples_last_their_time_and_the_last_stays(core, texture) -> None:
    lib = core.lib
    assert lib.an_texture_stream(texture, 3)
    for sample in (65535, 0, 32768):
        assert lib.an_texture_give(texture, sample)
    result = [lib.an_texture_step(texture) for _ in range(12)]
    assert result[:9] == pytest.approx([1.0] * 3 + [0.0] * 3 + [32768 / 65535] * 3, abs=1e-6)
    assert result[9:] == result[8:9] * 3
    assert texture.underruns == 1


def test_a_full_ring_takes_no_more(core, texture) -> None:
    lib = core.lib
    assert not lib.an_texture_give(texture, 1)
    assert lib.an_texture_stream(texture, 1)
    assert [lib.an_texture_give(texture, i) for i in range(257)] == [True] * 256 + [False]
    assert lib.an_texture_step(texture) == 0.0
    assert lib.an_texture_give(texture, 65535)


def test_streams_without_a_time_are_refused(core, texture) -> None:
    for every in (0, 50001):
        assert not core.lib.an_texture_stream(texture, every)


def test_the_client_learns_how_many_samples_were_taken(core) -> None:
    """As many as there is room for; the rest is sent again."""
    table, plate = held_plate(300.0)
    client = Client(RigPort(Rig(table, plate)))
    client.stream(200)
    taken = [client.samples([0.5] * 50) for _ in range(30)]
    assert taken[0] == 50 and taken[-1] == 0 and sum(taken) == pytest.approx(core.lib.AN_TEXTURE_ROOM, abs=2)
