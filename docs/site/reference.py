"""Reference pages generated from the program: case file, columns, JSON fields, commands, the library's names."""

from __future__ import annotations

import argparse
import inspect
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_type_hints

import yaml
from pydantic import BaseModel

import antinode
from pipeline.case.schema import MATERIAL_ALLOWED, TABLES, AttachedTable, MaterialTable, SupportTable
from pipeline.cli import main
from pipeline.questions import known, registered
from pipeline.questions import study as asked
from pipeline.questions.command import asks
from pipeline.records import part as declared
from pipeline.records import record, tables
from pipeline.records.outputs import unit_of

PAGE = TABLES | {"support": SupportTable, "cell.attached": AttachedTable}
SITE = Path(__file__).resolve().parent
ROOT = SITE.parents[1]
OWN = [name for name in antinode.__all__ if name != "__version__"]


def meanings() -> dict[str, dict[str, str]]:
    """Meaning of every key of a case file, by table."""
    return tomllib.loads((SITE / "keys.toml").read_text(encoding="utf-8"))


@cache
def field_meanings() -> dict[str, dict[str, Any]]:
    """Meaning of every field of a JSON document, by class; `any` applies to all, `documents` and `columns` are separate."""
    return tomllib.loads((SITE / "fields.toml").read_text(encoding="utf-8"))


def parts() -> dict[str, type[record.Part]]:
    """The classes of records that have fields."""
    listed = {name: part for name, part in vars(record).items() if inspect.isclass(part)}
    return {name: part for name, part in listed.items() if issubclass(part, record.Checked) and part.model_fields}


def answers() -> dict[str, type[declared.Part]]:
    """Classes of results and of their parts, whose fields have descriptions."""
    found: dict[str, type[declared.Part]] = {}
    waiting: list[Any] = [question.result for question in known().values()]
    while waiting:
        held = waiting.pop(0)
        if inspect.isclass(held) and issubclass(held, declared.Part) and held.__name__ not in found:
            found[held.__name__] = held
            hints = get_type_hints(held)
            waiting += [hints[name] for name in held.declared]
        waiting += get_args(held)
    return found


def meaning(part: type[BaseModel], name: str) -> str:
    """Meaning of a field in its class, else under `any`; an empty string without one."""
    known = field_meanings()
    return next((known[owner][name] for owner in (part.__name__, "any") if name in known.get(owner, {})), "")


def unexplained() -> list[str]:
    """Keys and fields without a meaning, and meanings without a key or a field."""
    return [*_unexplained_keys(), *_unexplained_fields()]


def _unexplained_fields() -> list[str]:
    known, classes = field_meanings(), parts()
    nameless = [f"{part}.{name}" for part, of in classes.items() for name in of.model_fields if not meaning(of, name)]
    there = {part: set(of.model_fields) for part, of in classes.items()}
    there |= {"any": set().union(*there.values()), "columns": column_names()}
    idle = [
        f"{owner}.{name}"
        for owner in known.keys() - {"documents"}
        for name in known[owner].keys() - there.get(owner, set())
    ]
    return sorted(nameless + idle)


def _unexplained_keys() -> list[str]:
    known, schema = meanings(), {table: {"", *model.model_fields} for table, model in PAGE.items()}
    return sorted(
        f"{table}.{key}"
        for table in known.keys() | schema.keys()
        for key in set(known.get(table, {})) ^ schema.get(table, set())
    )


def row(*cells: object) -> str:
    """Format a line of a table, with bars escaped."""
    return "| " + " | ".join(" ".join(str(cell).split()).replace("|", r"\|") for cell in cells) + " |"


def head(*cells: str) -> str:
    """The two first lines of a table."""
    return f"{row(*cells)}\n{row(*('---' for _ in cells))}"


def case_file() -> Iterator[str]:
    """Every key of a case file with its meaning, values and default."""
    known = meanings()
    yield f"## material\n\n{MATERIAL_ALLOWED}; `antinode materials` lists the names.\n"
    yield f"{head('key', 'values', 'default')}\n" + "\n".join(_keys(MaterialTable))
    for table, model in PAGE.items():
        yield f"\n## {table}\n\n{known[table]['']}\n\n{head('key', 'meaning', 'values', 'default')}"
        yield "\n".join(_keys(model, known[table]))


