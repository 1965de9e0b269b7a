"""Supports of a plate: clamped, pinned and elastic edges, and screws, springs, dampers and masses on discs of its back face."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from geometry.elements import FloatArray

EDGES = ("x-", "x+", "y-", "y+")
KINDS = ("clamp", "simple", "foam", "spring", "mass")
SOFT = 5e-3  # largest part of a plate's own stiffness and inertia that soft supports add
NEAR_M = 1e-9  # supports that agree to a nanometre are each other's image


@dataclass(frozen=True)
class Support:
    """A support along an edge, or on a disc of the back face.

    Attributes
    ----------
    kind : {"clamp", "simple", "foam", "spring", "mass"}
        clamp holds the edge face or disc; simple its u_z, and on an edge face the displacement along it; the others act as
        stated below.
    edge : str
        Edge face x-, x+, y- or y+; empty for a disc.
    at_m : tuple of float
        Middle (x, y) of the disc in m.
    radius_m : float
        Radius of the disc in m.
    stiffness_n_m : float
        Stiffness along z in N/m, spread evenly over edge face or disc.
    bedding_n_m2 : float
        Stiffness along z per metre of edge in N/m2, spread evenly through the thickness.
    damping_n_s_m : float
        Damping along z in N s/m, spread as the stiffness.
    mass_kg : float
        Mass in kg, which moves along all axes, spread evenly.
    """

    kind: str
    edge: str = ""
    at_m: tuple[float, float] = (0.0, 0.0)
    radius_m: float = 0.0
    stiffness_n_m: float = 0.0
    bedding_n_m2: float = 0.0
    damping_n_s_m: float = 0.0
    mass_kg: float = 0.0

    @property
    def held_axes(self) -> str:
        """Axes along which the face cannot move."""
        if self.kind == "clamp":
            return "xyz"
        return {"x": "yz", "y": "xz", "": "z"}[self.edge[:1]] if self.kind == "simple" else ""

    def stiffness_of(self, length_m: float) -> float:
        """Return the whole stiffness along z of an edge as long as this, or of a disc, N/m."""
        return self.stiffness_n_m + self.bedding_n_m2 * (length_m if self.edge else 0.0)

    @property
    def is_resonator(self) -> bool:
        """Whether a mass hangs on its spring."""
        return self.mass_kg > 0.0 and self.stiffness_n_m > 0.0

    @property
    def box_m(self) -> FloatArray:
        """The square around its disc, x0, x1, y0, y1 in m."""
        return np.array([end for place in self.at_m for end in (place - self.radius_m, place + self.radius_m)])

    @property
    def area_m2(self) -> float:
        """Area of the disc, m2."""
        return pi * self.radius_m**2

    def mirrored(self, axis: int) -> Support:
        """Return its image in the plane through the plate's middle normal to an axis."""
        if self.edge:
            turned = {"-": "+", "+": "-"}[self.edge[1]]
            return replace(self, edge=self.edge[0] + turned) if self.edge[0] == "xy"[axis] else self
        middle = list(self.at_m)
        middle[axis] = -middle[axis]
        return replace(self, at_m=(middle[0], middle[1]))

    @property
    def key(self) -> tuple[object, ...]:
        """Everything about it, its place rounded to NEAR_M."""
        place = tuple(round(each / NEAR_M) for each in (*self.at_m, self.radius_m))
        return (self.kind, self.edge, *place, self.stiffness_n_m, self.bedding_n_m2, self.damping_n_s_m, self.mass_kg)


def is_held_disc(support: Support) -> bool:
    """Whether a support is a disc that cannot move along some axis.

    Parameters
    ----------
    support : Support
        Any.

    Returns
    -------
    bool
        True for a screw or a sliding post.
    """
    return not support.edge and bool(support.held_axes)


def has_dampers(supports: Iterable[Support]) -> bool:
    """Whether supports take energy from the plate.

    Parameters
    ----------
    supports : iterable of Support
        Those of a plate.

    Returns
    -------
    bool
        True with a damping above 0.
    """
    return any(each.damping_n_s_m > 0.0 for each in supports)


def are_mirrored(supports: Iterable[Support]) -> bool:
    """Whether supports are their own mirror images in x = 0 and in y = 0.

    Parameters
    ----------
    supports : iterable of Support
        Those of a plate.

    Returns
    -------
    bool
        True without supports.
    """
    own = list(supports)
    keys = sorted(map(repr, (each.key for each in own)))
    return all(sorted(repr(each.mirrored(axis).key) for each in own) == keys for axis in (0, 1))
