"""Bodies for a printer or a CAD system, written as STL, 3MF and STEP, and the checks before they are printed."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape, quoteattr
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

from geometry.cad.solids import Body, CadSurface, cad_surface
from geometry.errors import GeometryError
from geometry.files import silence_kernel, written_whole
from geometry.layout import Design, region_materials

# -- files -------------------------------------------------------------------------------------------------------------
# A body for a printer or a CAD system: binary STL, 3MF and STEP in millimetres, plate down (z = 0 on the build plate).
# Each file appears whole or not at all.

NO_TIME = "1970-01-01T00:00:00"  # of a STEP file: its content does not depend on when it was written

DEFLECTION_MM = 0.01  # a tenth of what a powder-bed machine holds
ANGLE = 0.2  # rad between facets of a curve
XML = '<?xml version="1.0" encoding="UTF-8"?>\n'
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"
CONTENT_TYPES = (
    f'{XML}<Types xmlns="{PACKAGE}/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>'
)
RELATIONS = (
    f'{XML}<Relationships xmlns="{PACKAGE}/relationships"><Relationship Target="/3D/3dmodel.model" Id="rel0" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)
METADATA = {"Title", "Designer", "Description", "Copyright", "LicenseTerms", "Rating", "CreationDate"}
METADATA |= {"ModificationDate", "Application"}
COLOURS = ("#B0B0B0", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#F0E442", "#56B4E9", "#E69F00")
FIXED_DATE = (1980, 1, 1, 0, 0, 0)  # the same body gives the same bytes


def write_stl(body: Body, path: str | os.PathLike[str], name: str = "body") -> None:
    """Write a body as binary STL; the format has no unit, so the header says mm.

    Parameters
    ----------
    body : Body
        Body of one material.
    path : str or Path
        File to write.
    name : str, optional
        Name in the header.

    Raises
    ------
    GeometryError
        For a bonded body.
    """
    import trimesh

    surface = _printable(body)
    stl: Any = trimesh.Trimesh(surface.points, surface.triangles, process=False).export(file_type="stl")
    header = f"antinode {name} units=mm z=up".encode("ascii", "replace")[:80].ljust(80)
    with written_whole(path) as temporary:
        temporary.write_bytes(header + stl[80:])


def write_3mf(
    body: Body, path: str | os.PathLike[str], metadata: Mapping[str, str], materials: Mapping[str, str] | None = None
) -> None:
    """Write a body as a 3MF core model in mm; of a bonded body each material is an object, all of them one assembly.

    Parameters
    ----------
    body : Body
        Body of one or several materials.
    path : str or Path
        File to write.
    metadata : mapping of str
        Texts by name: Title, Description, ... of the core specification.
    materials : mapping of str, optional
        Names of the materials by region of a bonded body; the regions by default.

    Raises
    ------
    GeometryError
        For a metadata name that the specification does not have.

    References
    ----------
    .. [1] 3mf2018 (docs/references.bib)
    """
    unknown = sorted(set(metadata) - METADATA)
    if unknown:
        raise GeometryError(f"3MF metadata '{unknown[0]}' is not one of {', '.join(sorted(METADATA))}")
    parts = {
        "[Content_Types].xml": CONTENT_TYPES,
        "_rels/.rels": RELATIONS,
        "3D/3dmodel.model": _model(_surfaces(body, materials or {}), metadata),
    }
    with written_whole(path) as temporary, ZipFile(temporary, "w") as package:
        for name, text in parts.items():
            entry = ZipInfo(name, FIXED_DATE)
            entry.compress_type = ZIP_DEFLATED
            package.writestr(entry, text)


def write_step(
    body: Body, path: str | os.PathLike[str], name: str = "body", materials: Mapping[str, str] | None = None
) -> None:
    """Write a body as STEP AP214 in mm; of a bonded body each material is a named part of one assembly.

    Parameters
    ----------
    body : Body
        Body to write.
    path : str or Path
        File to write.
    name : str, optional
        Name of the product.
    materials : mapping of str, optional
        Names of the materials by region of a bonded body; the regions by default.

    Raises
    ------
    GeometryError
        If the CAD kernel cannot write the body.
    """
    from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.Interface import Interface_Static
    from OCP.STEPCAFControl import STEPCAFControl_Writer
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer
    from OCP.TCollection import TCollection_HAsciiString

    silence_kernel()
    for key in ("xstep.cascade.unit", "write.step.unit"):
        Interface_Static.SetCVal_s(key, "MM")
    writer = STEPControl_Writer()
    Interface_Static.SetCVal_s("write.step.product.name", name)  # known to the kernel once there is a writer
    if body.bonded:
        named = STEPCAFControl_Writer()
        done = named.Transfer(_assembly(body, name, materials or {}), STEPControl_AsIs)
        writer = named.ChangeWriter()
    else:
        done = writer.Transfer(body.shape.wrapped, STEPControl_AsIs) == IFSelect_RetDone
    APIHeaderSection_MakeHeader(writer.Model()).SetTimeStamp(TCollection_HAsciiString(NO_TIME))  # same bytes each time
    with written_whole(path) as temporary:
        if not done or writer.Write(str(temporary)) != IFSelect_RetDone:
            raise GeometryError(f"{Path(path)}: the CAD kernel could not write STEP")


def _printable(body: Body) -> CadSurface:
    if body.bonded:
        raise GeometryError("STL holds one solid of one material: write 3MF or STEP, which hold several")
    return cad_surface(body.shape, DEFLECTION_MM, ANGLE)


def _by_material(body: Body, materials: Mapping[str, str]) -> dict[str, Any]:
    """Solids of each material as one shape, by its name, in the order of the regions."""
    import cadquery as cq

    solids: dict[str, list[Any]] = {}
    for region, solid in body.solids():
        solids.setdefault(materials.get(region, region), []).append(solid)
    return {name: cq.Compound.makeCompound(each) for name, each in solids.items()}


def _surfaces(body: Body, materials: Mapping[str, str]) -> dict[str, CadSurface]:
    """Surface of each material by its name; of a body of one material "body"."""
    if not body.bonded:
        return {"body": _printable(body)}
    return {name: cad_surface(shape, DEFLECTION_MM, ANGLE) for name, shape in _by_material(body, materials).items()}


def _assembly(body: Body, name: str, materials: Mapping[str, str]) -> Any:
    """CAD document of the materials as named parts."""
    import cadquery as cq
    from cadquery.occ_impl.assembly import toCAF

    whole = cq.Assembly(name=name)
    for material, shape in _by_material(body, materials).items():
        whole.add(shape, name=material)
    return toCAF(whole, True)[1]


def _model(surfaces: Mapping[str, CadSurface], metadata: Mapping[str, str]) -> str:
    """Objects of a 3MF model; several of them are the components of one that is built."""
    notes = "".join(f"<metadata name={quoteattr(k)}>{escape(v)}</metadata>" for k, v in metadata.items())
    if len(surfaces) == 1:
        (only,) = surfaces.values()
        objects, last = f'<object id="1" type="model">{_mesh(only)}</object>', 1
    else:
        names = "".join(
            f'<base name={quoteattr(name)} displaycolor="{COLOURS[place % len(COLOURS)]}"/>'
            for place, name in enumerate(surfaces)
        )
        parts = "".join(
            f'<object id="{number}" type="model" name={quoteattr(name)} pid="1" pindex="{number - 2}">{_mesh(surface)}</object>'
            for number, (name, surface) in enumerate(surfaces.items(), start=2)
        )
        last = len(surfaces) + 2
        whole = "".join(f'<component objectid="{number}"/>' for number in range(2, last))
        objects = f'<basematerials id="1">{names}</basematerials>{parts}'
        objects += f'<object id="{last}" type="model"><components>{whole}</components></object>'
    return (
        f'{XML}<model unit="millimeter" xml:lang="en-US" xmlns="{CORE}">{notes}<resources>{objects}'
        f'</resources><build><item objectid="{last}"/></build></model>'
    )


def _mesh(surface: CadSurface) -> str:
    vertices = "".join(f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in surface.points.tolist())
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in surface.triangles.tolist())
    return f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"


# -- checks ------------------------------------------------------------------------------------------------------------
# Checks before printing: whether the STL is one closed body, its smallest feature, its steepest underside.
# trimesh reads the file back, since it shares no code with the CAD kernel that wrote it.

MM = 1e3
VOLUME_TOLERANCE = 1e-3
SUPPORT_DEG = 45.0  # undersides flatter than this from the vertical need supports in a metal powder bed
ON_BUILD_PLATE = 1e-6  # of the height


@dataclass(frozen=True)
class PrintReport:
    """Measurements of an STL or 3MF file printed with z up, in SI units.

    Attributes
    ----------
    watertight : bool
        Whether the surface is closed and consistently oriented.
    bodies : int
        Number of separate bodies.
    solids : int
        Number of solids of the CAD body; of several materials each part counts.
    volume_m3, cad_volume_m3 : float
        Volumes of the file and of the CAD solid, in m^3.
    features : dict of float
        Lengths in m by name that must be printed.
    overhang_deg : float
        Largest angle of a downward face from the vertical: 0 without one, 90 for a ceiling.
    overhang_area_m2 : float
        Area of downward faces beyond 45 degrees, without those on the build plate.
    extent_m : tuple of float
        Sides of the bounding box.
    mass_kg : float
        Mass of the volume in the materials of its parts.
    """

    watertight: bool
    bodies: int
    solids: int
    volume_m3: float
    cad_volume_m3: float
    features: dict[str, float]
    overhang_deg: float
    overhang_area_m2: float
    extent_m: tuple[float, float, float]
    mass_kg: float

    @property
    def volume_error(self) -> float:
        """Relative difference of the file's volume from the CAD solid's."""
        return self.volume_m3 / self.cad_volume_m3 - 1.0

    @property
    def smallest_feature(self) -> tuple[str, float]:
        """Name and length (m) of the smallest feature."""
        name = min(self.features, key=self.features.__getitem__)
        return name, self.features[name]

    @property
    def faults(self) -> list[str]:
        """Reasons not to print the file; empty if there are none."""
        violations = []
        if not self.watertight:
            violations.append("the surface is not closed")
        if self.bodies != self.solids:
            violations.append(f"{self.bodies} separate bodies, must be {self.solids}")
        if not abs(self.volume_error) <= VOLUME_TOLERANCE:
            violations.append(
                f"volume is {self.volume_error:+.2%} off the CAD solid's, allowed is {VOLUME_TOLERANCE:.1%}"
            )
        return violations


def check_print(path: str | os.PathLike[str], body: Body, design: Design) -> PrintReport:
    """Read an STL or 3MF file back and compare it with its CAD body.

    Parameters
    ----------
    path : str or Path
        File in mm, z up; 3MF where several materials are bonded.
    body : Body
        CAD body from which the file was written.
    design : Design
        Design of the body, for its features and its density.

    Returns
    -------
    PrintReport
        Measurements in SI units.

    Raises
    ------
    GeometryError
        If the file cannot be read or has no triangle.
    """
    import trimesh

    kind = "3mf" if body.bonded else "stl"
    try:
        parts = list(trimesh.load_scene(Path(path), file_type=kind).geometry.values())
    except Exception as fault:  # trimesh raises whatever its readers meet
        raise GeometryError(f"{Path(path)}: not a readable {kind.upper()} file") from fault
    if not any(len(mesh.faces) for mesh in parts):
        raise GeometryError(f"{Path(path)}: holds no triangle")
    triangles = np.concatenate([mesh.triangles for mesh in parts])
    angle, area = overhang(triangles)
    x, y, z = (float(side) / MM for side in np.ptp(triangles.reshape(-1, 3), axis=0))
    volume = sum(float(mesh.volume) for mesh in parts) / MM**3
    return PrintReport(
        watertight=all(mesh.is_watertight and mesh.is_winding_consistent for mesh in parts),
        bodies=sum(int(mesh.body_count) for mesh in parts),
        solids=len(body.solids()) if body.bonded else 1,
        volume_m3=volume,
        cad_volume_m3=body.volume_m3,
        features=features(design),
        overhang_deg=angle,
        overhang_area_m2=area / MM**2,
        extent_m=(x, y, z),
        mass_kg=volume * _density_kg_m3(body, design),
    )


def _density_kg_m3(body: Body, design: Design) -> float:
    """Mean density of a body, by the volumes of its parts."""
    known = region_materials(design.stack, design.pillar)
    if not body.bonded:
        return design.stack.material.density_kg_m3
    volumes = [(known[region].density_kg_m3, float(solid.Volume())) for region, solid in body.solids()]
    return sum(density * volume for density, volume in volumes) / sum(volume for _, volume in volumes)


def features(design: Design) -> dict[str, float]:
    """List the lengths that a printer must resolve.

    They are the thickness, the sizes of the pillar's shape, the fillet, and the clear widths between pillars. Of a
    pillar from STEP, only foot, tip and height are known.

    Parameters
    ----------
    design : Design
        The plate as built.

    Returns
    -------
    dict of float
        Lengths in m by name; of rows that differ, the smallest.
    """
    widths = {"plate thickness": design.thickness_m}
    pillar = design.pillar
    if pillar is None or not design.rows:
        return widths
    for each in design.kinds:
        widths |= {name: min(size, widths.get(name, size)) for name, size in each.features.items()}
    if pillar.fillet_m > 0.0:
        widths["foot fillet"] = pillar.fillet_m
    reach = np.array([each.reach_m for each in design.row_pillars])
    if len(design.column_centres()) > 1:
        widths["gap between pillars along x"] = design.pitch_x_m - float(reach[:, 0].max())
    if design.surround:
        widths["gap between pillars along y"] = design.pitch_y_m - float(reach[:, 1].max())
    elif design.rows > 1:
        between = design.row_pitches_m[1:] / 2.0 + design.row_pitches_m[:-1] / 2.0
        widths["gap between pillars along y"] = float((between - (reach[1:, 1] + reach[:-1, 1]) / 2.0).min())
    return widths


def overhang(triangles: np.ndarray) -> tuple[float, float]:
    """Measure the overhang of downward triangles.

    Triangles on the lowest plane rest on the build plate and do not count.

    Parameters
    ----------
    triangles : ndarray, shape (n, 3, 3)
        Corners of outward triangles, z up.

    Returns
    -------
    angle : float
        Largest angle from the vertical in degrees: 0 without a downward triangle, 90 for a ceiling.
    area : float
        Area of downward triangles beyond 45 degrees, in the square of the triangles' unit.
    """
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(normals, axis=1) / 2.0
    heights = triangles[:, :, 2]
    floor = heights.min() + ON_BUILD_PLATE * np.ptp(heights)
    counted = (heights.max(axis=1) > floor) & (areas > 0.0)
    if not counted.any():
        return 0.0, 0.0
    down = -normals[counted, 2] / (2.0 * areas[counted])
    angles = np.degrees(np.arcsin(np.clip(down, 0.0, 1.0)))
    return float(angles.max()), float(areas[counted][angles > SUPPORT_DEG].sum())
