"""Functions of times and dates (2nd edition, table 30; 3rd edition, tables 34 to 36)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plcemu.base.time import UNITS_NS
from plcemu.base.types import ELEMENTARY
from plcemu.lang import syntax as s
from plcemu.lang.functions.numbers import fold
from plcemu.lang.functions.rows import (
    INTEGER,
    NUMBER,
    Arguments,
    Emit,
    Kinds,
    Standard,
    fixed,
    push_integer,
)
from plcemu.lang.operators import within_day
from plcemu.lang.splits import SPLITS
from plcemu.lang.types import INT, INT_LITERAL, LINT, Type

if TYPE_CHECKING:
    from plcemu.lang.expressions import Expressions

_TIME, _DATE, _TOD, _DT = (("time",), ("date",), ("tod",), ("dt",))
_DATE_TYPE, _TOD_TYPE, _DT_TYPE = (ELEMENTARY[n] for n in ("DATE", "TIME_OF_DAY", "DATE_AND_TIME"))

_ARITHMETIC: tuple[tuple[str, str, Kinds, Kinds], ...] = (
    ("ADD_TIME ADD_LTIME", "ADD", _TIME, _TIME),
    ("ADD_TOD_TIME ADD_LTOD_LTIME", "ADD", _TOD, _TIME),
    ("ADD_DT_TIME ADD_LDT_LTIME", "ADD", _DT, _TIME),
    ("SUB_TIME SUB_LTIME", "SUB", _TIME, _TIME),
    ("SUB_DATE_DATE SUB_LDATE_LDATE", "SUB", _DATE, _DATE),
    ("SUB_TOD_TIME SUB_LTOD_LTIME", "SUB", _TOD, _TIME),
    ("SUB_TOD_TOD SUB_LTOD_LTOD", "SUB", _TOD, _TOD),
    ("SUB_DT_TIME SUB_LDT_LTIME", "SUB", _DT, _TIME),
    ("SUB_DT_DT SUB_LDT_LDT", "SUB", _DT, _DT),
    ("MULTIME MUL_TIME MUL_LTIME", "MUL", _TIME, NUMBER),
    ("DIVTIME DIV_TIME DIV_LTIME", "DIV", _TIME, NUMBER),
)
"""Names, the operator they stand for, and the kinds of both inputs."""


def _join(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
    """A date and a time of day make a date and time."""
    good = ex.emit(arguments[0], _DATE_TYPE) and ex.emit(arguments[1], _TOD_TYPE)
    ex.out.emit("add.i64", None, call.span)
    return good


def _made(*builtins: tuple[str, int]) -> Emit:
    """Make a value from whole numbers: the sum of what built-in functions make of some of them."""
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        good, begin = True, 0
        for name, count in builtins:
            for each in arguments[begin:begin + count]:
                good = push_integer(ex, each) and good
            ex.out.emit("builtin", name, call.span)
            if begin:
                ex.out.emit("add.i64", None, call.span)
            begin += count
        return good
    return emit


def _part_of_date(part: int) -> Emit:
    """The year, month, day or day of the week, which goes from 0 for Sunday to 6."""
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        good = ex.emit_natural(arguments[0]) is not None
        ex.out.emit("const", ("i64", part), call.span)
        ex.out.emit("builtin", "date.part", call.span)
        ex.convert(LINT, of, call.span)
        return good
    return emit


def _part_of_day(unit_ns: int, count: int) -> Emit:
    """How many units since the last larger one, of which it has so many."""
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        good = ex.emit_natural(arguments[0]) is not None
        within_day(ex.out, call.span)
        for op, number in (("div", unit_ns), ("mod", count)):
            ex.out.emit("const", ("i64", number), call.span)
            ex.out.emit(f"{op}.i64", None, call.span)
        ex.convert(LINT, of, call.span)
        return good
    return emit


def _no_value(ex: Expressions, call: s.Call, arguments: Arguments) -> Type | None:
    ex.report.error("P0023", call.span, f"{call.name} has no value", "call it as a statement")
    return None


_PARTS: tuple[tuple[str, Kinds, Emit], ...] = (
    ("DAY_OF_WEEK", ("date", "dt"), _part_of_date(3)), ("__YEAR", ("date", "dt"), _part_of_date(0)),
    ("__MONTH", ("date", "dt"), _part_of_date(1)), ("__DAY", ("date", "dt"), _part_of_date(2)),
    ("__HOUR", ("tod", "dt"), _part_of_day(UNITS_NS["h"], 24)),
    ("__MINUTE", ("tod", "dt"), _part_of_day(UNITS_NS["m"], 60)),
    ("__SECOND", ("tod", "dt"), _part_of_day(UNITS_NS["s"], 60)),
    ("__MILLISECOND", ("tod", "dt"), _part_of_day(UNITS_NS["ms"], 1000)),
)
"""Functions that take a number out of a date or time of day: names, kinds of input, code."""


def _rows() -> list[Standard]:
    rows = [Standard(name, ("IN1", "IN2"), False, fold(op), kinds=(first, second))
            for names, op, first, second in _ARITHMETIC for name in names.split()]
    rows += [Standard(name, ("IN1", "IN2"), False, None, fixed(_DT_TYPE), _join,
                      kinds=(_DATE, _TOD)) for name in ("CONCAT_DATE_TOD", "CONCAT_DATE_LTOD")]
    day, clock = ("YEAR", "MONTH", "DAY"), ("HOUR", "MINUTE", "SECOND", "MILLISECOND")
    made = (("CONCAT_DATE", day, _DATE_TYPE, _made(("date.of", 3))),
            ("CONCAT_TOD", clock, _TOD_TYPE, _made(("tod.of", 4))),
            ("CONCAT_LTOD", clock, _TOD_TYPE, _made(("tod.of", 4))),
            ("CONCAT_DT", day + clock, _DT_TYPE, _made(("date.of", 3), ("tod.of", 4))),
            ("CONCAT_LDT", day + clock, _DT_TYPE, _made(("date.of", 3), ("tod.of", 4))))
    rows += [Standard(name, inputs, False, None, fixed(of), emit, kinds=(INTEGER,) * len(inputs))
             for name, inputs, of, emit in made]
    rows += [Standard(name, ("IN",), False, None, fixed(INT_LITERAL), emit, kinds=(kinds,),
                      natural=INT) for name, kinds, emit in _PARTS]
    rows += [Standard(name, ("IN",), False, None, _no_value) for name in SPLITS]
    return rows


ROWS = tuple(_rows())
