"""Where results go, from the command line: standard output, places that cannot serve, inputs, caches, long and many lines."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

from pipeline.case.model import load_case
from pipeline.cli import main
from pipeline.errors import InputError, one_line
from pipeline.exchange import exports, finite_elements
from pipeline.logs import TerminalLog
from pipeline.questions import predesign
from pipeline.records import outputs

ROOT = Path(__file__).resolve().parents[3]
SMALL = ROOT / "examples" / "small.toml"


@pytest.fixture
def case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A case of one's own in a folder of its own, which is the working one."""
    path = tmp_path / "c.toml"
    path.write_text(SMALL.read_text())
    monkeypatch.chdir(tmp_path)
    return path


@pytest.fixture
def nothing_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    def computed(*_: object, **__: object) -> None:
        raise AssertionError("computed before the places were looked at")

    monkeypatch.setattr(predesign, "sized", computed)
    monkeypatch.setattr(exports, "_cad", computed)
    monkeypatch.setattr(exports, "_vtu", computed)
    monkeypatch.setattr(exports, "_table", computed)
    monkeypatch.setattr(finite_elements, "aster", computed)
    monkeypatch.setattr(finite_elements, "calculix", computed)


@pytest.mark.usefixtures("nothing_computed")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("predesign c.toml --json no/x.json", "no folder no"),
        ("predesign c.toml --json .", "is a folder"),
        ("predesign c.toml --json=", "no name"),
        ("predesign c.toml --json c.toml", "never overwritten"),
        ("predesign c.toml --out c.toml", "is not a folder"),
        ("predesign link.toml --json c.toml", "never overwritten"),
        ("export stl c.toml -o c.toml", "never overwritten"),
        ("export stl c.toml -o no/x.stl", "no folder no"),
        ("export vtu c.toml -o no/x.vtu", "no folder no"),
        ("export stl c.toml -o .", "is a folder"),
        ("export stl c.toml --output=", "no name"),
        ("export calculix c.toml -o no/x", "no folder no"),
        ("export calculix part.inp", "never overwritten"),
        ("export aster c.toml -o no/x", "no folder no"),
        ("export aster c.toml -o -", "several files (-.med, -.comm, -.export, -_README.txt)"),
        ("export table c.toml -o -", "several files (-.bin, -.h)"),
        ("export table c.toml -o fifo", "several files (fifo.bin, fifo.h)"),
        ("export stl c.toml -o - --json -", "standard output takes a single document"),
        ("export stl c.toml -o x.stl --json ./x.stl", "--json also writes this file"),
        ("modes c.toml --json no/x.json", "no folder no"),
        ("modes c.toml --json x --csv ./x", "--json also writes this file"),
        ("modes c.toml --csv x.svg --plot x.svg", "--csv also writes this file"),
        ("doctor table t.bin --json t.bin", "never overwritten"),
        ("response c.toml --measured out/response.csv --out out", "never overwritten"),
    ],
)
def test_places_that_cannot_serve_are_refused_in_one_line_before_computing(
    case: Path, words: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = case.read_bytes()
    Path("link.toml").symlink_to("c.toml")
    Path("part.inp").write_text(text.decode().replace('"small"', '"part"'))
    Path("t.bin").write_bytes(b"table")
    Path("out").mkdir()
    Path("out/response.csv").write_text("frequency_Hz,real,imag\n")
    os.mkfifo("fifo")
    before = sorted(path.name for path in case.parent.rglob("*"))
    assert main.main(words.split()) == 2
    message = capsys.readouterr().err.splitlines()
    assert len(message) == 1 and said in message[0], message
    assert case.read_bytes() == text and sorted(path.name for path in case.parent.rglob("*")) == before


def test_the_step_file_of_a_pillar_is_an_input(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import cadquery as cq

    cq.exporters.export(cq.Workplane().box(2, 2, 6, centered=(True, True, False)), "pillar.step")
    step = Path("pillar.step").read_bytes()
    words = ("--set", "pillar.shape=step", "--set", "pillar.file=pillar.step")
    assert main.main(["predesign", "c.toml", *words, "--json", "pillar.step"]) == 2
    assert "never overwritten" in capsys.readouterr().err and Path("pillar.step").read_bytes() == step


@pytest.mark.parametrize("place", ["-", "/dev/stdout"])
def test_json_on_standard_output_is_alone(case: Path, place: str) -> None:
    done = command("predesign", "c.toml", "--json", place)
    assert json.loads(done.stdout)["schema"] == 2 and done.returncode == 0
    assert [path.name for path in Path().iterdir()] == ["c.toml"]


def command(*words: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    env = os.environ | {"PYTHONPATH": str(ROOT)} | environment
    return subprocess.run([sys.executable, "-m", "pipeline.cli.main", *words], capture_output=True, env=env)


def test_a_file_for_others_on_standard_output_is_alone_and_whole(case: Path, capfdbinary: object) -> None:
    loaded = load_case("c.toml")
    sizes = {}
    for form in ("3mf", "stl"):
        exports.write(loaded, form, f"x.{form}", TerminalLog(quiet=True))
        exports.write(loaded, form, "-", TerminalLog(quiet=True))
        text = capfdbinary.readouterr().out  # type: ignore[attr-defined]
        assert text == Path(f"x.{form}").read_bytes()
        sizes[form] = text
    assert len(ZipFile(io.BytesIO(sizes["3mf"])).namelist()) == 3 and not Path("-").exists()


def test_text_on_standard_output_makes_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    monkeypatch.chdir(tmp_path)
    outputs.write_file(Path("-"), b"a,b\n")
    assert capfdbinary.readouterr().out == b"a,b\n" and not list(tmp_path.iterdir())


def test_a_calculix_file_goes_where_it_is_sent(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo")
    assert (
        finite_elements.calculix_file(Path("-")) == Path("-")
        and finite_elements.calculix_file(tmp_path / "fifo") == tmp_path / "fifo"
    )
    assert finite_elements.calculix_file(Path("x")) == Path("x.inp") and finite_elements.calculix_file(
        Path("x.inp")
    ) == Path("x.inp")
    assert finite_elements.calculix_file(Path("X.INP")) == Path("X.INP")
    assert finite_elements.aster_files(Path("a.MED"))[0] == Path("a.med")


def test_a_terminal_is_no_place_for_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    with pytest.raises(InputError, match="terminal"), outputs.delivered(Path("-")):
        pass


@pytest.mark.slow
def test_libraries_say_nothing_where_no_home_can_be_written(case: Path) -> None:
    """matplotlib and ezdxf, which cadquery brings along, warn of folders that they cannot make."""
    (case.parent / "home").write_text("no folder")
    environment = {"HOME": str(case.parent / "home"), "TMPDIR": str(case.parent)}
    for name in ("MPLCONFIGDIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"):
        environment[name] = ""
    done = command("export", "stl", "c.toml", "--quiet", "-o", "p.stl", **environment)
    assert (done.returncode, done.stderr) == (0, b"")
    assert sorted(path.name for path in case.parent.iterdir()) == ["c.toml", "home", "p.stl"]
    for lent, complains in (("process.lend_cache_folders()", False), ("pass", True)):
        code = f"from pipeline import process; {lent}; import matplotlib; matplotlib.get_configdir()"
        done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, env=os.environ | environment)
        assert (done.returncode, bool(done.stderr)) == (0, complains), done.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--unit", "mm"], "--unit = mm: needs --mesh-file"),
        (["--clamp", "FOOT"], "--clamp = FOOT: needs --mesh-file"),
        (["--near", "3kHz", "--band", "1kHz:2kHz"], "--near = 3kHz: cannot be combined with --band"),
    ],
)
def test_options_without_effect_are_refused(
    case: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(["modes", "c.toml", *words]) == 2
    text = capsys.readouterr().err.splitlines()
    assert len(text) == 1 and said in text[0]


@pytest.mark.parametrize(
    "words",
    [
        ["predesign", "no\nsuch\x1b[31m.toml"],
        ["predesign", "c.toml", "--set", "'''\n'''"],
        ["predesign", "c.toml", "--set", "pillar.shape='''a\nb'''"],
        ["predesign", "c.toml", "--set", 'pillar."a\\nb"=1'],
        ["predesign", "c.toml", "--set", "a" * 10_000 + "=1"],
        ["predesign", "c.toml", "--json", "no\nfolder/x"],
        ["predesign", "c.toml", "what\nis this"],
        ["frob\nnicate"],
    ],
)
def test_a_fault_is_one_line_of_sane_length(case: Path, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main.main(words)
    except SystemExit as end:
        code = int(end.code or 0)
    text = capsys.readouterr().err
    assert code == 2 and text.count("\n") == 1 and "\x1b" not in text and len(text) < 2100, text


def test_a_long_unknown_key_is_cut(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with case.open("a") as file:
        file.write(f"\n[pilar]\n{'k' * 200_000} = 1\n")
    assert main.main(["predesign", "c.toml"]) == 2
    assert max(map(len, capsys.readouterr().err.splitlines())) < 400


def test_what_no_terminal_can_show_is_escaped() -> None:
    assert one_line("a\nb\tc\x1b\udce4ü–") == "a\\nb\\tc\\x1b\\udce4ü–"
    assert len(one_line("x" * 10**6)) < 2100 and one_line("x" * 10**6 + "end").endswith("xend")


@pytest.mark.slow
def test_files_are_written_though_nobody_reads_standard_output(case: Path) -> None:
    words = f"{sys.executable} -m antinode predesign c.toml --json x.json --csv x.csv --plot x.svg | true"
    done = subprocess.run(["bash", "-c", f"set -o pipefail; {words}"], env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.returncode == 0
    assert all(Path(name).stat().st_size for name in ("x.json", "x.csv", "x.svg"))


@pytest.mark.slow
def test_closed_standard_streams_are_no_fault(case: Path) -> None:
    words = f"{sys.executable} -m antinode predesign c.toml --json x.json >&- 2>&-"
    done = subprocess.run(["bash", "-c", words], env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.returncode == 0 and json.loads(Path("x.json").read_text())["zone"]
