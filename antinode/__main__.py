"""The command: `antinode`, or `python -m antinode`."""
# PYTHON_ARGCOMPLETE_OK

from __future__ import annotations

import sys
from collections.abc import Sequence


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line; returns its exit code."""
    from pipeline.cli.main import main

    return main(argv)


if __name__ == "__main__":
    sys.exit(main())
