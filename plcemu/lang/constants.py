"""Constant expressions: what is known before the program runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from plcemu.base.spans import Span
from plcemu.base.types import ELEMENTARY, ElementaryType, StringType, Value
from plcemu.ir.ops import Fault
from plcemu.lang import syntax as s
from plcemu.lang.report import Report
from plcemu.lang.types import EnumType, Type, widens

Lookup = Callable[[s.Name | s.Literal], tuple[Value, ElementaryType] | None]
"""Finds a named constant or a value of an enumeration."""


class NotConstant(Exception):
    """An expression has no value before the program runs; where and why."""

    def __init__(self, span: Span, reason: str = "a constant is expected here") -> None:
        super().__init__(reason)
        self.span, self.reason = span, reason


def _nothing(_: s.Name | s.Literal) -> tuple[Value, ElementaryType] | None:
    return None


def fold(expr: s.Expr, lookup: Lookup = _nothing) -> Value:
    """Return the value of a constant expression.

    Raises:
        NotConstant: it has none.
    """
    if isinstance(expr, s.Literal):
        found = lookup(expr) if expr.kind == "string" else None
        return found[0] if found else expr.value
    if isinstance(expr, s.Name):
        found = lookup(expr)
        if found is None:
            raise NotConstant(expr.span)
        return found[0]
    if isinstance(expr, s.Unary):
        return _unary(expr, fold(expr.operand, lookup))
    if isinstance(expr, s.Binary):
        return _fold_chain(expr, lookup)
    raise NotConstant(expr.span)


def _fold_chain(expr: s.Expr, lookup: Lookup) -> Value:
    """Fold operators; they lean to the left, so a long sum is a deep tree: go down in a loop."""
    chain: list[s.Binary] = []
    while isinstance(expr, s.Binary):
        chain.append(expr)
        expr = expr.left
    value = fold(expr, lookup)
    for binary in reversed(chain):
        value = _binary(binary, value, fold(binary.right, lookup))
    return value


def _unary(expr: s.Unary, value: Value) -> Value:
    if isinstance(value, str):
        raise NotConstant(expr.span)
    if expr.op == "NOT" and not isinstance(value, float):
        return not value if isinstance(value, bool) else ~value
    return -value


_OPERATORS: dict[str, Callable[..., Value]] = {
    "ADD": lambda a, b: a + b, "SUB": lambda a, b: a - b, "MUL": lambda a, b: a * b,
    "AND": lambda a, b: a & b, "OR": lambda a, b: a | b, "XOR": lambda a, b: a ^ b,
    "EQ": lambda a, b: a == b, "NE": lambda a, b: a != b, "LT": lambda a, b: a < b,
    "LE": lambda a, b: a <= b, "GT": lambda a, b: a > b, "GE": lambda a, b: a >= b}


def _binary(expr: s.Binary, left: Value, right: Value) -> Value:
    if isinstance(left, str) or isinstance(right, str):
        raise NotConstant(expr.span)
    if expr.op in ("DIV", "MOD"):
        if right == 0:
            raise NotConstant(expr.span, "division by zero")
        if isinstance(left, float) or isinstance(right, float):
            return left / right
        quotient = abs(left) // abs(right) * (1 if (left < 0) == (right < 0) else -1)
        return quotient if expr.op == "DIV" else left - right * quotient
    try:
        return _OPERATORS[expr.op](left, right)
    except (TypeError, OverflowError, Fault) as problem:
        raise NotConstant(expr.span, str(problem)) from None


def constant_value(expr: s.Expr, of: ElementaryType | StringType, report: Report,
                   lookup: Lookup = _nothing) -> Value | None:
    """Return a constant's value as the nearest one of a type; mistakes go to the report."""
    if not _fits(expr, of, report, lookup):
        return None
    try:
        value = fold(expr, lookup)
        if _inverts(expr) and isinstance(value, int) and isinstance(of, ElementaryType) \
                and of.kind in ("bool", "bits"):
            value &= (1 << of.bits) - 1
        if of.kind == "bool" and isinstance(value, int):
            value = bool(value)
        if of.kind == "time" and isinstance(value, float) and math.isfinite(value):
            value = round(value)
        return of.unpack(of.pack(value))
    except NotConstant as problem:
        report.error("P0027", problem.span, problem.reason)
    except ValueError as problem:
        report.error("P0025", expr.span, str(problem))
    return None


def _inverts(expr: s.Expr) -> bool:
    """Whether NOT stands in a constant expression, so that it has as many bits as its type."""
    pending: list[s.Expr] = [expr]
    while pending:
        each = pending.pop()
        if isinstance(each, s.Unary):
            if each.op == "NOT":
                return True
            pending.append(each.operand)
        elif isinstance(each, s.Binary):
            pending += [each.left, each.right]
    return False


_LITERAL_KINDS: Mapping[str, tuple[str, ...]] = {
    "int": ("int", "uint", "bits", "float", "bool"), "real": ("float",), "time": ("time",),
    "bool": ("bool",), "string": ("string",), "date": ("date",), "tod": ("tod",), "dt": ("dt",)}


_FACTOR = ELEMENTARY["LREAL"]
"""What a TIME may be multiplied with."""


def _fits(expr: s.Expr, of: Type, report: Report, lookup: Lookup) -> bool:
    """Whether the literals and names of a constant expression can be of a type."""
    pending: list[s.Expr] = [expr]
    while pending:
        each = pending.pop()
        if isinstance(each, s.Unary):
            pending.append(each.operand)
        elif isinstance(each, s.Binary):
            if each.op in ("EQ", "NE", "LT", "LE", "GT", "GE"):
                continue
            scales = of.kind == "time" and each.op in ("MUL", "DIV")
            if scales and not _fits(each.right, _FACTOR, report, lookup):
                return False
            pending += [each.left] if scales else [each.right, each.left]
        elif isinstance(each, s.Name | s.Literal) and not _leaf_fits(each, of, lookup):
            what = "this literal" if isinstance(each, s.Literal) else str(each)
            report.error("P0023", each.span, f"{what} is no value of type {of.name}",
                         _prefix_hint(each, of))
            return False
    return True


def _prefix_hint(leaf: s.Name | s.Literal, of: Type) -> str:
    """Return how to write a name that several enumerations have (table 14, typed values)."""
    if not isinstance(leaf, s.Name) or not isinstance(of, EnumType):
        return ""
    names = [name for name, _ in of.members if name.upper() == str(leaf).upper()]
    return f"write {of.name}#{names[0]}: another enumeration has this name too" if names else ""


def _leaf_fits(leaf: s.Name | s.Literal, of: Type, lookup: Lookup) -> bool:
    found = lookup(leaf)
    if found is not None:
        return widens(found[1], of)
    return isinstance(leaf, s.Name) or literal_fits(leaf, of)


def literal_fits(literal: s.Literal, of: Type) -> bool:
    """Whether a literal can be of a type, apart from its range."""
    if isinstance(of, EnumType):
        return False
    if literal.type and literal.type in ELEMENTARY and literal.kind != "time":
        return widens(ELEMENTARY[literal.type], of)
    if literal.kind == "string" and isinstance(of, StringType):
        return (literal.type == "WSTRING") == of.wide
    if literal.kind == "int" and of.kind == "bool":
        return literal.value in (0, 1)
    return of.kind in _LITERAL_KINDS[literal.kind]
