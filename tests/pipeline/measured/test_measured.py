"""Measured files as people and instruments write them, and what is said of those that cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geometry.layout import Design
from geometry.materials import MATERIALS
from pipeline.errors import InputError
from pipeline.measured.files import MeasuredSweep, read_field, read_sweep

DESIGN = Design(60e-3, 20e-3, 2e-3, 4, MATERIALS["aluminium"], None, float("nan"), float("nan"), 0, 12e-3)
TONES = [30e3 + 10.0 * i for i in range(9)]
VALUES = np.exp(1j * np.linspace(0.0, 2.0, 9)) * np.linspace(1.0, 3.0, 9)


def rows(*columns: object, delimiter: str = ",") -> str:
    return "\n".join(delimiter.join(repr(float(v)) for v in row) for row in zip(*columns, strict=True)) + "\n"


def swept(tmp_path: Path, text: str) -> MeasuredSweep:
    path = tmp_path / "sweep.csv"
    path.write_text(text, encoding="utf-8")
    return read_sweep(path)


DEGREES, DECIBELS = np.degrees(np.angle(VALUES)), 20.0 * np.log10(np.abs(VALUES))
WRITTEN = {
    "real": "frequency_Hz,real,imag\n" + rows(TONES, VALUES.real, VALUES.imag),
    "kilohertz": "Frequency_kHz,real_mm_s,imag_mm_s\n" + rows(np.divide(TONES, 1e3), VALUES.real, VALUES.imag),
    "degrees": "frequency_hz,amplitude,phase_deg\n" + rows(TONES, np.abs(VALUES), DEGREES),
    "radians": "frequency_MHz;amplitude_mm_per_s;phase_rad\n"
    + rows(np.divide(TONES, 1e6), np.abs(VALUES), np.angle(VALUES), delimiter=";"),
    "decibels": "frequency_Hz\tamplitude_dB\tphase_deg\n" + rows(TONES, DECIBELS, DEGREES, delimiter="\t"),
    "brackets": "Frequency (Hz),Real,Imaginary\n" + rows(TONES, VALUES.real, VALUES.imag),
    "decimal commas": "frequency_Hz;real;imag\n"
    + rows(TONES, VALUES.real, VALUES.imag, delimiter=";").replace(".", ","),
    "units below": "Source File Name:\tsweep.svd\n\nFrequency\tMagnitude\tPhase\n[ kHz ]\t[ m/s ]\t[ deg ]\n"
    + rows(np.divide(TONES, 1e3), np.abs(VALUES), DEGREES, delimiter="\t"),
    "comments": "# a note\n\n# another\nfrequency_Hz, coherence, imag, real\n# in between\n"
    + rows(TONES, np.ones(9), VALUES.imag, VALUES.real),
    "reversed": "\ufefffrequency_Hz,real,imag\n" + rows(TONES[::-1], VALUES.real[::-1], VALUES.imag[::-1]),
}


@pytest.mark.parametrize("text", WRITTEN.values(), ids=WRITTEN.keys())
def test_one_sweep_written_in_many_ways(tmp_path: Path, text: str) -> None:
    result = swept(tmp_path, text)
    assert np.allclose(result.sweep.frequencies_hz, TONES, rtol=1e-12)
    assert np.allclose(result.sweep.response, VALUES, rtol=1e-12)
    assert result.quantity == "velocity" and not result.synthetic


@pytest.mark.parametrize("quantity", ["velocity", "displacement", "sensor"])
def test_the_column_says_what_was_measured(tmp_path: Path, quantity: str) -> None:
    head = f"frequency_Hz,{quantity}_amplitude_V,{quantity}_phase_deg\n"
    assert swept(tmp_path, head + rows(TONES, np.abs(VALUES), DEGREES)).quantity == quantity


@pytest.mark.parametrize(
    ("unit", "quantity"),
    [
        ("m/s", "velocity"),
        ("µm", "displacement"),
        ("V", "sensor"),
        ("nm", "displacement"),
        ("mV", "sensor"),
        ("pm/V", "displacement"),
        ("nm/s", "velocity"),
        ("(mm/s)/V", "velocity"),
        ("dB re 1 µm", "displacement"),
        ("dB re 1 m/s", "velocity"),
    ],
)
def test_a_unit_in_brackets_says_what_was_measured(tmp_path: Path, unit: str, quantity: str) -> None:
    head = f"Frequency [Hz],Magnitude [{unit}],Phase [°]\n"
    assert swept(tmp_path, head + rows(TONES, np.abs(VALUES), DEGREES)).quantity == quantity


@pytest.mark.parametrize(
    ("suffix", "quantity"),
    [
        ("", "velocity"),
        ("_m_per_s_per_V", "velocity"),
        ("_nm", "displacement"),
        ("_um_per_V", "displacement"),
        ("_mV", "sensor"),
    ],
)
def test_a_unit_at_the_end_of_a_name_says_what_was_measured(tmp_path: Path, suffix: str, quantity: str) -> None:
    head = f"frequency_Hz,real{suffix},imag{suffix}\n"
    assert swept(tmp_path, head + rows(TONES, VALUES.real, VALUES.imag)).quantity == quantity


@pytest.mark.parametrize("unit", ["N", "N/V", "dB re 20 uPa", "ohm", "a.u."])
def test_a_unit_of_something_else_is_no_velocity(tmp_path: Path, unit: str) -> None:
    values = rows(TONES, np.abs(VALUES), DEGREES)
    with pytest.raises(InputError, match="unknown unit: must be m/s, m, m/s2, g or V"):
        swept(tmp_path, f"Frequency [Hz],Magnitude [{unit}],Phase [°]\n" + values)
    assert swept(tmp_path, f"frequency_Hz,velocity_amplitude_{unit},phase_deg\n" + values).quantity == "velocity"


def test_a_unit_of_another_quantity_than_the_name_says_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="its unit is that of a displacement: must be of a velocity"):
        swept(tmp_path, "frequency_Hz,velocity_real_nm,velocity_imag_nm\n" + rows(TONES, VALUES.real, VALUES.imag))


def test_an_acceleration_is_read_as_the_displacement_it_is_of(tmp_path: Path) -> None:
    accelerations = -((2.0 * np.pi * np.array(TONES)) ** 2) * VALUES
    result = swept(
        tmp_path, "Frequency (Hz),Real [m/s²],Imaginary [m/s²]\n" + rows(TONES, accelerations.real, accelerations.imag)
    )
    assert result.quantity == "displacement"
    assert np.allclose(result.sweep.response, VALUES, rtol=1e-12)


def test_only_the_first_comment_marks_a_synthetic_file(tmp_path: Path) -> None:
    assert swept(tmp_path, "# SYNTHETIC, made by hand\n" + WRITTEN["real"]).synthetic
    assert not swept(tmp_path, "# not so\n# SYNTHETIC\n" + WRITTEN["real"]).synthetic


GOOD = "frequency_Hz,real,imag\n" + rows(TONES, VALUES.real, VALUES.imag)
LINES = GOOD.splitlines()
BAD_SWEEPS = [
    ("", ["no columns"]),
    ("Source File Name: sweep.svd\n", ["line 1", "no rows"]),
    ("frequency_Hz,real,imag\n", ["line 1", "no rows"]),
    ("freqency_Hz,real,imag\n1,2,3\n", ["line 1", "frequency_Hz or frequency_kHz", "did you mean frequency_Hz?"]),
    ("frequency,real,imag\n1,2,3\n", ["line 1", "frequency_kHz"]),
    ("frequency_Hz,real\n1,2\n", ["line 1", "real with imag", "imag is missing"]),
    ("frequency_Hz,amplitude\n1,2\n", ["line 1", "phase_deg", "phase is missing"]),
    ("frequency_Hz,voltage\n1,2\n", ["line 1", "real with imag"]),
    ("frequency_Hz,amplitude,phase\n1,2,3\n", ["column phase", "phase_deg or phase_rad"]),
    ("frequency_Hz,frequency_kHz,real,imag\n1,1,2,3\n", ["line 1", "both hold frequency"]),
    ("frequency_Hz,velocity_real,displacement_imag\n1,2,3\n", ["of one quantity"]),
    ("frequency_Hz,real_mV,imag_V\n1,2,3\n", ["one unit"]),
    ("\n".join([*LINES[:4], "30030,x,1"]), ["line 5", "column real", '"x"', "finite number"]),
    ("\n".join([*LINES[:4], "30030,nan,1"]), ["line 5", "column real", "finite number"]),
    ("\n".join([*LINES[:4], "30030,1"]), ["line 5", "2 values", "must be 3"]),
    ("\n".join([*LINES[:4], "-3,1,1"]), ["line 5", "column frequency_Hz", "above 0"]),
    ("# note\n" + "\n".join([*LINES, LINES[3]]), ["line 12", "column frequency_Hz", "repeats the frequency of line 5"]),
    ("\n".join(LINES[:4]), ["3 frequencies", "at least 8"]),
    (WRITTEN["degrees"] + "30200,-1,0\n", ["line 11", "column amplitude", "0 or more"]),
]  # fmt: skip


@pytest.mark.parametrize(("text", "words"), BAD_SWEEPS, ids=[str(i) for i in range(len(BAD_SWEEPS))])
def test_a_bad_sweep_is_told_in_one_line(tmp_path: Path, text: str, words: list[str]) -> None:
    with pytest.raises(InputError) as fault:
        swept(tmp_path, text)
    assert len(fault.value.lines) == 1 and "\n" not in fault.value.lines[0]
    for word in ["sweep.csv", *words]:
        assert word in fault.value.lines[0]


def test_what_is_no_text_or_not_there_is_told(tmp_path: Path) -> None:
    binary = tmp_path / "sweep.csv"
    binary.write_bytes(b"\xff\xfe\x00")
    for path, word in ((binary, "UTF-8"), (tmp_path / "none.csv", "no such file"), (tmp_path, "cannot be read")):
        with pytest.raises(InputError, match=word):
            read_sweep(path)


def mapped(tmp_path: Path, text: str) -> object:
    path = tmp_path / "field.csv"
    path.write_text(text)
    return read_field(path, DESIGN)


def test_a_map_in_millimetres_and_in_metres(tmp_path: Path) -> None:
    for head, unit in (("x_mm,y_mm", 1.0), ("x_m,y_m", 1e-3)):
        result = mapped(
            tmp_path,
            f"{head},velocity_amplitude,velocity_phase_deg\n"
            + rows([30 * unit, 0], [-22 * unit, 1 * unit], [1, 2], [0, 90]),
        )
        assert np.allclose(result.points_m, [[30e-3, -22e-3], [0.0, 1e-3]])
        assert np.allclose(result.values, [1.0, 2.0j])


BAD_MAPS = [
    ("x_mm,real,imag\n0,1,1\n", ["line 1", "y_mm or y_m"]),
    ("x_mm,y_mm,real,imag\n0,0,1,1\n31,0,1,1\n", ["line 3", "column x_mm", "-30 to 30 mm"]),
    ("x_mm,y_mm,real,imag\n0,0,1,1\n0,-23,1,1\n", ["line 3", "column y_mm", "-22 to 22 mm"]),
    ("x_mm,y_mm,real,imag\n0,0,1,1\n1,1,1,1\n0,0.0,1,1\n", ["line 4", "column x_mm", "repeats the point of line 2"]),
]


@pytest.mark.parametrize(("text", "words"), BAD_MAPS, ids=[str(i) for i in range(len(BAD_MAPS))])
def test_a_bad_map_is_told_in_one_line(tmp_path: Path, text: str, words: list[str]) -> None:
    with pytest.raises(InputError) as fault:
        mapped(tmp_path, text)
    assert len(fault.value.lines) == 1
    for word in ["field.csv", *words]:
        assert word in fault.value.lines[0]


UNDRIVEN = "frequency_Hz,amplitude,phase_deg\n" + rows(TONES, np.zeros(9), DEGREES)
LOUD = "frequency_Hz,amplitude,phase_deg\n" + rows(TONES, 1e308 * np.ones(9), DEGREES)
DEAFENING = "frequency_Hz,amplitude_dB,phase_deg\n" + rows(TONES, 7000.0 * np.ones(9), DEGREES)
HIGH = "frequency_MHz,amplitude,phase_deg\n" + rows(np.multiply(TONES, 1e6), np.ones(9), DEGREES)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (UNDRIVEN, "every value is 0, must hold a measurement"),
        (LOUD, "line 2, column amplitude = "),
        (DEAFENING, "must be from -600 to 600 dB"),
        (HIGH, "must be from 1e-09 to 1e+10 kHz"),
        ("frequency_Hz,real,imag\n1,2," + "9" * 131_073 + "\n", "is not valid CSV"),
    ],
    ids=["silent", "loud", "decibels", "frequency", "cell"],
)
def test_what_no_instrument_measures_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError) as fault:
        swept(tmp_path, text)
    (line,) = fault.value.lines
    assert said in line and "sweep.csv" in line
