"""`antinode view`: show a plate and its modes in a window, if there is a display."""

from __future__ import annotations

import logging
import os
import re
import socket
import sys
import tempfile
import warnings
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from geometry.decimation import closed_surface
from pipeline.case.model import Case, load_case
from pipeline.errors import InputError, NotAvailable
from pipeline.logs import TerminalLog
from pipeline.plots import rendering, style
from pipeline.plots.fields import FloatArray, IntArray, skin_faces
from pipeline.quantity import MM, frequency
from pipeline.records import outputs, store
from pipeline.records.record import DesignRecord
from pipeline.records.study import StoredCase, read_study

MAX_SHAPES = 7  # shapes of a plate: the target mode and its neighbours
DRAWN = 0.4  # largest displacement as first drawn, relative to the pillars' height (the thickness without pillars)
PERIOD_MS, FRAME_MS = 1600, 40
KEYS = "space plays and pauses, n shows the next shape, up and down change the amplitude"
PICTURES, SIZE, STEPS = (".png", ".gif"), (800, 400), 16  # file endings, pixels, and frames per period
TOWARDS, AROUND = (1.0, -1.6, 1.3), 1.08  # from the body to the eye; half a picture over half of the body drawn
COLOURS = 64  # in a .gif
BAR = 0.14  # of a picture's height: the scale of colours
SCALE = {"title": "u_z / largest", "n_labels": 3, "fmt": "%g", "width": 0.3, "position_x": 0.66, "position_y": 0.02,
         "title_font_size": 24, "label_font_size": 22}  # fmt: skip
LETTERS = 13  # points: they stay readable in a picture half as wide
NO_DISPLAY_HINT = "`antinode report STUDY` writes a page with animated shapes for a browser"


@dataclass(frozen=True)
class Scene:
    """Content of a window: points (n, 3) in mm, facets, and named shapes (n, 3) that move the points; `reach` in mm."""

    title: str
    points: FloatArray
    facets: IntArray
    shapes: list[tuple[str, FloatArray]] = field(default_factory=list)
    reach: float = 1.0


def view(arguments: Namespace) -> int:
    """Show a case, a VTU file or the best confined plate of a study. Raises NotAvailable without a display."""
    kind, place = _kind(arguments.target), arguments.off_screen
    check_place(place)
    if kind == "file":
        scene = of_vtu(Path(arguments.target))
    elif kind == "case":
        scene = of_case(load_case(arguments.target, arguments.set), arguments.solve, TerminalLog(arguments.quiet))
    else:
        scene = of_study(arguments.target, arguments.case_id, arguments.results)
    if place:
        draw(scene, Path(place))
        print(f"wrote {place}")
    else:
        show(scene)
    return 0


def check_place(place: str | None, option: str = "--off-screen") -> None:
    """Raise InputError if a scene cannot be drawn into a file, NotAvailable if there is neither a file nor a display."""
    if place and Path(place).suffix.lower() not in PICTURES:
        raise InputError(f"{option} = {place}: must end in {' or '.join(PICTURES)}")
    if place:
        outputs.check_files(option, [place])
    elif missing := display_fault():
        raise NotAvailable(f"view: {missing}; without a window, --off-screen FILE.png draws one, and {NO_DISPLAY_HINT}")


def _kind(target: str) -> str:
    """Classify the target as a mesh file, a case or a study. Raises InputError for anything else."""
    from pipeline.batch.study_file import find_study
    from pipeline.case.reading import nearest_file, read_toml

    if Path(target).suffix == ".vtu":
        if not Path(target).is_file():
            raise InputError(f"{target}: no such file{nearest_file(Path(target))}")
        return "file"
    path = find_study(target)
    return "study" if "study" in read_toml(path) else "case"


def display_fault() -> str:
    """Return '' or the reason why no window can be opened: Linux needs a responding X server."""
    if not sys.platform.startswith("linux"):
        return ""
    name = os.environ.get("DISPLAY", "")
    if not name:
        return "no display (the environment has no DISPLAY)"
    match = re.fullmatch(r"(?:[a-z]+/)?([^:]*):(\d+)(?:\.\d+)?", name)
    if not match:
        return f"DISPLAY = {name}: must be like :0 or host:10.0"
    hostname, number = match[1], int(match[2])
    return (
        ""
        if any(_answers(place) for place in _places(hostname, number))
        else f"no display responds at DISPLAY = {name}"
    )


