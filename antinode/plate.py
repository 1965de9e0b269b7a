"""A plate: one case and the questions that can be computed for it."""

from __future__ import annotations

import copy
import sys
import warnings
from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from pipeline.case import schema
from pipeline.case.limits import warn_of_doubts
from pipeline.case.model import Case, case_from_dict
from pipeline.case.reading import apply_overrides, check_exclusive, nearest, read_toml
from pipeline.case.schema import TABLES
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.questions import registered
from pipeline.questions.active import ActiveBeam, ActiveMason, ActivePillar, ActiveShaping
from pipeline.questions.active_dq import ActiveDq
from pipeline.questions.attenuation import Attenuation, MeshAttenuation
from pipeline.questions.bands import Bands, MeshBands, SupercellBands
from pipeline.questions.broadband import Broadband, MeshBroadband
from pipeline.questions.command import asks, numpydoc
from pipeline.questions.crosstalk import Crosstalk
from pipeline.questions.drift import Drift
from pipeline.questions.hybrid import Hybrid
from pipeline.questions.modes import MeshModes, Modes
from pipeline.questions.predesign import Predesign
from pipeline.questions.question import Pair, ask
from pipeline.questions.response import MeasuredResponse, Response, SyntheticResponse
from pipeline.questions.search import Goal, Search, SearchResult
from pipeline.questions.tolerance import AlikeTolerance, Tolerance
from pipeline.questions.touch import Touch
from pipeline.questions.travel import PlayedTravel, Travel
from pipeline.records.part import Frozen
from pipeline.search.terms import End, Range

OWN = ("antinode", "pipeline", "solvers", "geometry", "contextlib")
FILES = {"file", "sweep", "map"}  # keys of a case that name a file
OneTable = TypeVar("OneTable", bound=schema.Table)


