"""Quality factors from the loss of the materials: derivatives of frequencies, direct solves, and one loss for all."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geometry.hex.boxes import hex_mesh, part_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar, region_materials
from geometry.materials import MATERIALS, PIEZO_MATERIALS, Layer, Material
from geometry.tiling import lattice_panel
from pipeline.case.model import Case, case_from_dict, load_case
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.modes import PartModes, Request, solve_modes
from solvers.accuracy.reduction import by_modes
from solvers.errors import SolverError
from solvers.fem.eigen import modes_near
from solvers.fem.solid import SolidModel
from solvers.measures.confinement import TouchField
from solvers.measures.loss import SHARES, loss_factors, of_discarded, quality_and_bar
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patch import StaticCorrection, bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate, PressedPlate
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import Periodic
from solvers.superelement.plate import loss_of
from solvers.waves.complex_bands import Row
from tests.helpers.asked import bands_of

LOG = TerminalLog(quiet=True)
GLASS, EPOXY, LEAD = (MATERIALS[name] for name in ("glass", "epoxy", "lead"))
LAYERS = (Layer(GLASS, 1e-3), Layer(EPOXY, 0.4e-3), Layer(MATERIALS["aluminium"], 0.8e-3))
PILLAR = Pillar("square", 2e-3, 2e-3, 3e-3, LEAD)
DESIGN = Design(16e-3, 8e-3, 2.2e-3, 2, LAYERS[-1].material, PILLAR, 4e-3, 4e-3, 1, 2e-3, layers=LAYERS)
HEXAHEDRA = HexSettings(3, 3e-3, 0, 0.25, 2e-3)
STEP = 1e-3  # of a modulus: the second order of a central difference is below 1e-6 of its first


def stiffer(material: Material, factor: float) -> Material:
    return replace(material.scaled(factor), name=f"{material.name} {factor}")


def lossless(material: Material) -> Material:
    return replace(material, loss_factor=0.0)


@cache
def solid(materials: tuple[tuple[str, Material], ...]) -> SolidModel:
    mesh = hex_mesh(part_boxes(DESIGN, "plate", HEXAHEDRA, True), 3)
    return SolidModel(mesh, dict(materials), (), True)


def given() -> dict[str, Material]:
    return region_materials(DESIGN.stack, PILLAR)


@pytest.mark.slow
def test_the_loss_of_a_mode_is_the_sum_of_the_derivatives_of_its_frequency():
    """1/Q = sum of loss factors times d ln f^2 / d ln E: by frequencies alone, none of them computed with a loss."""
    model = solid(tuple(given().items()))
    modes = modes_near(model.pencil("SS"), 40e3, 4)
    factor, _ = loss_factors(model.scale.eigenvalue(modes.frequency_hz), model.lost("SS", modes.vectors))

    expected = np.zeros(len(factor))
    regions = sorted(region for region in given() if region in model.mesh.regions)
    for region in regions:
        ends = []
        for end in (1.0 + STEP, 1.0 - STEP):
            other = given() | {region: stiffer(given()[region], end)}
            near = SolidModel(model.mesh, other, (), True)
            ends.append(np.log(modes_near(near.pencil("SS"), 40e3, 4).frequency_hz))
        expected += given()[region].lost * (ends[0] - ends[1]) / STEP

    assert len(regions) == 4
    assert factor == pytest.approx(expected, rel=1e-5)
    assert factor.max() > 1.1 * factor.min()  # the modes differ


def test_the_loss_between_modes_completes_the_complex_eigenvalue():
    random = np.random.default_rng(3)
    own = np.array([1.0, 1.02, 1.5])
    half = random.normal(size=(3, 3))
    loss = 0.01 * half @ half.T
    factor, change = loss_factors(own, loss)
    exact = np.linalg.eigvals(np.diag(own) + 1j * loss)
    assert np.sort(factor + change) == pytest.approx(np.sort(exact.imag / exact.real), rel=1e-12)
    assert np.abs(change).max() > 1e-3 * factor.max()
    assert not loss_factors(own, np.diag(0.01 * own))[1].any()


def reduced(design: Design, lossy: bool = True) -> PlateModel:
    reduction = ReductionSettings(Interface(6, 3), 300e3, HEXAHEDRA, 4e-3)
    return PlateModel(design, Reductions(design.stack, design.pillar, reduction, lossy=lossy))


@pytest.mark.slow
def test_a_reduced_plate_loses_what_its_solid_does():
    """The same mesh: the shares of energy differ by the truncation, which the frequencies show."""
    whole, model = solid(tuple(given().items())), reduced(DESIGN)
    tones, factors = [], []
    for each in (whole, model):
        modes = modes_near(each.pencil("SS"), 40e3, 8)
        tones.append(modes.frequency_hz)
        factors.append(loss_factors(each.scale.eigenvalue(modes.frequency_hz), each.lost("SS", modes.vectors))[0])
    truncated = 2.0 * np.abs(tones[1] / tones[0] - 1.0)
    most = max(material.lost for material in DESIGN.materials)
    assert (np.abs(factors[1] / factors[0] - 1.0) < SHARES * truncated * (1.0 + np.sqrt(most / factors[0]))).all()


@pytest.mark.slow
def test_discarded_modes_change_no_more_of_a_loss_than_their_bound():
    """A reduction without modes above 70 kHz against the ample one, of the same mesh and boundary functions."""
    found, (most, least) = [], (pick(each.lost for each in DESIGN.materials) for pick in (max, min))
    for top_hz in (70e3, 300e3):
        reductions = Reductions(
            DESIGN.stack, DESIGN.pillar, ReductionSettings(Interface(6, 3), top_hz, HEXAHEDRA, 4e-3), lossy=True
        )
        model = PlateModel(DESIGN, reductions)
        modes = modes_near(model.pencil("SS"), 40e3, 8)
        value = model.scale.eigenvalue(modes.frequency_hz)
        found.append((loss_factors(value, model.lost("SS", modes.vectors))[0], value, modes.vectors, model))
    (factor, value, vectors, model), (ample, *_) = found
    bound = of_discarded(most, least, 2.0 * by_modes(model.assembled("SS"), value, vectors), factor)
    moved = np.abs(factor - ample)
    assert moved.max() > 1e-3 * ample.max()  # they do count
    assert (moved <= bound).all()


@pytest.mark.parametrize("off", [0.01, 0.3, 0.49, 0.51, 3.0])
def test_the_bar_of_a_quality_factor_holds_both_ends_of_its_loss(off: float):
    """1/(eta - d) lies farther from 1/eta than 1/(eta + d); a bar half as wide as the loss or wider says nothing."""
    factor = 0.02
    quality, half = quality_and_bar(factor, 0.5, 0.0, off * factor)
    assert quality == pytest.approx(1.0 / factor)
    if off > 0.5:
        assert half is None
    else:
        assert half == pytest.approx(1.0 / (factor * (1.0 - off)) - quality)


@pytest.mark.slow
def test_the_response_is_that_of_complex_moduli():
    """(K + i H - w^2 M) u = f solved at once; what the modes about the band leave out is of second order in the loss."""
    plate = PressedPlate({symmetry: reduced(DESIGN).assembled(symmetry) for symmetry in CLASSES}, DESIGN, "plate")
    (group,) = plate.groups
    band_hz = (30e3, 60e3)
    forced = ForcedPlate(plate, DESIGN, Drive((0,), (), band_hz, None))
    loss = group.plates[0].of_cells(loss_of)
    tones = np.concatenate([tone * (1.0 + np.array([-0.5, 0.0, 0.5]) * forced.loss_at(tone)) for tone in peaks(forced)])
    found = forced.curve(tones).zone_rms_m_per_v
    for tone, ours in zip(tones, found, strict=True):
        matrix = group.pencil.stiffness + 1j * loss - plate.scale.eigenvalue(tone) * group.pencil.mass
        moved = spla.splu(sp.csc_array(matrix)).solve(group.loads.astype(complex))
        (field,) = group.touch(np.column_stack([moved.real, moved.imag]))
        assert ours == pytest.approx(rms_of(field), rel=(2.0 * EPOXY.lost) ** 2)


def peaks(forced: ForcedPlate) -> np.ndarray:
    low, high = forced.band_hz
    return np.array([tone for tone in forced.resonances_hz if low < tone < high])


def rms_of(field: TouchField) -> float:
    active = field.is_active(DESIGN)
    square = (field.values[active] ** 2).sum(axis=1) @ field.weights[active]
    return float(np.sqrt(square / field.weights[active].sum()))


@pytest.mark.slow
def test_one_loss_for_plate_and_patches_is_one_quality_factor():
    """With patches, and with what yields beneath them. A number damps the modes alone, the materials all that moves."""
    alike = replace(MATERIALS["aluminium"], loss_factor=1.0 / 80.0)
    design = Design(24e-3, 10e-3, 2e-3, 2, alike, None, float("nan"), float("nan"), 0, 3e-3)
    ceramic = replace(PIEZO_MATERIALS["pz26"], loss_factor=1.0 / 80.0)
    model = reduced(design)
    box = np.array([-4e-3, 4e-3, -2e-3, 2e-3])
    patch = bonded_patch(ceramic, box, 0.5e-3, True, HexSettings(2, 4e-3, 1, 0.15))
    plates = {symmetry: model.assembled(symmetry) for symmetry in CLASSES}
    plate = PatchedPlate(plates, [patch], True, beneath=StaticCorrection(model.reductions), at_hz=30e3)
    by_materials, by_number = (
        ForcedPlate(plate, design, Drive((0,), (), (10e3, 60e3), quality)) for quality in (None, 80.0)
    )
    assert by_materials.losses == pytest.approx(1.0 / 80.0, rel=1e-9)
    tones = np.linspace(15e3, 50e3, 7)
    ours, theirs = (each.curve(tones).zone_rms_m_per_v for each in (by_materials, by_number))
    assert ours == pytest.approx(theirs, rel=1.0 / 80.0)


def test_a_patch_that_loses_more_damps_its_plate():
    still = lossless(MATERIALS["aluminium"])
    design = Design(24e-3, 10e-3, 2e-3, 2, still, None, float("nan"), float("nan"), 0, 3e-3)
    model = reduced(design)
    box = np.array([-4e-3, 4e-3, -2e-3, 2e-3])
    losses = []
    for factor in (0.01, 0.02):
        patch = bonded_patch(
            replace(PIEZO_MATERIALS["pz26"], loss_factor=factor), box, 0.5e-3, True, HexSettings(2, 4e-3, 1, 0.15)
        )
        plate = PatchedPlate({symmetry: model.assembled(symmetry) for symmetry in CLASSES}, [patch], True)
        losses.append(ForcedPlate(plate, design, Drive((0,), (), (10e3, 60e3), None)).losses)
    assert (losses[0] > 0.0).all()
    assert (losses[0] < 0.01).all()
    assert losses[1] == pytest.approx(2.0 * losses[0], rel=1e-9)


@pytest.mark.slow
def test_a_plate_reduced_without_loss_says_so():
    with pytest.raises(SolverError, match="without the loss"):
        reduced(DESIGN, lossy=False).lost("SS", np.zeros((1, 1)))


def row(design: Design, lossy: bool) -> Row:
    reduction = ReductionSettings(
        Interface(4, 3, design.stack.joints), 200e3, HexSettings(2, 2e-3, 0, 0.25, 2e-3), 4e-3
    )
    cell = Reductions(design.stack, design.pillar, reduction, lossy=lossy).cell(lattice_panel(design))
    return Row(Periodic([cell]), 200.0)


def wavenumbers(one: Row, frequency_hz: float) -> np.ndarray:
    found = one.waves(frequency_hz).wavenumber_per_m
    return np.asarray(found[np.abs(found.imag) < 0.1 * np.abs(found.real)])


@pytest.mark.slow
def test_waves_decay_by_the_derivatives_of_their_wavenumbers():
    """Im k = -sum of loss factors times dk / d ln E at one frequency, from rows without any loss."""
    tone, expected = 12e3, np.zeros(1)
    lossy, still = (wavenumbers(row(DESIGN, each), tone) for each in (True, False))
    for material in DESIGN.materials:
        ends = []
        for end in (1.0 + STEP, 1.0 - STEP):
            known = {material: stiffer(material, end)}
            layers = tuple(Layer(known.get(layer.material, layer.material), layer.thickness_m) for layer in LAYERS)
            pillar = replace(PILLAR, material=known.get(LEAD, LEAD))
            ends.append(wavenumbers(row(replace(DESIGN, layers=layers, pillar=pillar), False), tone).real)
        expected = expected - material.lost * (ends[0] - ends[1]) / (2.0 * STEP)
    assert len(lossy) == len(still) == 1  # one flexural wave
    assert (lossy.imag > 0.0).all()
    assert lossy.imag == pytest.approx(expected, rel=1e-2)  # of second order in the loss
    assert lossy.real == pytest.approx(still.real, rel=1e-3)


def test_a_row_without_loss_has_the_waves_it_had():
    """Mirrored rows need D_tb = D_bt^H no more; without loss it holds."""
    alike = tuple(Layer(lossless(layer.material), layer.thickness_m) for layer in LAYERS)
    still = replace(DESIGN, layers=alike, pillar=replace(PILLAR, material=lossless(LEAD)))
    ours, theirs = (row(still, lossy).waves(30e3).wavenumber_per_m[:6] for lossy in (True, False))
    turns = np.exp(1j * DESIGN.pitch_y_m * ours), np.exp(1j * DESIGN.pitch_y_m * theirs)
    assert turns[0] == pytest.approx(turns[1], rel=1e-6)  # at the edge of the zone both signs are one wave


def case(**more: object) -> Case:
    raw = {
        "name": "lossy",
        "material": "lead",
        "plate": {
            "layer": [{"material": layer.material.name, "thickness_mm": 1e3 * layer.thickness_m} for layer in LAYERS]
        },
        "zone": {"length_mm": 16.0, "width_mm": 8.0, "nodal_lines": 2},
        "pillar": {"side_mm": 2.0, "height_mm": 3.0},
        "array": {"pitch_mm": 4.0, "rows": 1, "extension_mm": 2.0},
        "damping": {"quality": "materials"},
    }
    return case_from_dict(raw, None, list(more.items()))


def qualities(own: Case, part: str = "plate") -> PartModes:
    return solve_modes(own, Request(part, band_hz=(30e3, 60e3), symmetry="SS" if part == "plate" else None), LOG)


@pytest.mark.slow
@pytest.mark.parametrize("change", [{"solve.model": "solid"}, {"solve.mesh": "tet"}], ids=["solid", "tetrahedra"])
def test_quality_factors_agree_within_their_bars(change: dict[str, object]):
    ours, other = qualities(case()), qualities(case(**change))
    assert len(ours.rows) == len(other.rows) > 1
    for one, two in zip(ours.rows, other.rows, strict=True):
        assert one.quality_factor and two.quality_factor and one.quality_error and two.quality_error
        assert abs(one.quality_factor - two.quality_factor) <= one.quality_error + two.quality_error
        assert one.quality_error < 0.2 * one.quality_factor


def test_one_material_has_one_quality_factor_without_doubt():
    own = load_case("examples/small.toml", ["damping.quality=materials", "solve.accuracy=0.05"])
    target = solve_modes(own, Request("pillar", count=2), LOG).rows
    assert [row.quality_factor for row in target] == pytest.approx([1.0 / MATERIALS["aluminium"].lost] * 2, rel=1e-9)
    assert [row.quality_error for row in target] == [0.0, 0.0]


def test_a_number_leaves_the_loss_of_the_materials_out():
    own = load_case("examples/small.toml", ["solve.accuracy=0.05"])
    assert {row.quality_factor for row in solve_modes(own, Request("pillar", count=2), LOG).rows} == {None}


def test_a_material_that_states_no_loss_is_named():
    with pytest.raises(InputError, match=r"material AlSi7Mg0\.6 has no loss_factor"):
        load_case("examples/small.toml", ["damping.quality=materials", "material=AlSi7Mg0.6"])


def test_commands_for_one_quality_factor_refuse_the_materials():
    own = load_case("studies/three-rows.toml", ["damping.quality=materials"])
    with pytest.raises(InputError, match=r'damping\.quality = "materials": must be a number: broadband'):
        own.one_quality_factor("broadband")


def banded(plate: float, pillar: float, *more: str) -> Case:
    """A cell of two materials of other moduli, in GPa, with the fewest elements of its accuracy."""
    tables = ((plate, 0.01), (pillar, 0.3))
    stuff = [{"young_GPa": e, "poisson": 0.3, "density_kg_m3": 2000.0, "loss_factor": loss} for e, loss in tables]
    raw = {
        "name": "cell",
        "material": stuff[0],
        "plate": {"thickness_mm": 2.0},
        "pillar": {"side_mm": 2.0, "height_mm": 3.0, "material": stuff[1]},
        "array": {"pitch_mm": 5.0, "rows": 1},
        "bands": {"points": 1, "count": 6},
        "damping": {"quality": "materials"},
        "solve": {"accuracy": 0.05},
    }
    return case_from_dict(raw, None, more)


@pytest.mark.slow
def test_the_loss_of_a_wave_is_the_sum_of_the_derivatives_of_its_frequency() -> None:
    """1/Q = sum of loss factors times d ln f^2 / d ln E, of bands that are simple at a corner of the path."""
    bands = bands_of(banded(10.0, 3.0), LOG)
    expected = np.zeros((4, 6))
    for plate, pillar, loss in ((1.0, 0.0, 0.01), (0.0, 1.0, 0.3)):
        ends = []
        for sign in (1.0, -1.0):
            own = banded(10.0 * (1.0 + sign * STEP * plate), 3.0 * (1.0 + sign * STEP * pillar))
            ends.append(np.array([point.computed_hz for point in bands_of(own, LOG).points]))
        expected += loss * np.log(np.where(ends[0] > 0.0, ends[0], 1.0) / np.where(ends[1] > 0.0, ends[1], 1.0)) / STEP
    for point, factors in zip(bands.points, expected, strict=True):
        assert point.quality_factor is not None and point.quality_error is not None
        for quality, bar, factor in zip(point.quality_factor, point.quality_error, factors, strict=True):
            if quality is not None:
                assert bar is not None and abs(quality - 1.0 / factor) <= bar
                if bar < 0.02 * quality:
                    assert 1.0 / quality == pytest.approx(factor, rel=0.01)


@pytest.mark.slow
def test_waves_of_one_loss_have_its_quality_factor() -> None:
    bands = bands_of(banded(10.0, 3.0, "material.loss_factor=0.02", "pillar.material.loss_factor=0.02"), LOG)
    known = [quality for point in bands.points for quality in point.quality_factor or () if quality is not None]
    assert len(known) == 4 * 6 - 2 * 3 and known == pytest.approx([50.0] * len(known))
