"""Mutants of a module: its source with one small error put in.

Most changes are those of Cosmic Ray (https://cosmic-ray.readthedocs.io). Two more, which Cosmic Ray
lacks, remove a term of a sum or product, and a statement.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import parso.python.tree as tree
from cosmic_ray.ast import Visitor, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Example, Operator
from cosmic_ray.plugins import get_operator

Position = tuple[tuple[int, int], tuple[int, int]]

KINDS = {
    "arithmetic": "BinaryOperator_Add_Sub BinaryOperator_Sub_Add BinaryOperator_Mul_Div "
    "BinaryOperator_Div_Mul BinaryOperator_Pow_Mul BinaryOperator_FloorDiv_Mul "
    "BinaryOperator_Mod_FloorDiv BinaryOperator_BitAnd_BitOr BinaryOperator_BitOr_BitAnd",
    "comparison": "ComparisonOperator_Lt_LtE ComparisonOperator_Lt_GtE ComparisonOperator_LtE_Lt "
    "ComparisonOperator_LtE_Gt ComparisonOperator_Gt_GtE ComparisonOperator_Gt_LtE "
    "ComparisonOperator_GtE_Gt ComparisonOperator_GtE_Lt ComparisonOperator_Eq_NotEq "
    "ComparisonOperator_NotEq_Eq ComparisonOperator_Is_IsNot ComparisonOperator_IsNot_Is",
    "sign": "UnaryOperator_Delete_USub UnaryOperator_Delete_Invert",
    "number": "NumberReplacer",
    "logic": "UnaryOperator_Delete_Not AddNot AndWithOr OrWithAnd TrueWithFalse FalseWithTrue",
    "loop": "ZeroIterationForLoop BreakWithContinue ContinueWithBreak",
}
"""Names of Cosmic Ray's operators by kind of error, without `core/` and `Replace`. Replacements
that end in a TypeError at once, such as + by >>, are left out, because every test kills them."""


@dataclass(frozen=True)
class Mutant:
    """One changed source."""

    line: int
    """Of the change, from 1."""
    kind: str
    """Of the change, such as arithmetic."""
    before: str
    """The lines that differ, as they are."""
    after: str
    """The same lines, changed."""
    source: str
    """The whole module, changed."""


class RemoveTerm(Operator):
    """Removes the right operand of a sum or product: a - b becomes a."""

    def mutation_positions(self, node: tree.PythonBaseNode) -> Iterator[Position]:
        """Where the node can be changed."""
        if node.type in ("arith_expr", "term"):
            for operator in node.children[1::2]:
                yield operator.start_pos, operator.end_pos

    def mutate(self, node: tree.PythonBaseNode, index: int) -> tree.PythonBaseNode:
        """Remove an operator and the operand behind it.

        Args:
            node: Part of the syntax tree.
            index: Number of the operator.

        Returns:
            The changed part.
        """
        node.children = node.children[: 2 * index + 1] + node.children[2 * index + 3 :]
        return node

    @classmethod
    def examples(cls) -> tuple[Example, ...]:
        """Before and after."""
        return (Example("a - b * c + d", "a + d"), Example("a - b * c + d", "a - b + d", 2))


class RemoveStatement(Operator):
    """Removes a statement that is a call or changes a variable in place, such as x += 1."""

    def mutation_positions(self, node: tree.PythonBaseNode) -> Iterator[Position]:
        """Where the node can be changed."""
        if node.type == "simple_stmt":
            first = node.children[0]
            call = first.type in ("atom_expr", "power") and first.children[-1].type == "trailer"
            in_place = first.type == "expr_stmt" and first.children[1].type == "operator"
            if call or (in_place and first.children[1].value not in ("=", ":")):
                yield first.start_pos, first.end_pos

    def mutate(self, node: tree.PythonBaseNode, index: int) -> tree.PythonBaseNode:
        """Replace the statement by `pass`.

        Args:
            node: Part of the syntax tree.
            index: Not used.

        Returns:
            The statement `pass`.
        """
        first = node.children[0]
        prefix = first.get_first_leaf().prefix
        node.children[0] = tree.Keyword("pass", first.start_pos, prefix)
        return node

    @classmethod
    def examples(cls) -> tuple[Example, ...]:
        """Before and after."""
        return (Example("f(x)\n", "pass\n"), Example("x += 1\n", "pass\n"))


class _Positions(Visitor):
    """Collects where an operator can change a source, in Cosmic Ray's own order."""

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self.found: list[Position] = []

    def visit(self, node: tree.PythonBaseNode) -> tree.PythonBaseNode:
        """Note the positions in a node."""
        self.found.extend(self._operator.mutation_positions(node))
        return node


