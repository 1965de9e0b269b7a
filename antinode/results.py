"""What a plate's computations return: frozen results with units in their names, pictures, tables and documents."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from antinode.tables import Frozen
from geometry.elements import FloatArray
from pipeline.quantity import level, signed
from pipeline.units import KHZ

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pipeline.records.record import (
        PeakRecord,
        SampleRecord,
    )

KIND = "kind"


def values(document: dict[str, Any], name: str, of: str = "") -> FloatArray:
    """A figure of a document, or of each item of a list in it, as an array; NaN for what has no value."""
    return np.array([each.get(name) for each in document[of]] if of else document[name], dtype=float)


def column(name: str, of: str = "", *, doc: str) -> Any:
    """The property of a result that is a figure of its document."""
    return property(lambda result: values(result._document, name, of), doc=doc)


def typed(kind: str, figures: dict[str, Any] | None) -> Any:
    """A part of a document as the frozen class of records that has its fields; None for None."""
    from pipeline.records import record

    return None if figures is None else getattr(record, kind).model_construct(**copy.deepcopy(figures))


class Result(Frozen):
    """A document as `--json` writes it, and what can be done with it."""

    kind = ""
    _dimensions: tuple[str, ...] = ("row",)

    def __init__(self, document: dict[str, Any]) -> None:
        self._document = {"schema": 1, **document, KIND: self.kind}

    def to_dict(self) -> dict[str, Any]:
        """The JSON document, with the case and the version that it answers."""
        return copy.deepcopy(self._document)

    def save(self, path: str | Path) -> Path:
        """Write the document as JSON, whole or not at all; `antinode.open` reads it back."""
        from pipeline.records.outputs import write_file

        write_file(Path(path), (json.dumps(self._document, indent=1, allow_nan=False) + "\n").encode())
        return Path(path)

    def _rows(self) -> list[dict[str, Any]]:
        """Rows of plain values, the columns of the command line's tables."""
        from pipeline.views.rows import ROWS

        return list(ROWS[self.kind](self._document))

    def to_dataframe(self) -> Any:
        """The rows as a pandas DataFrame, units in the column names. Raises ImportError without pandas."""
        from pipeline.records.frames import frame

        return frame(self._rows())

    def to_xarray(self) -> Any:
        """The rows as an xarray Dataset over this result's dimensions, `units` in the attributes.

        Raises ImportError without pandas and xarray (`pip install 'antinode[tables]'`).
        """
        from pipeline.records.frames import dataset

        rows = self._rows()
        numbered = [{self._dimensions[0]: index, **row} for index, row in enumerate(rows)]
        return dataset(rows if rows and self._dimensions[0] in rows[0] else numbered, self._dimensions)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw into matplotlib axes (new ones where none are given) and return them."""
        from pipeline.views import figures

        drawn: Axes = figures.draw(self.kind, self._document, ax)
        return drawn

    def _repr_html_(self) -> str:
        """The result in words and its figure, for a notebook."""
        import base64
        import io
        from html import escape

        out, words = io.BytesIO(), escape(repr(self))
        self.plot().figure.savefig(out, format="png", dpi=110, bbox_inches="tight")  # type: ignore[union-attr]
        data = base64.b64encode(out.getvalue()).decode()
        return f'<p>{words}</p><img alt="{words}" src="data:image/png;base64,{data}">{self._rows_html()}'

    def _rows_html(self) -> str:
        """Rows that a notebook shows beneath the picture; none for curves."""
        return ""


class Response(Result):
    """Forced response to the patches, per volt: arrays (points,), in Hz and m/V; more points about each peak.

    >>> import antinode
    >>> patch = antinode.Patches(material="pz26", size_mm=(8.0, 3.0, 0.3), centres_mm=[(0.0, 0.0)])
    >>> driven = antinode.load("examples/small.toml", accuracy=0.1, patches=patch).response((33.0, 36.0), points=5)
    >>> driven.zone_rms_m_per_V.shape == driven.frequency_hz.shape, 33e3 < driven.wanted_peak.frequency_hz < 36e3
    (True, True)
    """

    kind = "response"
    _dimensions = ("frequency_hz",)

    frequency_hz: FloatArray = column("frequency_hz", doc="Frequencies (points,) in Hz.")
    zone_rms_m_per_V: FloatArray = column(
        "zone_rms_m_per_V", doc="Rms of u_z on the active touch face (points,) in m/V."
    )

    @property
    def passive_rms_m_per_V(self) -> FloatArray | None:
        """Rms of u_z on the passive touch face (points,) in m/V; None without one."""
        name = "passive_rms_m_per_V"
        return None if self._document[name] is None else values(self._document, name)

    @property
    def wanted_peak(self) -> PeakRecord | None:
        """The wanted mode's peak, None without one: frequency_hz, zone_rms_m_per_V, confinement_db, quality_factor."""
        peak: PeakRecord | None = typed("PeakRecord", self._document.get("wanted_peak"))
        return peak

    def __repr__(self) -> str:
        f = self.frequency_hz / KHZ
        return f"<antinode.Response: {len(f)} frequencies from {f[0]:g} to {f[-1]:g} kHz>"


