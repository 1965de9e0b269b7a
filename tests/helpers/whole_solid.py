"""Modes of a small plate from reduced cells and from the whole solid mesh, each with its own error bars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from geometry.elements import FloatArray, IntArray
from geometry.mesh import AnyMesh
from pipeline.case.model import Case, case_from_dict
from pipeline.logs import TerminalLog
from pipeline.models import parts
from pipeline.models.modes import ModeRow, PartModes, solve_modes
from pipeline.planning.model_choice import Request
from pipeline.planning.plan import modes_step
from solvers.fem.assembly import System
from solvers.fem.solid import Pencil, SolidModel


def check_within_both_bars(raw: dict[str, Any], band_hz: tuple[float, float], symmetry: str | None = "SS") -> None:
    """Check that both models have equally many modes in a band, each within the sum of both errors, which are below 3 %."""
    query = Request("plate", band_hz=band_hz, symmetry=symmetry, search=False)
    cases = (case_from_dict(raw, None, [("solve.model", model)]) for model in ("superelement", "solid"))
    check_pairwise(*(_planned(case, query).rows for case in cases))


def check_pairwise(ours: Sequence[ModeRow], theirs: Sequence[ModeRow]) -> None:
    """Check modes of two models one by one, each within the sum of both errors, which are below 3 %."""
    assert len(ours) == len(theirs) > 2
    for one, other in zip(ours, theirs, strict=True):
        assert one.error is not None and other.error is not None
        assert one.frequency_hz == pytest.approx(other.frequency_hz, rel=one.error + other.error)
        assert max(one.error, other.error) < 0.03


def _planned(case: Case, query: Request) -> PartModes:
    return solve_modes(case, query, TerminalLog(True), modes_step(case, query).choice)


def solid_on_foam(case: Case, query: Request, rigid: int, monkeypatch: pytest.MonkeyPatch) -> PartModes:
    """Solve the whole solid of a case, which knows no supports, with springs along z spread over the edge faces of its foam.

    The meshes that estimate its errors are on the same springs; rigid: motions that they leave.
    """

    class OnFoam(SolidModel):
        @cached_property
        def system(self) -> System:
            own = super().system
            unit, stiffness = case.design.thickness_m * own.scale.young_pa * own.scale.length_m, own.stiffness
            for foam in case.design.supports:
                face, product = edge_gram(self.mesh, foam.edge, self.mesh.order)
                springs = sp.coo_array(product * foam.bedding_n_m2 / unit)
                at = (springs.data, (3 * face[springs.row] + 2, 3 * face[springs.col] + 2))
                stiffness = stiffness + sp.csr_array(at, shape=stiffness.shape)
            return replace(own, stiffness=sp.csr_array(stiffness))

        def pencil(self, symmetry: str | None) -> Pencil:
            return replace(super().pencil(symmetry), rigid_count=rigid)

    monkeypatch.setattr(parts, "SolidModel", OnFoam)
    assert {each.kind for each in case.design.supports} == {"foam"}
    return _planned(case.but({"support": [], "solve.model": "solid"}), query)


def edge_gram(mesh: AnyMesh, edge: str, order: int) -> tuple[IntArray, FloatArray]:
    """Nodes of the edge face of a plate of boxes, and the integrals of products of their shape functions over it."""
    axis = 1 - "xy".index(edge[0])
    face = mesh.nodes_of(edge)
    face = face[np.lexsort(mesh.nodes[face][:, [2, axis]].T)]
    along, z = (np.unique(np.round(mesh.nodes[face, each], 10)) for each in (axis, 2))
    return face, np.asarray(np.kron(_gram(along, order), _gram(z, order)), dtype=np.float64)


def _gram(places: FloatArray, order: int) -> FloatArray:
    """Integrals of products of the shape functions of elements along a line, whose nodes are given."""
    total, (s, weight) = np.zeros((len(places),) * 2), np.polynomial.legendre.leggauss(order + 1)
    for first in range(0, len(places) - 1, order):
        own = places[first : first + order + 1]
        half = (own[-1] - own[0]) / 2.0
        shapes = np.linalg.solve(np.vander(own / half).T, np.vander(own[0] / half + 1.0 + s, order + 1).T)
        total[first : first + order + 1, first : first + order + 1] += (shapes * half * weight) @ shapes.T
    return total
