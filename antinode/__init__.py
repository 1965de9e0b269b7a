"""Touch plates that hold their vibration, from one case to modes, bands, confinement and response.

    import antinode
    plate = antinode.load("examples/small.toml")
    bands = plate.bands()
    bands.plot()

Nothing heavy is imported until something is computed.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from antinode.plate import Caution, Plate, load
    from antinode.sweeps import SweepTable, open, sweep
    from pipeline.case.tables import Array, BandPath, Damping, Finger, Patches, Pillar, Scatter, Solve, Tip, Zone
    from pipeline.errors import InputError
    from pipeline.models.mode_parts import ModeRecord as Mode
    from pipeline.models.mode_parts import WantedRecord as Wanted
    from pipeline.questions.attenuation import AttenuationResult as Attenuation
    from pipeline.questions.bands import BandsResult as Bands
    from pipeline.questions.broadband import BroadbandResult as Broadband
    from pipeline.questions.crosstalk import CrosstalkResult as Crosstalk
    from pipeline.questions.hybrid import HybridResult as Hybrid
    from pipeline.questions.modes import ModesResult as Modes
    from pipeline.questions.predesign import PredesignResult as Predesign
    from pipeline.questions.response import ResponseResult as Response
    from pipeline.questions.search import SearchResult as Search
    from pipeline.questions.tolerance import ToleranceResult as Tolerance
    from pipeline.questions.touch import TouchResult as Touch
    from pipeline.questions.travel import TravelResult as Travel
    from solvers.errors import SolverError

HOMES = {
    "antinode.plate": ("Caution", "Plate", "load"),
    "antinode.sweeps": ("SweepTable", "open", "sweep"),
    "pipeline.case.tables": (
        "Array",
        "BandPath",
        "Damping",
        "Finger",
        "Patches",
        "Pillar",
        "Scatter",
        "Solve",
        "Tip",
        "Zone",
    ),
    "pipeline.errors": ("InputError",),
    "solvers.errors": ("SolverError",),
}
ANSWERS = {  # results of questions, and their parts
    **{
        name: f"pipeline.questions.{name.lower()}:{name}Result"
        for name in (
            "Attenuation",
            "Bands",
            "Broadband",
            "Crosstalk",
            "Hybrid",
            "Modes",
            "Predesign",
            "Response",
            "Search",
            "Tolerance",
            "Touch",
            "Travel",
        )
    },
    "Mode": "pipeline.models.mode_parts:ModeRecord",
    "Wanted": "pipeline.models.mode_parts:WantedRecord",
}
__all__ = [
    "Array",
    "Attenuation",
    "BandPath",
    "Bands",
    "Broadband",
    "Caution",
    "Crosstalk",
    "Damping",
    "Finger",
    "Hybrid",
    "InputError",
    "Mode",
    "Modes",
    "Patches",
    "Pillar",
    "Plate",
    "Predesign",
    "Response",
    "Scatter",
    "Search",
    "Solve",
    "SolverError",
    "SweepTable",
    "Tip",
    "Tolerance",
    "Touch",
    "Travel",
    "Wanted",
    "Zone",
    "__version__",
    "load",
    "open",
    "sweep",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("antinode")
    if name in ANSWERS:
        home, _, own = ANSWERS[name].partition(":")
        return getattr(import_module(home), own)
    for home, names in HOMES.items():
        if name in names:
            return getattr(import_module(home), name)
    raise AttributeError(f"module 'antinode' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