class Plate(Frozen):
    """A touch plate with its active zone, pillars and settings; immutable, `with_` returns a changed copy.

    Every question is a method: `predesign`, `modes`, `bands`, `response` and so on.

    Parameters
    ----------
    name : str
        Name of the case.
    material : str or dict
        Material by its name, or by young_GPa, density_kg_m3 and poisson.
    thickness_mm : float, optional
        Thickness of the plate in mm.
    zone, pillar, array, solve, bands, damping, air, patches, tolerance, touch : optional
        Tables of a case file, as Zone, Pillar, Array, Solve, BandPath, Damping, Air, Patches, Scatter, Finger or plain
        dictionaries, in the units of their keys.
    materials : dict, optional
        Materials of groups of a mesh file, for `mesh_modes`, `mesh_bands`, `mesh_attenuation` and `mesh_broadband`.

    Raises
    ------
    InputError
        With one line for every fault of the case.

    Examples
    --------
    >>> from antinode import Plate, Zone
    >>> plate = Plate(thickness_mm=2.0, zone=Zone(length_mm=115.5, width_mm=20.0, nodal_lines=8))
    >>> round(plate.predesign().zone_hz / 1e3, 1)
    34.0
    """

    def __init__(
        self,
        *,
        name: str = "plate",
        material: schema.GivenMaterial = "aluminium",
        thickness_mm: float | None = None,
        zone: schema.Zone | dict[str, Any] | None = None,
        pillar: schema.Pillar | dict[str, Any] | None = None,
        array: schema.Array | dict[str, Any] | None = None,
        solve: schema.Solve | dict[str, Any] | None = None,
        bands: schema.BandPath | dict[str, Any] | None = None,
        damping: schema.Damping | dict[str, Any] | None = None,
        air: schema.Air | dict[str, Any] | None = None,
        patches: schema.Patches | dict[str, Any] | None = None,
        tolerance: schema.Scatter | dict[str, Any] | None = None,
        touch: schema.Finger | dict[str, Any] | None = None,
        materials: dict[str, schema.GivenMaterial] | None = None,
    ) -> None:
        plate = {"thickness_mm": thickness_mm} if thickness_mm else None
        given: dict[str, Any] = {"name": name, "material": material, "plate": plate}
        given |= {"zone": zone, "pillar": pillar, "array": array, "solve": solve, "bands": bands}
        given |= {"damping": damping, "air": air, "patches": patches, "tolerance": tolerance, "touch": touch}
        given |= {"materials": materials}
        self._bind({key: plain(value) for key, value in given.items() if value is not None}, None)

    def _bind(self, raw: dict[str, Any], source: Path | None) -> None:
        self._raw, self._source = raw, source
        self._case = case_from_dict(raw, source)

    @classmethod
    def _of(cls, raw: dict[str, Any], source: Path | None) -> Plate:
        plate = cls.__new__(cls)
        plate._bind(raw, source)
        return plate

    @property
    def case(self) -> Case:
        """The validated case, in SI units."""
        return self._case

    @property
    def source(self) -> Path | None:
        """Path of the case file, None for a plate built in Python."""
        return self._source

    @property
    def name(self) -> str:
        """The name of the case."""
        return self._case.name

    @property
    def zone(self) -> schema.ZoneTable:
        """Keys of the table [zone] with their defaults, as attributes in the units of the file.

        >>> import antinode
        >>> antinode.load("examples/small.toml").zone.width_mm
        20.0
        """
        return self._table("zone", schema.ZoneTable)

    @property
    def pillar(self) -> Any:
        """Keys of the table [pillar] with their defaults, as attributes in the units of the file.

        >>> import antinode
        >>> antinode.load("examples/small.toml").pillar.height_mm
        6.3
        """
        return self._table("pillar", TABLES["pillar"])

    @property
    def array(self) -> schema.ArrayTable:
        """Keys of the table [array] with their defaults, as attributes in the units of the file.

        >>> import antinode
        >>> antinode.load("examples/small.toml").with_(rows=2).array.rows
        2
        """
        return self._table("array", schema.ArrayTable)

    def _table(self, name: str, model: type[OneTable]) -> OneTable:
        """Return a table of the case. Raises InputError if the case lacks it or has several of it."""
        given = self._raw.get(name)
        if not isinstance(given, dict):
            missing = "missing" if given is None else "one of several: to_dict() has them"
            raise InputError(f"{self.name}: [{name}]: {missing}")
        return model.model_construct(**given)

    def with_(self, **changes: Any) -> Plate:
        """Return a copy of the plate with changed keys.

        Parameters
        ----------
        **changes : object
            Keys with their new values: the last part of a key if only one table has it, else table__key. The name of a
            table replaces the whole table; None removes it.

        Returns
        -------
        Plate
            The changed plate.

        Raises
        ------
        InputError
            For an unknown or ambiguous name, or an invalid value.

        Examples
        --------
        >>> from antinode import Damping, load
        >>> other = load("examples/small.toml").with_(pitch_mm=5.0, damping=Damping(quality=200.0))
        >>> other.to_dict()["array"]["pitch_mm"], other.to_dict()["damping"]
        (5.0, {'quality': 200.0})
        """
        return Plate._of(changed(self._raw, changes), self._source)

    def to_dict(self) -> dict[str, Any]:
        """Return a copy of the case's tables, in the units of the case file.

        Returns
        -------
        dict
            Tables by name, each a dictionary of its keys.

        Examples
        --------
        >>> import antinode
        >>> antinode.load("examples/small.toml").to_dict()["plate"]
        {'thickness_mm': 2.0}
        """
        return copy.deepcopy(self._raw)

    predesign = asks(Predesign)
    modes = asks(Modes)
    mesh_modes = asks(MeshModes)
    bands = asks(Bands)
    mesh_bands = asks(MeshBands)
    supercell_bands = asks(SupercellBands)
    attenuation = asks(Attenuation)
    mesh_attenuation = asks(MeshAttenuation)
    broadband = asks(Broadband)
    mesh_broadband = asks(MeshBroadband)
    response = asks(Response)
    measured_response = asks(MeasuredResponse)
    synthetic_response = asks(SyntheticResponse)
    tolerance = asks(Tolerance)
    alike_tolerance = asks(AlikeTolerance)
    crosstalk = asks(Crosstalk)
    drift = asks(Drift)
    touch = asks(Touch)
    hybrid = asks(Hybrid)
    travel = asks(Travel)
    played_travel = asks(PlayedTravel)
    active_mason = asks(ActiveMason)
    active_pillar = asks(ActivePillar)
    active_beam = asks(ActiveBeam)
    active_shaping = asks(ActiveShaping)
    active_dq = asks(ActiveDq)

    def search(
        self,
        *,
        goal: Goal = "confinement",
        evaluations: int = 16,
        min_frequency_kHz: float | None = None,
        target_kHz: Pair | None = None,
        max_half_wavelength_mm: float = 20.0,
        min_feature_mm: float = 0.4,
        mac: float = 0.8,
        min_isolation_dB: float | None = None,
        verify_with: Literal["plate", "solid"] = "plate",
        progress: bool | None = None,
        **ranges: tuple[End, End],
    ) -> SearchResult:
        options = {name: value for name, value in locals().items() if name in Search.options}
        vary = tuple(Range.between(key_of(name, self._raw), plain(ends)) for name, ends in ranges.items())
        return ask(self._case, Search(vary=vary, **options), self._log(progress))

    search.__doc__ = numpydoc(
        Search,
        "vary",
        "**ranges : tuple\n    Keys to vary, as in `with_`, each with two ends in the unit of the key or two choices.",
    )

    def explore(
        self, path: str | Path | None = None, *, port: int = 0, browser: bool = True, progress: bool | None = None
    ) -> None:
        """Open the explorer, a page that recomputes the design at once while its sizes in mm are dragged.

        Preparing its reduced bases takes some minutes the first time; they are stored and used again.

        Parameters
        ----------
        path : str or Path, optional
            Write a single file that needs no server; by default the page is served until interrupted.
        port : int
            Port on the loopback address of this machine; 0 picks a free one.
        browser : bool
            Whether to open the page in the browser.
        progress : bool, optional
            Whether to report progress on standard error; by default in a terminal or a notebook.

        Raises
        ------
        InputError
            If the case lacks a plate, a zone or a square pillar.

        Examples
        --------
        >>> from pathlib import Path
        >>> from tempfile import mkdtemp
        >>> from antinode import load
        >>> page = Path(mkdtemp()) / "page.html"
        >>> load("examples/small.toml").explore(page)
        >>> "numbers-of-model" in page.read_text()
        True
        """
        from pipeline.cli import explore

        explorer = explore.explorer_of(self._case, self._raw, (), self._log(progress))
        if path is not None:
            explore.export(explorer, Path(path), self._log(progress))
            return
        from pipeline.explore.server import Server, serve

        serve(Server(explorer), port, lambda address: explore.opened(address, browser))

    def export(
        self,
        form: Literal[
            "stl", "step", "3mf", "vtu", "paraview", "xdmf", "driven", "phonopy", "uff", "impedance", "table"
        ],
        path: str | Path | None = None,
        *,
        progress: bool | None = None,
    ) -> list[Path]:
        """Write files for CAD, printing and other programs, as `antinode export` does.

        Parameters
        ----------
        form : str
            Format: stl, step and 3mf are the plate in mm; vtu the target mode, paraview and xdmf every mode; driven one
            period of the driven plate at its peak, for ParaView; phonopy the bands; uff the frequency responses;
            impedance that of the patches; table the mode table of the board.
        path : str or Path, optional
            File to write; by default named after the case, in the current folder.
        progress : bool, optional
            Whether to log progress on standard error; by default in a terminal.

        Returns
        -------
        list of Path
            The files written.

        Raises
        ------
        InputError
            If the case lacks a table that the format needs, or the file cannot be written.

        Examples
        --------
        >>> import antinode, tempfile
        >>> plate = antinode.load("examples/small.toml", rows=0)
        >>> [file.name for file in plate.export("step", f"{tempfile.mkdtemp()}/plate.step")]
        ['plate.step']
        """
        from pipeline.exchange import exports

        if form not in exports.ENDINGS:
            raise InputError(
                f"form = {form!r}: must be one of {', '.join(exports.ENDINGS)}{nearest(str(form), exports.ENDINGS)}"
            )
        return exports.write(self._case, form, None if path is None else str(path), self._log(progress), option="path")

    def save(self, path: str | Path) -> Path:
        """Write the case file of the plate; files that it names are named by their whole paths.

        Parameters
        ----------
        path : str or Path
            File to write, .toml; replaced if there is one.

        Returns
        -------
        Path
            The file written.

        Raises
        ------
        InputError
            If the file cannot be written, or its name does not end in .toml.

        Examples
        --------
        >>> import antinode, tempfile
        >>> plate = antinode.load("examples/small.toml", pitch_mm=5.0)
        >>> antinode.load(plate.save(f"{tempfile.mkdtemp()}/wide.toml")) == plate
        True
        """
        import tomli_w

        from pipeline.records.outputs import check_files, write_file

        if Path(path).suffix != ".toml":
            raise InputError(f"path = {path}: must end in .toml")
        check_files("path", [str(path)])
        write_file(Path(path), tomli_w.dumps(portable(self)).encode())
        return Path(path)

    def view(self, path: str | Path | None = None, *, solve: bool = True, progress: bool | None = None) -> None:
        """Show the plate, in mm, and its target mode in three dimensions, as `antinode view` does.

        Parameters
        ----------
        path : str or Path, optional
            Write a picture: .png at the largest displacement, .gif over one period; by default a window opens.
        solve : bool, optional
            Whether to compute the target mode and its neighbours; otherwise the plate is shown at rest.
        progress : bool, optional
            Whether to log progress on standard error; by default in a terminal.

        Raises
        ------
        InputError
            If the case has no plate or no mode of the target shape, or the file cannot be written.
        NotAvailable
            If there is neither a file nor a display.

        Examples
        --------
        >>> import antinode, tempfile
        >>> from PIL import Image
        >>> file = f"{tempfile.mkdtemp()}/plate.png"
        >>> antinode.load("examples/small.toml").view(file, solve=False)
        >>> Image.open(file).size
        (800, 400)
        """
        from pipeline.cli import view

        place = None if path is None else str(path)
        view.check_place(place, "path")
        scene = view.of_case(self._case, solve, self._log(progress))
        view.show(scene) if place is None else view.draw(scene, Path(place))

    def _log(self, progress: bool | None) -> TerminalLog:
        """Return the log of a computation, after warning of implausible values of the case."""
        log = log_of(progress)
        warn_of_doubts(self._case.design, log)
        return log

    if not TYPE_CHECKING:  # questions defined in other modules are found by name

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_") or name not in registered():
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}{self._elsewhere(name)}")
            return asks(registered()[name]).__get__(self)

        def __dir__(self) -> list[str]:
            return sorted({*super().__dir__(), *registered()})

        def _elsewhere(self, name: str) -> str:
            """Where a table or a key of the case is found, or the attribute that was meant."""
            if name in TABLES:
                return f": to_dict()[{name!r}] has it" if name in self._raw else f": the case has no table [{name}]"
            if held := [table for table in TABLES if name in (self._raw.get(table) or ())]:
                return f": to_dict()[{held[0]!r}][{name!r}] has it"
            return nearest(name, [each for each in dir(self) if not each.startswith("_")])

    def _repr_html_(self) -> str:
        """Text and labelled sketch of the plate for a notebook; text alone without a zone."""
        from pipeline.records.record import DesignRecord
        from pipeline.report.gallery import sketch

        words = f"<p>{escape(repr(self))}</p>"
        if not {"plate", "zone"} <= self._case.given:
            return words
        return f'{words}<div style="max-width: 30rem">{sketch(DesignRecord.of_design(self._case.design))}</div>'

    def __repr__(self) -> str:
        tables = ", ".join(key for key in self._raw if key in TABLES)
        return f"<antinode.Plate {self.name!r}: {tables}>"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Plate) and self._case.to_dict() == other._case.to_dict()

    def __hash__(self) -> int:
        return hash(repr(self._case.to_dict()))


