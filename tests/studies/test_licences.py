"""The page of licences: that it stands, how a licence is read, and what it says of single packages."""

from __future__ import annotations

import re
from email.message import Message
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from pipeline.paths import ROOT
from studies import licences


def metadata_of(**fields: str | list[str]) -> Message:
    """A package's metadata; underscores stand for hyphens."""
    message = Message()
    for name, value in fields.items():
        for one in value if isinstance(value, list) else [value]:
            message[name.replace("_", "-")] = one
    return message


def test_the_committed_page_is_what_the_locked_packages_say(capsys) -> None:
    code, err = licences.main(["--check"]), capsys.readouterr().err
    if code == 5:
        pytest.skip(err.strip())
    assert code == 0, err


def test_a_page_that_is_out_of_date_is_told_and_mended(capsys, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(licences, "PAGE", tmp_path / "licences.md")
    monkeypatch.setattr(licences, "lists", lambda: "new\n")
    licences.PAGE.write_text(f"prose\n{licences.MARK}old\n")
    assert licences.main(["--check"]) == 4 and "make licences" in capsys.readouterr().err
    assert licences.main([]) == 0 and licences.PAGE.read_text() == f"prose\n{licences.MARK}new\n"
    assert licences.main(["--check"]) == 0


def test_every_locked_package_has_hashes_and_the_extras_are_all_locked() -> None:
    text = (ROOT / "constraints.txt").read_text()
    blocks = re.findall(r"^([^\s#]+==[^\\\n]+?) ?((?:\\\n +--hash=sha256:[0-9a-f]{64} ?)*)$", text, re.MULTILINE)
    assert len(blocks) == text.count("==") - text.count(" == ") > 150
    assert [name for name, hashes in blocks if not hashes] == []
    needed = {canonicalize_name(one.name) for some in licences.extras().values() for one in some}
    assert needed <= set(licences.locked())


def test_another_version_than_the_locked_one_is_refused(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr(licences, "locked", lambda: {"numpy": "0.1"})
    with pytest.raises(licences.OtherVersion, match=r"numpy .* is installed, constraints.txt locks 0.1"):
        licences.package("numpy", licences.locked())
    with pytest.raises(licences.OtherVersion, match="does not lock it"):
        licences.package("scipy", licences.locked())


def test_a_closure_follows_markers_and_extras_of_the_stated_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    needs = {
        "a": ["b[more]>=1", 'c; python_version < "3.11"', 'd; sys_platform == "linux"'],
        "b": ['e; extra == "more"', 'f; extra == "less"'],
        "d": ["a"],
        "e": [],
    }

    class Found:
        def __init__(self, name: str) -> None:
            self.requires = needs[name]

    monkeypatch.setattr(licences, "_distribution", Found)
    assert licences.closure([Requirement("A>=1")]) == {"a", "b", "d", "e"}


def test_a_package_that_is_missing_is_named() -> None:
    with pytest.raises(licences.NotInstalled, match="antinode-no-such-package is not installed"):
        licences.closure([Requirement("antinode_no.such-package")])


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"License_Expression": "MIT", "License": "BSD"}, "MIT"),
        ({"License": "MIT"}, "MIT"),
        ({"License": "Copyright (c) 2015", "Classifier": ["License :: OSI Approved :: BSD License"]}, "BSD"),
        ({"License": "a text\nof lines", "Classifier": "License :: OSI Approved :: MIT License"}, "MIT"),
        ({"Classifier": ["Topic :: X", "License :: OSI Approved :: GNU General Public License v3 (GPLv3)"]}, "GPLv3"),
        ({}, "not declared"),
    ],
)
def test_what_a_package_declares(fields: dict, expected: str) -> None:
    assert expected in licences.declared(metadata_of(**fields))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("licence", "expected"),
    [
        ("GPL-2.0-only", "GPL"),
        ("AGPL-3.0", "GPL"),
        ("GNU Affero General Public License v3", "GPL"),
        ("GNU General Public License v2 (GPLv2)", "GPL"),
        ("GPL-3.0-or-later WITH GCC-exception-3.1", "GPL"),
        ("LGPLv3+", "LGPL"),
        ("GNU Lesser General Public License v3 or later (LGPLv3+)", "LGPL"),
        ("GNU Library General Public License", "LGPL"),
        ("MPL-2.0 AND MIT", "MPL"),
        ("LGPL-2.1 OR CDDL-1.0", "other reciprocal"),
        ("GPL-2.0 OR MIT", "permissive"),
        ("MIT AND (GPL-2.0 OR BSD-3-Clause)", "permissive"),
        ("EPL-2.0", "other reciprocal"),
        ("BSD License", "permissive"),
        ("Zlib", "permissive"),
    ],
)
def test_the_family_of_a_licence(licence: str, expected: str) -> None:
    assert licences.family(licence) == expected


def test_what_the_page_says_of_unicorn() -> None:
    """Its metadata's BSD stands beside the GPL of its description and the LGPL of its header."""
    try:
        unicorn = metadata.distribution("unicorn")
    except metadata.PackageNotFoundError:
        pytest.skip("unicorn is not installed: pip install unicorn")
    assert licences.declared(unicorn.metadata) == "BSD License"
    assert "Distributed under free software license GPLv2" in (unicorn.read_text("METADATA") or "")
    assert "released under LGPL2" in Path(str(unicorn.locate_file("unicorn/include/unicorn/unicorn.h"))).read_text()
    assert not [file for file in licences.files_of(unicorn) if licences.LICENCE_FILE.search(file)]
    result = licences.package("unicorn", licences.locked())
    assert [licences.family(terms) for _, terms, _ in result.inside] == ["GPL"]
    page = licences.PAGE.read_text()
    assert f"version {result.version}" in page and '"Distributed under free software license GPLv2"' in page


@pytest.mark.parametrize(
    ("name", "terms"), [("nlopt", "LGPL"), ("cadquery-ocp", "GPL-2.0-or-later"), ("pytetwild", "LGPL")]
)
def test_a_package_is_read_beyond_its_metadata(name: str, terms: str) -> None:
    try:
        result = licences.package(name, licences.locked())
    except licences.NotInstalled as missing:
        pytest.skip(str(missing))
    assert any(terms in inside for _, inside, _ in result.inside)
