"""A case's plate with its patches bonded and its modes solved: what the response and the mode table's gains start from."""

from __future__ import annotations

from geometry.tiling import Tiling, tile
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.models import parts
from pipeline.models.cell_cache import ArrayCache, MatrixCache
from pipeline.planning import driven_demand, foresight, mesh_rules, simplifications
from pipeline.planning.model_choice import ModelChoice, driven_band_hz, model_choice_of, response_high_hz
from pipeline.planning.resources import Demand
from pipeline.quantity import frequency
from pipeline.records.record import MeshRecord
from pipeline.units import MM
from solvers.piezo.beneath import Beneath, patch_mesh, pillars_beneath
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patch import BondedPatch, bonded_patch
from solvers.piezo.patched_plate import PatchedPlate, coupled_classes
from solvers.plates.assembled import PlateModel
from solvers.threads import one_thread

FOLLOWS = 0.2  # of its own lowest resonance: below it motion inside a patch adds at most 4 % to what follows statically


@one_thread()
def forced_plate(
    case: Case, log: Log, band_hz: tuple[float, float] | None = None, meshes: list[MeshRecord] | None = None,
    is_announced: bool = False, choice: ModelChoice | None = None,
) -> ForcedPlate:  # fmt: skip
    """Bond the patches and prepare the forced response over a band (default: the case's); meshes are added to
    `meshes`. is_announced: the plate is one of several, whose demand was told as a whole; choice: that of a plan, announced.

    InputError for a model that cannot carry patches; raises what its solvers raise.
    """
    band = driven_band_hz(case, band_hz)
    refuse_patches(case, band)
    if not is_announced and choice is None:
        foresight.announce("the forced response", _demand(case, band), log)
    if choice is None:
        choice = driven_demand.as_driven(case, model_choice_of(case, "plate", response_high_hz(case, band)))
        simplifications.log_all(choice.left_out, log)
    if choice.reduction is None:
        raise InputError(f"{case.name}: solve.model: patches are bonded to plates cells, must be auto or superelement")
    model = parts.built(case, choice, log, [] if meshes is None else meshes)
    assert isinstance(model, PlateModel)
    return driven(case, model, band, log)


@one_thread()
def driven(case: Case, model: PlateModel, band_hz: tuple[float, float], log: Log) -> ForcedPlate:
    """Build an assembled plate with the case's patches and solve its modes about the band."""
    patches = case.patches
    assert patches is not None
    with log.step("bond the patches"):
        bonded = _bonded(case, model.tiling)
        # patches that couple all classes would be dense in every pair of them, in the whole plate on their panels alone
        symmetries = model.symmetries if len(coupled_classes(bonded)) > 1 else (None,)
        plates = {plate.symmetry: plate for plate in map(model.assembled, symmetries)}
        middle_hz = (band_hz[0] + band_hz[1]) / 2.0
        beneath = Beneath(model.reductions, MatrixCache())
        plate = PatchedPlate(plates, bonded, patches.face == "back", model.name, beneath, middle_hz)
    if plate.undriven:
        log.left_out("symmetry classes " + ", ".join(plate.undriven), "the patches do not drive them")
    with log.step("modes of the patched plate"):
        drive = Drive(patches.drivers, patches.sensors, band_hz, case.quality_factor, patches.circuit)
        choice = model_choice_of(case, "plate", response_high_hz(case, band_hz))
        bytes_each = driven_demand.group_bytes(case, choice, _demand(case, band_hz).modes or 0.0)
        return ForcedPlate(plate, case.design, drive, bytes_each=bytes_each, wanted_window_hz=_search_window_hz(case))


def _search_window_hz(case: Case) -> tuple[float, float] | None:
    """Where the wanted mode is searched first; None for several zones, which share no mode."""
    return mesh_rules.search_window_hz(case.design) if case.design.zones == 1 else None


def refuse_patches(case: Case, band_hz: tuple[float, float]) -> None:
    """InputError for patches that no assembled plate can carry in this band, before anything of the plate is computed."""
    tiling = tile(case.design, case.design.length_m)
    _refuse_over_pillars(case, tiling)
    _refuse_ringing(case, min(patch.own_hz for patch in _bonded(case, tiling)), band_hz[1])


def _bonded(case: Case, tiling: Tiling) -> list[BondedPatch]:
    """The case's patches; those of one size are one, and kept."""
    patches = case.patches
    assert patches is not None
    material, thickness, back = patches.material, patches.size_m[2], patches.face == "back"
    return [
        bonded_patch(material, box, thickness, back, patch_mesh(case.design, tiling, box), ArrayCache())
        for box in patches.boxes_m()
    ]


def _refuse_over_pillars(case: Case, tiling: Tiling) -> None:
    """InputError where a patch shares a face with a pillar whose panel it reaches over: that face is not kept there."""
    patches = case.patches
    assert patches is not None
    if patches.face == "touch" and not any(pillar.faces == 2 for pillar in case.design.kinds):
        return
    for number, box in enumerate(patches.boxes_m()):
        for _, j in pillars_beneath(tiling, box):
            low, high = (end / MM for end in tiling.y[j : j + 2])
            y0, y1 = (end / MM for end in box[2:])
            raise InputError(
                f"{case.source or case.name}: patches: patch {number} reaches from y = {y0:g} to {y1:g} mm: must stay clear of "
                f"the strip from {low:g} to {high:g} mm, where pillars stand on its face"
            )


def _refuse_ringing(case: Case, own_hz: float, high_hz: float) -> None:
    """InputError where a patch would ring by itself on the plate, which it follows statically."""
    if high_hz > FOLLOWS * own_hz:
        assert case.patches is not None
        size = " x ".join(f"{each / MM:g}" for each in case.patches.size_m)
        raise InputError(
            f"{case.source or case.name}: patches.size_mm: a patch of {size} mm rings by itself at {frequency(own_hz)}: the "
            f"band must end below a fifth of that, {frequency(FOLLOWS * own_hz)}, or the patch be flatter"
        )


def _demand(case: Case, band_hz: tuple[float, float]) -> Demand:
    """What the response over a band is foreseen to take."""
    choice = model_choice_of(case, "plate", response_high_hz(case, band_hz))
    return driven_demand.of_response(case, choice, band_hz, 0)
