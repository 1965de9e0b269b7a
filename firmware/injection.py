"""Lets go wrong what can, at every tick of a second's run, and tells how long the output took to rest.

`python -m firmware.injection` runs the single-mode application on the rig of firmware.host.rig; it takes minutes. With
--stride N only every N-th tick is looked at.
"""

from __future__ import annotations

import argparse
import sys

from firmware.host import NoCompiler
from firmware.host.rig import RUN, SingleRig

TRIPS = {"clock": 1, "lost interrupt": 7, "break": 12, "supply": 15}
SENSORS = ("DEAD", "STUCK", "REVERSED", "CLIPPED")
TRIP_MOST, SENSOR_MOST, LATCHED = 25, 5000, 200  # ticks of 4 us: 100 us, 20 ms, 0.8 ms


def running(table: bytes, plate: object) -> SingleRig:
    """A rig that holds a plate."""
    rig = SingleRig(table, plate)  # type: ignore[arg-type]
    rig.run(5e-3)
    rig.start(0.15)
    rig.run(50e-3)
    if rig.state != RUN:
        raise RuntimeError("the plate is not held")
    return rig


def lines(table: bytes, plate: object, seconds: float, stride: int) -> list[tuple[str, float, float]]:
    """(what goes wrong, longest time to rest, time allowed) in s; the longest is infinite when some moment was never safe."""
    result = []
    kinds = [(name, "RIG_TRIP", 1 << bit, TRIP_MOST) for name, bit in TRIPS.items()]
    for name in SENSORS:
        kinds.append((f"sensor {name.lower()}", "RIG_SENSOR", -1, SENSOR_MOST))
    for name, kind, detail, most in kinds:
        rig = running(table, plate)
        value = detail if detail >= 0 else getattr(rig.lib, f"RIG_{name.split()[1].upper()}")
        ticks = round(seconds * rig.plate.sample_rate_hz)
        worst = rig.lib.rig_inject(rig.rig, getattr(rig.lib, kind), value, ticks, stride, most, LATCHED)
        taken = worst / rig.plate.sample_rate_hz if worst <= most else float("inf")
        result.append((name, taken, most / rig.plate.sample_rate_hz))
    return result


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    from firmware.control_table import held_plate

    parser = argparse.ArgumentParser(prog="python -m firmware.injection", description=__doc__)
    parser.add_argument("--seconds", type=float, default=1.0, help="length of the run")
    parser.add_argument("--stride", type=int, default=1, help="ticks between two injections")
    chosen = parser.parse_args(arguments)
    try:
        rows = lines(*held_plate(300.0), chosen.seconds, max(chosen.stride, 1))
    except NoCompiler as missing:
        print(f"injection: {missing}", file=sys.stderr)
        return 5
    for name, taken, allowed in rows:
        verdict = f"at rest after at most {1e6 * taken:.0f} us" if taken <= allowed else "NOT at rest in time"
        print(f"{name}: {verdict}, allowed {1e6 * allowed:.0f} us")
    return 0 if all(taken <= allowed for _, taken, allowed in rows) else 4


if __name__ == "__main__":
    sys.exit(main())
