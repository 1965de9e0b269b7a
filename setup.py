"""Building a wheel: everything in the one package `antinode`, the folders below `antinode/_lib` (docs/decisions/0006)."""

import re
import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
FOLDERS = ("geometry", "solvers", "pipeline", "studies", "firmware")
DATA = ("docs/glossary.md", "results/reference")  # read by commands, at the same places below the root
LEFT_OUT = ("__pycache__", "build", "generated")
PREFIX = "antinode._lib."
NAMES = "|".join(FOLDERS)
IMPORT = re.compile(rf"^(\s*(?:from|import) )({NAMES})(?=[. ])", re.MULTILINE)
MODULE_STRING = re.compile(rf"(?<=[\"'])({NAMES})\.(?=[a-z_{{])")


def nested(source: str) -> str:
    """A source with imports and names of modules in strings below `antinode._lib`; so are handlers in commands.toml."""
    return MODULE_STRING.sub(rf"{PREFIX}\1.", IMPORT.sub(rf"\1{PREFIX}\2", source))


def build(root: Path, target: Path) -> None:
    """Write the package `antinode` of the wheel into a folder."""
    shutil.rmtree(target, ignore_errors=True)  # an older build may lie there
    _copied(root / "antinode", target / "antinode")
    inside = target / "antinode" / "_lib"
    for name in (*FOLDERS, *DATA):
        _copied(root / name, inside / name)
    (inside / "__init__.py").write_text('"""The folders of the checkout, by names that are theirs alone."""\n')


def _copied(source: Path, target: Path) -> None:
    if source.is_dir():
        for entry in sorted(source.iterdir()):
            if entry.name not in LEFT_OUT:
                _copied(entry, target / entry.name)
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    if source.suffix in (".py", ".toml"):
        target.write_text(nested(source.read_text(encoding="utf-8")), encoding="utf-8")
    else:
        shutil.copyfile(source, target)


class NestedBuild(build_py):
    """build_py that nests the folders, but for editable installs, which run from the checkout as it is."""

    def run(self) -> None:
        if self.editable_mode:
            super().run()
        else:
            self.distribution.packages = ["antinode"]  # what top_level.txt says
            build(ROOT, Path(self.build_lib))


if __name__ == "__main__":
    setup(cmdclass={"build_py": NestedBuild})
