"""What a finger makes of the wanted mode: its frequency and quality factor, and how much of the free mode is left in it.

With the points' motion u_f = g q + R f and f = -D u_f, the modes' coordinates q obey (Lambda (1 + i/Q) - lambda + g' T g) q = 0
with T = (1 + D R)^-1 D at lambda: an eigenvalue problem as large as the number of modes, solved anew where lambda lands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from geometry.elements import ComplexArray
from solvers.touch.touched_plate import TouchedPlate

PASSES = 30
SETTLED = 1e-10  # relative change of an eigenvalue


@dataclass(frozen=True)
class LoadedMode:
    """The mode under the finger that holds most of the free plate's wanted mode, all patches short.

    lambda = (2 pi frequency)^2 (1 + i loss), loss = 1/Q; share: of the free wanted mode in it, of 1. Below one half the
    wanted mode is mixed with its neighbours.
    """

    free_hz: float
    frequency_hz: float
    free_loss: float
    loss: float
    share: float

    @property
    def shift_hz(self) -> float:
        """Detuning by the finger."""
        return self.frequency_hz - self.free_hz

    @property
    def quality_factor(self) -> float | None:
        """Quality factor under the finger; None where nothing is lost."""
        return 1.0 / self.loss if self.loss > 0.0 else None

    @property
    def added_loss(self) -> float:
        """What the finger adds to 1/Q."""
        return self.loss - self.free_loss


def loaded_mode(touched: TouchedPlate) -> LoadedMode | None:
    """The wanted mode under the finger; None when the band holds none, or the finger leaves none among the modes about it."""
    free_hz, row = touched.free.wanted_hz(), touched.wanted_row
    if free_hz is None or row is None:
        return None
    if touched.finger.tip.is_nothing:
        return LoadedMode(free_hz, free_hz, touched.loss, touched.loss, 1.0)
    scale = touched.plate.scale
    eigenvalues = np.concatenate([basis.eigenvalue for basis in touched.modes])
    own = np.diag(eigenvalues * (1.0 + 1j * touched.loss))
    low, high = (scale.eigenvalue(share * end) for share, end in zip(touched.margin, touched.band_hz, strict=True))
    value = complex(eigenvalues[row])
    for _ in range(PASSES):
        values, vectors = scipy.linalg.eig(own + _added(touched, value.real))
        known = np.flatnonzero((values.real >= low) & (values.real <= high))
        if not len(known):
            return None
        best = known[int(np.argmax(np.abs(vectors[row, known])))]  # unit columns
        before, value = value, complex(values[best])
        if abs(value - before) <= SETTLED * abs(value):
            frequency = float(scale.frequency(np.array(value.real)))
            loss = value.imag / value.real
            return LoadedMode(free_hz, frequency, touched.loss, loss, float(np.abs(vectors[row, best]) ** 2))
    return None


def _added(touched: TouchedPlate, eigenvalue: float) -> ComplexArray:
    """g' T g between all modes, scaled as the eigenvalues, (modes, modes)."""
    unit, count = touched.plate.stiffness_unit, len(touched.plate.patches)
    gain = np.vstack([basis.gain[:, count:] for basis in touched.modes])
    residual = unit * np.sum([basis.residual(eigenvalue)[count:, count:] for basis in touched.modes], axis=0)
    stiffness = touched.finger.stiffness_n_m(float(touched.plate.scale.frequency(np.array(eigenvalue))))
    matrix = np.eye(len(residual)) + stiffness * residual
    return np.asarray(unit * stiffness * gain @ np.linalg.solve(matrix, gain.T.astype(complex)))
