"""Functions of times and dates (2nd edition, table 30; 3rd edition, tables 34 to 36)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plcemu.base.spans import Span
from plcemu.base.types import ELEMENTARY
from plcemu.lang import syntax as s
from plcemu.lang.emitter import Emitter
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


def date_part(out: Emitter, part: int, span: Span) -> None:
    """Replace a date on the stack by its year, month, day or weekday, by number from 0."""
    out.emit("const", ("i64", part), span)
    out.emit("builtin", "date.part", span)


def _weekday(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
    """The day of the week, from 0 for Sunday to 6."""
    good = ex.emit_natural(arguments[0]) is not None
    date_part(ex.out, 3, call.span)
    ex.convert(LINT, of, call.span)
    return good


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
    rows.append(Standard("DAY_OF_WEEK", ("IN",), False, None, fixed(INT_LITERAL), _weekday,
                         kinds=(("date", "dt"),), natural=INT))
    return rows


ROWS = tuple(_rows())
