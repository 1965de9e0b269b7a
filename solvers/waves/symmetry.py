"""Mirror parity of Bloch waves where the mirror keeps the wavevector, up to a reciprocal vector."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from geometry.elements import ComplexArray, FloatArray, IntArray
from solvers.superelement.cell import Cell

AXES = {"x": 0, "y": 1}
SAME = 1e-9  # of 2 pi: a phase that counts as a whole turn
TOLERANCE = 1e-6  # how far the diagonal mirror may be from orthogonal and from leaving K and M alone
PURE = 0.99  # a wave's |<u, S u>| from which it has a parity


class Mirrors:
    """The mirrors of a cell: x -> -x, y -> -y, and "d", which exchanges x and y."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Mirrors that the cell has. x and y are those it was reduced with; the diagonal one is looked for."""
        flat = [name for name, axis in AXES.items() if (self.cell.fixed_parity[:, axis] != 0).all()]
        return (*flat, "d") if self._diagonal is not None else tuple(flat)

    def keeping(self, wavevector: FloatArray) -> tuple[str, ...]:
        """The mirrors that keep a wavevector (2,) in rad/m up to a reciprocal vector."""
        turns = np.asarray(wavevector) * np.array(self.cell.size_m[:2]) / (2.0 * np.pi)
        change = {"x": 2.0 * turns[0], "y": 2.0 * turns[1], "d": turns[0] - turns[1]}
        return tuple(name for name in self.names if abs(change[name] - round(change[name])) < SAME)

    def image(self, name: str, dofs: ComplexArray) -> ComplexArray:
        """The mirrored waves, (cell dof, n)."""
        face, out = self.cell.interface, np.empty_like(dofs)
        inner = dofs[face.count :]
        if name == "d":
            assert self._diagonal is not None
            out[: face.count] = dofs[face.diagonal()]
            out[face.count :] = self._diagonal @ inner
        else:
            where, sign = face.mirror(AXES[name])
            out[: face.count] = sign[:, None] * dofs[where]
            out[face.count :] = self.cell.fixed_parity[:, AXES[name], None] * inner
        return out

    def parity(self, name: str, dofs: ComplexArray) -> IntArray:
        """+1 where u_z is even under the mirror, -1 where it is odd, 0 where neither (degenerate waves mixed), (n,)."""
        value = np.einsum("ik,ik->k", dofs.conj(), self.cell.mass @ self.image(name, dofs)).real
        size = np.einsum("ik,ik->k", dofs.conj(), self.cell.mass @ dofs).real
        return np.where(np.abs(value) > PURE * size, np.sign(value), 0.0).astype(np.int64)

    @cached_property
    def _diagonal(self) -> FloatArray | None:
        """How the diagonal mirror exchanges the fixed-interface modes, from their coupling C to the boundary: C R = P C."""
        cell, count = self.cell, self.cell.interface.count
        if not np.isclose(*cell.size_m[:2], rtol=SAME, atol=0.0):
            return None
        where = cell.interface.diagonal()
        coupling = cell.mass[:count, count:]
        exchange = np.linalg.lstsq(coupling, coupling[where], rcond=None)[0]
        modes = cell.stiffness[count:, count:]
        checks = [
            (exchange.T @ exchange, np.eye(len(exchange))),
            (exchange.T @ modes @ exchange, modes),
            (coupling @ exchange, coupling[where]),
        ]
        for matrix in (cell.stiffness, cell.mass):
            edge = matrix[:count, :count]
            checks.append((edge[np.ix_(where, where)], edge))
        holds = all(
            np.abs(one - two).max(initial=0.0) <= TOLERANCE * np.abs(two).max(initial=1.0) for one, two in checks
        )
        return np.asarray(exchange) if holds else None
