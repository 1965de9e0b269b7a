"""Every branch of the core is taken by a test on this machine: `python -m tests.firmware.core_coverage`, by gcc and gcov.

Builds the core anew with counters in it, runs the tests that use it here, and prints each file's share of branches taken, with
the lines that have others. Assertions are left out, as on the board; `test_invariants.py` sees them fire. Exit code 4 unless
all are taken: a new branch comes with its test, and a branch that nothing can take goes.
"""

from __future__ import annotations

import gzip
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

TESTS = Path(__file__).parent
NAMES = (
    "test_frame.py test_table_reader.py test_texture.py test_link.py test_sine.py test_demod.py test_pi.py test_resonance.py "
    "test_sweep.py test_guards.py test_watch.py "
    "test_loop_on_host.py test_touch.py test_injection.py test_six.py test_supervisor.py test_keep.py test_identify.py"
)
NOT_HERE = "not emulated and not image_fits and not make_six and not the_image_keeps"
LONG = "not whatever_breaks and not at_many_moments"  # faults in their thousands: what they take, others do


def run_tests(folder: Path) -> subprocess.CompletedProcess[str]:
    """The host tests with a library that counts; its counters are written into the folder."""
    flags = "--coverage -O0 -fprofile-update=single -UAN_CHECKED"
    places = {"TMPDIR": str(folder), "XDG_CACHE_HOME": str(folder)}  # the library and its counters lie in the cache
    environment = os.environ | {"ANTINODE_HOST_FLAGS": flags, "CC": "gcc"} | places
    files = [str(TESTS / name) for name in NAMES.split() if (TESTS / name).exists()]
    chosen = ["-m", "slow or not slow", "-k", f"{NOT_HERE} and {LONG}"]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *chosen, *files]
    return subprocess.run(command, cwd=TESTS.parents[1], env=environment, capture_output=True, text=True)


def branches(folder: Path) -> dict[str, dict[tuple[int, int], bool]]:
    """Whether the branches of each source of the core are taken, by line and number there, in any of its objects."""
    result: dict[str, dict[tuple[int, int], bool]] = {}
    for counters in sorted(folder.rglob("*.gcda")):
        subprocess.run(["gcov", "-b", "-j", str(counters)], cwd=folder, capture_output=True, check=True)
    for packed in sorted(folder.glob("*.gcov.json.gz")):
        for file in json.loads(gzip.decompress(packed.read_bytes()))["files"]:
            path = Path(file["file"])
            if "core" not in path.parts:
                continue
            for line in file["lines"]:
                for number, branch in enumerate(line["branches"]):
                    own, place = result.setdefault(path.name, {}), (line["line_number"], number)
                    own[place] = own.get(place, False) or branch["count"] > 0
    return result


def main() -> int:
    """The command line; returns the exit code."""
    if not shutil.which("gcov") or not shutil.which("gcc"):
        print("coverage: gcc and gcov are not installed", file=sys.stderr)
        return 5
    with tempfile.TemporaryDirectory() as name:
        done = run_tests(Path(name))
        if done.returncode:
            print(done.stdout[-3000:], file=sys.stderr)
            return 3
        result = branches(Path(name))
    if not result:
        print("coverage: the library left no counters", file=sys.stderr)
        return 3
    for file, own in result.items():
        lines = sorted({line for (line, _), is_taken in own.items() if not is_taken})
        never = f"; not all of lines {', '.join(map(str, lines))}" if lines else ""
        print(f"{file}: {sum(own.values())} of {len(own)} branches, {100 * sum(own.values()) / len(own):.0f} %{never}")
    every = [is_taken for own in result.values() for is_taken in own.values()]
    print(f"core: {sum(every)} of {len(every)} branches, {100 * sum(every) / len(every):.1f} %")
    return 0 if all(every) else 4


if __name__ == "__main__":
    sys.exit(main())