def _keys(model: type[BaseModel], known: dict[str, str] | None = None) -> Iterator[str]:
    for name, field in model.model_fields.items():
        default = "required" if field.is_required() else field.get_default(call_default_factory=True)
        shown = "none" if default is None else f"`{default}`" if not field.is_required() else default
        allowed = field.description or "; ".join(
            each.description for each in field.metadata if getattr(each, "description", None)
        )
        yield row(f"`{name}`", *([known[name]] if known else []), allowed or "a list of numbers", shown)


def columns() -> Iterator[str]:
    """Every column of table.csv, by the measure that fills it."""
    for question in asked.questions():
        if columns := asked.columns(question):
            yield f"\n## {question.name}\n\n{head('column', 'meaning', 'unit')}"
            yield "\n".join(_column(each.name, each.heading, each.unit) for each in columns)
    yield f"\n## Several together\n\n{head('column', 'meaning', 'unit')}"
    yield "\n".join(_column(each.name, each.heading, each.unit) for each in asked.OF_SEVERAL)
    yield f"\n## Along a sweep\n\n{head('column', 'meaning', 'unit')}"
    yield "\n".join(_column(name, heading, unit) for name, heading, _, unit in tables.TRACKED)


def _column(name: str, heading: str, unit: str | None) -> str:
    """A line of the table; the file holds what pages show in percent relative."""
    return row(f"`{name}`", field_meanings()["columns"].get(name, heading), "-" if unit in (None, "", "%") else unit)


def column_names() -> set[str]:
    """Every column that a measure may fill."""
    own = {each.name for question in asked.questions() for each in (*asked.columns(question), *asked.OF_SEVERAL)}
    return own | {name for name, *_ in tables.TRACKED}


def json_fields() -> Iterator[str]:
    """Every field of the commands' documents, then of the typed parts that they and records hold."""
    yield "\n## Documents of the commands"
    for command, fields in field_meanings()["documents"].items():
        title = "Every document" if command == "every" else f"`antinode {command} --json FILE`"
        of, own = fields.get("of"), {key: text for key, text in fields.items() if key != "of"}
        yield f"\n### {title}\n"
        if of:
            yield f"The fields of [{of}](#{of.lower()}){', and' if own else '.'}\n"
        if own:
            yield "\n".join([head("field", "meaning"), *(row(f"`{key}`", text) for key, text in own.items())])
    for question in sorted(registered().values(), key=lambda question: question.command()):
        result = question.result.__name__
        yield f"\n### `antinode {question.command()} --json FILE`\n\nThe fields of [{result}](#{result.lower()}).\n"
    yield "\n## Parts"
    for name, answer in sorted(answers().items()):
        hints = get_type_hints(answer)
        yield f"\n### {name}\n\n{_summary(answer)}\n\n{head('field', 'meaning', 'type', 'unit')}"
        yield "\n".join(
            row(f"`{key}`", f"{each.about}.", f"`{_kind(hints[key])}`", each.unit or "-")
            for key, each in answer.declared.items()
        )
    for name, part in parts().items():
        yield f"\n### {name}\n\n{inspect.cleandoc(part.__doc__ or '')}\n\n{head('field', 'meaning', 'type', 'unit')}"
        yield "\n".join(_fields(part))


def _fields(part: type[BaseModel]) -> Iterator[str]:
    for name, field in part.model_fields.items():
        yield row(f"`{name}`", meaning(part, name), f"`{_kind(field.annotation)}`", unit_of(name) or "-")


def _kind(annotation: Any) -> str:
    """A type in words, without the modules of its parts."""
    if inspect.isclass(annotation) and not get_args(annotation):
        return annotation.__name__
    return re.sub(r"(pipeline\.\w+\.\w+|typing)\.", "", str(annotation))


def _summary(part: type) -> str:
    """A docstring without its sections and examples."""
    return re.split(r">>>|^\w+\n---", inspect.cleandoc(part.__doc__ or ""), flags=re.MULTILINE)[0].strip()


