"""The outer skin of a mesh: flat facets whole, curved ones cut at their nodes, closed along every edge."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from geometry.hex.panels import panel_mesh
from geometry.hex.scenes import HexSettings
from geometry.layout import Pillar
from geometry.materials import MATERIALS, Stack
from geometry.tiling import Panel
from solvers.fem.surface import skin_faces

T, H, R = 2e-3, 6e-3, 1e-3
STACK = Stack.of(T, MATERIALS["aluminium"])
ROUND = Pillar("round", 2.0 * R, 2.0 * R, H, MATERIALS["aluminium"])
PANEL = Panel((-2e-3, -2e-3), (2e-3, 2e-3), (0.0, 0.0))


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_round_pillar_is_as_round_as_its_nodes(order: int) -> None:
    """A rim of eight elements of an order is a polygon of 8 x order chords; between them every facet is flat or nearly so."""
    mesh = panel_mesh(PANEL, STACK, ROUND, HexSettings(order, 4e-3, 1, 0.15, H / 4.0)).mesh
    skin = mesh.nodes[skin_faces(mesh)]
    on_wall = (np.abs(np.linalg.norm(skin[:, :, :2], axis=2) / R - 1.0) < 0.03).all(axis=1)
    top = (np.abs(skin[:, :, 2] - T - H) < 1e-9).sum(axis=1) == 2
    assert (on_wall & top).sum() == 8 * order
    heights = np.ptp(skin[on_wall, :, 2], axis=1)
    assert len(heights) % (8 * order) == 0 and (heights > 0.0).all()


def test_flat_facets_stay_whole() -> None:
    """Plane facets with straight edges, also of leaning sides: as many as the elements have outside."""
    leaning = replace(ROUND, shape="tapered", tip_m=1.2 * R)
    mesh = panel_mesh(PANEL, STACK, leaning, HexSettings(3, 4e-3, 1, 0.15, H / 4.0)).mesh
    straight = panel_mesh(PANEL, STACK, replace(ROUND, shape="square"), HexSettings(3, 4e-3, 1, 0.15, H / 4.0)).mesh
    assert len(skin_faces(mesh)) == len(skin_faces(straight))


def test_every_edge_of_a_cut_skin_belongs_to_two_facets_or_lies_on_one_line() -> None:
    """The skin closes: edges that no other facet shares are straight ones that a neighbour has whole."""
    mesh = panel_mesh(PANEL, STACK, ROUND, HexSettings(3, 4e-3, 1, 0.15, H / 4.0)).mesh
    faces = skin_faces(mesh)
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    counts = Counter(map(tuple, edges.tolist()))
    assert max(counts.values()) == 2
    rim = np.abs(np.linalg.norm(mesh.nodes[:, :2], axis=1) / R - 1.0) < 1e-6
    lone = [edge for edge, count in counts.items() if count == 1 and rim[list(edge)].all()]
    assert not lone, "the rim itself is shared piece by piece"
