"""Touch plates that confine their vibration, from a single case to modes, bands, confinement and response.

    import antinode
    plate = antinode.load("examples/small.toml")
    bands = plate.bands()
    bands.plot()

Heavy libraries are imported only when a computation needs them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from antinode.plate import AntinodeWarning, Plate, load
    from antinode.sweeps import SweepTable, open, sweep
    from pipeline.case.schema import (
        Air,
        Array,
        BandPath,
        Damping,
        Finger,
        Patches,
        Pillar,
        Scatter,
        Section,
        Solve,
        Zone,
    )
    from pipeline.errors import InputError
    from pipeline.models.answer_parts import ModeRecord as Mode
    from pipeline.models.answer_parts import TargetRecord as Target
    from pipeline.questions.attenuation import AttenuationResult as Attenuation
    from pipeline.questions.bands import BandsResult as Bands
    from pipeline.questions.broadband import BroadbandResult as Broadband
    from pipeline.questions.crosstalk import CrosstalkResult as Crosstalk
    from pipeline.questions.drift import DriftResult as Drift
    from pipeline.questions.hybrid import HybridResult as Hybrid
    from pipeline.questions.modes import ModesResult as Modes
    from pipeline.questions.predesign import PredesignResult as Predesign
    from pipeline.questions.response import ResponseResult as Response
    from pipeline.questions.search import SearchResult as Search
    from pipeline.questions.tolerance import ToleranceResult as Tolerance
    from pipeline.questions.touch import TouchResult as Touch
    from pipeline.questions.travel import TravelResult as Travel
    from solvers.errors import SolverError

TABLES = ("Air", "Array", "BandPath", "Damping", "Finger", "Patches", "Pillar", "Scatter", "Section", "Solve", "Zone")
ANSWERS = (  # results of questions
    *("Attenuation", "Bands", "Broadband", "Crosstalk", "Drift", "Hybrid", "Modes", "Predesign", "Response"),
    *("Search", "Tolerance", "Touch", "Travel"),
)
HOMES = {  # module of each public name, and its name there
    **dict.fromkeys(("AntinodeWarning", "Plate", "load"), "antinode.plate"),
    **dict.fromkeys(("SweepTable", "open", "sweep"), "antinode.sweeps"),
    **dict.fromkeys(TABLES, "pipeline.case.schema"),
    **{name: f"pipeline.questions.{name.lower()}:{name}Result" for name in ANSWERS},
    **{name: f"pipeline.models.answer_parts:{name}Record" for name in ("Mode", "Target")},
    "InputError": "pipeline.errors",
    "SolverError": "solvers.errors",
}
__all__ = ["Plate", "load", "open", "sweep"]  # in the order of use, as the reference lists them
__all__ += ["Modes", "Predesign"]
__all__ += ["Attenuation", "Bands", "Broadband", "Crosstalk", "Drift", "Hybrid", "Response"]
__all__ += ["Search", "Tolerance", "Touch", "Travel"]
__all__ += ["Mode", "SweepTable", "Target"]
__all__ += ["Array", "Patches", "Pillar", "Section", "Solve", "Zone"]
__all__ += ["Air", "BandPath", "Damping", "Finger", "Scatter"]
__all__ += ["AntinodeWarning", "InputError", "SolverError", "__version__"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("antinode")
    if name not in HOMES:
        from difflib import get_close_matches

        near = get_close_matches(name, __all__, n=1)
        hint = f" (did you mean {near[0]}?)" if near else ""
        raise AttributeError(f"module 'antinode' has no attribute {name!r}{hint}")
    home, _, own = HOMES[name].partition(":")
    return getattr(import_module(home), own or name)


def __dir__() -> list[str]:
    return sorted(__all__)
