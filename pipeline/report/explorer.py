"""The explorer beside a study's report: a page of its own that answers without the program."""

from __future__ import annotations

from pathlib import Path

from pipeline.case.model import case_from_dict
from pipeline.case.reading import read_toml
from pipeline.errors import InputError
from pipeline.logs import Log
from pipeline.records import store
from solvers.errors import SolverError

NAME = "explorer.html"


def put(folder: Path, case_path: Path, log: Log | None = None) -> list[Path]:
    """Write the explorer of the study's case where its bases are in the cache; with a log they are made, which takes longer
    than most studies. Nothing is written for a cell that they cannot follow.
    """
    from pipeline.explore import offline
    from pipeline.explore.answer import Explorer, Scene
    from pipeline.models.parametric import cell_model, kept_model

    try:
        raw = read_toml(case_path)
        case = case_from_dict(raw, case_path)
        case.require("pillar", "zone", command="explore")
        model = cell_model(case, log) if log else kept_model(case)
        if model is None:
            return []
        html = offline.page(Explorer(Scene(case, raw, ()), model))
    except (InputError, SolverError) as fault:  # a cell that the bases cannot follow: the study has no explorer
        if log:
            log.warning("NO_EXPLORER", f"no explorer beside the report: {' '.join(str(fault).split())}")
        return []
    store.write_atomic(folder / NAME, html.encode())
    return [folder / NAME]


def link(folder: Path) -> str:
    """The address of the explorer beside a study's report, or nothing."""
    return NAME if (folder / NAME).exists() else ""
