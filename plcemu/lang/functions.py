"""The standard functions (IEC 61131-3, tables 22 to 28): one table, each row a way to lower a call.

Most are another spelling of operators and are rewritten to them. The others bring their own type
rule and code.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from plcemu.base.types import ELEMENTARY, ElementaryType
from plcemu.lang import syntax as s
from plcemu.lang.types import BOOL, DINT, LREAL, REAL, REAL_LITERAL, Type, common_type

if TYPE_CHECKING:
    from plcemu.lang.expressions import Expressions

Arguments = Sequence[s.Expr]
Rewrite = Callable[[s.Call, Arguments], s.Expr]
Infer = Callable[["Expressions", s.Call, Arguments], Type | None]
Emit = Callable[["Expressions", s.Call, Arguments, Type], bool]

MANY = 64
"""The largest number of arguments of an extensible function."""


@dataclass(frozen=True, slots=True)
class Standard:
    """A standard function.

    Attributes:
        name: in capitals.
        inputs: the formal names of its inputs; the last one's number goes on for extensible ones.
        extensible: whether more inputs may follow.
        rewrite: the operators it stands for; or None, and then
        infer: its type rule, and
        emit: its code, for arguments of the inferred type.
    """

    name: str
    inputs: tuple[str, ...]
    extensible: bool = False
    rewrite: Rewrite | None = None
    infer: Infer | None = None
    emit: Emit | None = None


# ---------------------------------------------------------------- operators in the form of a call


def _fold(op: str) -> Rewrite:
    def rewrite(call: s.Call, arguments: Arguments) -> s.Expr:
        joined = arguments[0]
        for each in arguments[1:]:
            joined = s.Binary(call.span, op, joined, each)
        return joined
    return rewrite


def _chain(op: str) -> Rewrite:
    """A comparison of more than two inputs holds if it holds between all neighbours."""
    def rewrite(call: s.Call, arguments: Arguments) -> s.Expr:
        pairs = [s.Binary(call.span, op, a, b)
                 for a, b in zip(arguments, arguments[1:], strict=False)]
        joined: s.Expr = pairs[0]
        for each in pairs[1:]:
            joined = s.Binary(call.span, "AND", joined, each)
        return joined
    return rewrite


def _operators() -> list[Standard]:
    two = ("IN1", "IN2")
    rows = [Standard(n, two, True, _fold(n)) for n in ("ADD", "MUL", "AND", "OR", "XOR")]
    rows += [Standard(n, two, False, _fold(n)) for n in ("SUB", "DIV", "MOD")]
    rows += [Standard(n, two, True, _chain(n)) for n in ("GT", "GE", "EQ", "LE", "LT")]
    rows.append(Standard("NE", two, False, _fold("NE")))
    rows.append(Standard("NOT", ("IN",), False, lambda c, a: s.Unary(c.span, "NOT", a[0])))
    rows.append(Standard("MOVE", ("IN",), False, lambda c, a: a[0]))
    times = {"ADD_TIME": "ADD", "SUB_TIME": "SUB", "MULTIME": "MUL", "DIVTIME": "DIV",
             "MUL_TIME": "MUL", "DIV_TIME": "DIV"}
    rows += [Standard(n, two, False, _fold(op)) for n, op in times.items()]
    return rows


# ---------------------------------------------------------------- numeric functions


def _wrong(ex: Expressions, call: s.Call, of: Type, expected: str) -> None:
    ex.report.error("P0023", call.span, f"{call.name} takes {expected}, not {of.name}")


def _infer_number(ex: Expressions, call: s.Call, arguments: Arguments) -> Type | None:
    of = ex.infer(arguments[0])
    if of is None or of.kind in ("int", "uint", "float", "literal"):
        return of
    _wrong(ex, call, of, "a number")
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
    _wrong(ex, call, of, "a REAL or LREAL")
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
    _wrong(ex, call, of, "a BYTE, WORD, DWORD or LWORD")
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


# ---------------------------------------------------------------- selection


def _common_of(first: int, ordered: bool = True) -> Infer:
    """The type of a selection is the common type of what it selects from."""
    def infer(ex: Expressions, call: s.Call, arguments: Arguments) -> Type | None:
        found: Type | None = None
        for each in arguments[first:]:
            of = ex.infer(each)
            if of is None:
                return None
            joined = of if found is None else common_type(found, of)
            if joined is None:
                assert found is not None
                ex.report.error("P0023", each.span, f"{call.name} cannot choose between "
                                f"{found.name} and {of.name}")
                return None
            found = joined
        if ordered and not isinstance(found, ElementaryType):
            assert found is not None
            _wrong(ex, call, found, "values that have an order")
            return None
        return found
    return infer


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
    ex.out.emit(f"{op}.{of.machine}", None, call.span)
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


def _selection() -> list[Standard]:
    return [
        Standard("MAX", ("IN1", "IN2"), True, None, _common_of(0), _emit_best("gt")),
        Standard("MIN", ("IN1", "IN2"), True, None, _common_of(0), _emit_best("lt")),
        Standard("LIMIT", ("MN", "IN", "MX"), False, None, _common_of(0), _emit_limit),
        Standard("SEL", ("G", "IN0", "IN1"), False, None, _common_of(1, False), _emit_sel),
        Standard("MUX", ("K", "IN0", "IN1"), True, None, _common_of(1, False), _emit_mux),
    ]


# ---------------------------------------------------------------- conversions


def _converted(source: str, target: str) -> Emit:
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        origin = ELEMENTARY[source] if source else ex.emit_natural(arguments[0])
        if origin is None or (source and not ex.emit(arguments[0], origin)):
            return False
        if not isinstance(origin, ElementaryType):
            _wrong(ex, call, origin, "a single value")
            return False
        ex.convert(origin, of, call.span)
        return True
    return emit


def _truncated(target: str) -> Emit:
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        origin = ex.infer(arguments[0])
        origin = REAL if origin is None or origin.kind != "float" else origin
        good = ex.emit(arguments[0], origin)
        ex.out.emit(f"trunc.{origin.machine}.{of.machine}", None, call.span)
        return good
    return emit


def _fixed(target: str) -> Infer:
    def infer(ex: Expressions, call: s.Call, arguments: Arguments) -> Type | None:
        return None if ex.infer(arguments[0]) is None else ELEMENTARY[target]
    return infer


_CONVERSION = re.compile(r"(?:(?P<source>[A-Z]+)_)?(?P<how>TO|TRUNC)_(?P<target>[A-Z]+)")


def _conversion(name: str) -> Standard | None:
    """Return `A_TO_B`, `TO_B`, `TRUNC_B` or `A_TRUNC_B`, if A and B are types of values."""
    match = _CONVERSION.fullmatch(name)
    if match is None or match["target"] not in ELEMENTARY:
        return None
    source, target = match["source"] or "", match["target"]
    if source and source not in ELEMENTARY:
        return None
    if match["how"] == "TRUNC":
        if source not in ("", "REAL", "LREAL"):
            return None
        return Standard(name, ("IN",), False, None, _fixed(target), _truncated(target))
    return Standard(name, ("IN",), False, None, _fixed(target), _converted(source, target))


_TABLE: dict[str, Standard] = {row.name: row for row in (
    *_operators(), *_numeric(), *_shifts(), *_selection(),
    Standard("TRUNC", ("IN",), False, None, _fixed("DINT"), _truncated("DINT")))}

NAMES: frozenset[str] = frozenset(_TABLE)
"""The functions that are in the table; conversions come on top, see `find`."""


def find(name: str) -> Standard | None:
    """Return the standard function of that name, or None."""
    return _TABLE.get(name.upper()) or _conversion(name.upper())


