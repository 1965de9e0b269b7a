"""`antinode view`: what it shows, and what it says where there is nothing to show it on."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path

import meshio
import numpy as np
import pytest

from pipeline import paths
from pipeline.case.model import load_case
from pipeline.cli import main, view
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.plots import rendering
from tests.helpers import synthetic

ROOT = Path(__file__).resolve().parents[3]
CASE = str(ROOT / "studies" / "three-rows.toml")


def outcome(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, list[str]]:
    code = main.main(["view", *arguments])
    return code, capsys.readouterr().err.splitlines()


@pytest.fixture
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)


@pytest.mark.parametrize("target", [CASE, "rows"])
def test_without_a_display_it_says_what_to_do_instead(
    target: str, no_display: None, capsys: pytest.CaptureFixture[str]
) -> None:
    code, lines = outcome(capsys, target)
    assert code == 5 and len(lines) == 1 and "DISPLAY" in lines[0] and "antinode report" in lines[0]


@pytest.mark.parametrize(
    ("name", "said"), [(":4711", "no display responds"), ("nonsense", "must be like"), ("", "has no DISPLAY")]
)
def test_a_display_is_asked_before_it_is_believed(name: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", name)
    assert said in view.display_fault()


def test_a_display_that_listens_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        monkeypatch.setattr(view, "_places", lambda host, number: [listening.getsockname()])
        monkeypatch.setenv("DISPLAY", "localhost:10.0")
        assert view.display_fault() == ""


@pytest.mark.parametrize("target", ["nothing.vtu", "nothing.toml", "rowz"])
def test_what_is_not_there_is_wrong_input_with_or_without_a_display(
    target: str, no_display: None, capsys: pytest.CaptureFixture[str]
) -> None:
    code, lines = outcome(capsys, target)
    assert code == 2 and len(lines) == 1 and target in lines[0]


@pytest.mark.slow
def test_a_study_shows_its_best_plate_or_the_one_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synthetic.put_study(tmp_path / "rows", pitches=(0.004,), rows=(1, 2))
    monkeypatch.setattr(paths, "RESULTS", tmp_path)
    best = view.of_study("rows")
    assert (
        best.title == "pitch_mm=4,rows=2" and "target" in best.shapes[0][0] and best.reach == pytest.approx(0.4 * 6.3)
    )
    assert np.ptp(best.points[:, 0]) == pytest.approx(115.5)  # mm
    assert view.of_study("rows", "pitch_mm=4,rows=1").title == "pitch_mm=4,rows=1"
    with pytest.raises(InputError, match="must be one of pitch_mm=4,rows=1"):
        view.of_study("rows", "pitch_mm=5")
    with pytest.raises(InputError, match="rows=1: the mesh has a cell with a negative Jacobian"):
        view.of_study("rows", "pitch_mm=12,rows=1")
    with pytest.raises(InputError, match="has no plate to show"):
        view.of_study("extremes")
    monkeypatch.setattr(paths, "RESULTS", tmp_path / "none")
    with pytest.raises(InputError, match="run it first"):
        view.of_study("rows")


def test_a_vtu_file_shows_its_surface_and_its_vectors(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    points = np.array([[x, y, z] for z in (0.0, 0.01) for y in (0.0, 0.01) for x in (0.0, 0.02)])
    cells = [("hexahedron", np.array([[0, 1, 3, 2, 4, 5, 7, 6]]))]
    path = tmp_path / "block.vtu"
    meshio.Mesh(points, cells, {"displacement": points, "level": points[:, 0]}).write(path)
    scene = view.of_vtu(path)
    assert [name for name, _ in scene.shapes] == ["displacement"] and np.ptp(scene.points[:, 0]) == pytest.approx(20.0)
    assert scene.facets.shape == (12, 3)
    (tmp_path / "bad.vtu").write_text("<VTKFile")
    with pytest.raises(InputError, match=r"bad.vtu"):
        view.of_vtu(tmp_path / "bad.vtu")
    assert capfd.readouterr().err == ""  # nothing of VTK's own complaints


@pytest.mark.slow
def test_a_moving_shape_is_drawn_into_a_file_without_a_window(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_display: None, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two pictures of a period: up and down differ; nothing half-written where the graphics library cannot."""
    from PIL import Image

    synthetic.put_study(tmp_path / "rows", pitches=(0.004,), rows=(1,))
    monkeypatch.setattr(paths, "RESULTS", tmp_path)
    assert outcome(capsys, "rows", "--off-screen", str(tmp_path / "a.jpg")) == (
        2, [f"antinode: --off-screen = {tmp_path / 'a.jpg'}: must end in .png or .gif"])  # fmt: skip
    with monkeypatch.context() as broken:
        broken.setattr(rendering, "drawn_apart", lambda draw, *given: ([], "no graphics library"))
        code, lines = outcome(capsys, "rows", "--off-screen", str(tmp_path / "a.gif"))
        assert code == 5 and "no graphics library" in lines[0] and not (tmp_path / "a.gif").exists()
    code = main.main(["view", "rows", "--off-screen", str(tmp_path / "a.gif")])
    said = capsys.readouterr()
    if code == 5:
        pytest.skip(f"this machine draws nothing off-screen: {said.err}")
    assert said.out == f"wrote {tmp_path / 'a.gif'}\n"
    with Image.open(tmp_path / "a.gif") as film:
        assert (code, film.n_frames, film.size) == (0, view.STEPS, view.SIZE)
        frames = []
        for number in (0, view.STEPS // 2):
            film.seek(number)
            frames.append(np.asarray(film.convert("RGB"), dtype=float))
    assert np.abs(frames[1] - frames[0]).mean() > 1.0


def test_a_case_shows_its_solid() -> None:
    scene = view.of_case(load_case(CASE, ["array.rows=1"]), False, TerminalLog(quiet=True))
    assert scene.shapes == [] and np.ptp(scene.points[:, 0]) == pytest.approx(115.5, abs=1e-3)
    assert np.ptp(scene.points[:, 2]) == pytest.approx(2.0 + 6.3, abs=1e-3)


@pytest.mark.slow
def test_a_window_opens_and_moves_on_a_virtual_display(tmp_path: Path) -> None:
    server = shutil.which("Xvfb")
    if not server:
        pytest.skip("no virtual display on this machine (Debian package xvfb)")
    synthetic.put_study(tmp_path / "rows", pitches=(0.004,), rows=(1,))
    script = (
        "import pyvista as pv\nfrom pipeline.cli.main import main\n"
        "real = pv.Plotter.show\n"
        "def show(self, **more):\n"
        "    real(self, interactive_update=True, auto_close=False)\n"
        "    mesh = self.mesh; first = mesh.points.copy()\n"
        "    for _ in range(20): self.update(20)\n"
        "    print('moved', abs(mesh.points - first).max())\n"
        "    self.screenshot('window.png'); self.close()\n"
        "pv.Plotter.show = show\nraise SystemExit(main(['view', 'rows']))\n"
    )
    with subprocess.Popen([server, ":87", "-screen", "0", "800x600x24"], stderr=subprocess.DEVNULL) as virtual:
        try:
            env = {**os.environ, "DISPLAY": ":87", "ANTINODE_RESULTS": str(tmp_path), "PYTHONPATH": str(ROOT)}
            for _ in range(100):
                if view._answers("/tmp/.X11-unix/X87"):
                    break
                time.sleep(0.1)
            done = subprocess.run([sys.executable, "-c", script], env=env, cwd=tmp_path, capture_output=True, text=True)
        finally:
            virtual.terminate()
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[-1]) > 0.1  # mm
    from PIL import Image

    with Image.open(tmp_path / "window.png") as image:
        assert np.asarray(image).std() > 5
