"""A mesh in one .npz file, written whole or not at all, read back to the same sha256."""

from __future__ import annotations

import os
import zlib
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from geometry.errors import MeshError
from geometry.files import written_whole
from geometry.mesh import Mesh

FORMAT = 1


def save_mesh(mesh: Mesh, path: str | os.PathLike[str]) -> None:
    """Write nodes, cells, regions, faces, spans and the sha256; the file appears under its name only when complete."""
    arrays = {"nodes": mesh.nodes, "cells": mesh.cells}
    arrays |= {f"region/{name}": cells for name, cells in mesh.regions.items()}
    arrays |= {f"face/{name}": nodes for name, nodes in mesh.faces.items()}
    if mesh.spans is not None:
        arrays["spans"] = mesh.spans
    with written_whole(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file, format=FORMAT, kind=mesh.kind, order=mesh.order, sha256=mesh.sha256, allow_pickle=False, **arrays
        )


def load_mesh(path: str | os.PathLike[str]) -> Mesh:
    """Read a mesh. Raises MeshError for a missing, damaged or foreign file, one of another format, or a wrong hash."""
    try:
        with np.load(path, allow_pickle=False) as file:
            stored = {name: file[name] for name in file.files}
        version, kind, order = int(stored["format"]), str(stored["kind"]), int(stored["order"])
        expected = str(stored["sha256"])
        mesh = Mesh(
            stored["nodes"],
            stored["cells"],
            kind,
            order,
            _named(stored, "region/"),
            _named(stored, "face/"),
            stored.get("spans"),
        )
    except FileNotFoundError as fault:
        raise MeshError(f"{Path(path)}: no such mesh file") from fault
    except (OSError, ValueError, KeyError, EOFError, AttributeError, MemoryError, BadZipFile, zlib.error) as fault:
        raise MeshError(f"{Path(path)}: not a readable mesh file ({type(fault).__name__})") from fault
    if version != FORMAT:
        raise MeshError(f"{Path(path)}: mesh format {version}, this version reads {FORMAT}")
    if mesh.sha256 != expected:
        raise MeshError(f"{Path(path)}: damaged: the arrays hash to {mesh.sha256[:12]}, the file says {expected[:12]}")
    return mesh


def _named(stored: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): array for name, array in stored.items() if name.startswith(prefix)}
