"""First-order changes of a peak's quality factor against the factor read again on plates that were changed."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.layout import Design
from geometry.materials import MATERIALS, PIEZO_MATERIALS, Stack
from solvers.control.identification import half_power_points
from solvers.driven.error_bars import Variation, width_rates
from solvers.piezo.forced import Drive, ForcedPlate, GroupModes
from solvers.piezo.patch import bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate
from solvers.piezo.responses import highest_hz
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings

ALUMINIUM = MATERIALS["aluminium"]
QUALITY = 60.0
PLATE = Design(24e-3, 10e-3, 2e-3, 2, ALUMINIUM, None, float("nan"), float("nan"), 0, 3e-3)
BAND_HZ = (15e3, 60e3)
SMALL = 1e-5  # of an eigenvalue


@cache
def patched() -> PatchedPlate:
    reduction = ReductionSettings(Interface(4, 1), 200e3, HexSettings(2, 2e-3, 0, 0.2), 8e-3)
    model = PlateModel(PLATE, Reductions(Stack.of(PLATE.thickness_m, ALUMINIUM), None, reduction))
    boxes = np.array([[-9e-3, -3e-3, -2e-3, 2e-3], [3e-3, 9e-3, -2e-3, 2e-3]])
    patches = [bonded_patch(PIEZO_MATERIALS["pz26"], box, 0.5e-3, True) for box in boxes]
    return PatchedPlate({symmetry: model.assembled(symmetry) for symmetry in CLASSES}, patches, True)


def peak(plate: ForcedPlate, tone: float) -> tuple[float, tuple[float, float]]:
    """A peak and its half-power points on a grid so fine that a change of 1e-5 is seen."""
    width = tone * plate.loss_at(tone)
    even = np.linspace(tone - 2.0 * width, tone + 2.0 * width, 20001)
    level = plate.curve(even).zone_rms_m_per_v
    at = int(np.argmax(level))
    ends = half_power_points(even, level, at)
    assert ends is not None
    top = np.polyfit(even[at - 40 : at + 41] - even[at], level[at - 40 : at + 41], 2)
    return float(even[at] - top[1] / (2.0 * top[0])), ends


def quality(plate: ForcedPlate, tone: float) -> float:
    top, (low, high) = peak(plate, tone)
    return top / (high - low)


@pytest.mark.slow
@pytest.mark.parametrize("circuit", ["short", "open"])
def test_rates_are_those_of_the_factor_read_again(circuit: str) -> None:
    plate = ForcedPlate(patched(), PLATE, Drive((0,), (1,), BAND_HZ, QUALITY, circuit))
    top, ends = peak(plate, highest_hz(plate, *BAND_HZ, 401))
    rates = width_rates(plate, top, ends)
    assert sum(len(basis.eigenvalue) for basis in plate.modes) >= 4
    for basis in plate.modes:
        values = basis.eigenvalue
        for mode, value in enumerate(values):
            step = SMALL * value
            single = [Variation(basis, (mode,), (value + sign * step,)) for sign in (-1.0, 1.0)]
            compare(plate, top, single, rates.change(single[1]))
        for pair in ((0, 1), (0, len(values) - 1)):
            if pair[0] == pair[1] or pair[1] >= len(values):
                continue
            step = SMALL * float(np.sqrt(values[list(pair)].prod()))
            mixed = [coupled(basis, pair, sign * step) for sign in (-1.0, 1.0)]
            compare(plate, top, mixed, rates.change(mixed[1]))


def coupled(basis: GroupModes, pair: tuple[int, int], step: float) -> Variation:
    values = basis.eigenvalue[list(pair)]
    new, turn = np.linalg.eigh(np.array([[values[0], step], [step, values[1]]]))
    return Variation(basis, pair, tuple(new.tolist()), turn * np.sign(np.diag(turn)))


def compare(plate: ForcedPlate, top: float, both: list[Variation], change: float) -> None:
    low, high = (np.log(quality(each.of(plate), top)) for each in both)
    assert change == pytest.approx((high - low) / 2.0, rel=0.03, abs=1e-4 * SMALL * QUALITY)
