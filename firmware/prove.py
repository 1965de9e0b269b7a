"""What holds for every input: `python -m firmware.prove`, by abstract interpretation (Frama-C's Eva).

Each driver in firmware/proofs runs a part of the core once, from any state. Eva shows that no access leaves its array, that no
conversion or shift is undefined, and that the driver's assertions hold, whatever the values. Exit code 4 if anything stays
open, 5 without Frama-C.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
CORE, PROOFS = HERE / "core", HERE / "proofs"
SOURCES = {
    "fast": ("single/an_fast.c", "an_sine.c"),
    "fault": ("single/an_fast.c", "an_sine.c"),
    "six": ("six/an_six_fast.c", "an_sine.c"),
    "capture": ("an_capture.c",),
    "texture": ("an_texture.c", "an_sine.c", "an_dds.c", "an_bytes.c"),
}
EVA = "-eva -eva-precision 6 -eva-domains equality,symbolic-locations -eva-verbose 0 -kernel-verbose 0 -machdep gcc_x86_32 -c11"
SPECIAL = "-warn-special-float none"  # infinity and NaN are values, not errors, until they become integers
ABSOLUTE = "-D__builtin_fabsf(x)=((x)>=0.0f?(x):-(x))"
OPEN = re.compile(r"\[eva:alarm\] (.*?): Warning:\s*(.*?)(?=\n\[|\Z)", re.DOTALL)


def is_installed() -> bool:
    """Return whether Frama-C is on PATH."""
    return shutil.which("frama-c") is not None


def unproven(name: str, core: Path = CORE) -> list[str]:
    """Return what Eva cannot show for a driver.

    Parameters
    ----------
    name : str
        Key of SOURCES.
    core : Path
        Folder of the core's sources.

    Returns
    -------
    list of str
        A line for each alarm: place and assertion.

    Raises
    ------
    RuntimeError
        If the analysis fails.
    """
    places = " ".join(f"-I{place}" for place in (PROOFS, core, core / "single", core / "six"))
    files = [str(PROOFS / f"{name}.c"), *(str(core / source) for source in SOURCES[name])]
    command = ["frama-c", *EVA.split(), *SPECIAL.split(), f"-cpp-extra-args={places} '{ABSOLUTE}'", *files]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{name}: {(done.stdout + done.stderr).strip()[-500:]}")
    return [f"{place}: {' '.join(what.split())}" for place, what in OPEN.findall(done.stdout)]


def main() -> int:
    """Print what is proven; returns the exit code."""
    if not is_installed():
        print("prove: frama-c is not installed (Debian: frama-c-base)", file=sys.stderr)
        return 5
    found = {name: unproven(name) for name in SOURCES}
    for name, lines in found.items():
        what = (PROOFS / f"{name}.c").read_text().partition("*/")[0].removeprefix("/*").strip()
        print(f"{'open' if lines else 'holds':6s}{name}: {what}", *lines, sep="\n      ")
    return 4 if any(found.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
