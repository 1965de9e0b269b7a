"""Open against short circuit: the patches' solids beside the published unimorph and beside exact laminated beams.

A patch's e31, its stiffness and its capacitance all stand in the shift; the sign of e31 in the force of a volt.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geometry.hex.boxes import Boxes, hex_mesh
from geometry.hex.scenes import HexSettings
from geometry.layout import Design
from geometry.materials import MATERIALS, PIEZO_MATERIALS, Material, PiezoMaterial, Stack
from solvers.control.identification import half_power_quality_factor
from solvers.fem.assembly import assemble
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patch import _mesh, bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate
from solvers.piezo.responses import circuit_shift, open_modes
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from studies.independent import bonded_solid, lifted
from tests.helpers.piezo_beam import (
    Section,
    cantilever_hz,
    elastic_layer,
    free_even_hz,
    gain_per_volt,
    laminate,
    piezo_layer,
)
from tests.helpers.unimorph import CERAMIC, CERAMIC_M, D31, LENGTH_M, METAL_M, STEEL_LIKE, published

ALUMINIUM, PZT = MATERIALS["aluminium"], PIEZO_MATERIALS["pzt-5h"]
NARROW_M, ELEMENT_M = 2e-3, 5e-3  # of the cantilever: with Poisson's ratio 0 its width does not matter
FREE = Design(60e-3, 5e-3, 0.5e-3, 2, ALUMINIUM, None, float("nan"), float("nan"), 0, 0.0)
THICK_M = 0.2e-3
PATCH_MESH = HexSettings(2, 5e-3, 1, 0.15)  # a fifteenth of a wavelength, shorter at the ends


def cantilever(material: PiezoMaterial) -> tuple[float, float]:
    """First frequency in Hz, short and open, of metal and ceramic as solids that share their nodes, all of one end held."""
    box = np.array([0.0, LENGTH_M, 0.0, NARROW_M])
    above = _mesh(box, CERAMIC_M, HexSettings(2, ELEMENT_M, 0), True)
    x, y = (np.unique(np.round(above.nodes[:, axis], 12))[::2] for axis in (0, 1))
    region = np.zeros((len(x) - 1, len(y) - 1, 1), dtype=np.int64)
    below = hex_mesh(Boxes(x, y, np.array([0.0, METAL_M]), region, ("metal",)), 2)
    system = assemble(below, {"metal": STEEL_LIKE})
    joined = bonded_solid(system, lifted(above, below), material, CERAMIC_M)
    k, m, load = joined.stiffness.toarray(), joined.mass.toarray(), joined.load
    kept = np.repeat(joined.place_nm[:, 0] > 0, 3)
    result = []
    for opened in (0.0, 1.0):
        whole = k + opened * np.outer(load, load) / joined.capacitance_f
        pencil = [sp.csc_array(matrix[kept][:, kept]) for matrix in (whole, m)]
        value = spla.eigsh(pencil[0], 2, pencil[1], sigma=0.0, return_eigenvectors=False)
        result.append(np.sqrt(np.sort(value)) / (2.0 * np.pi))
    bends = 0 if result[0][0] > 30.0 else 1  # narrower than high it first sways sideways
    return float(result[0][bends]), float(result[1][bends])


def test_the_published_cantilever_as_solids() -> None:
    """Printed 47.8 Hz; shear and rotation take (beta r)^2 (1 + E/kG)/2 = 5e-5 of it, elements of 5 mm less."""
    short, opened = cantilever(CERAMIC)
    exact = published(stretch=True)
    assert short == pytest.approx(47.8, abs=0.06)
    assert short == pytest.approx(cantilever_hz(exact, LENGTH_M, 1, False), rel=5e-4)
    assert opened == pytest.approx(cantilever_hz(exact, LENGTH_M, 1, True), rel=5e-4)
    shift = cantilever_hz(exact, LENGTH_M, 1, True) - cantilever_hz(exact, LENGTH_M, 1, False)
    assert opened - short == pytest.approx(shift, rel=0.01)


@dataclass(frozen=True)
class Pair:
    """Metal and ceramic, and how far solids may be from the laminate in what a volt does.

    Across a real ceramic's strip stresses balance over the width except within a thickness of its edges, 0.7 mm of 5 on
    either side; where nothing happens across the strip, the ends alone remain, 0.7 mm of 60.
    """

    metal: Material
    ceramic: PiezoMaterial
    apart: float


UNIAXIAL, REAL = Pair(STEEL_LIKE, CERAMIC, 0.01), Pair(ALUMINIUM, PZT, 0.05)
PAIRS = pytest.mark.parametrize(
    "pair", [UNIAXIAL, pytest.param(REAL, marks=pytest.mark.slow)], ids=["uniaxial", "real"]
)


def section(pair: Pair) -> Section:
    bond = FREE.thickness_m
    layers = [elastic_layer(pair.metal, 0.0, bond), piezo_layer(pair.ceramic, bond, bond + THICK_M)]
    return laminate(layers, FREE.width_m, uneven=True)


@cache
def joined(metal: Material) -> dict:
    reduction = ReductionSettings(Interface(5, 2), 200e3, HexSettings(3, 5e-3, 0, 0.2), 5e-3)
    design = replace(FREE, material=metal)
    model = PlateModel(design, Reductions(Stack.of(FREE.thickness_m, metal), None, reduction))
    return {symmetry: model.assembled(symmetry) for symmetry in CLASSES}


@cache
def covered(pair: Pair, back: bool = True, circuit: str = "short") -> ForcedPlate:
    """A free strip with one patch over a whole face."""
    box = np.array([-FREE.length_m / 2, FREE.length_m / 2, -FREE.width_m / 2, FREE.width_m / 2])
    plate = PatchedPlate(joined(pair.metal), [bonded_patch(pair.ceramic, box, THICK_M, back, PATCH_MESH)], back)
    hz = free_even_hz(section(pair), FREE.length_m, 1, False)
    return ForcedPlate(plate, FREE, Drive((0,), (), (0.8 * hz, 1.25 * hz), 500.0, circuit))


def first_even(forced: ForcedPlate) -> tuple[float, float, float]:
    """Frequency, gain per volt (N/(V sqrt(kg))) and the touch face's u_z at x = L/2 of the only driven mode."""
    result = max(forced.modes, key=lambda one: np.abs(one.gain).max(initial=0.0))
    index = int(np.abs(result.gain[:, 0]).argmax())
    field = result.group.touch(result.columns[:, [index]])[result.group.symmetries.index("SS")]
    end = field.values[np.argmax(field.points[:, 0]), 0]
    plate = forced.plate
    unit = plate.stiffness_unit / np.sqrt(plate.scale.mass_kg)
    return float(result.frequency_hz[index]), float(result.gain[index, 0] * unit), float(end)