def commands() -> Iterator[str]:
    """The `--help` text of each command."""
    for name, sub in _subcommands("", main._parser()):
        sub.formatter_class = lambda prog: argparse.RawDescriptionHelpFormatter(prog, width=110)
        yield f"\n## {name}\n\n```text\n{sub.format_help().strip()}\n```"


def _subcommands(name: str, parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Every command of a parser, and those of its commands, by their words."""
    choices = [each.choices for each in parser._actions if isinstance(each, argparse._SubParsersAction)]
    for word, sub in choices[0].items() if choices else ():
        yield f"{name} {word}".strip(), sub
        yield from _subcommands(f"{name} {word}".strip(), sub)


def library() -> Iterator[str]:
    """Every public name of `import antinode`, from its docstring."""
    for name in OWN:
        thing = getattr(antinode, name)
        if inspect.isclass(thing):
            inherited = ":inherited-members: dict, Sequence, UserWarning, Exception, object"
            options = [":members:", inherited]
            directive = f".. autoclass:: antinode.{name}"
        else:
            directive, options = f".. autofunction:: antinode.{name}", []
        lines = [directive, *(f"   {option}" for option in options)]
        yield f"\n## {name}\n\n" + "\n".join(["```{eval-rst}", *lines, "```"])


def public_names() -> set[str]:
    """Every name required in the library's reference: public names, and public members of their classes."""
    names = set()
    for name in OWN:
        thing: Any = getattr(antinode, name)
        names.add(f"antinode.{name}")
        for owner in inspect.getmro(thing) if inspect.isclass(thing) else ():
            if owner.__module__.startswith(("antinode", "pipeline.questions")):
                names |= {f"antinode.{name}.{key}" for key, value in vars(owner).items() if _is_member(key, value)}
    return names


def _is_member(key: str, value: object) -> bool:
    return not key.startswith("_") and (callable(value) or isinstance(value, property))


def cite() -> Iterator[str]:
    """A BibTeX entry from CITATION.cff, and the literature."""
    cff = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    fields = {
        "author": " and ".join(f"{{{each['name']}}}" for each in cff["authors"]),
        "title": cff["title"],
        "version": cff["version"],
        "license": cff["license"],
    }
    entry = ",\n".join(f"  {key} = {{{value}}}" for key, value in fields.items())
    yield f"```bibtex\n@software{{antinode,\n{entry}\n}}\n```\n\n## Literature\n"
    yield f"```bibtex\n{(ROOT / 'docs' / 'references.bib').read_text(encoding='utf-8').strip()}\n```"


def names() -> Iterator[str]:
    """What every public name of `import antinode` is for, in a sentence."""
    yield f"\n{head('name', 'what it is for')}"
    questions = {f"antinode.Plate.{key}" for key, value in vars(antinode.Plate).items() if isinstance(value, asks)}
    for name in sorted(public_names() | questions, key=lambda name: (OWN.index(name.split(".")[1]), name)):
        thing: Any = antinode
        for step in name.split(".")[1:]:
            thing = getattr(thing, step)
        yield row(f"`{name.partition('.')[2]}`", (inspect.getdoc(thing) or "").split("\n\n")[0])


# text that follows the words of a page: committed with them, and made again by `python docs/site/reference.py`
PAGES = {
    "reference/case-file.md": case_file,
    "reference/columns.md": columns,
    "reference/json.md": json_fields,
    "reference/commands.md": commands,
    "reference/library.md": names,
    "cite.md": cite,
}
MARK = "<!-- what follows is made by docs/site/reference.py -->"


def completed(page: str) -> str:
    """A page's own words with the text that is made for it."""
    words = (ROOT / "docs" / page).read_text(encoding="utf-8").partition(MARK)[0].rstrip()
    made = "\n".join(PAGES[page]()).strip()
    return f"{words}\n\n{MARK}\n\n{made}\n"


if __name__ == "__main__":
    for page in PAGES:
        (ROOT / "docs" / page).write_text(completed(page), encoding="utf-8")