def _places(hostname: str, number: int) -> list[Any]:
    """Return the address of an X server: a local socket (abstract or in /tmp), or TCP."""
    if hostname in {"", "unix"}:
        return [f"\0/tmp/.X11-unix/X{number}", f"/tmp/.X11-unix/X{number}"]
    return [(hostname, 6000 + number)]


def _answers(place: Any) -> bool:
    family = socket.AF_UNIX if isinstance(place, str) else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_STREAM) as line:
            line.settimeout(3.0)
            line.connect(place)
    except OSError:
        return False
    return True


def of_study(target: str, case_id: str | None = None, results: str | None = None) -> Scene:
    """Return a stored case of a study with its modes; the best confined one unless named."""
    from pipeline.batch import study_file
    from pipeline.batch.script_study import load_script
    from pipeline.batch.study_file import find_study, load_study
    from pipeline.report import text

    if script := load_script(find_study(target)):
        raise InputError(f"{target}: {script.name} has no plate to show; antinode report {script.name} writes its page")
    location = load_study(target)
    try:
        study = read_study(study_file.stored_folder(location.name, location.source, results))
    except store.BadRecord as error:
        raise InputError(f"{target}: no stored results; run it first: antinode run {target}") from error
    names = [case.case_id for case in study.cases]
    if case_id is not None and case_id not in names:
        raise InputError(f"--case = {case_id}: must be one of {', '.join(names[:12])}")
    case = study.cases[names.index(case_id)] if case_id else text.best_case(study)
    if case is None:
        raise InputError(f"{target}: none of its cases has a target mode")
    return _stored(case)


def _stored(case: StoredCase) -> Scene:
    arrays, errors = case.read_arrays()
    if skin_faces(arrays, "surface") is None or "surface_u" not in arrays:
        why = "its record contains no mode shapes; add modes to the study's measures and run it again"
        raise InputError(errors or f"{case.case_id}: {why if case.record.answered else case.record.diagnosis}")
    return of_arrays(case.case_id, arrays, case.record.design)


def of_arrays(title: str, arrays: dict[str, Any], design: DesignRecord | None) -> Scene:
    """Build the scene from the mode shapes that a study stores."""
    facets, points = skin_faces(arrays, "surface"), np.asarray(arrays["surface_points"], dtype=float)
    assert facets is not None
    kept, triangles = closed_surface(points, facets, design.thickness_m if design else None)
    tones = arrays.get("surface_frequency_hz", np.zeros(len(arrays["surface_u"])))
    shapes = [
        (f"{frequency(float(tone))}{', target' if number == 0 else ''}", np.asarray(shape[kept], dtype=float))
        for number, (tone, shape) in enumerate(zip(tones, arrays["surface_u"], strict=True))
    ]
    tall = MM if design is None else design.pillar.top_m if design.pillar else design.thickness_m
    return Scene(title, points[kept] / MM, triangles, shapes, DRAWN * tall / MM)


def of_case(case: Case, solve: bool, log: TerminalLog) -> Scene:
    """Build the scene of a case with CAD; solved, its target mode and the neighbouring modes."""
    from pipeline.case.features import LARGER, OF_A_PLATE, OUTLINE, PLACES, SUPPORTS
    from pipeline.case.limits import warn_of_doubts
    from pipeline.models import mode_fields, modes
    from pipeline.models.mode_fields import nearest_rows

    warn_of_doubts(case.design, log)
    case.refuse("view", (LARGER, PLACES, OUTLINE, SUPPORTS) if solve else OF_A_PLATE)
    case.require_plate("view")
    if not solve:
        return _solid(case, log)
    part_modes = modes.solve_modes(case, modes.Request("plate", symmetry=case.target_symmetry), log)
    part_modes = part_modes.whole_window
    index = part_modes.index(part_modes.target.row) if part_modes.target else None
    if index is None:
        raise InputError(f"{case.name}: no mode of the plate has the target shape; antinode modes lists its modes")
    arrays = mode_fields.plate_arrays(part_modes, nearest_rows(part_modes, index)[:MAX_SHAPES])
    return of_arrays(case.name, arrays, DesignRecord.of_design(case.design))


