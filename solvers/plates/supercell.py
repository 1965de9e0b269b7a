"""Bloch waves of a rectangle of reduced panels that repeats along x and y, such as two rows of which one is shifted."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh

from geometry.elements import FloatArray, IntArray
from geometry.layout import Design
from geometry.tiling import Tiling, signature
from solvers.accuracy.bands import STILL
from solvers.accuracy.plate import ModeErrors, mode_errors
from solvers.plates.assembled import Reductions
from solvers.superelement.lattice import ROUNDING
from solvers.superelement.plate import WHOLE, AssembledPlate, Grid
from solvers.threads import one_thread


def staggered_tiling(design: Design) -> Tiling:
    """The rectangle pitch_x x 2 pitch_y of staggered rows: four panels half a pitch wide, pillars in two of them."""
    half, pitch = design.pitch_x_m / 2.0, design.pitch_y_m
    x, y = half * np.array([-0.5, 0.5, 1.5]), pitch * np.array([-1.0, 0.0, 1.0])
    feet = {(0, 0): (0.0, -pitch / 2.0), (1, 1): (half, pitch / 2.0)} if design.pillar else {}
    return Tiling(x, y, feet, design.is_mirrored, periodic=True)


class Supercell:
    """Panels of a periodic tiling joined, degrees of freedom on x+ and y+ following those on x- and y- with a phase."""

    def __init__(self, tiling: Tiling, reductions: Reductions) -> None:
        panels = [tiling.panel(*place) for place in tiling.representatives(True)]
        plate = AssembledPlate(tiling, {signature(panel): reductions.cell(panel) for panel in panels}, WHOLE)
        self.plate, self.pencil, follows = plate, plate.pencil(), _followed(plate.grid)
        self.scale = self.pencil.scale
        self.size_m = np.array([np.ptp(tiling.x), np.ptp(tiling.y)])
        self.offset = (follows != np.arange(len(follows))[:, None]).astype(float)
        root = follows[follows[:, 0], 1]
        masters, self.column = np.unique(root, return_inverse=True)
        self.dof = len(masters)

    def frequencies(self, wavevector: FloatArray, count: int) -> FloatArray:
        """The `count` lowest Bloch frequencies at a wavevector (2,) in rad/m, ascending, Hz (a dense solve misses none)."""
        return self.solve(wavevector, count)[0]

    def solve(self, wavevector: FloatArray, count: int) -> tuple[FloatArray, ModeErrors]:
        """The same, and what truncation and the panels' meshes may put each of them off by."""
        phase = np.exp(1j * self.offset @ (np.asarray(wavevector) * self.size_m))
        turn = sp.csr_array((phase, (np.arange(len(phase)), self.column)), shape=(len(phase), self.dof))
        stiffness, mass = (
            (turn.conj().T @ part @ turn).toarray() for part in (self.pencil.stiffness, self.pencil.mass)
        )
        with one_thread():
            values, waves = eigh(stiffness, mass, subset_by_index=[0, min(count, self.dof) - 1])
        rounding = ROUNDING * np.abs(stiffness).max() / np.abs(mass).max()
        tones = self.scale.frequency(np.where(np.abs(values) < rounding, 0.0, values))
        moving, errors_of = tones > STILL * tones[-1], np.zeros((5, len(tones)))
        errors = mode_errors(self.plate, self.pencil, turn @ waves[:, moving], rims=1.0)
        errors_of[:, moving] = errors.modes, errors.degrees, errors.through, errors.taken, errors.mesh
        return tones, ModeErrors(*errors_of)


def _followed(grid: Grid) -> IntArray:
    """What every degree of freedom follows along x and along y, (n, 2); itself off the sides x+ and y+."""
    follows = np.repeat(np.arange(grid.count)[:, None], 2, axis=1)
    face = grid.interface
    for j in range(grid.ny):
        first, last = grid.dofs(0, j), grid.dofs(grid.nx - 1, j)
        pairs = ((face.vertex(0), face.vertex(1)), (face.vertex(2), face.vertex(3)), (face.side(0), face.side(1)))
        for low, high in pairs:
            follows[last[high], 0] = first[low]
    for i in range(grid.nx):
        first, last = grid.dofs(i, 0), grid.dofs(i, grid.ny - 1)
        pairs = ((face.vertex(0), face.vertex(2)), (face.vertex(1), face.vertex(3)), (face.side(2), face.side(3)))
        for low, high in pairs:
            follows[last[high], 1] = first[low]
    return follows
