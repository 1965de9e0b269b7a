"""The command `antinode`: parse arguments, run one command, print errors in a line each, set the exit code, complete.

Questions declare their commands (`pipeline.questions`); commands.toml declares the others. Nothing heavy is imported
here: each command imports what it needs when it runs.
"""

from __future__ import annotations

import argparse
import importlib
import os
import re
import sys
import tomllib
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator, Sequence
from math import inf
from pathlib import Path
from typing import Any, NoReturn

from pipeline.case import limits
from pipeline.errors import one_line
from pipeline.process import lend_cache_folders, terminable
from pipeline.questions import Listed, listed, load

DECLARED = Path(__file__).with_name("commands.toml")
GROUPS = ("case", "files", "plan")  # of options that every question has

# Arguments that name input files: these files are never overwritten.
READ = ("case", "study", "target", "mesh_file", "measured", "map", "table", "sweep", "file")

FIRST = ("new",)  # before the questions, in the order of use; the other commands follow them as declared
SELDOM = ("active", "check-gap", "completion", "schema")  # commands that the first page of help only names
FAMILIES = {"active": ("compute analogy and control models", "active beam --gain 1e7 --gain 1e8 --out beam")}
MAX_DIGITS = 40  # characters
NEGATIVE = re.compile(
    r"-(?!\d+$|\d*\.\d+$)\.?\d"
)  # start of a value such as -7,3 or -5kHz; argparse knows plain numbers
DONE, WRONG_INPUT, NOT_TRUSTED, CHECK_FAILED, UNAVAILABLE, INTERRUPTED = 0, 2, 3, 4, 5, 130


class _Parser(argparse.ArgumentParser):
    """Argument parser that prints an error in one line instead of a usage block and suggests the nearest command."""

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.dest == "command" and action.choices is not None and value not in action.choices:
            from pipeline.case.reading import nearest

            raise argparse.ArgumentError(None, f"{value}: no such command{nearest(value, list(action.choices))}")
        super()._check_value(action, value)

    def error(self, message: str) -> NoReturn:
        print(one_line(f"{self.prog}: {message} (see {self.prog} --help)"), file=sys.stderr)
        raise SystemExit(WRONG_INPUT)


