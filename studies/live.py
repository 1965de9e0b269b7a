"""Error of the parametric cell's bands relative to plain reductions of random designs, and the ratio of times.

    python -m studies.live [DESIGNS] [CASE]    a number of random designs
    python -m studies.live corners [CASE]      those of the corners of the box
    python -m studies.live plates N [CASE]     live answers next to assembled plates, N designs of the cloud, or of a study
    python -m studies.live picture [CASE]      docs/pictures/explore.gif: the page while its pillars grow, in Chromium

Each design is solved once from the bases and once as `antinode bands` would at accuracy 0.001, in one process, one after
the other. The bar counted is that of the bases and the mesh's together.
"""

from __future__ import annotations

import hashlib
import io
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from pipeline.case.model import Case, load_case
from pipeline.case.reading import read_toml
from pipeline.explore import offline
from pipeline.explore.answer import BATCH, Document, Explorer, Scene, compute
from pipeline.logs import TerminalLog, WarningLog
from pipeline.models.bands import row_cell
from pipeline.models.parametric import BANDS, CellModel, cell_model, with_sizes
from pipeline.models.unit_cell import lattice_model
from pipeline.paths import ROOT, STUDIES
from pipeline.planning.model_choice import cell_model_choice
from solvers.parametric.affine import Sizes, as_sizes
from solvers.parametric.bands import FLAT

ACCURACY, GOAL = 0.001, 0.003
FRAMES, PICTURE = 14, ROOT / "docs" / "pictures" / "explore.gif"
WIDE, TALL, COLOURS = 1152, 1000, 96  # pixels of its window, and colours
SPARE = 3  # designs of the cloud for each one asked for: some have no target mode
EVERY = 5  # wavevectors that the plain reduction solves
DRAW = 7  # seed of the drawn designs
PLATE = 0.01  # accuracy of assembled plates: their error bars count in addition to the live ones


@dataclass(frozen=True)
class Compared:
    """One design: relative differences (k, bands) from the plain reduction, the bar (bands,), seconds of each."""

    sizes: Sizes
    difference: FloatArray
    bar: FloatArray
    live_s: float
    plain_s: float


def compare(case: Case, model: CellModel, sizes: Sizes) -> Compared:
    """Both models of one design."""
    begin = time.perf_counter()
    live = model.bands(sizes)
    live_s = time.perf_counter() - begin
    chosen = model.bases.fractions[::EVERY] * np.pi / sizes[3]
    begin = time.perf_counter()
    varied = with_sizes(case, sizes, ACCURACY, BANDS)
    frequencies = _plain(varied, chosen)
    reduced_s = time.perf_counter() - begin
    reference = np.array([frequencies(k, BANDS) for k in chosen])
    plain_s = reduced_s + EVERY * (time.perf_counter() - begin - reduced_s)
    moving = reference > FLAT * reference.max()
    difference = np.where(moving, live.frequency_hz[::EVERY] / np.where(moving, reference, 1.0) - 1.0, 0.0)
    by_mesh = model.by_mesh(sizes)
    return Compared(sizes, difference, live.error + (0.0 if by_mesh is None else by_mesh), live_s, plain_s)


def _plain(case: Case, wavevectors: FloatArray) -> Callable[[FloatArray, int], FloatArray]:
    """The case's own reduction: so many frequencies at a wavevector."""
    choice = cell_model_choice(case)
    if case.design.stagger and choice.reduction:
        return row_cell(case.design, choice.reduction).frequencies
    return lattice_model(case, choice, wavevectors[[0, 5, 10]], WarningLog(), []).lattice.frequencies


def main(count: int | None, path: str) -> int:
    """Print one line per design, then a summary: of `count` random ones, or of the corners of the box."""
    case = load_case(path)
    model = cell_model(case, TerminalLog())
    box, rng = model.cell.box, np.random.default_rng(7)
    designs = as_sizes(box.sample(rng.random((count, 4)))) if count else box.spread(0)
    all_of_them = []
    for sizes in designs:
        one = compare(case, model, sizes)
        all_of_them.append(one)
        worst = np.abs(one.difference).max()
        text = ", ".join(f"{1e3 * size:.2f}" for size in sizes)
        outside = int((np.abs(one.difference) > one.bar + ACCURACY).sum())
        print(f"{text} mm: {worst:.3%} at most, bar {one.bar.max():.3%}, {outside} of {one.difference.size} outside, "
              f"{one.plain_s / one.live_s:.0f} times as fast", flush=True)  # fmt: skip
    good = sum(np.abs(one.difference).max() <= GOAL for one in all_of_them)
    outside = sum(int((np.abs(one.difference) > one.bar + ACCURACY).sum()) for one in all_of_them)
    values = sum(one.difference.size for one in all_of_them)
    ratio, live_s = (
        np.median(column) for column in zip(*((o.plain_s / o.live_s, o.live_s) for o in all_of_them), strict=True)
    )
    print(f"{good} of {len(designs)} designs within {GOAL:.1%}")
    print(f"{outside} of {values} values beyond bar and accuracy together")
    print(f"{ratio:.0f} times as fast as a plain reduction, {live_s:.3f} s (medians)")
    _whole(Explorer(Scene(case, read_toml(Path(path)), ()), model), case)
    return 0


