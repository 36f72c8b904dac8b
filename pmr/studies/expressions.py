"""Expressions in a study file: arithmetic over named amounts, and nothing else that Python can do."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

Amounts = Mapping[str, float | Mapping[str, float]]
Value = Callable[[Amounts], float]

#: Longest expression, in characters: what is nested deeper than Python follows has no place in a file.
LONGEST = 1000
OPERATORS: dict[type[ast.AST], Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
FUNCTIONS: dict[str, Callable[..., float]] = {
    "abs": abs,
    "max": max,
    "min": min,
    "sqrt": lambda x: float(np.sqrt(x)),
    "sin": lambda x: float(np.sin(x)),
    "cos": lambda x: float(np.cos(x)),
    "hypot": lambda *x: float(np.linalg.norm(x)),
}


def value_of(text: str, names: tuple[str, ...], tables: tuple[str, ...]) -> Value:
    """Compile an expression: numbers, + - * / **, `FUNCTIONS`, `names`, and entries of `tables` as table["name"].

    A ValueError says in one line what is not allowed; what is computed may raise a KeyError of a name that a table does
    not have, a ValueError or an ArithmeticError.
    """
    if len(text) > LONGEST:
        raise ValueError(f"at most {LONGEST} characters are allowed")
    try:
        tree = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError("it is no arithmetic expression") from None
    try:
        return _value(tree, names, tables)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def entries(text: str, table: str) -> list[str]:
    """Names of the entries of a table that an expression asks for, which `value_of` has taken."""
    subscripts = [node for node in ast.walk(ast.parse(text, mode="eval")) if isinstance(node, ast.Subscript)]
    of_table = [node for node in subscripts if isinstance(node.value, ast.Name) and node.value.id == table]
    return [str(node.slice.value) for node in of_table if isinstance(node.slice, ast.Constant)]


def _value(node: ast.expr, names: tuple[str, ...], tables: tuple[str, ...]) -> Value:
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)) and not isinstance(node.value, bool):
        constant = _as_float(node.value)
        return lambda at: constant
    if isinstance(node, ast.Name) and node.id in names:
        return _entry(node.id)
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id in tables:
        if isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, str):
            return _entry(node.value.id, node.slice.value)
    elif isinstance(node, (ast.BinOp, ast.UnaryOp)) and type(node.op) in OPERATORS:
        parts = [node.left, node.right] if isinstance(node, ast.BinOp) else [node.operand]
        return _apply(OPERATORS[type(node.op)], [_value(part, names, tables) for part in parts])
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS:
        if node.args and not node.keywords:
            return _apply(FUNCTIONS[node.func.id], [_value(part, names, tables) for part in node.args])
    listed = ", ".join([*names, *(f'{part}["name"]' for part in tables), *(f"{function}()" for function in FUNCTIONS)])
    raise ValueError(f"{ast.unparse(node)!r} is not allowed: numbers, + - * / **, {listed} are")


def _as_float(number: float) -> float:
    """A number of an expression: powers of floats overflow where those of integers would fill the memory."""
    try:
        value = float(number)
    except OverflowError:  # of integers; 1e400 is infinite
        value = math.inf
    if not math.isfinite(value):
        raise ValueError("a number in it is too large: up to 1.8e308 is allowed")
    return value


def _entry(name: str, entry: str | None = None) -> Value:
    def lookup(at: Amounts) -> float:
        amount: Any = at[name]
        return float(amount if entry is None else amount[entry])

    return lookup


def _apply(function: Callable[..., float], parts: list[Value]) -> Value:
    def apply(at: Amounts) -> float:
        value = function(*(part(at) for part in parts))
        if isinstance(value, complex):
            raise ValueError("a power of a negative number is no real one")
        return value

    return apply
