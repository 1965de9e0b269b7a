"""What a plate's computations return: frozen results with units in their names, pictures, tables and documents."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from antinode.tables import Frozen
from geometry.elements import FloatArray
from pipeline.quantity import figure, frequency, interval, level, signed
from pipeline.units import KHZ

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pipeline.analysis.modes import PartModes
    from pipeline.case.model import Case
    from pipeline.records.record import (
        GapRecord,
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
        from antinode.frames import frame

        return frame(self._rows())

    def to_xarray(self) -> Any:
        """The rows as an xarray Dataset over this result's dimensions, `units` in the attributes.

        Raises ImportError without pandas and xarray (`pip install 'antinode[tables]'`).
        """
        from antinode.frames import dataset

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


@dataclass(frozen=True)
class Wanted:
    """The verdict on the wanted mode: status is single, split or none; with none, frequency and levels are None.

    Frequency in Hz, MAC and strength from 0 to 1, confinement in dB as a mode (driven_confinement_db is None: `response`
    has the driven one at its wanted_peak); rivals of a split mode as dictionaries of the same figures.

    >>> import antinode
    >>> antinode.Wanted("single", 34.6e3, 0.97, 0.62, 12.1, None, ()).confinement_db
    12.1
    """

    status: str
    frequency_hz: float | None
    mac: float | None
    strength: float | None
    confinement_db: float | None
    driven_confinement_db: float | None
    rivals: tuple[dict[str, float], ...]


@dataclass(frozen=True)
class Mode:
    """One mode: frequency in Hz, symmetry class (SS, SA, AS, AA or None), measures (None without meaning), relative error.

    `mac`, `zone_share` and `strength` run from 0 to 1, `confinement_db` is in dB, `error` the half-width of the frequency's
    error bar over the frequency, `confinement_error_db` that of the level's in dB; the other errors are those of their measure.

    >>> import antinode
    >>> mode = antinode.load("examples/small.toml", accuracy=0.1).modes(part="pillar", count=1)[0]
    >>> 38e3 < mode.frequency_hz < 41e3, mode.to_pyvista()["displacement"].shape[1]
    (True, 3)
    """

    frequency_hz: float
    symmetry: str | None
    mac: float | None
    zone_share: float | None
    confinement_db: float | None
    strength: float | None
    residual: float
    error: float | None
    _owner: Modes = field(repr=False, compare=False)
    confinement_error_db: float | None = None
    zone_share_error: float | None = None
    mac_error: float | None = None
    strength_error: float | None = None

    def to_pyvista(self) -> Any:
        """The closed outer surface of the whole body in m, with `displacement` (points, 3) of unit modal mass as point data.

        Raises ValueError for modes that were read from a file: their shapes are not in it.
        """
        return self._owner._surface(self)


class Modes(Result, Sequence[Mode]):
    """Modes in ascending order, proven complete by a count; a sequence of Mode, arrays of shape (modes,).

    >>> import antinode
    >>> pillar = antinode.load("examples/small.toml", accuracy=0.02).modes(part="pillar", count=2)
    >>> len(pillar), round(pillar[0].frequency_hz, -2)
    (2, 39100.0)
    """

    kind = "modes"
    _dimensions = ("mode",)

    def __init__(self, document: dict[str, Any], solved: PartModes | None = None, case: Case | None = None) -> None:
        super().__init__(document)
        self._solved, self._case = solved, case

    @cached_property
    def _modes(self) -> tuple[Mode, ...]:
        names = [each.name for each in fields(Mode) if not each.name.startswith("_")]
        return tuple(Mode(**{name: mode.get(name) for name in names}, _owner=self) for mode in self._document["modes"])

    error: FloatArray = column(
        "error",
        "modes",
        doc="Half-width of each frequency's error bar (modes,), relative; NaN where none was calibrated.",
    )
    frequency_hz: FloatArray = column("frequency_hz", "modes", doc="Frequencies (modes,) in Hz.")

    @property
    def wanted(self) -> Wanted | None:
        """The verdict on the wanted mode; None for a part or symmetry class that has none."""
        verdict = self._document.get("wanted")
        if verdict is None:
            return None
        keys = ("status", "frequency_hz", "mac", "strength", "confinement_db", "driven_confinement_db")
        return Wanted(**{key: verdict.get(key) for key in keys}, rivals=tuple(verdict.get("rivals") or ()))

    @property
    def rigid_count(self) -> int:
        """Rigid-body modes, which are counted and not listed."""
        return int(self._document["rigid_count"])

    @overload
    def __getitem__(self, index: int) -> Mode: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Mode, ...]: ...
    def __getitem__(self, index: int | slice) -> Mode | tuple[Mode, ...]:
        return self._modes[index]

    def __len__(self) -> int:
        return len(self._modes)

    def __iter__(self) -> Iterator[Mode]:
        return iter(self._modes)

    def __repr__(self) -> str:
        ends = [(mode.frequency_hz, mode.error) for mode in (self[0], self[-1])] if len(self) else []
        span = f", {interval(*(hz for hz, _ in ends), *(error for _, error in ends))}" if ends else ""
        return f"<antinode.Modes of the {self._document.get('part', 'plate')}: {len(self)}{span}>"

    def to_pyvista(self, mode: int | Mode | None = None) -> Any:
        """The closed surface of a mode, by its number or itself, in m as Mode.to_pyvista gives it; None: of the wanted mode.

        Raises ValueError where no mode is the wanted one, and for modes that were read from a file.
        """
        if mode is None:
            at = self.wanted.frequency_hz if self.wanted else None
            if at is None:
                raise ValueError("none of these modes is the wanted one: name a mode by its number")
            mode = int(np.argmin(np.abs(self.frequency_hz - at)))
        return (self[mode] if isinstance(mode, int) else mode).to_pyvista()

    def _rows_html(self) -> str:
        from antinode.frames import html_table
        from pipeline.records.reading import filled

        levels = ("zone_share", "confinement_db", "confinement_error_db", "mac", "strength")
        names = ("frequency_hz", "error", "symmetry", *levels, "zone_share_error", "mac_error", "strength_error")
        wanted = self.wanted.frequency_hz if self.wanted else None
        shown = filled(names, [[getattr(mode, name) for name in names] for mode in self])
        return html_table(*shown, [i for i, mode in enumerate(self) if mode.frequency_hz == wanted])

    def _surface(self, mode: Mode) -> Any:
        if self._solved is None or self._case is None:
            raise ValueError("these modes were read from a file, which holds no shapes: compute them again")
        from antinode.surfaces import closed_surface

        return closed_surface(self._solved, self._case, self._modes.index(mode))


class Bands(Result):
    """Bloch bands along a path: frequencies (points, bands) in Hz, wavevectors (points, 2) in rad/m.

    >>> import antinode
    >>> bands = antinode.load("examples/small.toml", accuracy=0.02, bands__points=2, bands__count=4).bands()
    >>> bands.frequencies_hz.shape, bands.labels[0]
    ((7, 4), 'G')
    """

    kind = "bands"
    _dimensions = ("point", "band")

    def _rows(self) -> list[dict[str, Any]]:
        """One row a wavevector and band, the wavevectors numbered."""
        rows, bands = super()._rows(), len(self._document["points"][0]["frequencies_hz"])
        return [{"point": index // bands, **row} for index, row in enumerate(rows)]

    frequencies_hz: FloatArray = column("frequencies_hz", "points", doc="Frequencies (points, bands) in Hz.")
    computed_hz: FloatArray = column("computed_hz", "points", doc="Frequencies (points, bands) of the mesh itself, Hz.")

    @property
    def wavevectors_per_m(self) -> FloatArray:
        """Wavevectors (points, 2) in rad/m."""
        return np.column_stack([values(self._document, f"k{axis}_per_m", "points") for axis in "xy"])

    @property
    def labels(self) -> tuple[str | None, ...]:
        """G, X, M, Y or None, one a point."""
        return tuple(point["label"] for point in self._document["points"])

    @property
    def gaps(self) -> tuple[GapRecord, ...]:
        """Complete gaps along the path: band numbers from 1, edges in Hz, relative half-widths of the edges' bars."""
        return tuple(typed("GapRecord", gap) for gap in self._document["gaps"])

    error: FloatArray = column(
        "error", "points", doc="Half-width of the error bars (points, bands), relative; NaN where none was calibrated."
    )

    @property
    def distance_per_m(self) -> FloatArray:
        """Distance along the path (points,) in rad/m."""
        from solvers.waves.brillouin import Path

        return Path(self.wavevectors_per_m, self.labels).arc

    def __repr__(self) -> str:
        points, bands = self.frequencies_hz.shape
        gaps = f"{len(self.gaps)} complete gap{'s' * (len(self.gaps) != 1)}"
        return f"<antinode.Bands: {bands} bands at {points} wavevectors, {gaps}>"