class Tolerance(Result):
    """How far peak and confinement of the response move when no two pillars are alike: one dictionary a plate, Hz and dB.

    `plate.with_(tolerance=Scatter(height_mm=0.05, samples=20)).tolerance()` computes one; here is what it holds.

    >>> import antinode
    >>> antinode.Tolerance({"samples": [{"peak_hz": 34.45e3, "confinement_db": 11.5}]}).samples[0].confinement_db
    11.5
    """

    kind = "tolerance"
    _dimensions = ("sample",)

    @property
    def samples(self) -> tuple[SampleRecord, ...]:
        """Each plate: peak_hz, zone_rms (m/V or m/N), confinement_db, quality_factor, tracking."""
        return tuple(typed("SampleRecord", each) for each in self._document["samples"])

    def __repr__(self) -> str:
        return f"<antinode.Tolerance: {len(self.samples)} samples>"


class Search(Result):
    """What a search found: the best design beside the one it started from, every evaluation as a row; dB, Hz, mm, kg.

    `plate.search(height_mm=(5.0, 8.0))` computes one; here is what it holds.

    >>> import antinode
    >>> best = {"set": {"pillar.height_mm": 6.6}, "confinement_db": 13.0}
    >>> search = antinode.Search({"best": best, "gain_db": 1.9, "goal": "confinement", "evaluations": []})
    >>> search.best_values, search.gain_db
    ({'pillar.height_mm': 6.6}, 1.9)
    """

    kind = "search"
    _dimensions = ("evaluation",)

    def __init__(self, document: dict[str, Any], start: Any = None) -> None:
        super().__init__(document)
        self._start = start

    @property
    def best_values(self) -> dict[str, float | str]:
        """Values of the varied keys in the best design, in the file's units, or words."""
        return dict(self._document["best"]["set"])

    @property
    def best(self) -> Any:
        """The best design as a Plate. Raises ValueError for a search that was read from a file."""
        if self._start is None:
            raise ValueError("this search was read from a file: apply best_values to its plate with with_")
        from pipeline.case.overrides import apply_overrides, parse_override

        varied = {name.partition("[")[0] for name in self.best_values}
        settings = [parse_override(text) for text in self._document["repeat"] if text.partition("=")[0] in varied]
        return self._start._of(apply_overrides(self._start.to_dict(), settings), self._start.source)

    @property
    def gain_db(self) -> float | None:
        """What the goal gained over the first design, dB; None where one has no wanted mode, or the goal is no level."""
        return self._document["gain_db"]

    @property
    def tradeoff(self) -> tuple[dict[str, Any], ...]:
        """Designs that no other beats in goal, frequency and mass at once, the best first."""
        return tuple(copy.deepcopy(self._document["tradeoff"]))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the goal over the varied keys into matplotlib axes (new ones where none are given) and return them."""
        from pipeline.plots import style
        from pipeline.search.plots import over_keys

        with style.style():
            drawn: Axes = style.panels(3.6)[1] if ax is None else ax
            over_keys(drawn, self._document)
            return drawn

    def __repr__(self) -> str:
        gain = "" if self.gain_db is None else f", {signed(level(self.gain_db))}"
        return f"<antinode.Search: {len(self._document['evaluations'])} evaluations, best {self.best_values}{gain}>"


KINDS: dict[str, type[Result]] = {
    kind.kind: kind
    for kind in (
        Response,
        Tolerance,
        Search,
    )
}