def _solid(case: Any, log: TerminalLog) -> Scene:
    import pyvista as pv

    from geometry.cad import printing, solids

    with log.step("build the solid"), tempfile.TemporaryDirectory(prefix="antinode-view-") as folder:
        path = Path(folder) / "plate.stl"
        printing.write_stl(solids.plate_solid(case.design), path, case.name)
        surface = pv.read(path)
    return Scene(case.name, np.asarray(surface.points, dtype=float), np.asarray(surface.regular_faces))


def of_vtu(path: Path) -> Scene:
    """Read the outer surface of a VTU file in metres; every three-component point field is a shape."""
    import pyvista as pv

    with _hushed():
        try:
            mesh = pv.read(path)
        except Exception as error:  # VTK's readers raise exceptions of any type
            raise InputError(f"{path}: cannot be read as a VTU file ({type(error).__name__}: {error})") from error
        if not isinstance(mesh, pv.UnstructuredGrid) or not mesh.n_cells:
            raise InputError(f"{path}: no cells could be read; must be a VTU file, an unstructured grid with cells")
        surface = mesh.extract_surface(nonlinear_subdivision=0).triangulate()
    names = [name for name in surface.point_data if np.shape(surface.point_data[name]) == (surface.n_points, 3)]
    shapes = [(name, np.asarray(surface.point_data[name], dtype=float)) for name in names]
    points = np.asarray(surface.points, dtype=float) / MM
    return Scene(
        path.name, points, np.asarray(surface.regular_faces), shapes, 0.05 * float(np.ptp(points, axis=0).max())
    )