def slender(number: int) -> float:
    """What shear and rotation take of a frequency: (beta r)^2 (1 + E/kG)/2, r^2 = h^2/12, E/kG = 2 (1 + nu) 6/5."""
    beta = (number + 0.5) * np.pi / FREE.length_m
    radius = (FREE.thickness_m + THICK_M) ** 2 / 12.0
    return float(beta**2 * radius * (1.0 + 2.4 * (1.0 + ALUMINIUM.as_isotropic.poisson)) / 2.0)


@pytest.mark.slow
@PAIRS
def test_a_free_strip_under_one_patch_has_the_laminates_frequency(pair: Pair) -> None:
    """Shear and rotation lower it; what a strip's width does to the real pair, (width/half-wave)^2 of nu^2, raises it."""
    exact = free_even_hz(section(pair), FREE.length_m, 1, False)
    result = first_even(covered(pair))[0]
    wide = pair.metal.as_isotropic.poisson**2 * (FREE.width_m * 1.5 * np.pi / FREE.length_m) ** 2 / 2.0
    assert -2.0 * slender(1) < result / exact - 1.0 < 0.5 * slender(1) + wide


@pytest.mark.slow
@PAIRS
@pytest.mark.parametrize("back", [True, False], ids=["back", "touch"])
def test_a_volt_pushes_it_as_far_and_the_same_way(pair: Pair, back: bool) -> None:
    """The field runs along z whichever face the patch is on: below the plate's axis the same stretch bends it back."""
    _, gain, end = first_even(covered(pair, back))
    exact = gain_per_volt(section(pair), FREE.length_m, 1)
    assert np.sign(gain * end) == np.sign(exact) * (1.0 if back else -1.0)
    assert abs(gain) == pytest.approx(abs(exact), rel=pair.apart)