def _over(result: Result, f: FloatArray) -> str:
    """What a result over frequency is, in a few words."""
    return f"<antinode.{type(result).__name__}: {len(f)} frequencies from {f[0] / KHZ:g} to {f[-1] / KHZ:g} kHz>"


class Attenuation(Result):
    """Decay per row across the zone's border over frequency: arrays (points,), in Hz and dB.

    >>> import antinode
    >>> waves = antinode.load("examples/small.toml", accuracy=0.1).attenuation((30.0, 34.0), points=3)
    >>> waves.frequency_hz.tolist(), waves.db_per_row.shape, round(waves.kx_per_m)
    ([30000.0, 32000.0, 34000.0], (3,), 196)
    """

    kind = "attenuation"
    _dimensions = ("frequency_hz",)

    frequency_hz: FloatArray = column("frequency_hz", "points", doc="Frequencies (points,) in Hz.")
    db_per_row: FloatArray = column(
        "db_per_row",
        "points",
        doc="Decay per row (points,) in dB of the least attenuated flexural wave; NaN where there is none.",
    )

    @property
    def kx_per_m(self) -> float:
        """Wavenumber along the zone, rad/m."""
        return float(self._document["kx_per_m"])

    def __repr__(self) -> str:
        return _over(self, self.frequency_hz)


