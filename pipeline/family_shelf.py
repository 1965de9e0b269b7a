"""Families of reduced cells kept on disk, as single cells are."""

from __future__ import annotations

import contextlib
import os
import tempfile
import zipfile
from pathlib import Path

import numpy as np

from pipeline.cell_shelf import CellShelf, _packed, _unpacked
from solvers.superelement.varied import CellFamily, nodes_of

OWN = ("reach_m", "stiffness_changes", "mass_changes")


class FamilyShelf(CellShelf):
    """A folder of .npz files, one per family, beside those of cells; a torn or foreign file counts as absent."""

    def get(self, key: str) -> CellFamily | None:  # type: ignore[override]
        """A family kept under this key by the same code, or None."""
        with (
            contextlib.suppress(OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile),
            np.load(self._path(key)) as file,
        ):
            flat = {name: file[name] for name in file.files}
            reach, stiffness, mass = (flat.pop(name) for name in OWN)
            return CellFamily(_unpacked(flat), reach, nodes_of(reach), stiffness, mass)
        return None

    def put(self, key: str, family: CellFamily) -> None:  # type: ignore[override]
        """Keep a family; a full disk costs the next run time, not this one its result."""
        own = dict(zip(OWN, (family.reach_m, family.stiffness, family.mass), strict=True))
        with contextlib.suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=self.folder, suffix=".part")
            try:
                with os.fdopen(handle, "wb") as file:
                    np.savez(file, **(_packed(family.cell) | own))
                Path(name).replace(self._path(key))
            finally:
                Path(name).unlink(missing_ok=True)
            self._make_room(self._path(key))
