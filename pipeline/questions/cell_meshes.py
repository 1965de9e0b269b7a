"""Options of questions about a user's own mesh of a unit cell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pipeline.errors import InputError
from pipeline.questions.question import Declared, option

if TYPE_CHECKING:
    from pipeline.models.user_mesh import UserMesh


class OfCellMeshes(Declared):
    """Options for one or two meshes of a unit cell."""

    mesh_file: tuple[str, ...] = option(
        default=(), kw_only=False, metavar="FILE",
        help="mesh of the cell: .med, .msh or .inp; a second one for error bars",
    )  # fmt: skip
    unit: Literal["m", "mm"] | None = option(default=None, help="length unit of the mesh file (default: m)")
    merge: float | None = option(
        default=None, at_least=0.0, metavar="D",
        help="merge nodes closer than this, in the unit of the file (0: keep touching bodies separate)",
    )  # fmt: skip

    @property
    def files(self) -> list[UserMesh]:
        """The meshes."""
        from pipeline.models.user_mesh import UserMesh

        return [UserMesh(file, self.unit or "m", merge=self.merge) for file in self.mesh_file]

    def check_files(self) -> None:
        """Raise InputError for more than two files and for a missing one."""
        from pipeline.questions.modes import check_mesh_files

        if not 1 <= len(self.mesh_file) <= 2:
            raise InputError(f"--mesh-file: {len(self.mesh_file)} files: must be one, or two meshes of one cell")
        check_mesh_files(self.mesh_file)
