"""Project files whose functions run in a command; the bodies of modules and classes do not count.

    python -m tests.architecture.hops [ARGUMENT ...]

prints these files, each with its functions, and their number: by default of `antinode bands examples/small.toml`.
Nothing that an earlier run has kept is used.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[2]
COMMAND = ("bands", "examples/small.toml")
TRACED = """
import json, sys, threading
called = set()
def note(frame, event, argument):
    if event == "call":
        called.add(frame.f_code)
sys.setprofile(note)
threading.setprofile(note)
from antinode.__main__ import main
sys.argv = ["antinode", *sys.argv[2:], "--quiet"]
code = main()
sys.setprofile(None)
from inspect import CO_OPTIMIZED  # neither a module nor the body of a class
functions = [each for each in called if each.co_flags & CO_OPTIMIZED]
named = sorted((each.co_filename, each.co_qualname) for each in functions)
print(json.dumps({"code": code, "named": named}), file=sys.stderr)
"""


def functions_by_file(*arguments: str) -> dict[str, list[str]]:
    """Qualified names of the functions that run in a command, by the file of this project that they stand in."""
    with TemporaryDirectory(prefix="antinode-hops-") as folder:
        places = {"ANTINODE_RESULTS": f"{folder}/results", "XDG_CACHE_HOME": f"{folder}/cache"}
        done = subprocess.run(
            [sys.executable, "-c", TRACED, "--", *(arguments or COMMAND)],
            cwd=ROOT,
            env=os.environ | places | {"PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
        )
    if done.returncode:
        raise RuntimeError(done.stderr)
    told = json.loads(done.stderr.splitlines()[-1])
    if told["code"]:
        raise RuntimeError(done.stderr)
    found: dict[str, list[str]] = {}
    for path, name in told["named"]:
        if _is_of_the_project(Path(path)) and not _is_of_a_body(name):
            found.setdefault(Path(path).relative_to(ROOT).as_posix(), []).append(name)
    return found


def _is_of_the_project(path: Path) -> bool:
    """Whether a file stands in the checkout, but not among the packages of an environment that lies there, too."""
    return path.is_relative_to(ROOT) and "site-packages" not in path.parts


def _is_of_a_body(name: str) -> bool:
    """Whether a comprehension stands in the body of a module or a class, of which it is a part."""
    return "<locals>" not in name and name.endswith(("comp>", "genexpr>"))


def main(arguments: list[str]) -> None:
    found = functions_by_file(*arguments)
    for path, names in found.items():
        print(f"{path}: {', '.join(names)}")
    print(f"{len(found)} files")


if __name__ == "__main__":
    main(sys.argv[1:])
