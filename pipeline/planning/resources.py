"""What a computation will take, foretold from its plan: memory, degrees of freedom, modes, an order of time; and what there is.

An estimate may be off by the factors of MEMORY_RANGE and SECONDS_RANGE, which `studies/benchmarks/foresight.py` measured on
scenes of other materials, sizes, models and accuracies than the calibrated design.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from pipeline.errors import InputError
from solvers.fem.cost import Cost
from solvers.machine import available_bytes

GIB = 2.0**30
BASE_BYTES = 0.25 * GIB  # the program with its libraries
CAD_BYTES = 0.45 * GIB  # those of CAD and tetrahedra
START_S = 3.0  # to load them
SPEED = 4e9  # operations a second and core
UNITS = ((31557600.0, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))
MEMORY_RANGE = (0.5, 1.6)  # of the estimate, by the slow proof; the upper end is what has to fit
SECONDS_RANGE = (0.2, 5.0)


@dataclass(frozen=True)
class Demand:
    """What a step of a plan takes, and what to change where that is too much.

    modes: how many the window may hold (None where nothing is counted); functions: degrees of freedom of a reduced cell, at a
    wavevector or in one of the panels of an assembled plate; `change` in the order in which it helps. beside_bytes: what
    symmetry classes solved beside the first one take, which wait for their turn where memory holds one alone. finer_bytes: peak
    memory on each finer mesh that may have to follow, B; one that memory does not hold is left out.
    """

    cost: Cost
    modes: float | None = None
    functions: int | None = None
    panels: int | None = None
    change: tuple[str, ...] = ()
    cad: bool = False
    beside_bytes: float = 0.0
    finer_bytes: tuple[float, ...] = ()

    @property
    def least_bytes(self) -> float:
        """Peak memory where one symmetry class is solved after another, B."""
        return BASE_BYTES + (CAD_BYTES if self.cad else 0.0) + self.cost.peak.bytes

    @property
    def memory_bytes(self) -> float:
        """Peak memory on this machine, B."""
        side_by_side = self.least_bytes + self.beside_bytes
        return side_by_side if MEMORY_RANGE[1] * side_by_side <= available_bytes() else self.least_bytes

    @property
    def seconds(self) -> float:
        """Order of magnitude of the time, s."""
        return START_S + self.cost.operations / SPEED

    @property
    def a_what(self) -> str:
        """What has so many functions."""
        return "a panel" if self.panels else "a wavevector"

    def then(self, other: Demand) -> Demand:
        """Both demands one after the other: the larger peak and what it asks to change."""
        larger, smaller = (self, other) if self.memory_bytes >= other.memory_bytes else (other, self)
        return replace(larger, cost=larger.cost.then(smaller.cost))

    def text(self) -> str:
        """One line for people."""
        low, high = (factor * self.memory_bytes for factor in MEMORY_RANGE)
        parts = [f"memory {_size(self.memory_bytes)} ({_size(low)} to {_size(high)}), most while {self.cost.peak.name}"]
        if self.finer_bytes:
            finer = ", ".join(_size(each) for each in self.finer_bytes)
            parts.append(f"on finer meshes, where the accuracy asks for them, {finer}")
        if self.panels:
            parts.append(f"{_count(self.panels)} panels")
        parts.append(f"{_count(self.cost.dofs)} degrees of freedom at once")
        if self.functions:
            parts.append(f"about {_count(self.functions)} functions {self.a_what}")
        if self.modes is not None:
            parts.append(f"about {_count(round(self.modes))} modes")
        early, late = (factor * self.seconds for factor in SECONDS_RANGE)
        parts.append(f"time of the order of {_time(self.seconds)} ({_time(early)} to {_time(late)})")
        return "foreseen: " + "; ".join(parts)

    def to_dict(self) -> dict[str, Any]:
        """The same for scripts."""
        return {
            "memory_bytes": round(self.memory_bytes),
            "memory_range_bytes": [round(factor * self.memory_bytes) for factor in MEMORY_RANGE],
            "finer_memory_bytes": [round(each) for each in self.finer_bytes],
            "most_while": self.cost.peak.name,
            "dofs": self.cost.dofs,
            "modes": None if self.modes is None else round(self.modes),
            "functions": self.functions,
            "panels": self.panels,
            "seconds": float(f"{self.seconds:.2g}"),
            "seconds_range": [float(f"{factor * self.seconds:.2g}") for factor in SECONDS_RANGE],
        }


def too_much(demand: Demand) -> str | None:
    """Say why this machine cannot hold a demand, and what to change; None where it can."""
    needed, room = MEMORY_RANGE[1] * demand.memory_bytes, available_bytes()
    if needed <= room:
        return None
    reason = f"{_count(demand.cost.dofs)} degrees of freedom, most while {demand.cost.peak.name}"
    return (
        f"needs about {_size(demand.memory_bytes)} of memory, up to {_size(needed)} ({reason}), {_size(room)} are available: "
        f"{', or '.join(demand.change) or 'ask for less'}"
    )


def refuse(demands: Mapping[str, Demand]) -> None:
    """Raise InputError with a line for every named demand that this machine cannot hold."""
    lines = [f"{name}: {reason}" for name, demand in demands.items() if (reason := too_much(demand))]
    if lines:
        raise InputError(lines)


def _size(number: float) -> str:
    return f"{_short(number / GIB)} GiB"


def _count(number: float) -> str:
    """Write a count with no more digits than an estimate has."""
    return _short(number) if number < 1e3 else f"{float(f'{number:.3g}'):,.0f}".replace(",", " ")


def _time(seconds: float) -> str:
    """Write a time in the largest unit of which it has two."""
    unit, name = next(((size, name) for size, name in UNITS if seconds >= 2.0 * size), UNITS[-1])
    return f"{_short(seconds / unit, 2)} {name}"


def _short(number: float, digits: int = 3) -> str:
    """Write a number with so many significant digits, in powers of ten only where it would be unreadable otherwise."""
    return f"{float(f'{number:.{digits}g}'):.10g}" if number < 1e6 else f"{number:.0e}"