@contextmanager
def _hushed() -> Iterator[None]:
    """Capture VTK's many lines on standard error about a faulty file and report one line instead."""
    from vtkmodules.vtkCommonCore import vtkLogger

    level = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    logging.disable(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(logging.NOTSET)
        vtkLogger.SetStderrVerbosity(level)


def show(scene: Scene) -> None:
    """Open the window and wait until it is closed."""
    plotter, motion = _staged(scene)
    if motion:
        motion.start()
    plotter.show()


def draw(scene: Scene, place: Path) -> None:
    """Draw a scene into a file without a window. Raises NotAvailable if the graphics library cannot."""
    from PIL import Image

    film = place.suffix.lower() == ".gif" and bool(scene.shapes)
    pixels, fault = rendering.drawn_apart(_frames, replace(scene, shapes=scene.shapes[:1]), STEPS if film else 1)
    if fault:
        raise NotAvailable(f"--off-screen: {fault}; {NO_DISPLAY_HINT}")
    first, *others = (Image.fromarray(each) for each in pixels)
    if others:  # one palette, without dithering: colours do not flicker and the file stays small
        both = Image.new("RGB", (SIZE[0], 2 * SIZE[1]))  # the two ends of the motion
        both.paste(first, (0, 0))
        both.paste(others[STEPS // 2 - 1], (0, SIZE[1]))
        palette = both.quantize(COLOURS, method=Image.Quantize.FASTOCTREE)
        first, *others = (
            each.quantize(COLOURS, palette=palette, dither=Image.Dither.NONE) for each in (first, *others)
        )
    more: dict[str, Any] = {"save_all": True, "append_images": others, "duration": PERIOD_MS // STEPS, "loop": 0}
    with outputs.delivered(place) as temporary:
        first.save(temporary, place.suffix[1:], **(more if others else {}))


def _frames(scene: Scene, count: int) -> list[Any]:
    """Run `draw` in the child process: one picture at the largest displacement, or the frames of a period."""
    plotter, motion = _staged(scene, off_screen=True, window_size=list(SIZE))
    frames = []
    for step in range(count):
        if motion:
            motion.at(step / STEPS * PERIOD_MS)
        frames.append(np.asarray(plotter.screenshot(None, return_img=True)))
    plotter.close()
    return frames


def _staged(scene: Scene, **window: Any) -> tuple[Any, _Motion | None]:
    """Return a plotter with the scene and camera, and its animation; None for a body without shapes."""
    import pyvista as pv

    mesh = pv.PolyData.from_regular_faces(scene.points, scene.facets.astype(int))  # type: ignore[arg-type]
    plotter = pv.Plotter(title=f"antinode view: {scene.title}", **window)
    plotter.set_background("white")  # type: ignore[arg-type]
    motion = None
    if scene.shapes:
        mesh["u_z"] = scene.shapes[0][1][:, 2]
        plotter.add_mesh(mesh, scalars="u_z", cmap=style.SIGNED, clim=(-1.0, 1.0), scalar_bar_args=SCALE)
        motion = _Motion(plotter, mesh, scene, "" if window else f"\n{KEYS}")
    else:
        plotter.add_mesh(mesh, color=rendering.PLAIN_COLOUR, show_edges=False)
    plotter.add_axes()  # type: ignore[call-arg]
    plotter.enable_parallel_projection()  # type: ignore[call-arg]
    plotter.view_vector(TOWARDS, viewup=(0, 0, 1))  # type: ignore[arg-type]
    if window:
        _fit(plotter.camera, scene.points, motion)
    return plotter, motion


def _fit(camera: Any, points: FloatArray, motion: _Motion | None) -> None:
    """Centre a drawn body, at rest and in its largest motions, in the picture, and fill it."""
    reach = motion.reach * motion.shape if motion else np.zeros_like(points)
    places = np.concatenate([points, points - reach, points + reach])
    right = np.cross((0.0, 0.0, 1.0), TOWARDS)
    axes = np.array([right, np.cross(TOWARDS, right), TOWARDS])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    low, high = (end(places @ axes.T, axis=0) for end in (np.min, np.max))
    across, up, _ = (high - low) / 2.0
    bar = BAR if motion else 0.0  # at the lower end: the body is drawn above it
    camera.parallel_scale = AROUND * max(up / (1.0 - bar), across * SIZE[1] / SIZE[0])
    middle = ((low + high) / 2.0 - [0.0, bar * camera.parallel_scale, 0.0]) @ axes
    camera.position = tuple(middle + np.array(camera.position) - np.array(camera.focal_point))
    camera.focal_point = tuple(middle)


class _Motion:
    """Animation of a window's mesh: space plays and pauses, n is the next shape, up and down the amplitude."""

    def __init__(self, plotter: Any, mesh: Any, scene: Scene, keys: str) -> None:
        self.plotter, self.mesh, self.scene, self.keys = plotter, mesh, scene, keys
        self.playing, self.number, self.reach, self.time_ms = True, 0, scene.reach, 0.0
        self._take(0)

    def start(self) -> None:
        """Connect keys and a timer to the animation."""
        self.plotter.add_key_event("space", self._toggle)
        self.plotter.add_key_event("n", lambda: self._take(self.number + 1))
        self.plotter.add_key_event("Up", lambda: self._scale(1.25))
        self.plotter.add_key_event("Down", lambda: self._scale(0.8))
        self.plotter.add_timer_event(max_steps=10**9, duration=FRAME_MS, callback=self._step)

    def at(self, time_ms: float) -> None:
        """Draw the shape at one time."""
        self.time_ms = time_ms
        self._draw()

    def _take(self, number: int) -> None:
        self.number = number % len(self.scene.shapes)
        name, shape = self.scene.shapes[self.number]
        self.shape = shape / max(float(np.abs(shape).max()), 1e-300)
        self.level = self.shape[:, 2] / max(float(np.abs(self.shape[:, 2]).max()), 1e-300)
        self.plotter.add_text(f"{self.scene.title}: {name}{self.keys}", font_size=LETTERS, color="black", name="title")
        self._draw()

    def _toggle(self) -> None:
        self.playing = not self.playing

    def _scale(self, factor: float) -> None:
        self.reach *= factor
        self._draw()

    def _step(self, _: int) -> None:
        if self.playing:
            self.time_ms += FRAME_MS
            self._draw()

    def _draw(self) -> None:
        now = np.cos(2.0 * np.pi * self.time_ms / PERIOD_MS)
        self.mesh.points = self.scene.points + now * self.reach * self.shape
        self.mesh["u_z"] = now * self.level
        self.plotter.render()
