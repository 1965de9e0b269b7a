"""What a plate's computations return: frozen results with units in their names, pictures, tables and documents."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.quantity import figure, frequency
from pipeline.records.part import Frozen
from pipeline.units import KHZ

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pipeline.records.record import (
        HybridMethod,
        LoadedModeRecord,
        PeakRecord,
        SampleRecord,
        TouchStateRecord,
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


class Touch(Result):
    """A finger on the driven plate: one dictionary a state, amplitudes in m, powers in W, friction over that at rest.

    `plate.with_(touch=Finger(radius_mm=5.0)).touch()` computes one; here is what it holds.

    >>> import antinode
    >>> antinode.Touch({"states": [{"state": "touched", "finger_m": 2e-7}]}).states["touched"].finger_m
    2e-07
    """

    kind = "touch"
    _dimensions = ("state",)

    @property
    def states(self) -> dict[str, TouchStateRecord]:
        """Every state by its name: free, touched, retuned, held, shaped; what cannot be is not there."""
        return {state["state"]: typed("TouchStateRecord", state) for state in self._document["states"]}

    @property
    def mode(self) -> LoadedModeRecord | None:
        """The wanted mode under the finger: frequencies in Hz, quality factor, share; None where none is left."""
        mode: LoadedModeRecord | None = typed("LoadedModeRecord", self._document["mode"])
        return mode

    def __repr__(self) -> str:
        moved = {name: (state.finger_m, state.finger_error_m) for name, state in self.states.items()}
        amplitudes = ", ".join(
            f"{name} {figure(1e6 * size, None if error is None else 1e6 * error)} um"
            for name, (size, error) in moved.items()
        )
        return f"<antinode.Touch: {amplitudes}>"


class Hybrid(Result):
    """Rows and patches together over frequency: levels in dB and V for 1 um of neither, rows, patches and both.

    `plate.hybrid()` computes one; here is what it holds.

    >>> import antinode
    >>> method = {"method": "rows", "confinement_db": [14.6]}
    >>> antinode.Hybrid({"frequency_hz": [34.8e3], "methods": [method]}).methods["rows"].confinement_db
    [14.6]
    """

    kind = "hybrid"
    _dimensions = ("frequency_hz",)

    frequencies_hz = column("frequency_hz", doc="Frequencies (points,) in Hz.")

    @property
    def methods(self) -> dict[str, HybridMethod]:
        """Every method by its name: neither, rows, patches, both; lists over the frequencies, dB and V for 1 um."""
        return {method["method"]: typed("HybridMethod", method) for method in self._document["methods"]}

    def __repr__(self) -> str:
        return f"<antinode.Hybrid: {len(self.frequencies_hz)} frequencies, {', '.join(self.methods)}>"


class Travel(Result):
    """A wave that travels inside the zone: two modes held a quarter period apart; fields and powers for 1 um rms there.

    `plate.travel()` computes one; here is what it holds.

    >>> import antinode
    >>> antinode.Travel({"x_m": [0.0], "field_m": [[0.0, 1e-6]], "twr": 0.6, "frequency_hz": 14e3}).field_m
    array([0.+1.e-06j])
    """

    kind = "travel"
    _dimensions = ("x_m",)

    x_m = column("x_m", doc="Places along the zone's centre line (points,) in m.")

    @property
    def field_m(self) -> Any:
        """u_z there, complex (points,) in m."""
        return np.array([complex(*each) for each in self._document["field_m"]])

    @property
    def twr(self) -> float:
        """Travelling-wave ratio: 1 travels, 0 stands."""
        return float(self._document["twr"])

    def __repr__(self) -> str:
        tone = frequency(self._document["frequency_hz"], self._document.get("frequency_error"))
        return f"<antinode.Travel: {tone}, travelling-wave ratio {figure(self.twr, self._document.get('twr_error'))}>"


KINDS: dict[str, type[Result]] = {
    kind.kind: kind
    for kind in (
        Response,
        Tolerance,
        Touch,
        Hybrid,
        Travel,
    )
}
