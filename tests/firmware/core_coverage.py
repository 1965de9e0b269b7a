"""Every branch of the core is taken by a test on this machine: `python -m tests.firmware.core_coverage`, by gcc and gcov.

Builds the core anew with counters in it, runs the tests that use it here, and prints each file's share of branches taken, with
the lines that have others. Assertions are left out, as on the board; `test_invariants.py` sees them fire. Exit code 4 unless
all are taken: a new branch comes with its test, and a branch that nothing can take goes.

With `--conditions`, by clang 18 or later: every condition of a decision decides it alone in some pair of tests (MC/DC).
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from studies.mutants import COUNTING, gcov

TESTS = Path(__file__).parent
NAMES = (
    "test_frame.py test_table_reader.py test_texture.py test_link.py test_sine.py test_demod.py test_pi.py test_resonance.py "
    "test_sweep.py test_guards.py test_watch.py test_matrix.py "
    "test_loop_on_host.py test_touch.py test_injection.py test_six.py test_supervisor.py test_keep.py test_identify.py"
)
NOT_HERE = "not emulated and not image_fits and not make_six and not the_image_keeps"
VERSIONS = ("-22", "-21", "-20", "-19", "-18")
LONG = "not whatever_breaks and not at_many_moments"  # faults in their thousands: what they take, others do


def run_tests(folder: Path, built: dict[str, str]) -> None:
    """The host tests with a library that counts; its counters are written into the folder.

    Raises
    ------
    RuntimeError
        If a test fails.
    """
    places = {"TMPDIR": str(folder), "XDG_CACHE_HOME": str(folder)}  # the library and its counters lie in the cache
    profile = {"LLVM_PROFILE_FILE": str(folder / "%p-%m.profraw")}
    files = [str(TESTS / name) for name in NAMES.split() if (TESTS / name).exists()]
    chosen = ["-m", "slow or not slow", "-k", f"{NOT_HERE} and {LONG}"]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *chosen, *files]
    environment = os.environ | built | places | profile
    done = subprocess.run(command, cwd=TESTS.parents[1], env=environment, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stdout[-3000:])


def branches(folder: Path) -> dict[str, dict[tuple[int, int], bool]]:
    """Whether the branches of each source of the core are taken, by line and number there, in any of its objects."""
    result: dict[str, dict[tuple[int, int], bool]] = {}
    for file in gcov(folder):
        path = Path(file["file"])
        if "core" not in path.parts:
            continue
        for line in file["lines"]:
            for number, branch in enumerate(line["branches"]):
                own, place = result.setdefault(path.name, {}), (line["line_number"], number)
                own[place] = own.get(place, False) or branch["count"] > 0
    return result


def conditions(folder: Path, version: str) -> dict[str, dict[tuple[int, int], bool]]:
    """Whether each condition has decided alone, by line and number of the source's conditions."""
    profile = folder / "all.profdata"
    raw = map(str, folder.rglob("*.profraw"))
    subprocess.run([f"llvm-profdata{version}", "merge", "-sparse", "-o", str(profile), *raw], check=True)
    (library,) = folder.rglob("core-*.so")
    command = [f"llvm-cov{version}", "export", "-instr-profile", str(profile), str(library)]
    listed = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    result: dict[str, dict[tuple[int, int], bool]] = {}
    for file in listed["data"][0]["files"]:
        path = Path(file["filename"])
        if "core" in path.parts and file["mcdc_records"]:
            every = [(record[0], each) for record in file["mcdc_records"] for each in _conditions(record)]
            result[path.name] = {(line, number): each for number, (line, each) in enumerate(every)}
    return result


def _conditions(record: list[Any]) -> list[bool]:
    """Whether each condition of a decision decides alone; later versions of llvm-cov add lists of another kind."""
    return next(part for part in record if isinstance(part, list) and part and all(isinstance(x, bool) for x in part))


def clang() -> str | None:
    """Suffix of a clang with MC/DC and its tools, such as "-19"."""
    tools = ("clang", "llvm-cov", "llvm-profdata")
    return next((end for end in VERSIONS if all(shutil.which(tool + end) for tool in tools)), None)


def counted(by_conditions: bool, folder: Path) -> dict[str, dict[tuple[int, int], bool]] | None:
    """What the tests take, by file, line and number; None without the compiler that counts."""
    if by_conditions:
        version = clang()
        if version is None:
            return None
        flags = "-fprofile-instr-generate -fcoverage-mapping -fcoverage-mcdc -O0 -UAN_CHECKED"
        run_tests(folder, {"ANTINODE_HOST_FLAGS": flags, "CC": f"clang{version}"})
        return conditions(folder, version)
    if not shutil.which("gcov") or not shutil.which("gcc"):
        return None
    run_tests(folder, COUNTING)
    return branches(folder)


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.firmware.core_coverage")
    parser.add_argument("--conditions", action="store_true", help="count conditions, by clang, instead of branches")
    by_conditions = parser.parse_args(arguments).conditions
    what = "conditions" if by_conditions else "branches"
    with tempfile.TemporaryDirectory() as name:
        try:
            result = counted(by_conditions, Path(name))
        except RuntimeError as failed:
            print(failed, file=sys.stderr)
            return 3
    if result is None:
        print(f"coverage: {'clang 18 or later' if by_conditions else 'gcc and gcov'} is not installed", file=sys.stderr)
        return 5
    if not result:
        print("coverage: the library left no counters", file=sys.stderr)
        return 3
    for file, own in result.items():
        lines = sorted({line for (line, _), is_taken in own.items() if not is_taken})
        never = f"; not all of lines {', '.join(map(str, lines))}" if lines else ""
        print(f"{file}: {sum(own.values())} of {len(own)} {what}, {100 * sum(own.values()) / len(own):.0f} %{never}")
    every = [is_taken for own in result.values() for is_taken in own.values()]
    print(f"core: {sum(every)} of {len(every)} {what}, {100 * sum(every) / len(every):.1f} %")
    return 0 if all(every) else 4


if __name__ == "__main__":
    sys.exit(main())
