"""A row of the table of standard functions, and what the rows share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from plcemu.base.types import ElementaryType
from plcemu.lang import syntax as s
from plcemu.lang.types import LINT, Type

if TYPE_CHECKING:
    from plcemu.lang.expressions import Expressions

Arguments = Sequence[s.Expr]
Rewrite = Callable[[s.Call, Arguments], s.Expr]
Infer = Callable[["Expressions", s.Call, Arguments], Type | None]
Emit = Callable[["Expressions", s.Call, Arguments, Type], bool]
Kinds = tuple[str, ...]

MANY = 64
"""The largest number of arguments of an extensible function."""

NUMBER: Kinds = ("int", "uint", "float", "literal")
INTEGER: Kinds = ("int", "uint", "literal")


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
        kinds: the kinds of types that each input takes, if the function is not overloaded.
        natural: the type of its value where nothing around the call asks for another integer type;
            its `infer` gives the type of an integer literal then (ANY_INT).
    """

    name: str
    inputs: tuple[str, ...]
    extensible: bool = False
    rewrite: Rewrite | None = None
    infer: Infer | None = None
    emit: Emit | None = None
    kinds: tuple[Kinds, ...] = ()
    natural: ElementaryType | None = None


_NAMES = {"time": "a TIME", "date": "a DATE", "tod": "a TIME_OF_DAY", "dt": "a DATE_AND_TIME",
          "string": "a STRING or WSTRING", "bits": "a BYTE, WORD, DWORD or LWORD",
          "int": "a whole number"}


def wrong(ex: Expressions, call: s.Call, of: Type, expected: str) -> None:
    """Report an argument of a type that the function does not take."""
    ex.report.error("P0023", call.span, f"{call.name} takes {expected}, not {of.name}")


def arguments_fit(ex: Expressions, call: s.Call, row: Standard, arguments: Arguments) -> bool:
    """Whether arguments are of the kinds that a function takes; mistakes go to the report."""
    for kinds, each in zip(row.kinds, arguments, strict=bool(row.kinds)):
        of = ex.infer(each)
        if of is None:
            return False
        if of.kind not in kinds or (of.name == "real literal" and "float" not in kinds):
            expected = "a number" if "float" in kinds else _NAMES[kinds[0]]
            ex.report.error("P0023", each.span, f"{call.name} takes {expected} here, not {of.name}")
            return False
    return True


def fixed(of: Type) -> Infer:
    """Return the type rule of a function whose value has one type."""
    def infer(ex: Expressions, call: s.Call, arguments: Arguments) -> Type | None:
        return None if any(ex.infer(each) is None for each in arguments) else of
    return infer


def push_integer(ex: Expressions, expr: s.Expr) -> bool:
    """Push a whole number of any type as i64."""
    of = ex.emit_natural(expr)
    if of is not None:
        ex.convert(of, LINT, expr.span)
    return of is not None
