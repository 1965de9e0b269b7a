"""A body for a printer or a CAD system: binary STL, 3MF and STEP in millimetres, plate down (z = 0 on the build plate).

Each file appears whole or not at all.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

from geometry.cad.solids import Body
from geometry.cad.surface import CadSurface, cad_surface
from geometry.errors import GeometryError
from geometry.files import written_whole
from geometry.quiet import silence_kernel

NO_TIME = "1970-01-01T00:00:00"  # of a STEP file: its content does not depend on when it was written

DEFLECTION_MM = 0.01  # a tenth of what a powder-bed machine holds
ANGLE = 0.2  # rad between facets of a curve
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"
MODEL_TYPE = "application/vnd.ms-package.3dmanufacturing-3dmodel+xml"
RELATION_TYPE = "application/vnd.openxmlformats-package.relationships+xml"
MODEL_RELATION = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
FIXED_DATE = (1980, 1, 1, 0, 0, 0)  # the same body gives the same bytes


def write_stl(body: Body, path: str | os.PathLike[str], name: str = "body") -> None:
    """Binary STL; the format has no unit, so the header says mm. Raises GeometryError for a bonded body."""
    surface = _printable(body)
    corners = surface.points[surface.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    facets = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    facets["normal"], facets["corners"] = normals, corners
    header = f"antinode {name} units=mm z=up".encode("ascii", "replace")[:80].ljust(80)
    with written_whole(path) as temporary:
        temporary.write_bytes(header + np.uint32(len(facets)).tobytes() + facets.tobytes())


def write_3mf(body: Body, path: str | os.PathLike[str], metadata: Mapping[str, str]) -> None:
    """3MF core model in mm with metadata (Title, Description, ... of the core specification).

    Raises GeometryError for a bonded body or a metadata name the specification does not have. Source: 3mf2018.
    """
    unknown = sorted(set(metadata) - METADATA)
    if unknown:
        raise GeometryError(f"3MF metadata '{unknown[0]}' is not one of {', '.join(sorted(METADATA))}")
    parts = {
        "[Content_Types].xml": _content_types(),
        "_rels/.rels": _relations(),
        "3D/3dmodel.model": _model(_printable(body), metadata),
    }
    with written_whole(path) as temporary, ZipFile(temporary, "w") as package:
        for name, text in parts.items():
            entry = ZipInfo(name, FIXED_DATE)
            entry.compress_type = ZIP_DEFLATED
            package.writestr(entry, text)


METADATA = {
    "Title",
    "Designer",
    "Description",
    "Copyright",
    "LicenseTerms",
    "Rating",
    "CreationDate",
    "ModificationDate",
    "Application",
}


def write_step(body: Body, path: str | os.PathLike[str], name: str = "body") -> None:
    """STEP AP214 in mm; parts of a bonded body stay separate solids. Raises GeometryError when the kernel refuses."""
    from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
    from OCP.IFSelect import IFSelect_RetDone
    from OCP.Interface import Interface_Static
    from OCP.STEPControl import STEPControl_AsIs, STEPControl_Writer
    from OCP.TCollection import TCollection_HAsciiString

    silence_kernel()
    for key in ("xstep.cascade.unit", "write.step.unit"):
        Interface_Static.SetCVal_s(key, "MM")
    writer = STEPControl_Writer()
    Interface_Static.SetCVal_s("write.step.product.name", name)  # known to the kernel once there is a writer
    done = writer.Transfer(body.shape.wrapped, STEPControl_AsIs) == IFSelect_RetDone
    APIHeaderSection_MakeHeader(writer.Model()).SetTimeStamp(TCollection_HAsciiString(NO_TIME))  # same bytes each time
    with written_whole(path) as temporary:
        if not done or writer.Write(str(temporary)) != IFSelect_RetDone:
            raise GeometryError(f"{Path(path)}: the CAD kernel could not write STEP")


def _printable(body: Body) -> CadSurface:
    if body.bonded:
        raise GeometryError("a print is one solid of one material: leave patches out and give pillars the plate's")
    return cad_surface(body.shape, DEFLECTION_MM, ANGLE)


def _model(surface: CadSurface, metadata: Mapping[str, str]) -> str:
    notes = "".join(f"<metadata name={quoteattr(k)}>{escape(v)}</metadata>" for k, v in metadata.items())
    vertices = "".join(f'<vertex x="{x:.9g}" y="{y:.9g}" z="{z:.9g}"/>' for x, y, z in surface.points.tolist())
    triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in surface.triangles.tolist())
    mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"
    return _xml(
        f'<model unit="millimeter" xml:lang="en-US" xmlns="{CORE}">{notes}<resources><object id="1" type="model">{mesh}'
        '</object></resources><build><item objectid="1"/></build></model>'
    )


def _content_types() -> str:
    return _xml(
        f'<Types xmlns="{PACKAGE}/content-types"><Default Extension="rels" ContentType="{RELATION_TYPE}"/>'
        f'<Default Extension="model" ContentType="{MODEL_TYPE}"/></Types>'
    )


def _relations() -> str:
    return _xml(
        f'<Relationships xmlns="{PACKAGE}/relationships">'
        f'<Relationship Target="/3D/3dmodel.model" Id="rel0" Type="{MODEL_RELATION}"/></Relationships>'
    )


def _xml(text: str) -> str:
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}'
