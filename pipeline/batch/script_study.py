"""Studies described by a Python module of studies/: cases, computation of one, conclusion from all.

The study file names it: `[study] script = "extremes"`. The module offers

    TITLE: str; LEAD: str                          heading and opening words of the page
    cases() -> list[(case id, parameters)]         parameters are plain values
    compute(parameters, folder, log) -> values     plain ones by name, status, diagnosis; runs in a worker process
    conclude(records) -> Page                      tables and pictures only from stored values: each case's parameters,
                                                   values, status, diagnosis and case_id
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

from pipeline import paths
from pipeline.batch.job import Job
from pipeline.case.reading import Diagnostics, read_toml
from pipeline.logs import Log, RunLog
from pipeline.records import record, store
from pipeline.records.record import Record
from pipeline.report.html import Page, write_page

SHARED = ("ladder", "scenes")  # modules of studies/ that scripts use


@dataclass(frozen=True)
class ScriptStudy:
    """A study file that names a module of studies/."""

    name: str
    source: Path
    script: str

    @property
    def about(self) -> dict[str, Any]:
        """Return the description of the study for its report."""
        return {"name": self.name, "script": self.script}

    @property
    def module(self) -> ModuleType:
        """Import the module."""
        return importlib.import_module(f"studies.{self.script}")


def load_script(path: Path) -> ScriptStudy | None:
    """Return the study of a file that names a script, else None. Raises InputError with a line per fault."""
    raw = read_toml(path)
    table = raw.get("study")
    if not isinstance(table, dict) or "script" not in table:
        return None
    diagnostics = Diagnostics(str(path))
    for key in raw:
        if key != "study":
            diagnostics.unknown(key, raw[key], ["study"])
    for key in table:
        if key not in ("name", "script"):
            diagnostics.unknown(f"study.{key}", table[key], ["study.name", "study.script"])
    script, name = table["script"], table.get("name", path.stem)
    known = sorted(file.stem for file in paths.STUDIES.glob("*.py") if "def conclude" in file.read_text())
    if script not in known:
        diagnostics.add("study.script", script, f"must be one of {', '.join(known)}")
    if not (isinstance(name, str) and re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._+-]{0,99}", name)):
        diagnostics.add("study.name", name, "must be 1 to 100 letters, digits, dots, dashes or underscores")
    diagnostics.stop()
    return ScriptStudy(name, path, script)


def jobs_of(study: ScriptStudy, all_fields: bool = False) -> list[Job]:
    """Return the cases of the script, each with the hash of its sources. No script has fields of modes."""
    sources = {
        name: store.file_hash(paths.STUDIES / f"{name}.py")
        for name in (study.script, *SHARED)
        if (paths.STUDIES / f"{name}.py").exists()
    }
    return [
        Job(case_id, {"name": case_id, "parameters": parameters, "sources": sources}, {})
        for case_id, parameters in study.module.cases()
    ]


def computer(study: ScriptStudy) -> Any:
    """Return the picklable function that computes one case in a worker process."""
    return partial(compute, study.script)


def compute(script: str, payload: Mapping[str, Any], folder: Path, log: RunLog) -> dict[str, Any]:
    """Compute one case of a script, with its outcome if the script provides one."""
    module = importlib.import_module(f"studies.{script}")
    result = dict(module.compute(payload["parameters"], folder, log))
    ended = {key: result.pop(key) for key in ("status", "diagnosis") if key in result}
    return {**ended, "other": result}


def explored(study: ScriptStudy, folder: Path, log: Log) -> list[Path]:
    """Return nothing: a script has no single case to explore."""
    return []


def conclude(study: ScriptStudy, folder: Path, all_pictures: bool = True) -> list[Path]:
    """Write tables, pictures and page from the stored records, in the order of the cases."""
    records = []
    for case_id, parameters in study.module.cases():
        try:
            result = record.read(store.case_folder(folder, case_id))
        except store.StoreError as error:
            result = Record(case_id=case_id, status="FAILED", diagnosis=str(error))
        ended = {"status": result.status, "diagnosis": result.diagnosis, "case_id": case_id}
        records.append({"parameters": parameters, **result.other, **ended})
    page: Page = study.module.conclude(records)
    return write_page(folder, study.name, study.module.TITLE, study.module.LEAD, page)