def operators() -> dict[str, list[Operator]]:
    """Operators by kind of error."""
    found: dict[str, list[Operator]] = {}
    for kind, names in KINDS.items():
        found[kind] = [get_operator(f"core/{_full_name(name)}")() for name in names.split()]
    return found | {"term removed": [RemoveTerm()], "statement removed": [RemoveStatement()]}


def draw_mutants(source: str, number: int, rng: np.random.Generator) -> list[Mutant]:
    """Draw mutants of a module.

    Places are drawn without replacement, each with the same chance, and then one of the changes
    that are possible there. Type annotations, decorators and what only type checkers read are left
    as they are: no test can notice a change of them.

    Args:
        source: Text of the module.
        number: How many mutants; fewer if the module has fewer places.
        rng: Decides which.

    Returns:
        The mutants in the order of their lines.
    """
    lines, parsed = source.splitlines(), get_ast(source)
    spared = _spared(source)
    places = defaultdict(list)
    for kind, members in operators().items():
        for operator in members:
            visitor = _Positions(operator)
            visitor.walk(parsed)
            for occurrence, (start, end) in enumerate(visitor.found):
                star = lines[start[0] - 1].startswith("*,", start[1])  # of keyword-only arguments
                if not star and not any(low <= start and end <= high for low, high in spared):
                    places[start].append((kind, operator, occurrence))
    starts = sorted(places)
    chosen = rng.choice(len(starts), size=min(number, len(starts)), replace=False)
    mutants = []
    for start in (starts[k] for k in sorted(chosen.tolist())):
        kind, operator, occurrence = places[start][rng.integers(len(places[start]))]
        changed = mutate_code(source, operator, occurrence)
        mutants.append(Mutant(start[0], kind, *_difference(source, changed), changed))
    return mutants


def _full_name(name: str) -> str:
    """Cosmic Ray's name of an operator."""
    whole = name in ("NumberReplacer", "AddNot", "ZeroIterationForLoop")
    return name if whole else f"Replace{name}"


def _spared(source: str) -> list[Position]:
    """Parts of a source that no test can judge: first and last position of each."""
    parts: list[ast.expr | ast.stmt] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            parts.extend([*node.decorator_list, *filter(None, [node.returns])])
        elif isinstance(node, ast.ClassDef):
            parts.extend(node.decorator_list)
        elif isinstance(node, ast.arg | ast.AnnAssign) and node.annotation:
            parts.append(node.annotation)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            parts.append(node)
    lines = source.splitlines()

    def place(line: int | None, column: int | None) -> tuple[int, int]:
        """Line and column in characters, as parso counts; ast counts the column in bytes."""
        line = line or 1
        return line, len(lines[line - 1].encode()[:column].decode())

    return [
        (place(part.lineno, part.col_offset), place(part.end_lineno, part.end_col_offset))
        for part in parts
    ]


def _difference(before: str, after: str) -> tuple[str, str]:
    """The lines that differ, in one line each."""
    old, new = before.splitlines(), after.splitlines()
    first = next(k for k, (a, b) in enumerate(zip(old, new, strict=False)) if a != b)
    last = next(k for k, (a, b) in enumerate(zip(old[::-1], new[::-1], strict=False)) if a != b)
    one, other = (
        " ".join(line.strip() for line in lines[first : len(lines) - last]) for lines in (old, new)
    )
    return one, other
