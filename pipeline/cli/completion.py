"""`antinode completion`: what could be typed next, for the shell that asks."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from typing import Any


def completion(arguments: Namespace) -> int:
    """Print the shell's code that asks `antinode` itself for completions."""
    import argcomplete

    print(argcomplete.shellcode(["antinode"], shell=arguments.shell).strip())
    return 0


def complete(parser: ArgumentParser) -> None:
    """Answer a shell that asks what could come next, and end."""
    import argcomplete
    from argcomplete.completers import FilesCompleter

    places = {"case": FilesCompleter(("toml",)), "study": _studies, "target": _studies, "set": _keys, "vary": _varied}
    for command in next(iter(parser._subparsers._group_actions)).choices.values():  # type: ignore
        for action in command._actions:
            if action.dest in places:
                action.completer = places[action.dest]
    argcomplete.autocomplete(parser, always_complete_options=False)


def _studies(prefix: str, **_: Any) -> list[str]:
    """Studies by their names, and study files below the folder."""
    from argcomplete.completers import FilesCompleter

    from pipeline.batch.study_file import checkout_studies

    files: list[str] = FilesCompleter(("toml",))(prefix)
    return [*checkout_studies(), *files]


def _keys(prefix: str, **_: Any) -> Iterator[str]:
    """Keys of a case file with what a named choice may be."""
    from typing import Literal, get_args, get_origin

    from geometry.materials import MATERIALS
    from pipeline.case.schema import TABLES

    yield from (f"material={name}" for name in MATERIALS)
    for table, schema in TABLES.items():
        for name, field in schema.model_fields.items():
            choices = get_args(field.annotation) if get_origin(field.annotation) is Literal else ("",)
            yield from (f"{table}.{name}={choice}" for choice in choices)


def _varied(prefix: str, **_: Any) -> list[str]:
    """Keys that a search may vary."""
    from pipeline.search.space import searchable_keys, word_keys

    return [f"{key}=" for key in (*searchable_keys(), *word_keys())]
