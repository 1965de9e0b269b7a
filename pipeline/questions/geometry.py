"""Print and CAD files of the plate, and the check of the print file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from geometry.layout import Design, region_materials
from pipeline.case.features import OF_A_PLATE
from pipeline.quantity import GRAM, MM, figure, percentage, several, signed
from pipeline.questions.late import Case, Plan
from pipeline.questions.question import Question, Run
from pipeline.questions.result import Result, figure_at
from pipeline.records.part import column

if TYPE_CHECKING:
    from pathlib import Path

    from pipeline.logs import Log


class GeometryResult(Result, axes=()):
    """Print and CAD files, and the check of the print file."""

    files: list[str] = column("written files", table=False)
    mass_kg: float = column("mass of the plate", "kg")
    volume_m3: float = column("volume of the print file", "m3")
    watertight: bool = column("whether the surface of the print file is closed")
    bodies: int = column("number of bodies in the print file")
    volume_error: float = column("volume of the print file's mesh relative to that of the solid, minus 1")
    smallest_feature_m: float = column("smallest printed feature", "m")
    smallest_feature: str = column("name of the smallest feature", default="")
    overhang_deg: float | None = column("steepest overhang", "degree", default=None)
    overhang: float | None = column("area of the overhangs", "m2", default=None)

    mass = figure_at("mass_kg", "mass", "kg", name="mass_kg")

    def lines(self) -> Iterator[str]:
        """Yield the check of the print file."""
        yield (
            f"print file: closed {self.watertight}, {self.bodies} {'body' if self.bodies == 1 else 'bodies'}, "
            f"volume {signed(percentage(self.volume_error))} of the solid's, mass {figure(self.mass_kg / GRAM)} g, "
            f"smallest feature {self.smallest_feature} {self.smallest_feature_m / MM:g} mm, "
            f"overhang {figure(self.overhang_deg or 0.0)} degrees"
        )


class Geometry(Question[GeometryResult], in_studies_only=True, honours=OF_A_PLATE):
    """Write print and CAD files of the plate and check the print file."""

    step = ("print and CAD files", "CAD solids; STL read back")

    def compute(self, case: Case, plan: Plan, run: Run) -> GeometryResult:
        """Write STL, STEP and 3MF into the case's folder and read the STL back; of several materials the 3MF, without STL."""
        from geometry.cad import printing, solids

        assert run.folder
        with run.step("build the solid"):
            body = solids.plate_solid(case.design)
        printed = "plate.3mf" if body.bonded else "plate_mm.stl"
        files = ("plate.step", "plate.3mf") if body.bonded else (printed, "plate.step", "plate.3mf")
        with run.step("write STEP, 3MF" if body.bonded else "write STL, STEP, 3MF"):
            if not body.bonded:
                printing.write_stl(body, run.folder / "plate_mm.stl", case.name)
            printing.write_step(body, run.folder / "plate.step", case.name, material_names(case.design))
            printing.write_3mf(body, run.folder / "plate.3mf", about(case), material_names(case.design))
        with run.step("check the print file"):
            return checked(case, body, run.folder / printed, run.log, files)


def checked(case: Case, body: Any, file: Path, log: Log, files: tuple[str, ...]) -> GeometryResult:
    """Check the print file of a solid, and log the findings and faults."""
    from geometry.cad.printing import check_print

    found = check_print(file, body, case.design)
    feature, size_m = found.smallest_feature
    result = GeometryResult.of(
        found, files=files, smallest_feature=feature, smallest_feature_m=size_m, overhang=found.overhang_area_m2
    )
    for line in result.lines():
        log.info(line)
    for fault in found.faults:
        log.warning("PRINT", fault)
    return result


def material_names(design: Design) -> dict[str, str]:
    """Return the name of the material of each region, with that of the region where materials share a name."""
    known = region_materials(design.stack, design.pillar)
    shared = Counter(material.name for material in dict.fromkeys(known.values()))
    return {
        region: material.name if shared[material.name] == 1 else f"{material.name} ({region})"
        for region, material in known.items()
    }


def about(case: Case) -> dict[str, str]:
    """Return the description stored in a 3MF file."""
    from pipeline.records.store import input_hash

    return {
        "Title": case.name,
        "Description": f"touch plate, {several(case.design.rows, 'row')} of pillars per side; "
        f"touch face down on the build plate; design {input_hash(case.to_dict())}",
        "Application": "antinode",
    }
