"""The tests of the core once more, with every memory access and every undefined operation checked by the compiler."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ACCESSES, NUMBERS = "address,undefined", "float-cast-overflow,float-divide-by-zero"
PARSERS = ["test_frame.py", "test_table_reader.py", "test_texture.py", "test_link.py", "test_sine.py", "test_demod.py"]
ALL = [
    *PARSERS,
    "test_pi.py",
    "test_resonance.py",
    "test_sweep.py",
    "test_guards.py",
    "test_loop_on_host.py",
    "test_six.py",
]


def flags(checks: str) -> str:
    """The compiler's, for a library that ends at the first thing it finds."""
    return f"-O1 -g -fsanitize={checks} -fno-sanitize-recover=all -fno-omit-frame-pointer"


def library(name: str) -> str:
    """Path of a sanitizer's runtime, to be loaded before Python."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler with sanitizers: install gcc")
    result = subprocess.run([compiler, f"-print-file-name={name}"], capture_output=True, text=True, check=True)
    path = Path(result.stdout.strip())
    if not path.is_absolute():
        pytest.skip(f"the C compiler has no {name}: install gcc with its sanitizers")
    return str(path)


def sanitized(arguments: list[str], **environment: str) -> subprocess.CompletedProcess:
    settings = {
        "LD_PRELOAD": library("libasan.so"),
        "ASAN_OPTIONS": "detect_leaks=0",
        "ANTINODE_HOST_FLAGS": flags(f"{ACCESSES},{NUMBERS}"),
        "CC": "gcc",
    }
    command = [sys.executable, *arguments]
    return subprocess.run(
        command, cwd=HERE.parents[1], env=os.environ | settings | environment, capture_output=True, text=True
    )


def run_tests(names: list[str], **environment: str) -> None:
    command = [
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-m",
        "not slow",
        "-k",
        "not emulated and not image_fits",
    ]
    environment |= {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = sanitized([*command, *[str(HERE / name) for name in names]], **environment)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]


@pytest.mark.slow
def test_parsers_stay_within_their_bounds() -> None:
    run_tests(PARSERS)


@pytest.mark.slow
def test_all_of_the_core_is_defined_behaviour() -> None:
    run_tests(ALL)


@pytest.mark.slow
def test_no_flipped_bit_leads_beyond_an_array() -> None:
    """A number that is none may come of one, and ends as a fault; an access to other memory may not."""
    run_tests(["test_injection.py"], ANTINODE_HOST_FLAGS=flags(ACCESSES))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "word"),
    [
        ("lib.an_crc32(ffi.new('uint8_t[4]'), 64)", "heap-buffer-overflow"),
        ("t = ffi.new('an_texture *'); t.kind = 2; t.every = 0; lib.an_texture_step(t)", ""),
    ],
)
def test_the_sanitizers_are_awake(code: str, word: str) -> None:
    """Reading beyond an array is seen; a sound call is not complained about."""
    done = sanitized(["-c", f"from firmware.host import load\nffi, lib = load()\n{code}"])
    assert (word in done.stderr and done.returncode != 0) if word else done.returncode == 0, done.stderr[-2000:]