def _whole(explorer: Explorer, case: Case) -> None:
    """The page's whole answer of the case itself, after one to warm up, and designs of its cloud."""
    assert case.design.pillar is not None
    explorer.document(case, {})
    begin, busy = time.perf_counter(), time.process_time()
    explorer.document(case, {})
    print(
        f"bands, decay and column: {time.perf_counter() - begin:.3f} s, {time.process_time() - busy:.3f} s of the processor"
    )
    busy = time.process_time()
    made = [point for first in range(0, 10 * BATCH, BATCH) for point in explorer.cloud(first, BATCH)]
    each = (time.process_time() - busy) / len(made)
    print(f"a design of the cloud: {each:.3f} s of the processor, {60.0 / each:.0f} a minute")


@dataclass(frozen=True)
class BesidePlate:
    """A live answer minus the assembled plate's, relative to the live frequency and in dB, both bars together, and whether a
    rival mode is near.

    Of several modes that the live answer names, the one nearest to the plate's counts. A plate that lacks the live mode is
    infinitely far off.
    """

    frequency: float
    level_db: float
    frequency_bar: float
    level_bar_db: float
    live_bar_db: float
    near: bool

    @classmethod
    def of(cls, live: Document, real: Document) -> BesidePlate:
        """Differences of both answers."""
        near = live["near_hz"] is not None
        if real.get("confinement_db") is None:
            return cls(np.inf, np.inf, live["frequency_error"], *2 * (live["confinement_error_db"],), near)
        every = [cls._of_mode(mode, real, near) for mode in (live, *live["others"])]
        return min(every, key=lambda one: one.ratios[0])

    @classmethod
    def _of_mode(cls, mode: Document, real: Document, near: bool) -> BesidePlate:
        """One of the modes that the live answer names against the plate's."""
        bars = mode["frequency_error"], mode["confinement_error_db"]
        ratio = real["frequency_hz"] / mode["frequency_hz"]
        off = 1.0 - ratio, mode["confinement_db"] - real["confinement_db"]
        own = [real.get(name) or 0.0 for name in ("frequency_error", "confinement_error_db")]
        return cls(*off, bars[0] + ratio * own[0], bars[1] + own[1], bars[1], near)

    @property
    def ratios(self) -> tuple[float, float]:
        """Frequency and level over their bars."""
        return abs(self.frequency) / self.frequency_bar, abs(self.level_db) / self.level_bar_db

    @property
    def within(self) -> bool:
        """Whether frequency and level lie within their bars."""
        return max(self.ratios) <= 1.0


def drawn(explorer: Explorer, count: int, sweep: dict[str, list[float]]) -> Iterator[dict[str, float]]:
    """The designs of a sweep over keys of the sliders, or `count` of the cloud, and some to spare."""
    names = {limit.key: name for name, limit in explorer.scene.limits.items()}
    if not sweep:
        every = explorer.cloud_designs  # steps through a low-discrepancy sequence would meet one corner of it
        yield from (every[at] for at in np.random.default_rng(DRAW).permutation(len(every))[: SPARE * count])
        return
    for values in product(*sweep.values()):
        yield explorer.scene.own() | {names[key]: float(value) for key, value in zip(sweep, values, strict=True)}


def plates(count: int, path: str) -> int:
    """Print the live mode's deviation from the plate's, one line per design, and how many lie within; 1 unless all do."""
    study = read_toml(Path(path))
    source = Path(path).parent / study["study"]["case"] if "study" in study else Path(path)
    case, raw = load_case(source), read_toml(source)
    explorer = Explorer(Scene(case, raw, ()), cell_model(case, TerminalLog()))
    assembled = Scene(case, raw, (f"solve.accuracy={PLATE}",))
    every: list[BesidePlate] = []
    for given in drawn(explorer, count, study.get("sweep", {})):
        live = explorer.answer(given)["plate"]
        if live.get("confinement_db") is None or len(every) == count:
            continue
        every.append(BesidePlate.of(live, compute(assembled, given, WarningLog())))
        print(_line(given, live, every[-1]), flush=True)
    print(summary(every))
    return 0 if all(one.within for one in every) else 1


