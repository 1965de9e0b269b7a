import ctypes
import time

import numpy as np
import pytest

from pipeline.plots import rendering
from pipeline.plots.rendering import Surface

CUBE = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
FACES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
PLAIN, COLOURED = Surface(CUBE, FACES), Surface(CUBE, FACES, np.linspace(0, 1, 6), edges=True)


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(rendering, "_faults", [])


@pytest.mark.slow
def test_by_pyvista_or_with_the_reason_why_not():
    images, fault = rendering.render([PLAIN, COLOURED])
    assert len(images) == 2 and all(rendering.image_fault(image) == "" for image in images)
    if fault:
        pytest.skip(f"no off-screen rendering on this machine: {fault}")
    assert len(np.unique(images[0].reshape(-1, 3), axis=0)) > 3  # faces shaded apart
    assert images[1].astype(int).std(axis=2).max() > 20  # colours, not greys


def crash(surfaces: list[Surface]) -> None:
    ctypes.string_at(0)


def doze(surfaces: list[Surface]) -> None:
    time.sleep(60.0)


@pytest.mark.slow
def test_a_child_that_dies_of_a_segmentation_fault_is_survived(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(rendering, "_draw_all", crash)
    images, fault = rendering.render([PLAIN])
    assert "SIGSEGV" in fault and rendering.image_fault(images[0]) == ""
    monkeypatch.setattr(rendering, "drawn_apart", None)
    assert rendering.render([PLAIN])[1] == fault  # not tried again


@pytest.mark.slow
def test_pictures_are_drawn_by_one_kept_child():
    rendering.render([PLAIN])
    first = dict(rendering._child()._processes)
    rendering.render([COLOURED])
    assert first and rendering._child()._processes == first


def blank(surfaces: list[Surface]) -> list[np.ndarray]:
    return [np.full((80, 100, 3), 255, dtype=np.uint8)]


def test_an_empty_image_is_not_believed(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(rendering, "_draw_all", blank)
    images, fault = rendering.render([PLAIN])
    assert "empty" in fault and rendering.image_fault(images[0]) == ""


@pytest.mark.slow
def test_a_rendering_that_hangs_is_ended(monkeypatch: pytest.MonkeyPatch):
    rendering.render([PLAIN])  # the child is there
    (child,) = rendering._child()._processes.values()
    monkeypatch.setattr(rendering, "TIMEOUT_S", 0.01)
    monkeypatch.setattr(rendering, "_draw_all", doze)
    _, fault = rendering.render([PLAIN])
    assert "longer than 0.01 s" in fault and not child.is_alive()


def test_image_faults():
    assert "empty" in rendering.image_fault(np.full((9, 9, 3), 255, dtype=np.uint8))
    assert "empty" in rendering.image_fault(np.zeros((9, 9, 3), dtype=np.uint8))


def test_projection_by_hand_hides_what_is_behind():
    far, near = (
        np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]),
        np.array([[0.0, -1, 0], [1, -1, 0], [1, -1, 1], [0, -1, 1]]),
    )
    both = Surface(
        np.concatenate([near, far]), np.array([[0, 1, 2, 3], [4, 5, 6, 7]]), np.array([1.0, 0.0]), direction=(0, -1, 0)
    )
    alone = Surface(near, np.array([[0, 1, 2, 3]]), np.array([1.0]), direction=(0, -1, 0))
    one, two = rendering._by_hand(both), rendering._by_hand(alone)
    middle = tuple(size // 2 for size in one.shape[:2])
    np.testing.assert_array_equal(one[middle], two[middle])
