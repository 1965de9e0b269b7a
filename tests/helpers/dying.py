"""Cases of a study, one of which ends the process that computes it."""

from __future__ import annotations

import os
import signal
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.batch import case_study


def computer(study: Any) -> Any:
    """Return the function that computes a case instead of `case_study.computer`."""
    return partial(compute, str(study.case_path))


def compute(case_path: str, payload: dict[str, Any], folder: Path, log: Any) -> Any:
    """Compute a case; end the process at a pitch of 5 mm."""
    if "pitch_mm=5" in folder.name:
        os.kill(os.getpid(), signal.SIGKILL)
    return case_study.compute(case_path, payload, folder, log)
