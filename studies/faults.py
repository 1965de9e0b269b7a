"""Small faults that can be planted in a source: sign, factor, index, comparison, dropped term, guard or tolerance.

Those of Python come from its syntax tree. Those of C come from its text, in functions written as in firmware/core: braces of a
function in the first column, blanks around binary operators, one statement a line. Assertions are left alone, and
comparisons that choose the larger or smaller of their values.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass

OPPOSITE: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
FACTOR, LOOSER = 2, 1000
SMALL = 1e-3  # a constant of a module below it is a tolerance


@dataclass(frozen=True)
class Fault:
    """One change of a file, relative to the checkout: its span in characters, both texts, and the lines that run it."""

    path: str
    kind: str
    span: tuple[int, int]
    before: str
    after: str
    lines: tuple[int, ...]

    def planted(self, text: str) -> str:
        """The source with the fault."""
        return text[: self.span[0]] + self.after + text[self.span[1] :]

    def __str__(self) -> str:
        """Where it is, and both texts in one line."""
        before, after = (" ".join(text.split()) for text in (self.before, self.after))
        return f"{self.path}:{self.lines[0]}: {self.kind}: {before} -> {after}"


def faults(path: str, text: str) -> Iterator[Fault]:
    """Every fault that can be planted in a source of Python or C, in no particular order."""
    return _of_c(path, text) if path.endswith(".c") else _of_python(path, text)


def _of_python(path: str, text: str) -> Iterator[Fault]:
    tree = ast.parse(text)
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    rows = text.splitlines()

    def span(node: ast.expr) -> tuple[int, int]:
        ends = (node.lineno, node.col_offset), (node.end_lineno or 0, node.end_col_offset or 0)
        first, last = (starts[n - 1] + len(rows[n - 1].encode()[:column].decode()) for n, column in ends)
        return first, last

    for node, kind, changed, lines in _changes(tree):
        at = span(node)
        yield Fault(path, kind, at, text[slice(*at)], f"({ast.unparse(changed)})", lines)


def _changes(tree: ast.Module) -> Iterator[tuple[ast.expr, str, ast.expr, tuple[int, ...]]]:
    """Nodes, what is wrong with each, the wrong node, and lines that run it."""
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    inside = {part: None for function in functions for part in ast.walk(function) if isinstance(part, ast.stmt)}
    for statement in inside:
        if not isinstance(statement, ast.FunctionDef | ast.ClassDef):
            for node in _running(statement):
                whole = node if hasattr(statement, "body") else statement
                for kind, changed in _wrong(node):
                    yield node, kind, changed, tuple(range(whole.lineno, (whole.end_lineno or 0) + 1))
    for statement in tree.body:
        value = getattr(statement, "value", None)
        if isinstance(statement, ast.Assign) and isinstance(value, ast.Constant) and isinstance(value.value, float):
            name, own = getattr(statement.targets[0], "id", ""), statement.lineno
            uses = {n.lineno for n in ast.walk(tree) if isinstance(n, ast.Name) and n.id == name} - {own}
            kind, factor = ("tolerance", LOOSER) if 0.0 < abs(value.value) < SMALL else ("factor", FACTOR)
            yield value, kind, ast.Constant(value.value * factor), tuple(sorted(uses)) or (own,)


def _running(node: ast.AST) -> Iterator[ast.expr]:
    """Expressions of a statement itself, without annotations and texts."""
    if isinstance(node, ast.JoinedStr):
        return
    if isinstance(node, ast.expr):
        yield node
    for name, value in ast.iter_fields(node):
        if name != "annotation":
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and not isinstance(child, ast.stmt | ast.excepthandler):
                    yield from _running(child)


def _wrong(node: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Wrong forms of an expression."""
    if isinstance(node, ast.BinOp) and not isinstance(node.left, ast.Constant | ast.JoinedStr):
        if isinstance(node.op, ast.Add | ast.Sub):
            yield "sign", ast.BinOp(node.left, OPPOSITE[type(node.op)](), node.right)  # type: ignore[arg-type]
            yield "dropped term", node.left
        elif isinstance(node.op, ast.Mult):
            yield "dropped factor", node.left
        elif isinstance(node.op, ast.Pow):
            yield "dropped power", node.left
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
        yield "sign", node.operand
    if isinstance(node, ast.Constant) and type(node.value) is float and node.value not in (0.0, float("inf")):
        yield "factor", ast.Constant(node.value * FACTOR)
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant) and type(node.slice.value) is int:
        yield "index", ast.Subscript(node.value, ast.Constant(node.slice.value + 1), node.ctx)
    if isinstance(node, ast.Compare) and type(node.ops[0]) in OPPOSITE:
        operators = [OPPOSITE[type(node.ops[0])](), *node.ops[1:]]
        yield "comparison", ast.Compare(node.left, operators, node.comparators)  # type: ignore[arg-type]
    if isinstance(node, ast.BoolOp):
        yield "guard", node.values[0]


IN_C: dict[str, dict[str, str | None]] = {
    "sign": {r" \+ ": " - ", r" - ": " + ", r" \+= ": " -= ", r" -= ": " += ", r"(?<=[(=,?:] )-(?=[a-z(])": ""},
    "dropped factor": {r" \* [\w.>\[\]-]+(?=[;,) ])": ""},
    "comparison": {
        r" < ": " <= ", r" <= ": " < ", r" > ": " >= ", r" >= ": " > ", r" == ": " != ", r" != ": " == ",
    },
    "guard": {r" && ": " || ", r" \|\| ": " && ", r"!(?=[a-z(])": ""},
    "index": {r"\[0u?\]": "[1]", r"\[1u?\]": "[0]"},
    "factor": {r"\b\d+\.?\d*(?:e-?\d+)?(?=f\b)": None},
    "dropped statement": {r"(?m)^ +(?:[\w.>\[\]-]+ [-+*/&|^]?= .*|an_\w+\(.*\));(?= *$)": ""},
}  # fmt: skip
# of equal values, either is the same
LARGER = re.compile(r"(\S+) [<>]=? (?:\(\w+\))?(\S+) \? (?:-?\1|(?:\(\w+\))?\2)(?: -| :)")
COMMENT = re.compile(r'/\*.*?\*/|"(?:\\.|[^"\\])*"|AN_ASSERT\(.*?\);|sizeof [^;,)]*', re.S)
FUNCTION = re.compile(r"^\{$.*?^\}$", re.S | re.M)
CONSTANT = re.compile(r"^#define (\w+) .*?\b(\d+\.?\d*(?:e-?\d+)?)f\b", re.M)


def _of_c(path: str, text: str) -> Iterator[Fault]:
    code = COMMENT.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)

    def line(at: int) -> int:
        return text.count("\n", 0, at) + 1

    for function in FUNCTION.finditer(code):
        for kind, forms in IN_C.items():
            for form, after in forms.items():
                for found in re.compile(form).finditer(code, *function.span()):
                    own = line(found.start())
                    row = code.splitlines()[own - 1]
                    if not (kind == "comparison" and LARGER.search(row)):
                        wrong = str(float(found[0]) * FACTOR) if after is None else after
                        if wrong != found[0]:
                            yield Fault(path, kind, found.span(), found[0], wrong, (own,))
    for found in CONSTANT.finditer(code):
        uses = [line(use.start()) for use in re.finditer(rf"\b{found[1]}\b", code) if use.start() > found.end()]
        wrong = str(float(found[2]) * FACTOR)
        if uses and float(found[2]):
            yield Fault(path, "factor", found.span(2), found[2], wrong, tuple(uses))
