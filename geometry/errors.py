"""What geometry raises."""


class GeometryError(ValueError):
    """A shape that cannot be built or is not what it claims to be (an open STEP file, an empty solid)."""


class MeshFileError(GeometryError):
    """A mesh file that is not what it claims to be, or holds what cannot serve."""


class MeshError(RuntimeError):
    """A mesh that failed its checks; the message names the worst element."""
