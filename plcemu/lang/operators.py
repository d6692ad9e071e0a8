"""Operators: on which types they work (IEC 61131-3, tables 24 to 30), and their code."""

from __future__ import annotations

from plcemu.base.dates import DAY_NS
from plcemu.base.spans import Span
from plcemu.base.types import ELEMENTARY, ElementaryType, StringType
from plcemu.lang.emitter import Emitter
from plcemu.lang.types import (
    BOOL,
    INT_LITERAL,
    LINT,
    LREAL,
    REAL_LITERAL,
    TIME,
    Type,
    common_type,
    root,
)

ARITHMETIC = {"ADD": "add", "SUB": "sub", "MUL": "mul", "DIV": "div", "MOD": "mod"}
LOGIC = {"AND": "and", "OR": "or", "XOR": "xor"}
COMPARISON = {"EQ": "eq", "NE": "ne", "LT": "lt", "LE": "le", "GT": "gt", "GE": "ge"}

NUMERIC = ("int", "uint", "float", "literal")
KINDS = {"ADD": (*NUMERIC, "time"), "SUB": (*NUMERIC, "time"), "MUL": NUMERIC,
         "DIV": NUMERIC, "MOD": ("int", "uint", "literal"),
         "NEG": ("int", "float", "time", "literal"),
         **dict.fromkeys(LOGIC, ("bool", "bits")), "NOT": ("bool", "bits", "literal")}
"""The kinds of types that an operator works on; the comparisons take all."""

_DATES = ("date", "tod", "dt")
_ULINT = ELEMENTARY["ULINT"]


def _scales(op: str, left: Type, right: Type) -> bool:
    """Whether it is a TIME times or divided by a number (table 30, MULTIME and DIVTIME)."""
    return op in ("MUL", "DIV") and left.kind == "time" and right.kind in NUMERIC


def operand_type(op: str, left: Type, right: Type) -> Type | None:
    """Return the type in which an operator works on its operands, or None if they do not fit it."""
    left, right = root(left), root(right)
    if left.kind in _DATES and op in ("ADD", "SUB"):
        if right.kind == "time" and left.kind != "date":
            return left
        return left if op == "SUB" and right == left else None
    if op in LOGIC and INT_LITERAL in (left, right) and BOOL in (left, right):
        return BOOL
    if _scales(op, left, right):
        return left
    common = common_type(left, right)
    if common is None or (op not in COMPARISON and common.kind not in KINDS[op]):
        return None
    if op in COMPARISON and not isinstance(common, ElementaryType | StringType):
        return None
    return common


def result_type(op: str, common: Type, right: Type) -> Type:
    """Return the type of an operator's value."""
    if op in COMPARISON:
        return BOOL
    return TIME if op == "SUB" and common.kind in _DATES and right.kind == common.kind else common


def second_type(op: str, common: Type, right: Type) -> Type:
    """Return the type of an operator's second operand: of TIME times a number it is the number."""
    if common.kind in _DATES and right.kind == "time":
        return TIME
    if not _scales(op, common, right):
        return common
    if right.kind == "float" or right is REAL_LITERAL:
        return LREAL
    return _ULINT if root(right) == _ULINT else LINT


def apply_operator(out: Emitter, op: str, common: Type, right: Type, span: Span) -> None:
    """Emit an operator on two operands on the stack; `right` is the second one's own type."""
    second = second_type(op, common, right)
    if isinstance(common, StringType):
        _compare_strings(out, op, common, span)
    elif second == LREAL and common.kind == "time":
        _scale_by_real(out, op, span)
    elif second == _ULINT and common.kind == "time":
        out.emit("to.u64.i64", None, span)
        out.emit(f"{ARITHMETIC[op]}.i64", None, span)
    else:
        name = ARITHMETIC.get(op) or LOGIC.get(op) or COMPARISON[op]
        out.emit(f"{name}.{common.machine}", None, span)
        if common.kind == "tod" and result_type(op, common, right) == common:
            within_day(out, span)


def _scale_by_real(out: Emitter, op: str, span: Span) -> None:
    """Multiply or divide a TIME by an LREAL; the product is rounded to ns, half to even."""
    factor = out.new_local("f64")
    out.emit("set", factor, span)
    out.emit("to.i64.f64", None, span)
    out.emit("get", factor, span)
    out.emit(f"{ARITHMETIC[op]}.f64", None, span)
    out.emit("to.f64.i64", None, span)


def within_day(out: Emitter, span: Span) -> None:
    """Reduce ns to a time of day; before and after midnight is another day's."""
    for op in ("mod", "add", "mod"):
        out.emit("const", ("i64", DAY_NS), span)
        out.emit(f"{op}.i64", None, span)


def _compare_strings(out: Emitter, op: str, of: StringType, span: Span) -> None:
    """Compare the two strings whose addresses are on the stack."""
    out.emit("builtin", f"string.compare.{'w' if of.wide else 's'}", span)
    out.emit("const", ("i64", 0), span)
    out.emit(f"{COMPARISON[op]}.i64", None, span)
