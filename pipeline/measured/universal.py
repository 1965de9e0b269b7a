"""Measured frequency responses of a universal file (datasets 58, nodes in 15 or 2411): a sweep of one, a map of all.

Only motion along z, the plate's normal, is read: directions +3, and -3 with its sign turned; 0 says nothing and counts as +3.
A file with several responses serves as a sweep by that of the node which moves most along z.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.files import read_by_command
from geometry.layout import Design
from pipeline.errors import InputError
from pipeline.measured.files import EDGE_M, MIN_COUNT, MeasuredField, MeasuredSweep, Quantity
from solvers.control.identification import Sweep

SUFFIXES = (".uff", ".unv", ".bunv")
FREQUENCY_RESPONSE = 4
QUANTITIES: dict[int, Quantity] = {0: "velocity", 8: "displacement", 11: "velocity", 12: "displacement"}
ACCELERATION = 12  # becomes a displacement: over -omega^2
NORMAL = {0: 1.0, 3: 1.0, -3: -1.0}  # directions along the plate's normal, and their signs
DIRECTIONS = {1: "x", 2: "y", 4: "rotation about x", 5: "rotation about y", 6: "rotation about z"}


def read_sweep(path: str | Path) -> MeasuredSweep:
    """The response of the file, or of its node that moves most. InputError for a file that holds none."""
    responses, _ = _read(Path(path))
    most = max(responses, key=lambda each: float(np.abs(each["data"]).max()))
    frequency, values = _curve(most, Path(path))
    return MeasuredSweep(str(path), False, _quantity(most, Path(path)), Sweep(frequency, values))


def read_field(path: str | Path, design: Design) -> MeasuredField:
    """Every node's response at the frequency where all of them together move most.

    InputError for nodes without a place, beyond the design's plate, or without a response of their own.
    """
    responses, places = _read(Path(path))
    curves = [_curve(each, Path(path)) for each in responses]
    frequency = curves[0][0]
    if any(len(tones) != len(frequency) or not np.allclose(tones, frequency) for tones, _ in curves):
        raise InputError(f"{path}: the responses have different frequencies: a map needs one list of them")
    values = np.stack([curve for _, curve in curves])
    nodes = [int(each["rsp_node"]) for each in responses]
    faults = [
        f"{path}: node {node} has a response and no place (dataset 15 or 2411)" for node in nodes if node not in places
    ]
    if faults or len(set(nodes)) < len(nodes):
        raise InputError(faults or f"{path}: a node has several responses: a map needs one each")
    points = np.array([places[node] for node in nodes])
    beyond = np.abs(points) > np.array([design.length_m / 2.0, design.half_span_m]) + EDGE_M
    if beyond.any():
        node = nodes[int(np.flatnonzero(beyond.any(axis=1))[0])]
        raise InputError(
            f"{path}: node {node} lies beyond the plate: coordinates count from its centre, in the file's unit (164)"
        )
    peak = int(np.argmax((np.abs(values) ** 2).sum(axis=0)))
    return MeasuredField(str(path), False, _quantity(responses[0], Path(path)), points, values[:, peak])


def _read(path: Path) -> tuple[list[dict[str, Any]], dict[int, FloatArray]]:
    """Frequency responses, and the places (x, y) of nodes in m."""
    import pyuff

    read_by_command(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file: must be a universal file")
    try:
        sets = pyuff.UFF(str(path)).read_sets()
    except Exception as fault:  # pyuff raises whatever a line makes it trip over
        raise InputError(f"{path}: no universal file that can be read ({fault})") from fault
    listed = sets if isinstance(sets, list) else [sets]
    responses = [each for each in listed if each.get("type") == 58 and each.get("func_type") == FREQUENCY_RESPONSE]
    if not responses:
        raise InputError(
            f"{path}: holds no frequency response: must have a dataset 58 of function type {FREQUENCY_RESPONSE}"
        )
    normal = [each for each in responses if _direction(each) in NORMAL]
    if not normal:
        there = ", ".join(sorted({DIRECTIONS.get(abs(_direction(each)), "unknown") for each in responses}))
        raise InputError(
            f"{path}: responses along {there} alone: must have some along z, the plate's normal (record 6)"
        )
    length = next((float(each["length"]) for each in listed if each.get("type") == 164), 1.0)
    if not 0.0 < length < np.inf:
        raise InputError(f"{path}: dataset 164: a length factor of {length:g}: must be above 0")
    places: dict[int, FloatArray] = {}
    for each in listed:
        if each.get("type") in (15, 2411):
            numbers = np.atleast_1d(each.get("node_nums", each.get("grid_global")))
            columns = [np.atleast_1d(each[axis]) for axis in "xy"]
            if {len(column) for column in columns} != {len(numbers)} or not np.isfinite([numbers, *columns]).all():
                raise InputError(f"{path}: dataset {each['type']}: every node must have a number and finite x, y and z")
            places |= {int(number): np.array(place) / length for number, *place in zip(numbers, *columns, strict=True)}
    return normal, places


def _direction(response: dict[str, Any]) -> int:
    return int(response.get("rsp_dir") or 0)


def _curve(response: dict[str, Any], path: Path) -> tuple[FloatArray, ComplexArray]:
    """Frequencies above 0 and complex values along z; an acceleration's displacement."""
    frequency, values = np.asarray(response["x"], dtype=float), np.asarray(response["data"], dtype=complex)
    above = frequency > 0.0
    if above.sum() < MIN_COUNT:
        raise InputError(f"{path}: {above.sum()} frequencies above 0: must be at least {MIN_COUNT}")
    if not np.isfinite(values).all():
        raise InputError(f"{path}: node {response['rsp_node']}: every value must be a finite number")
    frequency, values = frequency[above], NORMAL[_direction(response)] * values[above]
    if int(response["ordinate_spec_data_type"]) == ACCELERATION:
        values = values / -((2.0 * np.pi * frequency) ** 2)
    return frequency, np.asarray(values, dtype=complex)


def _quantity(response: dict[str, Any], path: Path) -> Quantity:
    code = int(response["ordinate_spec_data_type"])
    if code not in QUANTITIES:
        known = "8 (displacement), 11 (velocity), 12 (acceleration) or 0 (read as a velocity)"
        raise InputError(f"{path}: ordinate of type {code}: must be {known}")
    return QUANTITIES[code]