@PAIRS
def test_open_it_is_stiffer_by_the_laminates_share(pair: Pair) -> None:
    exact = [free_even_hz(section(pair), FREE.length_m, 1, is_open) for is_open in (False, True)]
    shift = circuit_shift(covered(pair))
    assert shift is not None and shift.share > 0.99
    assert shift.coupling == pytest.approx(1.0 - (exact[0] / exact[1]) ** 2, rel=pair.apart)


@pytest.mark.slow
def test_the_space_of_modes_and_rests_holds_the_open_mode() -> None:
    """Against the whole pencil with theta theta'/C added to it."""
    forced = covered(REAL)
    result = next(one for one in forced.modes if "SS" in one.group.symmetries)
    pencil, plate = result.group.pencil, forced.plate
    load = result.group.loads
    whole = pencil.stiffness.toarray() + load @ load.T * plate.stiffness_unit / plate.capacitance_f[0]
    values = scipy.linalg.eigh(whole, pencil.mass.toarray(), eigvals_only=True)
    direct = plate.scale.frequency(values)
    hz = first_even(forced)[0]
    reference = direct[(direct > hz) & (direct < 1.2 * hz)]
    frequency, _ = open_modes(forced, [0])
    mine = frequency[(frequency > hz) & (frequency < 1.2 * hz)]
    assert mine == pytest.approx(reference, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("circuit", ["short", "open"])
def test_a_voltage_peaks_at_the_short_and_a_charge_at_the_open_frequency(circuit: str) -> None:
    forced = covered(REAL, circuit=circuit)
    shift = circuit_shift(forced)
    assert shift is not None
    hz = shift.short_hz if circuit == "short" else shift.open_hz
    tones = np.linspace(0.99 * hz, 1.01 * hz, 801)
    curve = forced.curve(tones).zone_rms_m_per_v
    peak = int(np.argmax(curve))
    assert tones[peak] == pytest.approx(hz, rel=1e-4)
    quality_factor = half_power_quality_factor(tones, curve, peak)
    assert quality_factor is not None
    lossless = 1.0 if circuit == "short" else 1.0 - shift.coupling  # what the voltage stiffens has no losses
    assert quality_factor == pytest.approx(500.0 / lossless, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "seen"),
    [({"d31": 0.95 * D31}, "size"), ({"s11": 1.1 * CERAMIC.s11}, "stiffness")],
    ids=["d31 a twentieth too small", "a patch a tenth too soft"],
)
def test_a_planted_fault_is_seen(fault: dict, seen: str) -> None:
    """Solids of a patch with a fault in it, against the laminate without: outside every tolerance above."""
    wrong = circuit_shift(covered(replace(UNIAXIAL, ceramic=replace(CERAMIC, **fault))))
    exact = [free_even_hz(section(UNIAXIAL), FREE.length_m, 1, is_open) for is_open in (False, True)]
    assert wrong is not None
    coupling = abs(wrong.coupling / (1.0 - (exact[0] / exact[1]) ** 2) - 1.0)
    frequency = abs(wrong.short_hz / exact[0] - 1.0)
    assert coupling > 5.0 * UNIAXIAL.apart if seen == "size" else frequency > 5.0 * slender(1)
