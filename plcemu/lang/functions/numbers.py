"""Numeric functions, bit shifts and operators in the form of a call (tables 23 to 28)."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from plcemu.lang import syntax as s
from plcemu.lang.functions.rows import (
    NUMBER,
    Arguments,
    Emit,
    Rewrite,
    Standard,
    fixed,
    wrong,
)
from plcemu.lang.types import (
    DINT,
    INT_LITERAL,
    LINT,
    LREAL,
    REAL,
    REAL_LITERAL,
    Type,
    common_type,
)

if TYPE_CHECKING:
    from plcemu.lang.expressions import Expressions

# ---------------------------------------------------------------- operators in the form of a call


def fold(op: str) -> Rewrite:
    """Return how a function becomes an operator between its inputs, from the left."""
    def rewrite(call: s.Call, arguments: Arguments) -> s.Expr:
        joined = arguments[0]
        for each in arguments[1:]:
            joined = s.Binary(call.span, op, joined, each)
        return joined
    return rewrite


def _chain(op: str) -> Rewrite:
    """A comparison of more than two inputs holds if it holds between all neighbours."""
    def rewrite(call: s.Call, arguments: Arguments) -> s.Expr:
        pairs = [s.Binary(call.span, op, a, b) for a, b in pairwise(arguments)]
        joined: s.Expr = pairs[0]
        for each in pairs[1:]:
            joined = s.Binary(call.span, "AND", joined, each)
        return joined
    return rewrite


def _operators() -> list[Standard]:
    two = ("IN1", "IN2")
    rows = [Standard(n, two, True, fold(n)) for n in ("ADD", "MUL", "AND", "OR", "XOR")]
    rows += [Standard(n, two, False, fold(n)) for n in ("SUB", "DIV", "MOD")]
    rows += [Standard(n, two, True, _chain(n)) for n in ("GT", "GE", "EQ", "LE", "LT")]
    rows.append(Standard("NE", two, False, fold("NE")))
    rows.append(Standard("NOT", ("IN",), False, lambda c, a: s.Unary(c.span, "NOT", a[0])))
    rows.append(Standard("MOVE", ("IN",), False, lambda c, a: a[0]))
    return rows


# ---------------------------------------------------------------- numeric functions


def _infer_number(ex: Expressions, call: s.Call, arguments: Arguments) -> Type | None:
    of = ex.infer(arguments[0])
    if of is None or of.kind in ("int", "uint", "float", "literal"):
        return of
    wrong(ex, call, of, "a number")
    return None


def _infer_real(ex: Expressions, call: s.Call, arguments: Arguments) -> Type | None:
    """An integer becomes the REAL that holds it without loss."""
    of = ex.infer(arguments[0])
    if of is None or of.kind == "float":
        return of
    if of.kind == "literal":
        return REAL_LITERAL
    for real in (REAL, LREAL):
        if common_type(of, real) == real:
            return real
    wrong(ex, call, of, "a REAL or LREAL")
    return None


def _emit_unary(op: str) -> Emit:
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        good = ex.emit(arguments[0], of)
        if of.kind != "uint" or op != "abs":
            ex.out.emit(f"{op}.{of.machine}", None, call.span)
        return good
    return emit


def _emit_expt(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
    second = ex.infer(arguments[1])
    if second is None or not ex.emit(arguments[0], of):
        return False
    if second.kind in ("float", "literal") and second is not LREAL:
        good = ex.emit(arguments[1], of)
    else:
        good = ex.emit(arguments[1], second)
        ex.convert(second, of, call.span)
    ex.out.emit(f"expt.{of.machine}", None, call.span)
    return good


_REAL_FUNCTIONS = ("SQRT", "LN", "LOG", "EXP", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN")


def _numeric() -> list[Standard]:
    rows = [Standard(n, ("IN",), False, None, _infer_real, _emit_unary(n.lower()))
            for n in _REAL_FUNCTIONS]
    rows.append(Standard("ABS", ("IN",), False, None, _infer_number, _emit_unary("abs")))
    rows.append(Standard("EXPT", ("IN1", "IN2"), False, None, _infer_real, _emit_expt))
    return rows


# ---------------------------------------------------------------- bit shifts


def _infer_bits(ex: Expressions, call: s.Call, arguments: Arguments) -> Type | None:
    of = ex.infer(arguments[0])
    if of is None or of.kind == "bits":
        return of
    wrong(ex, call, of, "a BYTE, WORD, DWORD or LWORD")
    return None


def _emit_shift(op: str) -> Emit:
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        if not ex.emit(arguments[0], of):
            return False
        good = ex.emit(arguments[1], DINT)
        ex.out.emit(f"{op}.{of.machine}", None, call.span)
        return good
    return emit


def _shifts() -> list[Standard]:
    return [Standard(n, ("IN", "N"), False, None, _infer_bits, _emit_shift(n.lower()))
            for n in ("SHL", "SHR", "ROL", "ROR")]


# ---------------------------------------------------------------- truncation


def truncated(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
    """Cut off a REAL's fraction; where a REAL is expected, its whole part comes back as one."""
    origin = ex.infer(arguments[0])
    origin = LREAL if origin is None or origin.kind != "float" else origin
    good = ex.emit(arguments[0], origin)
    whole = LINT if of.kind == "float" else of
    ex.out.emit(f"trunc.{origin.machine}.{whole.machine}", None, call.span)
    ex.convert(whole, of, call.span)
    return good


ROWS = (*_operators(), *_numeric(), *_shifts(),
        Standard("TRUNC", ("IN",), False, None, fixed(INT_LITERAL), truncated,
                 kinds=(NUMBER,), natural=DINT))
