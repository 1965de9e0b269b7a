"""The lists of docs/licences.md from the installed packages' own metadata: `make licences`.

What stands above the mark is prose and stays as it is; `python -m studies.licences --check` only compares.
"""

from __future__ import annotations

import argparse
import csv
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from pipeline.paths import ROOT
from pipeline.records.outputs import markdown
from pipeline.records.store import write_atomic

PAGE = ROOT / "docs" / "licences.md"

# The environment whose closure is listed, wherever the page is made: what a marker asks for.
ENVIRONMENT = {
    "implementation_name": "cpython",
    "implementation_version": "3.11.0",
    "os_name": "posix",
    "platform_machine": "x86_64",
    "platform_python_implementation": "CPython",
    "platform_release": "",
    "platform_system": "Linux",
    "platform_version": "",
    "python_full_version": "3.11.0",
    "python_version": "3.11",
    "sys_platform": "linux",
}

FAMILIES = (  # the strongest terms first; a licence belongs to the first family that fits
    ("GPL", re.compile(r"(?<!L)GPL|GNU (?:Affero )?General Public", re.I)),
    ("LGPL", re.compile(r"LGPL|Lesser General Public|Library General Public", re.I)),
    ("MPL", re.compile(r"\bMPL|Mozilla Public", re.I)),
    ("other reciprocal", re.compile(r"\bEPL|Eclipse Public|CeCILL|CDDL", re.I)),
)
PERMISSIVE = "permissive"
CLASSIFIERS = {
    "Apache Software License": "Apache-2.0",
    "BSD License": "BSD",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF",
}

TITLES = {  # how licence texts begin, on a line of their own; one file says it in a sentence
    "GPL": r"^\W*GNU GENERAL PUBLIC LICENSE\W*$",
    "LGPL": r"^\W*GNU (?:LESSER|LIBRARY) GENERAL PUBLIC LICENSE\W*$|governed by the terms of\s+the LGPL",
    "MPL": r"^\W*Mozilla Public License,? Version",
    "EPL": r"^\W*Eclipse Public License",
    "CeCILL": r"^\W*CeCILL",
    "CDDL": r"^\W*COMMON DEVELOPMENT AND DISTRIBUTION",
}
SOURCES = (".py", ".pyc", ".pyi", ".h")
LICENCE_FILE = re.compile(r"licen[cs]e|copying|copyright|/licenses/", re.I)
LIBRARIES = (  # what wheels carry in addition to their own code: by file name, under terms beyond a notice
    ("libTK[A-Z0-9]", "Open CASCADE Technology", "LGPL-2.1-only WITH OCCT-exception-1.0"),
    ("libcoinmumps", "MUMPS", "CeCILL-C"),
    ("libfreeimage", "FreeImage", "FreeImage OR GPL-2.0 OR GPL-3.0"),
    ("libgfortran", "GNU Fortran run time", "GPL-3.0-or-later WITH GCC-exception-3.1"),
    ("libgmp", "GNU MP", "LGPL-3.0-or-later OR GPL-2.0-or-later"),
    ("libgomp", "GNU OpenMP run time", "GPL-3.0-or-later WITH GCC-exception-3.1"),
    ("libjbig", "JBIG-KIT", "GPL-2.0-or-later"),
    ("libquadmath", "GNU quadruple precision", "LGPL-2.1-or-later"),
    ("libraw", "LibRaw", "LGPL-2.1 OR CDDL-1.0"),
    ("libunicorn", "parts of QEMU", "GPL-2.0"),
)

MARK = "<!-- From here on written by `make licences`. -->\n"


@dataclass(frozen=True)
class Package:
    """An installed package: its name, version, declared terms, and further terms found in its files."""

    name: str
    version: str
    declared: str
    inside: tuple[tuple[str, str, str], ...]  # what, its terms, where

    @property
    def family(self) -> str:
        """The strongest family of terms that it declares itself."""
        return family(self.declared)


class NotInstalled(RuntimeError):
    """The lists cannot be made here: a package is missing."""


class OtherVersion(RuntimeError):
    """An installed package is not of the version that constraints.txt locks."""


def family(licence: str) -> str:
    """The family of a licence's text or expression; of a choice ("A OR B") the mildest."""
    choices = [_single_family(choice) for choice in re.split(r"\bOR\b", licence)]
    order = [name for name, _ in FAMILIES] + [PERMISSIVE]
    return max(choices, key=order.index)


def _single_family(licence: str) -> str:
    return next((name for name, pattern in FAMILIES if pattern.search(licence)), PERMISSIVE)


