"""The forced response as a universal file: nodes of the touch face (dataset 15) and a frequency response each (dataset 58)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.case.model import Case
from pipeline.logs import Log

FREQUENCY_RESPONSE, DISPLACEMENT, UNKNOWN, FREQUENCY, UP = 4, 8, 0, 18, 3  # codes of dataset 58
REAL_LENGTH = 80


def write(case: Case, path: Path, log: Log) -> Path:
    """Compute the response about the wanted peak on a grid of the touch face and write it, u_z in m per volt."""
    import pyuff

    from pipeline.measured.synthetic import grid, tones
    from pipeline.questions.question import Run, ask
    from pipeline.questions.response import Response
    from pipeline.records import outputs
    from solvers.piezo.responses import point_responses

    run = Run(log)
    peak = ask(case, Response(), run).peak
    points, frequency = grid(case.design), tones(case, peak.frequency_hz)
    with log.step(f"response at {len(points)} points"):
        values = point_responses(run.solved["forced"], points, frequency)
    sets = [_units(), _nodes(points), *(_response(case, node, frequency, row) for node, row in enumerate(values, 1))]
    with outputs.delivered(path) as temporary:
        pyuff.UFF(str(temporary)).write_sets(sets, "overwrite")
    return path


def _units() -> dict[str, Any]:
    """Dataset 164: SI units."""
    factors = {"length": 1.0, "force": 1.0, "temp": 1.0, "temp_offset": 273.15}
    return {"type": 164, "units_code": 1, "units_description": "SI units", "temp_mode": 1} | factors


def _nodes(points: Any) -> dict[str, Any]:
    zero = [0] * len(points)
    numbers = list(range(1, len(points) + 1))
    place = {"x": points[:, 0].tolist(), "y": points[:, 1].tolist(), "z": [0.0] * len(points)}
    return {"type": 15, "node_nums": numbers, "def_cs": zero, "disp_cs": zero, "color": zero} | place


def _response(case: Case, node: int, frequency: Any, values: Any) -> dict[str, Any]:
    return {
        "type": 58,
        "binary": 0,
        "func_type": FREQUENCY_RESPONSE,
        "id1": f"{case.name}: u_z per volt on the patches"[:REAL_LENGTH],
        "rsp_node": node,
        "rsp_dir": UP,
        "ref_node": 0,
        "ref_dir": 0,
        "rsp_ent_name": "touch face",
        "ref_ent_name": "patches",
        "data": values,
        "x": np.asarray(frequency, dtype=float),
        "abscissa_spec_data_type": FREQUENCY,
        "ordinate_spec_data_type": DISPLACEMENT,
        "ordinate_axis_units_lab": "m",
        "orddenom_spec_data_type": UNKNOWN,
        "orddenom_axis_units_lab": "V",
    }
