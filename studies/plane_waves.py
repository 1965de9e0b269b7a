"""Flexural waves of a thin plate with masses, springs and resonators, by plane waves (xiao2012): no elements, no reduction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.special import j1

from geometry.elements import FloatArray
from geometry.lattice import Lattice, Path
from geometry.supports import Support

SMALLEST = 1e-9  # argument below which the mean over a disc is 1


@dataclass(frozen=True)
class LoadedPlate:
    """One cell of a thin plate: its lattice, bending stiffness in N m and mass per area in kg/m2, and what is attached to it.

    attached: discs of the plate with a mass, a spring to ground, or both as a resonator along z.
    """

    lattice: Lattice
    stiffness_n_m: float
    kg_per_m2: float
    attached: Sequence[Support] = ()

    def frequencies(self, wavevector: FloatArray, count: int, reach: int = 8) -> FloatArray:
        """The lowest flexural waves in Hz, (count,), of w = sum of w_G exp(i (k + G) r) at a wavevector (2,) in rad/m.

        G has multiples of the reciprocal vectors up to `reach`: (2 reach + 1)^2 plane waves (xiao2012).
        """
        steps = np.arange(-reach, reach + 1)
        q = wavevector + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2) @ self.lattice.reciprocal_per_m
        length, area = np.linalg.norm(q, axis=1), self.lattice.area_m2
        stiffness = np.diag(self.stiffness_n_m * length**4 * area).astype(complex)
        mass = np.diag(np.full(len(q), self.kg_per_m2 * area)).astype(complex)
        for each in self.attached:
            argument = np.maximum(each.radius_m * length, SMALLEST)
            mean = np.zeros(len(mass), dtype=complex)
            mean[: len(q)] = 2.0 * j1(argument) / argument * np.exp(-1j * q @ np.array(each.at_m))
            if each.mass_kg and each.stiffness_n_m:
                mean = np.append(mean, -1.0)
                stiffness, mass = np.pad(stiffness, (0, 1)), np.pad(mass, (0, 1))
                mass[-1, -1] = each.mass_kg
            else:
                mass = mass + each.mass_kg * np.outer(mean, mean.conj())
            stiffness = stiffness + each.stiffness_n_m * np.outer(mean, mean.conj())
        values = eigh(stiffness, mass, eigvals_only=True, subset_by_index=[0, count - 1])
        return np.sqrt(np.abs(values)) / (2.0 * np.pi)

    def gap(
        self, below: int, points: int = 24, reach: int = 8, corners_per_m: FloatArray | None = None
    ) -> tuple[float, float]:
        """The highest frequency of a band (from 1) and the lowest of the next one along a path, Hz: no gap where they cross.

        The path has the corners given in rad/m, the lattice's default ones without any, and so many `points` a segment.
        """
        if corners_per_m is None:
            corners_per_m = self.lattice.path(self.lattice.default_path, 1).wavevectors
        wavevectors = Path(np.asarray(corners_per_m), ("",) * len(corners_per_m)).finer(points).wavevectors
        bands = np.array([self.frequencies(k, below + 1, reach) for k in wavevectors])
        return float(bands[:, below - 1].max()), float(bands[:, below].min())
