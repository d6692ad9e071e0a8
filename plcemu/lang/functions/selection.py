"""Selection: MAX, MIN, LIMIT, SEL and MUX (table 27), on values and on strings."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plcemu.base.types import ElementaryType, StringType
from plcemu.lang import syntax as s
from plcemu.lang.functions.rows import Arguments, Emit, Infer, Standard, wrong
from plcemu.lang.operators import apply_operator
from plcemu.lang.types import BOOL, DINT, Type, common_type

if TYPE_CHECKING:
    from plcemu.lang.expressions import Expressions

def _common_of(first: int, ordered: bool = True) -> Infer:
    """The type of a selection is the common type of what it selects from."""
    def infer(ex: Expressions, call: s.Call, arguments: Arguments) -> Type | None:
        found: Type | None = None
        for each in arguments[first:]:
            of = ex.infer(each)
            if of is None:
                return None
            joined = of if found is None else _joined(found, of)
            if joined is None:
                assert found is not None
                ex.report.error("P0023", each.span, f"{call.name} cannot choose between "
                                f"{found.name} and {of.name}")
                return None
            found = joined
        if ordered and not isinstance(found, ElementaryType | StringType):
            assert found is not None
            wrong(ex, call, found, "values that have an order")
            return None
        return found
    return infer


def _joined(a: Type, b: Type) -> Type | None:
    """Return the type of both; a string has the larger capacity of two."""
    common = common_type(a, b)
    if isinstance(a, StringType) and isinstance(b, StringType) and common is not None:
        return max(a, b, key=lambda of: of.capacity)
    return common


def _into_local(ex: Expressions, expr: s.Expr, of: Type) -> int:
    number = ex.out.new_local(of.machine)
    if ex.emit(expr, of):
        ex.out.emit("set", number, expr.span)
    return number


def _emit_best(op: str) -> Emit:
    """MAX and MIN: keep the better of the one so far and the next."""
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        best = _into_local(ex, arguments[0], of)
        for each in arguments[1:]:
            other = _into_local(ex, each, of)
            _choose(ex, op, other, best, of, call)
            ex.out.emit("set", best, call.span)
        ex.out.emit("get", best, call.span)
        return not ex.report.has_errors
    return emit


def _choose(ex: Expressions, op: str, first: int, second: int, of: Type,
            call: s.Call) -> None:
    """Push the first local if it compares so with the second, else the second."""
    for number in (first, second, first, second):
        ex.out.emit("get", number, call.span)
    apply_operator(ex.out, op.upper(), of, of, call.span)
    ex.out.emit("select", of.machine, call.span)


def _emit_limit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
    low, value, high = (_into_local(ex, each, of) for each in arguments)
    _choose(ex, "gt", value, low, of, call)
    ex.out.emit("set", value, call.span)
    _choose(ex, "lt", value, high, of, call)
    return not ex.report.has_errors


def _emit_sel(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
    good = ex.emit(arguments[2], of) and ex.emit(arguments[1], of) and ex.emit(arguments[0], BOOL)
    ex.out.emit("select", of.machine, call.span)
    return good


def _emit_mux(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
    """Push the input that K names; outside the inputs the nearest one."""
    key = _into_local(ex, arguments[0], DINT)
    good = ex.emit(arguments[1], of)
    for n, each in enumerate(arguments[2:], 1):
        held = ex.out.new_local(of.machine)
        ex.out.emit("set", held, each.span)
        good = ex.emit(each, of) and good
        ex.out.emit("get", held, each.span)
        ex.out.emit("get", key, each.span)
        ex.out.emit("const", ("i32", n), each.span)
        ex.out.emit("ge.i32", None, each.span)
        ex.out.emit("select", of.machine, each.span)
    return good


ROWS = (
    Standard("MAX", ("IN1", "IN2"), True, None, _common_of(0), _emit_best("gt")),
    Standard("MIN", ("IN1", "IN2"), True, None, _common_of(0), _emit_best("lt")),
    Standard("LIMIT", ("MN", "IN", "MX"), False, None, _common_of(0), _emit_limit),
    Standard("SEL", ("G", "IN0", "IN1"), False, None, _common_of(1, False), _emit_sel),
    Standard("MUX", ("K", "IN0", "IN1"), True, None, _common_of(1, False), _emit_mux),
)
