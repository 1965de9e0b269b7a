"""Moduli that depend on the frequency: frequencies against solutions with the moduli that belong to them."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import Material
from geometry.spectra import Zener
from geometry.tiling import lattice_panel
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.modes import Request, solve_modes
from pipeline.questions.attenuation import Attenuation
from pipeline.questions.predesign import Predesign
from pipeline.questions.question import Run, ask
from pipeline.questions.response import Response
from pipeline.questions.touch import Touch
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patched_plate import CLASSES, PressedPlate
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import Periodic
from solvers.superelement.moduli import Moduli
from solvers.superelement.plate import part_of
from solvers.waves.complex_bands import Row
from tests.helpers.asked import bands_of
from tests.helpers.exploring import SMALL
from tests.helpers.recording_log import RecordingLog

LOG = TerminalLog(True)
ROWS = [[1e3, 2.0, 0.02], [1e4, 2.6, 0.05], [1e5, 4.0, 0.08]]
RESIN = {"young_GPa_at": ROWS, "poisson": 0.38, "density_kg_m3": 1180.0}
ZENER = {
    "zener": {"relaxed_GPa": 1.8, "unrelaxed_GPa": 4.5, "time_s": 1e-5, "order": 0.4},
    "poisson": 0.38,
    "density_kg_m3": 1180.0,
}
METAL = {"young_GPa": 70.0, "poisson": 0.34, "density_kg_m3": 2700.0}


def young(tone: float) -> float:
    """Of the rows, in GPa: log E is linear in log f."""
    tones, moduli, _ = np.array(ROWS).T
    return float(np.exp(np.interp(np.log(tone), np.log(tones), np.log(moduli))))


def case(plate: dict[str, Any], pillar: dict[str, Any], *more: Any) -> Case:
    raw = tomllib.loads(SMALL.read_text("utf-8"))
    raw |= {"material": plate, "pillar": raw["pillar"] | {"material": pillar}}
    return case_from_dict(raw, None, ["solve.accuracy=0.1", "bands.points=1", "bands.count=5", *more])


def fixed(tone: float) -> dict[str, float]:
    return {"young_GPa": young(tone), "poisson": 0.38, "density_kg_m3": 1180.0}


def test_a_modulus_between_two_rows_is_a_power_of_the_frequency() -> None:
    own = Material.of_table("resin", RESIN).at_hz(np.sqrt(1e3 * 1e4))
    assert own.as_isotropic.young_pa == pytest.approx(1e9 * np.sqrt(2.0 * 2.6)) and own.lost == pytest.approx(0.035)
    assert own.at_hz(1.0).as_isotropic.young_pa == pytest.approx(2e9)
    assert own.at(60.0).at_hz(1e5).as_isotropic.young_pa == pytest.approx(own.at_hz(1e5).as_isotropic.young_pa)


@pytest.mark.parametrize("order", [1.0, 0.3])
def test_a_fractional_zener_law_loses_most_where_and_what_its_closed_form_says(order: float) -> None:
    """Pritz: w tau = c^(-1/2a), eta = (c - 1) sin(a pi/2) / (2 sqrt(c) + (c + 1) cos(a pi/2)), c = E_inf/E_0."""
    own, c = Zener(2e9, 8e9, 1e-5, order), 4.0
    peak = c ** (-0.5 / order) / (2.0 * np.pi * own.time_s)
    most = (c - 1.0) * np.sin(order * np.pi / 2.0) / (2.0 * np.sqrt(c) + (c + 1.0) * np.cos(order * np.pi / 2.0))
    assert own.at(peak)[1] == pytest.approx(most, rel=1e-12)
    assert max(own.at(0.9 * peak)[1], own.at(1.1 * peak)[1]) < most
    slow, quick = own.at(1e-40)[0], own.at(1e45)[0]
    assert (slow, quick) == pytest.approx((2e9, 8e9), rel=1e-9) and own.ends_hz == (0.0, np.inf)


def test_zeners_own_law_is_a_spring_beside_a_spring_and_a_dashpot() -> None:
    """E_0 + i w m E_1 / (E_1 + i w m), with E_1 = E_inf - E_0 and tau = m / E_1."""
    low, more, viscosity, w = 2e9, 6e9, 5e4, 2.0 * np.pi * 3e4
    exact = low + 1j * w * viscosity * more / (more + 1j * w * viscosity)
    found, loss = Zener(low, low + more, viscosity / more, 1.0).at(3e4)
    assert (found, loss) == pytest.approx((exact.real, exact.imag / exact.real), rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("law", [RESIN, ZENER], ids=["rows", "zener"])
def test_each_mode_of_one_material_has_the_modulus_of_its_own_frequency(law: dict[str, Any]) -> None:
    found = solve_modes(case(law, law), Request("pillar", near_hz=0.0, count=4), LOG)
    assert len(found.rows) >= 4
    for number, row in enumerate(found.rows):
        own = Material.of_table("own", law).at_hz(row.frequency_hz).as_isotropic.young_pa / 1e9
        alone = case(*2 * (METAL | {"young_GPa": own, "poisson": 0.38, "density_kg_m3": 1180.0},))
        again = solve_modes(alone, Request("pillar", near_hz=0.0, count=4), LOG).rows[number]
        assert row.frequency_hz == pytest.approx(again.frequency_hz, rel=1e-7)
        assert "moduli" not in row.error_parts or row.error_parts["moduli"] < 1e-12


@pytest.mark.slow
def test_the_target_mode_of_two_materials_has_the_moduli_of_its_own_frequency_and_others_lie_within_their_bars() -> (
    None
):
    found = solve_modes(case(METAL, RESIN), Request("plate", band_hz=(20e3, 36e3)), LOG)
    row = found.target_row or found.rows[len(found.rows) // 2]
    for own in {row, found.rows[0], found.rows[-1]}:
        again = solve_modes(case(METAL, fixed(own.frequency_hz)), Request("plate", band_hz=(19e3, 37e3)), LOG)
        nearest = min((each.frequency_hz for each in again.rows), key=lambda hz: abs(hz / own.frequency_hz - 1.0))
        assert own.frequency_hz == pytest.approx(nearest, rel=1e-6 if own is row else own.error_parts["moduli"] + 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("plate", [RESIN, METAL], ids=["alike", "two"])
def test_each_wave_has_the_moduli_of_its_own_frequency(plate: dict[str, Any]) -> None:
    bands = bands_of(case(plate, RESIN), LOG)
    for place, band in ((1, 0), (1, 3), (2, 4)):
        tone = bands.points[place].frequencies_hz[band]
        again = bands_of(case(fixed(tone) if plate is RESIN else METAL, fixed(tone)), LOG)
        open_by = 1e-7 if plate is RESIN else bands.points[place].error[band]
        assert open_by is not None and abs(again.points[place].frequencies_hz[band] / tone - 1.0) <= open_by


def rising(plate: float, pillar: float) -> Design:
    """A plate with a pillar whose moduli rise as these powers of the frequency, from 30 kHz."""
    tones = np.geomspace(1e3, 1e6, 31).tolist()
    made = [
        Material.of_table(
            name,
            {"density_kg_m3": density, "poisson": 0.35}
            | {"young_GPa_at": [[tone, young * (tone / 30e3) ** power, loss * tone / 30e3] for tone in tones]},
        )
        for name, young, density, power, loss in (("a", 70.0, 2700.0, plate, 1e-3), ("b", 3.0, 1200.0, pillar, 5e-3))
    ]
    standing = Pillar("square", 2e-3, 2e-3, 3e-3, made[1])
    return Design(16e-3, 8e-3, 1.2e-3, 2, made[0], standing, 4e-3, 4e-3, 1, 2e-3)


def at_hz(design: Design, tone: float) -> Design:
    """The same with the moduli at a frequency."""
    assert design.pillar
    standing = replace(design.pillar, material=design.pillar.material.at_hz(tone))
    return replace(design, material=design.material.at_hz(tone), pillar=standing)


def row(design: Design, top_hz: float, lossy: bool, parted: bool) -> Row:
    reduction = ReductionSettings(Interface(5, 3), top_hz, HexSettings(3, 3e-3, 0, 0.25, 2e-3), 4e-3)
    reductions = Reductions(design.stack, design.pillar, reduction, lossy=lossy, parted=parted)
    moduli = Moduli(reductions.materials, lossy) if parted else None
    return Row(Periodic([reductions.cell(lattice_panel(design))]), 150.0, moduli)


@pytest.mark.parametrize("lossy", [False, True])
def test_a_row_whose_moduli_change_alike_has_those_of_each_frequency(lossy: bool) -> None:
    """The basis is the same, so that the waves are those of a row reduced with the moduli at the frequency, to rounding."""
    design = rising(0.1, 0.1)
    ours = row(at_hz(design, 30e3), 250e3, lossy, parted=True)
    for tone in (22e3, 36e3):
        theirs = row(at_hz(design, tone), 250e3 * (tone / 30e3) ** 0.05, lossy, parted=False)
        expected = theirs.waves(tone).factor[:6]
        assert ours.waves(tone).factor[:6] == pytest.approx(expected, rel=1e-9)
        assert not lossy or (np.abs(expected) < 1.0 - 1e-4).all()


def test_a_row_of_two_materials_misses_no_more_of_other_moduli_than_its_basis_may() -> None:
    design = rising(0.0, 0.3)
    ours = row(at_hz(design, 30e3), 250e3, lossy=False, parted=True)
    for tone in (20e3, 26e3, 36e3):
        theirs = row(at_hz(design, tone), 250e3, lossy=False, parted=False)
        missed = ours.moduli.missed(tone) if ours.moduli else 0.0
        exact, further = (theirs.waves(each).wavenumber_per_m[0].real for each in (tone, tone * (1.0 - missed / 2.0)))
        assert abs(ours.waves(tone).wavenumber_per_m[0].real - exact) <= exact - further
        assert missed < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("plate", "band_khz"), [(RESIN, (14.0, 18.0)), (METAL, (30.0, 34.0))], ids=["alike", "two"])
def test_attenuation_has_the_moduli_of_each_frequency(plate: dict[str, Any], band_khz: tuple[float, float]) -> None:
    """Against solutions with constant moduli: equal where all change alike, else within both error bars."""
    log = RecordingLog()
    found = ask(case(plate, RESIN), Attenuation(band_kHz=band_khz, points=2), Run(log))
    assert not any("MODULI" in text for text in log.warnings)
    again = Attenuation(band_kHz=band_khz, points=2, kx_per_m=found.kx_per_m)
    for number, point in enumerate(found.points):
        own = fixed(point.frequency_hz)
        alone = ask(case(own if plate is RESIN else METAL, own), again, Run(LOG)).points[number]
        assert point.taken_db is not None and point.taken_error_db and alone.taken_error_db
        bar = 1e-9 if plate is RESIN else point.taken_error_db + alone.taken_error_db
        assert abs(point.taken_db - alone.taken_db) <= bar < 0.01 * point.taken_db
        assert point.waves[0].ky_re_per_m == pytest.approx(
            alone.waves[0].ky_re_per_m, rel=1e-9 if plate is RESIN else 1e-3
        )


@pytest.mark.slow
@pytest.mark.parametrize(("quality", "powers"), [(None, (0.1, 0.3)), (80.0, (0.1, 0.3)), (80.0, (0.1, 0.1))])
def test_the_response_has_the_moduli_and_losses_of_each_frequency(
    quality: float | None, powers: tuple[float, float]
) -> None:
    """K with the moduli of each frequency, solved at once: modes and residual vectors of 45 kHz miss what their bars say.

    A quality factor damps the modes alone: the residual vectors differ by 1/Q from one loss for all.
    """
    design = at_hz(rising(*powers), 45e3)
    reduction = ReductionSettings(Interface(5, 3), 250e3, HexSettings(3, 3e-3, 0, 0.25, 2e-3), 4e-3)
    model = PlateModel(design, Reductions(design.stack, design.pillar, reduction, lossy=quality is None, parted=True))
    plate = PressedPlate({symmetry: model.assembled(symmetry) for symmetry in CLASSES}, design, "plate")
    moduli = Moduli(model.reductions.materials, quality is None)
    forced = ForcedPlate(plate, design, Drive((0,), (), (30e3, 60e3), quality, moduli=moduli))
    (group,), (basis,) = plate.groups, forced.modes
    (whole,), scale = group.plates, plate.scale
    parts = [whole.of_cells(partial(part_of, number)) for number in range(2)]
    assert basis.parted is not None and len(basis.frequency_hz) > 1
    inside = [pair for pair in zip(basis.frequency_hz, basis.loss, strict=True) if 30e3 < pair[0] < 60e3]
    assert inside
    for tone, loss in inside:
        factors = moduli.factors(tone)
        eta = 0.0 if quality is None else 1.0 / quality
        stiffness = (1.0 + 1j * eta) * sum(factor * part for factor, part in zip(factors, parts, strict=True))
        missed = float(basis.parted.missed(np.array([tone]))[0])
        near = spla.eigs(
            sp.csc_array(stiffness),
            1,
            sp.csc_array(group.pencil.mass),
            scale.eigenvalue(tone),
            return_eigenvectors=False,
        )[0]
        assert tone == pytest.approx(float(scale.frequency(np.array(near.real))), rel=missed + 1e-9)
        most = max(material.at_hz(tone).lost for material in moduli.materials) if quality is None else 0.0
        assert loss == pytest.approx(near.imag / near.real, rel=2.0 * np.sqrt(missed * most / loss) + 1e-3)
        for end in (-0.5, 0.5):
            at = tone * (1.0 + end * loss)
            factors = moduli.factors(at)
            stiffness = (1.0 + 1j * eta) * sum(factor * part for factor, part in zip(factors, parts, strict=True))
            moved = spla.splu(sp.csc_array(stiffness - scale.eigenvalue(at) * group.pencil.mass)).solve(
                group.loads.astype(complex)
            )
            (field,) = group.touch(np.column_stack([moved.real, moved.imag]))
            active = field.is_active(design)
            square = (field.values[active] ** 2).sum(axis=1) @ field.weights[active]
            expected = float(np.sqrt(square / field.weights[active].sum()))
            ours = float(forced.curve(np.array([at])).zone_rms_m_per_v[0])
            second = eta or (2.0 * most) ** 2
            assert ours == pytest.approx(expected, rel=second + 2.0 * missed / loss + np.sqrt(2.0 * missed))


STEEP = {"young_GPa_at": [[1e3, 0.8, 0.01], [1e5, 4.0, 0.05]], "poisson": 0.38, "density_kg_m3": 1180.0}


def driven(pillar: dict[str, Any]) -> Case:
    """A patched plate of metal with a finger on it."""
    raw = tomllib.loads(SMALL.read_text("utf-8"))
    finger = {"stiffness_N_per_m": 2e4, "damping_Ns_per_m": 0.3, "mass_g": 0.01}
    raw |= {
        "material": METAL,
        "pillar": raw["pillar"] | {"material": pillar},
        "patches": {"material": "pz26", "size_mm": [8.0, 3.0, 0.3], "centres_mm": [[0.0, 0.0]]},
        "touch": {"at_mm": [1.0, 1.0], "radius_mm": 2.0, "impedance": finger},
    }
    return case_from_dict(raw, None, ["solve.accuracy=0.1"])


@pytest.mark.slow
def test_a_driven_and_touched_plate_has_the_moduli_of_its_frequency() -> None:
    """Against plates with the modulus of the peak, and of the mode under the finger: within both error bars."""
    response, touch = Response(band_kHz=(28.0, 42.0), points=5), Touch(band_kHz=(28.0, 42.0), mapped=False)

    def constant(tone: float) -> Case:
        own = Material.of_table("resin", STEEP).at_hz(tone)
        young = own.as_isotropic.young_pa / 1e9
        return driven({"young_GPa": young, "poisson": 0.38, "density_kg_m3": 1180.0})

    run = Run(RecordingLog())
    peak = ask(driven(STEEP), response, run).peak
    other = ask(constant(peak.frequency_hz), response, Run(LOG)).peak
    assert not any("MODULI" in text for text in run.warnings)
    for name, bar in (("zone_nm_per_V", "zone_error_nm_per_V"), ("confinement_db", "confinement_error_db")):
        assert abs(getattr(peak, name) - getattr(other, name)) <= getattr(peak, bar) + getattr(other, bar)
    assert peak.frequency_hz == pytest.approx(other.frequency_hz, rel=1e-5)

    mode = ask(driven(STEEP), touch, Run(LOG)).mode
    assert mode is not None
    again = ask(constant(mode.frequency_hz), touch, Run(LOG)).mode
    assert again is not None and mode.shift_error_hz and again.shift_error_hz
    assert abs(mode.shift_hz - again.shift_hz) <= mode.shift_error_hz + again.shift_error_hz
    assert abs(mode.added_loss - again.added_loss) <= (mode.added_loss_error or 0.0) + (again.added_loss_error or 0.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"young_GPa_at": ROWS[::-1]}, "must be rows in order of rising frequency"),
        ({"loss_factor": 0.1}, "must be left out: young_GPa_at has its own over the frequency"),
        ({"young_GPa": 9.0}, "must lie within young_GPa_at, 2 to 4, or be left out"),
        ({"young_GPa_at": ROWS[:1]}, "young_GPa_at"),
        ({"cubic_GPa": {"C11": 3.0, "C12": 1.0, "C44": 1.0}}, "cannot be combined with young_GPa"),
        ({"zener": ZENER["zener"]}, "zener = .* cannot be combined with young_GPa_at: one law only"),
        ({"zener": {**ZENER["zener"], "relaxed_GPa": 5.0}, "young_GPa_at": None}, "must be relaxed_GPa = 5 or more"),
        ({"zener": {**ZENER["zener"], "order": 1.5}, "young_GPa_at": None}, "must be a table .*, order from 0.01 to 1"),
        ({"zener": ZENER["zener"], "young_GPa": 5.0, "young_GPa_at": None}, "must lie within zener, 1.8 to 4.5"),
    ],
)
def test_rows_that_no_material_can_have_are_named(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        case(METAL, {key: value for key, value in (RESIN | change).items() if value is not None})


@pytest.mark.slow
def test_frequencies_beyond_the_rows_are_named() -> None:
    short = RESIN | {"young_GPa_at": ROWS[:2]}
    log = RecordingLog()
    found = solve_modes(case(short, short), Request("pillar", near_hz=0.0, count=4), log)
    assert found.rows[-1].frequency_hz > 1e4
    assert any("young_GPa_at holds from" in text for text in log.warnings.values())


def test_other_questions_say_at_which_frequency_they_take_the_moduli() -> None:
    run = Run(LOG)
    ask(case(METAL, RESIN), Predesign(), run)
    assert any("MODULI: given: its moduli are those at 10000 Hz" in text for text in run.warnings)
    run = Run(LOG)
    ask(case(METAL, RESIN, "solve.moduli_kHz=30"), Predesign(), run)
    assert not any("MODULI" in text for text in run.warnings)
