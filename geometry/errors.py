"""Exceptions of the geometry."""


class GeometryError(ValueError):
    """Raised for a shape that cannot be built, or that is not a single closed solid (an open STEP file, an empty solid)."""


class MeshFileError(GeometryError):
    """Raised for a mesh file that cannot be read, or whose content cannot be used."""


class MeshError(RuntimeError):
    """Raised for a mesh that fails its checks; the message names the worst element."""
