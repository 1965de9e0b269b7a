"""Resources that a computation will need, estimated from its plan: memory, degrees of freedom, modes and order of time.

Estimates are good to the factors MEMORY_RANGE and SECONDS_RANGE. `studies/benchmarks/resource_estimate.py` measured them on
scenes whose materials, sizes, models and accuracies differ from those of the calibrated design.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from pipeline.errors import InputError
from pipeline.quantity import several
from solvers.fem.cost import Cost
from solvers.machine import available_bytes

GIB = 2.0**30
BASE_BYTES = 0.18 * GIB  # the program with its libraries, once a small plan is made
CAD_BYTES = 0.45 * GIB  # those of CAD and tetrahedra
START_S = 3.0  # to load them
SPEED = 4e9  # operations per second and core
UNITS = ((31557600.0, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))
MEMORY_RANGE = (0.5, 1.6)  # of the estimate, checked by the slow test; the upper end has to fit
SECONDS_RANGE = (0.2, 5.0)


@dataclass(frozen=True)
class ResourceEstimate:
    """Resources that a step of a plan needs, and changes that reduce them, the most effective first.

    modes: number expected in the window (None if none are counted); functions: degrees of freedom of a reduced cell, per
    wavevector or per panel of a plate; parallel_bytes: memory of the symmetry classes solved in parallel with the first, which
    run in sequence if it is not available; finer_bytes: peak memory on each finer mesh that may follow, if it fits.
    """

    cost: Cost
    modes: float | None = None
    functions: int | None = None
    panels: int | None = None
    change: tuple[str, ...] = ()
    cad: bool = False
    parallel_bytes: float = 0.0
    finer_bytes: tuple[float, ...] = ()

    @property
    def least_bytes(self) -> float:
        """Peak memory if the symmetry classes are solved in sequence, B."""
        return BASE_BYTES + (CAD_BYTES if self.cad else 0.0) + self.cost.peak.bytes

    @property
    def memory_bytes(self) -> float:
        """Peak memory on this machine, B."""
        side_by_side = self.least_bytes + self.parallel_bytes
        return side_by_side if MEMORY_RANGE[1] * side_by_side <= available_bytes() else self.least_bytes

    @property
    def seconds(self) -> float:
        """Order of magnitude of the time, s."""
        return START_S + self.cost.operations / SPEED

    @property
    def per(self) -> str:
        """Object that the number of functions refers to."""
        return "panel" if self.panels else "wavevector"

    def then(self, other: ResourceEstimate) -> ResourceEstimate:
        """Combine two steps in sequence: the larger peak with its changes, and the summed operations."""
        larger, smaller = (self, other) if self.memory_bytes >= other.memory_bytes else (other, self)
        return replace(larger, cost=larger.cost.then(smaller.cost))

    def text(self) -> str:
        """Return the estimate as a log line."""
        low, high = (factor * self.memory_bytes for factor in MEMORY_RANGE)
        needed = f"{_size(self.memory_bytes)} of memory ({_size(low)} to {_size(high)})"
        parts = [f"{needed}, peak while {self.cost.peak.name}"]
        if self.finer_bytes:
            finer = ", ".join(_size(each) for each in self.finer_bytes)
            parts.append(f"{finer} on finer meshes, if the accuracy requires them")
        if self.panels:
            parts.append(several(self.panels, "panel", _count(self.panels)))
        parts.append(f"largest system {_count(self.cost.dofs)} degrees of freedom")
        if self.functions:
            parts.append(f"about {_count(self.functions)} functions per {self.per}")
        if self.modes is not None:
            parts.append(f"about {several(round(self.modes), 'mode', _count(round(self.modes)))}")
        early, late = (factor * self.seconds for factor in SECONDS_RANGE)
        parts.append(f"roughly {in_time(self.seconds)} ({in_time(early)} to {in_time(late)})")
        return "estimate: " + "; ".join(parts)

    def to_dict(self) -> dict[str, Any]:
        """Return the estimate as plain JSON: memory in bytes, time in seconds."""
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


def shortfall(demand: ResourceEstimate) -> str | None:
    """Explain why this machine lacks the memory and what to change; None if the estimate fits."""
    needed, room = MEMORY_RANGE[1] * demand.memory_bytes, available_bytes()
    if needed <= room:
        return None
    reason = f"{_count(demand.cost.dofs)} degrees of freedom, peak while {demand.cost.peak.name}"
    return (
        f"needs about {_size(demand.memory_bytes)} of memory, up to {_size(needed)} ({reason}), but only {_size(room)} "
        f"is available: {', or '.join(demand.change) or 'request less'}"
    )


def refuse(demands: Mapping[str, ResourceEstimate]) -> None:
    """Raise InputError with one line for every named estimate that exceeds the available memory."""
    lines = [f"{name}: {reason}" for name, demand in demands.items() if (reason := shortfall(demand))]
    if lines:
        raise InputError(lines)


def _size(number: float) -> str:
    return f"{_short(number / GIB)} GiB"


def _count(number: float) -> str:
    """Write a count with the three digits that an estimate deserves."""
    return _short(number) if number < 1e3 else f"{float(f'{number:.3g}'):,.0f}".replace(",", " ")


def in_time(seconds: float) -> str:
    """Write a time in the largest unit that gives at least two."""
    unit, name = next(((size, name) for size, name in UNITS if seconds >= 2.0 * size), UNITS[-1])
    return f"{_short(seconds / unit, 2)} {name}"


def _short(number: float, digits: int = 3) -> str:
    """Write a number with a given number of significant digits, and in powers of ten from a million upwards."""
    return f"{float(f'{number:.{digits}g}'):.10g}" if number < 1e6 else f"{number:.0e}"