def extras() -> dict[str, list[Requirement]]:
    """Requirements of each extra of pyproject.toml; "" holds those that are always needed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    requirements = {"": project["dependencies"], **project["optional-dependencies"]}
    return {name: [Requirement(line) for line in lines] for name, lines in requirements.items()}


def closure(requirements: Iterable[Requirement]) -> set[str]:
    """The canonical names of all packages that these ask for, directly or not. Raises NotInstalled."""
    seen: set[tuple[str, str]] = set()
    waiting = [pair for need in requirements for pair in _with_extras(need)]
    while waiting:
        name, extra = pair = waiting.pop()
        if pair not in seen:
            seen.add(pair)
            needs = map(Requirement, _distribution(name).requires or [])
            there = (
                need for need in needs if need.marker is None or need.marker.evaluate(ENVIRONMENT | {"extra": extra})
            )
            waiting += [each for need in there for each in _with_extras(need)]
    return {name for name, _ in seen}


def _with_extras(need: Requirement) -> list[tuple[str, str]]:
    """A package by its canonical name, alone and with each extra asked for."""
    return [(canonicalize_name(need.name), extra) for extra in ("", *need.extras)]


@cache
def _distribution(name: str) -> metadata.Distribution:
    try:
        return metadata.distribution(name)
    except metadata.PackageNotFoundError:
        raise NotInstalled(f"{name} is not installed here: `make setup` on Linux x86-64 installs it") from None


def locked() -> dict[str, str]:
    """The versions of constraints.txt by canonical name."""
    lines = re.findall(r"^([^\s#]+)==([^\s;]+)", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
    return {canonicalize_name(name): version for name, version in lines}


def package(name: str, versions: dict[str, str]) -> Package:
    """Read an installed package's metadata and files. Raises OtherVersion, NotInstalled."""
    distribution = _distribution(name)
    about = distribution.metadata
    if about["Version"] != versions.get(name):
        locked = f"locks {versions[name]}" if name in versions else "does not lock it"
        raise OtherVersion(f"{name} {about['Version']} is installed, constraints.txt {locked}")
    licence, files = declared(about), files_of(distribution)
    texts = {file: Path(str(distribution.locate_file(file))) for file in files if _is_licence(file)}
    return Package(name, versions[name], licence, (*_libraries(files), *_texts(texts, family(licence))))


def files_of(distribution: metadata.Distribution) -> list[str]:
    """The paths of an installed package's files."""
    return sorted(row[0] for row in csv.reader((distribution.read_text("RECORD") or "").splitlines()))


def declared(about: metadata.PackageMetadata) -> str:
    """The licence a package's metadata declares: an SPDX expression, a short field, or its classifiers."""
    if "License-Expression" in about:
        return about["License-Expression"]
    field = " ".join(about.get_all("License") or []).strip()
    if field and "\n" not in field and len(field) < 60 and not field.startswith(("Copyright", "=")):
        return field
    classifiers = [line.split(" :: ")[-1] for line in about.get_all("Classifier") or [] if line.startswith("License")]
    return ", ".join(CLASSIFIERS.get(line, line) for line in classifiers) or "not declared"


def _is_licence(file: str) -> bool:
    return bool(LICENCE_FILE.search(file)) and not file.endswith(SOURCES)


def _libraries(files: list[str]) -> Iterator[tuple[str, str, str]]:
    names = " ".join(file.rpartition("/")[2] for file in files if re.search(r"\.(so|dll|dylib)\b", file))
    for pattern, component, terms in LIBRARIES:
        if re.search(rf"(^| ){pattern}", names):
            yield component, terms, f"`{pattern.partition('[')[0]}*`"


def _texts(paths: dict[str, Path], own: str) -> Iterator[tuple[str, str, str]]:
    texts = {file: path.read_text(errors="replace") for file, path in paths.items()}
    for name, title in TITLES.items():
        places = [_place(file) for file, text in texts.items() if re.search(title, text, re.M)]
        if places and family(name) != own:
            yield "licence text", name, ", ".join(f"`{place}`" for place in dict.fromkeys(places))


def _place(file: str) -> str:
    """The component's folder where there is one for each, else the file."""
    parts = [part for part in file.split("/") if not part.endswith(".dist-info")]
    at = parts.index("licenses") + 1 if "licenses" in parts else 0
    return parts[at] if len(parts) > at + 1 else "/".join(parts[at:])


def lists() -> str:
    """Return everything below the mark. Raises OtherVersion, NotInstalled."""
    versions, requirements = locked(), extras()
    always = closure(requirements.pop(""))
    names = {extra: closure(needs) - always for extra, needs in requirements.items()}
    packages = {name: package(name, versions) for name in sorted(always.union(*names.values()))}
    homes = {name: [extra for extra, own in names.items() if name in own] for name in packages}
    sections = [
        _table("Declared: terms beyond a notice", ("family", "package", "version", "declares", "installed"), (
            (family, one.name, one.version, one.declared, ", ".join(f"`{extra}`" for extra in homes[name]) or "always")
            for family, _ in FAMILIES for name, one in packages.items() if one.family == family
        )),
        _table("Carried inside: terms beyond a notice", ("package", "inside", "terms"), (
            (one.name, *inside[:2]) for one in packages.values() for inside in one.inside if "GCC-exception" not in inside[1]
        )),
    ]  # fmt: skip
    unknown = ", ".join(name for name, one in packages.items() if one.declared in ("UNKNOWN", "not declared"))
    rest = f"## Others\n\nThe other {len(packages)} packages declare permissive licences, or none: {unknown}.\n"
    return "\n".join([*sections, rest])


def _table(title: str, head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    return f"## {title}\n\n{markdown(head, rows)}"


def main(arguments: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m studies.licences", description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare with the page instead of writing it")
    about = parser.parse_args(arguments)
    try:
        made = lists()
    except (NotInstalled, OtherVersion) as error:
        print(f"licences: {error}", file=sys.stderr)
        return 5 if isinstance(error, NotInstalled) else 3
    prose, mark, stored = PAGE.read_text().partition(MARK)
    stands = stored == made
    if about.check and not stands:
        print("licences: docs/licences.md is out of date: run `make licences`", file=sys.stderr)
        return 4
    if not stands:
        write_atomic(PAGE, (prose + (mark or MARK) + made).encode())
    print(made if not about.check else "", end="")
    print(f"docs/licences.md {'is up to date' if stands else 'was rewritten'}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