class Broadband(Result):
    """What the rows hold over frequency: arrays (points,) in Hz and dB, of one column of cells at the wanted wavenumber.

    >>> import antinode
    >>> held = antinode.load("examples/small.toml", accuracy=0.1).broadband((30.0, 36.0), points=3)
    >>> held.frequency_hz.tolist(), held.confinement_db.shape
    ([30000.0, 33000.0, 36000.0], (3,))
    """

    kind = "broadband"
    _dimensions = ("frequency_hz",)

    frequency_hz: FloatArray = column("frequency_hz", "points", doc="Frequencies (points,) in Hz.")
    confinement_db: FloatArray = column(
        "confinement_db",
        "points",
        doc="Confinement (points,) in dB of the motion that the wanted shape's pressure forces.",
    )

    @property
    def stopped_hz(self) -> list[tuple[float, float]]:
        """Intervals in Hz in which the rows let at most a tenth of a flexural wave's power through."""
        return [(low, high) for low, high in self._document["stopped"]]

    def __repr__(self) -> str:
        return _over(self, self.frequency_hz)


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
        return _over(self, self.frequency_hz)


class Predesign(Result):
    """Analytic sizing of zone and pillar: frequencies in Hz, lengths in mm.

    >>> import antinode
    >>> sizes = antinode.load("examples/small.toml").predesign()
    >>> round(sizes.zone_hz / 1e3, 1), round(sizes.pillar_height_mm, 1)
    (33.5, 7.0)
    """

    kind = "predesign"
    _dimensions = ("part", "quantity")

    @property
    def zone_hz(self) -> float:
        """Frequency of the wanted mode of the bare zone by pre-design, Hz."""
        return float(self._document["zone"]["frequency_hz"])

    @property
    def half_wavelength_mm(self) -> float:
        """Half a wavelength along the zone, mm."""
        return float(self._document["zone"]["half_wavelength_mm"])

    @property
    def pillar_height_mm(self) -> float | None:
        """Height at which the pillar resonates at the zone's frequency, mm; None without a pillar."""
        return None if self._document.get("pillar") is None else float(self._document["pillar"]["height_mm"])

    @property
    def limits(self) -> tuple[Any, ...]:
        """What speaks against the design."""
        return tuple(self._document["limits"])

    def __repr__(self) -> str:
        height = "" if self.pillar_height_mm is None else f", pillar {figure(self.pillar_height_mm)} mm"
        return f"<antinode.Predesign: zone {frequency(self.zone_hz)}{height}>"


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


class Crosstalk(Result):
    """Several zones on one plate, each driven in turn: levels of all of them over the driven one's, dB.

    `plate.crosstalk()` computes one; here is what it holds.

    >>> import antinode
    >>> zones = [{"level_db": [0.0, -31.5]}, {"level_db": [-31.5, 0.0]}]
    >>> float(antinode.Crosstalk({"zones": zones, "shared_rows": 3}).level_db[0, 1])
    -31.5
    """

    kind = "crosstalk"
    _dimensions = ("driven", "measured")

    level_db = column("level_db", "zones", doc="Levels (driven zones, measured zones) in dB.")

    def __repr__(self) -> str:
        return f"<antinode.Crosstalk: {len(self.level_db)} zones>"


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
        Modes,
        Bands,
        Attenuation,
        Broadband,
        Response,
        Predesign,
        Tolerance,
        Touch,
        Hybrid,
        Travel,
        Crosstalk,
        Search,
    )
}
