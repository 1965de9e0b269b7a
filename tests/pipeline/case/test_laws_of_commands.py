"""Commands on anisotropic, layered, sectioned and lossy plates: each works, or refuses them in one line."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest

from pipeline.case.model import Case, case_from_dict
from pipeline.cli.explore import explorer_of
from pipeline.errors import InputError
from pipeline.models import parametric
from pipeline.questions.broadband import Broadband
from pipeline.questions.question import Question, Run, ask
from pipeline.questions.search import Search
from pipeline.questions.tolerance import AlikeTolerance, Tolerance
from pipeline.questions.travel import Travel
from pipeline.search.terms import Range
from tests.helpers.exploring import OFFLINE, SMALL
from tests.helpers.recording_log import RecordingLog

GRAINED: dict[str, Any] = {
    "density_kg_m3": 2700.0,
    "orthotropic": {"E1_GPa": 70.0, "E2_GPa": 60.0, "E3_GPa": 65.0, "nu12": 0.3, "nu13": 0.3, "nu23": 0.3}
    | {"G12_GPa": 25.0, "G13_GPa": 24.0, "G23_GPa": 23.0},
}
PATCHES = {"material": "pz26", "size_mm": [6.0, 3.0, 0.3], "centres_mm": [[-6.0, 0.0], [6.0, 0.0], [0.0, 0.0]]}
LAWS: dict[str, dict[str, Any]] = {
    "orthotropic": {"material": GRAINED},
    "turned": {"material": GRAINED | {"axes_deg": [30.0, 0.0, 0.0]}},
    "layers": {
        "plate": {"layer": [{"material": "glass", "thickness_mm": 1.2}, {"material": "aluminium", "thickness_mm": 0.8}]}
    },
    "sections": {
        "pillar": {"section": [{"height_mm": 4.5, "material": "epoxy"}, {"height_mm": 1.8, "material": "steel"}]}
        | {"side_mm": 2.0}
    },
    "young_GPa_at": {
        "material": {"density_kg_m3": 2700.0, "poisson": 0.34, "young_GPa_at": [[1e3, 65.0, 1e-3], [1e5, 72.0, 2e-3]]}
    },
    "materials": {"damping": {"quality": "materials"}},
}
QUESTIONS: dict[str, Question[Any]] = {
    "search": Search(vary=(Range.read("pillar.side_mm=1.9:2.1"),), evaluations=1),
    "tolerance": Tolerance(),
    "tolerance --alike": AlikeTolerance(alike=True),
    "broadband": Broadband(points=3),
    "travel": Travel(),
}
REFUSED = {
    ("explore", "orthotropic"): "explore holds for a plate of one isotropic layer",
    ("explore", "turned"): "explore holds for a plate of one isotropic layer",
    ("explore", "layers"): "explore holds for a plate of one isotropic layer",
    ("explore", "sections"): "pillar.shape must be square, round",
    ("explore", "materials"): "must be a number: explore supports a single quality factor only",
    ("tolerance --alike", "orthotropic"): "explore holds for a plate of one isotropic layer",
    ("tolerance --alike", "turned"): "explore holds for a plate of one isotropic layer",
    ("tolerance --alike", "sections"): "of one section without fillet, on the back alone, can be varied",
    ("tolerance --alike", "layers"): "explore holds for a plate of one isotropic layer",
    ("tolerance --alike", "materials"): "must be a number: explore supports a single quality factor only",
    ("tolerance", "turned"): "tolerance needs a plate that is its own mirror image along x and y",
    ("tolerance", "sections"): "of one section without fillet, on the back alone, can be varied",
    ("tolerance", "materials"): "must be a number: tolerance supports a single quality factor only",
    ("search", "turned"): "search needs a plate that is its own mirror image along x and y",
    ("search", "materials"): "must be a number: search supports a single quality factor only",
    ("broadband", "turned"): "broadband needs a plate that is its own mirror image along x and y",
    ("broadband", "materials"): "must be a number: broadband supports a single quality factor only",
    ("travel", "materials"): "must be a number: travelling supports a single quality factor only",
}


def case(law: str, command: str) -> Case:
    raw = tomllib.loads(SMALL.read_text("utf-8")) | LAWS[law]
    if command == "travel":
        raw["patches"] = PATCHES | {"sensors": [2]}
    if command.startswith("tolerance"):
        raw["tolerance"] = {"height_mm": 0.05, "samples": 1}
    return case_from_dict(raw, None, ["solve.accuracy=0.1"])


def asked(law: str, command: str, run: Run) -> Any:
    about = case(law, command)
    return explorer_of(about, about.raw, (), run) if command == "explore" else ask(about, QUESTIONS[command], run)


@pytest.mark.parametrize(("command", "law"), REFUSED)
def test_a_law_that_a_command_cannot_follow_is_refused_in_one_line(command: str, law: str) -> None:
    with pytest.raises(InputError) as error:
        asked(law, command, Run(RecordingLog()))
    assert REFUSED[command, law] in str(error.value)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "law"),
    [(command, law) for command in ("explore", *QUESTIONS) for law in LAWS if (command, law) not in REFUSED],
)
def test_a_law_that_a_command_follows_gives_an_answer(command: str, law: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parametric, "Offline", lambda: OFFLINE)  # a small box
    run = Run(RecordingLog())
    assert asked(law, command, run) is not None
    if law == "young_GPa_at" and command != "explore":  # whose page says so where it starts
        assert any("MODULI" in text for text in run.warnings)
