"""Bars of what is read from a response: a peak's quality factor, the curves; what resonances within their bars make of them."""

from __future__ import annotations

from copy import copy
from functools import cache

import numpy as np
import pytest

from geometry.elements import FloatArray
from geometry.hex.scenes import HexSettings
from geometry.layout import Design
from geometry.materials import MATERIALS, PIEZO_MATERIALS, Stack
from pipeline.models import forced as driven_plate
from pipeline.models.forced import AROUND_PEAK, DECAYED, curve_errors, quality_error
from solvers.driven.curve_bars import Doubts
from solvers.driven.error_bars import Variation, bases
from solvers.piezo.forced import Curve, Drive, ForcedPlate
from solvers.piezo.patch import bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate
from solvers.piezo.responses import Peak, curve_about, highest_hz, near_hz, peak_of
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings

ALUMINIUM = MATERIALS["aluminium"]
QUALITY = 60.0  # low enough that neighbours matter
PLATE = Design(24e-3, 10e-3, 2e-3, 2, ALUMINIUM, None, float("nan"), float("nan"), 0, 3e-3)
BAND_HZ = (10e3, 30e3)


@cache
def forced() -> ForcedPlate:
    reduction = ReductionSettings(Interface(4, 1), 200e3, HexSettings(2, 2e-3, 0, 0.2), 8e-3)
    model = PlateModel(PLATE, Reductions(Stack.of(PLATE.thickness_m, ALUMINIUM), None, reduction))
    patch = bonded_patch(PIEZO_MATERIALS["pz26"], np.array((-9e-3, -3e-3, -2e-3, 2e-3)), 0.5e-3, True)
    patched = PatchedPlate({symmetry: model.assembled(symmetry) for symmetry in CLASSES}, [patch], True)
    return ForcedPlate(patched, PLATE, Drive((0,), (), BAND_HZ, QUALITY))


def peak_near(plate: ForcedPlate, tone: float) -> Peak:
    top = near_hz(plate, tone)
    reach = DECAYED * top * plate.loss_at(top)
    return peak_of(curve_about(plate, top - reach, top + reach, AROUND_PEAK, [top]), top)


def known(monkeypatch: pytest.MonkeyPatch, error: float) -> None:
    """All resonances are known to a relative error, loads exactly, and no modes mix."""
    monkeypatch.setattr(
        driven_plate, "frequency_errors", lambda of: [np.full(len(b.frequency_hz), error) for b in bases(of)]
    )
    monkeypatch.setattr(driven_plate, "height_error", lambda of, hz: 0.0)
    monkeypatch.setattr(driven_plate.calibration, "mixing", lambda: 0.0)


@pytest.mark.slow
def test_the_bar_grows_with_those_of_the_resonances_and_covers_each_that_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    plate = forced()
    peak = peak_near(plate, highest_hz(plate, *BAND_HZ, 401))
    bars = []
    for error in (0.0, 0.005, 0.01):
        known(monkeypatch, error)
        bar = quality_error(plate, peak)
        assert bar is not None
        bars.append(bar)
    assert bars[0] == pytest.approx(0.0, abs=1e-2 * QUALITY) and bars[0] < bars[1] < bars[2]
    for basis in bases(plate):
        for mode, value in enumerate(basis.eigenvalue):
            for end in (0.99, 1.01):
                moved = Variation(basis, (mode,), (value * end**2,)).of(plate)
                is_own = abs(basis.frequency_hz[mode] - peak.frequency_hz) < 0.5 * peak.frequency_hz / QUALITY
                read = peak_near(moved, peak.frequency_hz * (end if is_own else 1.0)).quality_factor
                assert (
                    read is not None and peak.quality_factor is not None and abs(read - peak.quality_factor) <= bars[2]
                )


def test_an_unknown_resonance_leaves_the_bar_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    plate = forced()
    peak = peak_near(plate, highest_hz(plate, *BAND_HZ, 401))
    known(monkeypatch, 0.01)
    assert quality_error(plate, Peak(peak.frequency_hz, peak.zone_rms, peak.passive_rms, None)) is None
    monkeypatch.setattr(driven_plate, "height_error", lambda of, hz: None)
    assert quality_error(plate, peak) is None
    known(monkeypatch, float("nan"))
    assert quality_error(plate, peak) is None


def doubts_of(plate: ForcedPlate, frequency: float, load: float) -> Doubts:
    """Every mode's frequency and every driver's load off by as much, relative."""
    value = np.concatenate([basis.eigenvalue for basis in plate.modes])
    gain = np.concatenate([basis.gain[:, plate.drivers] for basis in plate.modes])
    group = np.repeat(np.arange(len(plate.modes)), [len(basis.eigenvalue) for basis in plate.modes])
    ends = value[:, None] * ((1.0 + frequency * np.array([-1.0, 1.0])) ** 2 - 1.0)
    errors = np.full(len(value), frequency)
    return Doubts(value, ends, errors, load * np.abs(gain), np.full(gain.shape[1], load), group, 0.0, 0.0)


def test_the_curves_bars_cover_each_resonance_that_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    """Anywhere within its bar, of a percent here; one of them moves a curve by more than half of its bar."""
    plate = forced()
    monkeypatch.setattr(driven_plate, "doubts", lambda *_: doubts_of(plate, 0.01, 0.0))
    curve = plate.curve(np.linspace(*BAND_HZ, 41))
    bars, used = curve_errors(plate, curve), 0.0
    assert bars is not None and bars.shape == (2, 41)
    for basis in plate.modes:
        for mode, value in enumerate(basis.eigenvalue):
            for end in (0.99, 0.997, 1.004, 1.01):
                moved = Variation(basis, (mode,), (value * end**2,)).of(plate).curve(curve.frequency_hz)
                off = np.abs(np.array([moved.zone_rms_m_per_v, moved.passive_rms_m_per_v]) - rms_of(curve))
                assert (off <= bars * (1.0 + 1e-9)).all()
                used = max(used, float((off / bars).max()))
    assert used > 0.5


def test_louder_patches_raise_the_curves_by_as_much(monkeypatch: pytest.MonkeyPatch) -> None:
    """The residual's loads among them: a curve is linear in them."""
    plate = forced()
    monkeypatch.setattr(driven_plate, "doubts", lambda *_: doubts_of(plate, 0.0, 0.02))
    curve = plate.curve(np.linspace(*BAND_HZ, 5))
    bars = curve_errors(plate, curve)
    assert bars is not None and (bars >= 0.02 * rms_of(curve) * (1.0 - 1e-9)).all()


def test_curves_without_an_estimate_have_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one part of the plate, or where a charge feeds the drivers: what that makes of a load is not known."""
    plate, charged = forced(), copy(forced())
    charged.circuit = "open"
    curve = plate.curve(np.array([20e3]))
    monkeypatch.setattr(driven_plate, "doubts", lambda *_: doubts_of(plate, 0.01, 0.0))
    assert curve_errors(plate, curve) is not None and curve_errors(charged, curve) is None
    monkeypatch.setattr(driven_plate, "doubts", lambda *_: None)
    assert curve_errors(plate, curve) is None


def rms_of(curve: Curve) -> FloatArray:
    """Of zone and passive face, (2, n)."""
    return np.array([curve.zone_rms_m_per_v, curve.passive_rms_m_per_v])