class _Version(argparse.Action):
    """Print the version and exit; it is looked up only then."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        """Print the version."""
        from importlib.metadata import version

        print(f"antinode {version('antinode')}")
        parser.exit()


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line; the exit code is the contract with scripts."""
    words = sys.argv[1:] if argv is None else argv
    _open_streams()
    if "_ARGCOMPLETE" in os.environ:  # a shell asks for completions
        complete(_parser())
    arguments = _read(_parser(_asked(words)), words)
    try:
        with terminable():
            return _run(arguments)
    except KeyboardInterrupt:
        print("antinode: interrupted; finished work is kept", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except Exception as error:
        if arguments.debug:
            raise
        return _report_error(error)


def completion(arguments: Namespace) -> int:
    """Print the shell code that asks `antinode` for completions."""
    import argcomplete

    print(argcomplete.shellcode(["antinode"], shell=arguments.shell).strip())
    return 0


def complete(parser: ArgumentParser) -> None:
    """Print the completions that a shell asks for, and exit."""
    import argcomplete
    from argcomplete.completers import FilesCompleter

    places = {"case": FilesCompleter(("toml",)), "study": _studies, "target": _studies, "set": _keys, "vary": _varied}
    for command in next(iter(parser._subparsers._group_actions)).choices.values():  # type: ignore
        for action in command._actions:
            if action.dest in places:
                action.completer = places[action.dest]
    argcomplete.autocomplete(parser, always_complete_options=False)


def _open_streams() -> None:
    """Redirect standard output and error to the null device where the caller closed them."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115


def _read(parser: argparse.ArgumentParser, words: Sequence[str]) -> argparse.Namespace:
    """Parse a command line; `antinode` alone and `antinode help [COMMAND]` mean --help."""
    if not words or words[0] == "help":
        words = [*words[1:2], "--help"]
    arguments, unknown = parser.parse_known_args(_with_negatives(words))
    arguments.words = words
    if unknown:
        own = arguments.prog
        line = f"{own}: unrecognized arguments: {' '.join(unknown)} (see {own} --help)"
        print(one_line(line), file=sys.stderr)
        raise SystemExit(WRONG_INPUT)
    return arguments


def _with_negatives(words: Sequence[str]) -> list[str]:
    """Join options and values that begin with a negative number, such as --at -7,3, which argparse takes for an option."""
    joined: list[str] = []
    for word in words:
        if NEGATIVE.match(word) and joined and joined[-1].startswith("--") and "=" not in joined[-1]:
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _asked(words: Sequence[str]) -> str:
    """Return the command that a command line names, '' if it names none."""
    return next((each for each in words if not each.startswith("-") and each != "help"), "")


def _run(arguments: argparse.Namespace) -> int:
    from geometry.files import inputs_kept, read_by_command
    from pipeline.logs import TerminalLog
    from pipeline.questions import command

    _require_variables()
    lend_cache_folders()
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # the search reads every installed distribution
    TerminalLog.verbose = arguments.verbose
    with inputs_kept():
        given = (getattr(arguments, name, None) for name in READ)
        each = (place for places in given for place in (places if isinstance(places, list) else [places]))
        read_by_command(*(place for place in each if isinstance(place, str)))
        command.check(arguments)
        return int(_function(arguments.handler)(arguments))


def _function(place: str) -> Callable[..., Any]:
    """Import a function from MODULE:NAME."""
    module, _, name = place.partition(":")
    function: Callable[..., Any] = getattr(importlib.import_module(module), name)
    return function


def _require_variables() -> None:
    """Raise InputError for an invalid limit of threads or memory, or an unknown factorisation, in the environment."""
    from pipeline.errors import InputError
    from solvers.machine import FACTOR, LIMIT, STATED, factorisations

    faults, given = [], {name: os.environ[name] for name in (LIMIT, STATED, FACTOR) if name in os.environ}
    if not given.get(LIMIT, "0").isdecimal():
        faults.append(f"{LIMIT} = {given[LIMIT]!r}: must be a whole number of threads; 0 uses every core")
    if not _is_above_0(given.get(STATED, "1")):
        faults.append(f"{STATED} = {given[STATED]!r}: must be a number above 0, in GiB")
    if given.get(FACTOR) and given[FACTOR] not in factorisations():
        faults.append(f"{FACTOR} = {given[FACTOR]!r}: must be one of {', '.join(factorisations())} here")
    if faults:
        raise InputError(faults)


def _is_above_0(text: str) -> bool:
    try:
        return 0.0 < float(text) < inf
    except ValueError:
        return False


def _report_error(error: Exception) -> int:
    """Print one line per reason and return the exit code of the error."""
    from geometry.errors import GeometryError, MeshError
    from pipeline.errors import CommandError
    from solvers.errors import SolverError

    if isinstance(error, CommandError):
        lines, code = error.lines, error.exit_code
    elif isinstance(error, MemoryError):
        from solvers.machine import memory_text

        lines, code = [memory_text(error)], NOT_TRUSTED
    elif isinstance(error, MeshError | SolverError):
        lines, code = [" ".join(str(error).split())], NOT_TRUSTED
    elif isinstance(error, GeometryError | OSError):
        lines, code = [" ".join(str(error).split())], WRONG_INPUT
    elif isinstance(error, ModuleNotFoundError):
        lines, code = [f"{error.name} is not installed: run `make setup`"], UNAVAILABLE
    else:
        lines, code = (
            [f"unexpected {type(error).__name__}: {error}; --debug prints the traceback. Please report it"],
            NOT_TRUSTED,
        )
    for line in lines:
        print(f"antinode: {one_line(line)}", file=sys.stderr)
    return code


def _parser(asked: str | None = None) -> argparse.ArgumentParser:
    """Build the parser from the commands of questions and those of commands.toml.

    Only the requested question gets its options, so that no other question is loaded; by default all of them do.
    """
    parser = _Parser(
        prog="antinode",
        description="Design touch plates that confine vibration: one case file gives modes, gaps, prints and firmware.",
        epilog=f"other commands: {', '.join(SELDOM)} (antinode COMMAND --help)\n\n"
        "example: antinode modes studies/three-rows.toml --part zone --near 40kHz --count 3",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(debug=False)
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    with DECLARED.open("rb") as file:
        declared = tomllib.load(file)
    begun = {name: declared["commands"].pop(name) for name in FIRST}
    _add_declared(commands, begun, declared["groups"], asked)
    families: dict[str, Any] = {}
    for question in listed():
        family, _, word = question.command.rpartition(" ")
        if family and family not in families:
            families[family] = _family(commands, family)
        summary = question.summary
        about = f"{summary[0].lower()}{summary[1:]}"
        handler = "pipeline.questions.command:run"
        sub = _command(families.get(family, commands), word, about, question.example, handler)
        if asked is None or asked == (family or word):
            _add_options(sub, question, declared["groups"])
    _add_declared(commands, declared["commands"], declared["groups"], asked)
    return parser


def _add_declared(commands: Any, declared: dict[str, Any], groups: dict[str, Any], asked: str | None) -> None:
    """Add commands of commands.toml with their options."""
    for name, about in declared.items():
        sub = _command(commands, name, about["help"], about["example"], about["run"])
        own = about.get("options", {})
        shared = {flag: words for group in about.get("groups", ()) for flag, words in groups[group].items()}
        positional = [flag for flag in own if not flag.startswith("-")]
        for flag in dict.fromkeys((*positional, *shared, *own)):
            _add(sub, flag, *(words for words in (shared.get(flag), own.get(flag)) if words is not None))
        if "add" in about and asked in (None, name):
            _function(about["add"])(sub)


def _add_options(sub: argparse.ArgumentParser, listed: Listed, groups: dict[str, Any]) -> None:
    """Add the options that every question has, and its own."""
    from pipeline.questions.command import add_options

    question = load(listed)
    sub.set_defaults(question=question.name)
    for flag, words in (pair for group in GROUPS for pair in groups[group].items()):
        optional = {"nargs": "?"} if flag == "case" and question.without_case is not None else {}
        _add(sub, flag, words, optional)
    add_options(sub, question)


def _family(commands: Any, name: str) -> Any:
    """Add a command whose models are subcommands."""
    return _sub(commands, name, *FAMILIES[name]).add_subparsers(dest="model", required=True, metavar="MODEL")


def _sub(commands: Any, name: str, text: str, example: str) -> argparse.ArgumentParser:
    look: dict[str, Any] = {
        "epilog": f"example: antinode {example}",
        "formatter_class": argparse.RawDescriptionHelpFormatter,
    }
    about = {} if name in SELDOM else {"help": text}
    sub: argparse.ArgumentParser = commands.add_parser(name, description=text, **about, **look)
    return sub


def _command(commands: Any, name: str, text: str, example: str, handler: str) -> argparse.ArgumentParser:
    """Add a command by its name, help and example; `handler` is the module and the function that run it."""
    sub = _sub(commands, name, text, example)
    sub.set_defaults(handler=handler, prog=sub.prog)
    sub.add_argument("-q", "--quiet", action="store_true", help="print no progress or log on standard error")
    sub.add_argument("-v", "--verbose", action="store_true", help="also log the simplifications and their reasons")
    sub.add_argument("--debug", action="store_true", help="print the traceback of an error")
    return sub


def _add(sub: argparse.ArgumentParser, flag: str, *declared: dict[str, Any] | str) -> None:
    words: dict[str, Any] = {}
    for each in declared:
        words |= {"action": "store_true", "help": each} if isinstance(each, str) else each
    if "most" in words:
        most = words.pop("most")
        words["type"] = _count(words.pop("least", 1), most if isinstance(most, int) else getattr(limits, most))
    sub.add_argument(*flag.split(), **words)


def _count(least: int, most: int) -> Callable[[str], int]:
    """Return the type of an option that counts something, within the limits of the same key of a case file."""

    def number(text: str) -> int:
        value = int(text) if len(text) < MAX_DIGITS else -1
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{text[:MAX_DIGITS]}: must be {least} or more, at most {most}")
        return value

    return number


def _studies(prefix: str, **_: Any) -> list[str]:
    """Complete study names, and study files below the folder."""
    from argcomplete.completers import FilesCompleter

    from pipeline.batch.study_file import checkout_studies

    files: list[str] = FilesCompleter(("toml",))(prefix)
    return [*checkout_studies(), *files]


def _keys(prefix: str, **_: Any) -> Iterator[str]:
    """Complete the keys of a case file and the values of named choices."""
    from typing import Literal, get_args, get_origin

    from geometry.materials import MATERIALS
    from pipeline.case.schema import TABLES

    yield from (f"material={name}" for name in MATERIALS)
    for table, schema in TABLES.items():
        for name, field in schema.model_fields.items():
            choices = get_args(field.annotation) if get_origin(field.annotation) is Literal else ("",)
            yield from (f"{table}.{name}={choice}" for choice in choices)


def _varied(prefix: str, **_: Any) -> list[str]:
    """Complete the keys that a search may vary."""
    from pipeline.search.space import searchable_keys, word_keys

    return [f"{key}=" for key in (*searchable_keys(), *word_keys())]


if __name__ == "__main__":
    raise SystemExit(main())
