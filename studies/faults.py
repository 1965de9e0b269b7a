"""Small faults in Python sources: a sign, a factor, an index, a comparison, a dropped term, a guard, a tolerance."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

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
    """One change of a source.

    Attributes
    ----------
    path : str
        File, relative to the checkout.
    kind : str
        What is changed.
    span : tuple of int
        Begin and end of the changed text, in characters.
    before, after : str
        The text.
    lines : tuple of int
        Lines that run the changed text.
    """

    path: str
    kind: str
    span: tuple[int, int]
    before: str
    after: str
    lines: tuple[int, ...]

    def planted(self, text: str) -> str:
        """Return the source with the fault.

        Parameters
        ----------
        text : str
            The source without it.
        """
        return text[: self.span[0]] + self.after + text[self.span[1] :]

    def __str__(self) -> str:
        """Where it is, and both texts in one line."""
        before, after = (" ".join(text.split()) for text in (self.before, self.after))
        return f"{self.path}:{self.lines[0]}: {self.kind}: {before} -> {after}"


def faults(path: str, text: str) -> Iterator[Fault]:
    """Yield every fault that can be planted in a source.

    Parameters
    ----------
    path : str
        File, relative to the checkout.
    text : str
        Its content.

    Yields
    ------
    Fault
        In no particular order.
    """
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


def of_folder(root: Path, folder: str) -> list[Fault]:
    """List every fault that can be planted in a folder, or in a file.

    Parameters
    ----------
    root : Path
        The checkout.
    folder : str
        Folder below it.

    Returns
    -------
    list of Fault
        By file.
    """
    base = root / folder
    found = [base] if base.is_file() else base.rglob("*.py")
    files = sorted(path for path in found if "build" not in path.relative_to(root).parts)
    return [fault for path in files for fault in faults(str(path.relative_to(root)), path.read_text(encoding="utf-8"))]