def _line(given: dict[str, float], live: Document, one: BesidePlate) -> str:
    design = ", ".join(f"{name} {value:g}" for name, value in given.items())
    bars = f"+-{live['frequency_error']:.2%}, {live['confinement_db']:.1f} dB +-{live['confinement_error_db']:.1f}"
    others = "".join(f" or {each['frequency_hz']:.0f} Hz +-{each['frequency_error']:.2%}" for each in live["others"])
    said = f"{live['status']}{', a mode is near' if one.near else ''}"
    own = f"{design}: {live['frequency_hz']:.0f} Hz {bars}{others}, {said}"
    if not np.isfinite(one.frequency):
        return f"{own}; the plate has no such mode"
    return f"{own}; deviation {one.frequency:+.2%} and {one.level_db:+.2f} dB{'' if one.within else ', OUTSIDE'}"


def summary(every: list[BesidePlate]) -> str:
    """Number within their error bars, median error bar of the live levels away from resonances, and the worst of each."""
    tones, levels = (np.array([one.ratios for one in every]) <= 1.0).sum(axis=0)
    away = [one.live_bar_db for one in every if not one.near]
    lacking = sum(not np.isfinite(one.frequency) for one in every)
    found = [one for one in every if np.isfinite(one.frequency)]
    worst = [max((abs(getattr(one, name)) for one in found), default=np.nan) for name in ("frequency", "level_db")]
    ratios = np.max([one.ratios for one in found], axis=0) if found else np.full(2, np.nan)
    return (
        f"{tones} of {len(every)} frequencies and {levels} levels within their bars; {lacking} plates lack the mode\n"
        f"median bar of a level: {np.median(away) if away else np.nan:.2f} dB of {len(away)} plates away from a resonance\n"
        f"worst: {worst[0]:.2%} and {worst[1]:.2f} dB; {ratios[0]:.2f} and {ratios[1]:.2f} of a bar"
    )


def picture(path: str) -> None:
    """Write the moving picture of the documentation: the page in Chromium at FRAMES heights, there and back."""
    from PIL import Image, ImageOps
    from playwright.sync_api import sync_playwright

    case = load_case(path)
    explorer = Explorer(Scene(case, read_toml(Path(path)), ()), cell_model(case, TerminalLog()))
    heights = [round(float(height), 2) for height in np.linspace(5.0, 8.0, FRAMES)]
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        file = Path(folder) / "explorer.html"
        file.write_text(offline.page(explorer), encoding="utf-8")
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": WIDE, "height": TALL}, reduced_motion="reduce")
        tab.goto(file.as_uri())
        shots = [Image.open(io.BytesIO(_dragged(tab, height))).convert("RGB") for height in heights]
        browser.close()
    size = WIDE, max(shot.height for shot in shots)  # a split mode has more cards
    shots = [ImageOps.pad(shot, size, color="white", centering=(0.0, 0.0)) for shot in shots]
    palette = shots[-1].quantize(COLOURS)
    first, *rest = (shot.quantize(palette=palette, dither=Image.Dither.NONE) for shot in (*shots, *shots[-2:0:-1]))
    first.save(PICTURE, save_all=True, append_images=rest, duration=125, loop=0, comment=page_hash())
    print(PICTURE)


def _dragged(tab: Any, height: float) -> bytes:
    """A picture of the page once it has answered a height."""
    answered = "state.shown && !document.body.classList.contains('stale')"
    while not tab.evaluate(answered):  # the page's policy forbids the browser's own waiting
        tab.wait_for_timeout(50)
    tab.evaluate(
        "(height) => { $('height-range').value = height; $('height-range').dispatchEvent(new Event('input')); }", height
    )
    while not tab.evaluate(answered):
        tab.wait_for_timeout(50)
    top, bottom = tab.evaluate(
        "['design', 'bands'].map((id) => $(id).getBoundingClientRect()).flatMap((box) => [box.top, box.bottom])"
    )[::3]
    return bytes(tab.screenshot(clip={"x": 0, "y": top - 10, "width": WIDE, "height": bottom - top + 20}))


def page_hash() -> str:
    """Hash of the page's files, which the picture's comment holds."""
    return hashlib.sha256(b" ".join(path.read_bytes() for path in sorted(offline.PAGE.iterdir()))).hexdigest()


if __name__ == "__main__":
    words = sys.argv[1:]
    if words[:1] == ["plates"]:
        raise SystemExit(plates(int(words[1]), words[2] if len(words) > 2 else str(STUDIES / "three-rows.toml")))
    if words[:1] == ["picture"]:
        picture(words[1] if len(words) > 1 else str(STUDIES / "three-rows.toml"))
        raise SystemExit
    designs = None if words[:1] == ["corners"] else int(words[0]) if words else 100
    raise SystemExit(main(designs, words[1] if len(words) > 1 else str(STUDIES / "three-rows.toml")))
