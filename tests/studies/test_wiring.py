"""The wiring pictures and the page they are in: same pins everywhere, committed pictures as the script draws them."""

from __future__ import annotations

import re
from importlib import metadata
from xml.etree import ElementTree

import pytest

from solvers.shaping.voltages import filter_for
from studies import licences, wiring

PAGE = wiring.FOLDER.parent / "board" / "wiring.md"


@pytest.mark.parametrize("name", wiring.PICTURES)
def test_the_committed_picture_is_what_the_script_draws(name: str) -> None:
    pytest.importorskip("schemdraw", reason="schemdraw is not installed: pip install schemdraw")
    if metadata.version("schemdraw") != licences.locked()["schemdraw"]:
        pytest.skip("schemdraw is not of the version in constraints.txt: another one may draw otherwise")
    picture = wiring.picture(name)
    assert (wiring.FOLDER / f"{name}.svg").read_bytes() == picture, (
        "run `python -m studies.wiring` and look at the picture"
    )
    assert f"(../pictures/{name}.svg)" in PAGE.read_text()


def test_each_pin_is_in_its_picture_by_number_and_role() -> None:
    root = ElementTree.parse(wiring.FOLDER / "wiring-pins.svg").getroot()
    texts = {" ".join("".join(node.itertext()).split()) for node in root.iter("{http://www.w3.org/2000/svg}text")}
    for pin in wiring.PINS:
        label = [text for text in texts if re.match(rf"{pin.number} {pin.name}\b", text)]
        assert len(label) == 1 and all(role in label[0] for role in (pin.single, pin.six) if role), pin


def test_no_place_is_used_twice_and_each_job_has_one_pin() -> None:
    places = [(pin.connector, pin.number) for pin in wiring.PINS]
    assert len(set(places)) == len(places) == len({pin.name for pin in wiring.PINS})
    for build in ("single", "six"):
        roles = [role for pin in wiring.PINS if (role := getattr(pin, build))]
        assert len(set(roles)) == len(roles)
    six = [pin.six or "" for pin in wiring.PINS]
    assert sum(role.startswith("bridge") for role in six) == 12 and sum(role.startswith("sensor") for role in six) == 6


def test_the_page_names_each_pin_with_its_place() -> None:
    text = PAGE.read_text()
    rows = [line for line in text.splitlines() if line.startswith("| P")]
    for pin in wiring.PINS:
        row = [line for line in rows if re.search(rf"\b{pin.name}\b", line.split("|")[1])]
        assert row, pin
        assert any(re.search(rf"\b{pin.number}\b", line) or "| B1 |" in line or "| USB |" in line for line in row), pin


def test_the_filter_on_the_page_is_that_of_the_thesis() -> None:
    made = filter_for(10e-9, 4e3, 40e3)
    assert (made.inductance_h, made.resistance_ohm, made.corner_hz) == pytest.approx((16e-3, 1.8e3, 12.6e3), rel=0.02)
    assert abs(made.response(40e3)) == pytest.approx(0.1, rel=0.01)
    assert "16 mH, 1.8 kΩ, corner 12.6 kHz, 20 dB less at 40 kHz" in " ".join(PAGE.read_text().split())