def load(path: str | Path, **overrides: Any) -> Plate:
    """Read a case file.

    Parameters
    ----------
    path : str or Path
        The case file (TOML).
    **overrides : object
        Changed keys, as in `Plate.with_`.

    Returns
    -------
    Plate
        The plate of the case.

    Raises
    ------
    InputError
        With one line for every fault of the file.

    Examples
    --------
    >>> from antinode import load
    >>> load("examples/small.toml", rows=2).to_dict()["array"]["rows"]
    2
    """
    file = Path(path)
    return Plate._of(changed(read_toml(file), overrides), file)


def changed(raw: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a case with keys or whole tables changed, as in Plate.with_."""
    tables = {name: value for name, value in changes.items() if name in TABLES and not isinstance(value, str)}
    kept = {key: value for key, value in raw.items() if key not in tables}
    whole = kept | {name: plain(value) for name, value in tables.items() if value is not None}
    pairs = [(key_of(name, whole), plain(value)) for name, value in changes.items() if name not in tables]
    check_exclusive(pairs, "keywords")
    return apply_overrides(whole, pairs)


def portable(plate: Plate) -> dict[str, Any]:
    """Return the tables of a plate with whole paths of the files that they name, for a case file in any folder."""
    raw, here = plate.to_dict(), plate.source.parent if plate.source else Path()
    for table in (each for each in raw.values() if isinstance(each, dict)):
        table.update({key: str((here / table[key]).resolve()) for key in FILES & table.keys()})
    return raw


def plain(value: Any) -> Any:
    """Convert a value to the types of a parsed case file: tuples and arrays to lists, numpy scalars to numbers; drop None."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items() if item is not None}
    return [plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def key_of(name: str, tables: Iterable[str] = ()) -> str:
    """Return the dotted key of a keyword; if several tables have the key, that of the table in the case (`tables`)."""
    if "__" in name:
        return name.replace("__", ".")
    if name in ("material", "name"):
        return name
    owners = [table for table, schema in TABLES.items() if name in schema.model_fields]
    here = [table for table in owners if table in tables] if len(owners) > 1 else owners
    if len(here) == 1:
        return f"{here[0]}.{name}"
    if owners:
        listed = ", ".join(f"{owner}__{name}" for owner in owners)
        raise InputError(f"{name}: several tables have this key; write one of {listed}")
    known = sorted({field for schema in TABLES.values() for field in schema.model_fields})
    raise InputError(f"{name}: no such key{nearest(name, known)}")


class AntinodeWarning(UserWarning):
    """Warning of a computation whose numbers need care; the message is the warning's id, a colon and its text.

    Examples
    --------
    >>> import antinode, warnings
    >>> with warnings.catch_warnings(record=True) as seen:
    ...     warnings.simplefilter("always", antinode.AntinodeWarning)  # "error" would stop the script
    ...     modes = antinode.load("examples/small.toml", accuracy=0.1).modes((20.0, 21.0), part="pillar")
    >>> str(seen[0].message).partition(" lies")[0]
    'NO_MODES: no mode of the pillar'
    """


class _Log(TerminalLog):
    """Progress on standard error, warnings as Python warnings."""

    def warning(self, id: str, text: str) -> None:
        level, frame = 1, sys._getframe(0)
        while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in OWN:
            level, frame = level + 1, frame.f_back
        warnings.warn(f"{id}: {text}", AntinodeWarning, stacklevel=level)  # at the caller's line


def log_of(progress: bool | None) -> TerminalLog:
    """Return a log that shows progress if asked; None shows it in a terminal or a notebook."""
    shown = sys.stderr.isatty() or "ipykernel" in sys.modules if progress is None else progress
    return _Log(quiet=not shown)
