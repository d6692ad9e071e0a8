"""Functions of character strings (IEC 61131-3, table 29), for STRING and WSTRING.

A function that makes a string puts it into bytes of its own in memory, a place for each call in the
text, which are large enough for whatever the operands can hold; assigning it cuts it to the target.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from plcemu.base.spans import Span
from plcemu.base.types import StringType
from plcemu.lang import syntax as s
from plcemu.lang.functions.rows import Arguments, Emit, Infer, Standard, push_integer
from plcemu.lang.types import INT, INT_LITERAL, LINT, REAL_LITERAL, Type

if TYPE_CHECKING:
    from plcemu.lang.expressions import Expressions

LONGEST = 65535
"""The largest capacity of a string, in characters."""


def letter(of: StringType) -> str:
    """Return the letter of built-in functions for a kind of string."""
    return "w" if of.wide else "s"


def begin_string(ex: Expressions, of: StringType, span: Span) -> int:
    """Push the target and its capacity for a built-in that makes a string; return the place."""
    place = ex.out.functions.temporary(of.size)
    ex.out.emit("addr", ("memory", place), span)
    ex.out.emit("const", ("i64", of.capacity), span)
    return place


def _infer(shape: str, sums: bool, result: Type | None = None) -> Infer:
    """Return the type rule of inputs `t` (strings of one kind) and `n` (whole numbers)."""
    def infer(ex: Expressions, call: s.Call, arguments: Arguments) -> Type | None:
        wanted = shape.ljust(len(arguments), shape[-1])
        strings: list[StringType] = []
        for letter_, each in zip(wanted, arguments, strict=True):
            of = ex.infer(each)
            if of is None or not _fits(ex, call, each, of, letter_, strings):
                return None
        capacity = sum(of.capacity for of in strings) if sums else strings[0].capacity
        return result or StringType(min(capacity, LONGEST), strings[0].wide)
    return infer


def _fits(ex: Expressions, call: s.Call, each: s.Expr, of: Type, wanted: str,
          strings: list[StringType]) -> bool:
    """Whether an argument fits; of strings also with those before it."""
    if wanted == "n":
        good = of.kind in ("int", "uint", "literal") and of is not REAL_LITERAL
        expected = "a whole number"
    else:
        good = isinstance(of, StringType) and (not strings or strings[0].wide == of.wide)
        expected = f"a {'WSTRING' if strings[0].wide else 'STRING'}" if strings \
            else "a STRING or WSTRING"
    if not good:
        ex.report.error("P0023", each.span, f"{call.name} takes {expected} here, not {of.name}")
    elif isinstance(of, StringType):
        strings.append(of)
    return good


def _operands(ex: Expressions, shape: str, arguments: Arguments) -> bool:
    good = True
    for letter_, each in zip(shape, arguments, strict=True):
        pushed = push_integer(ex, each) if letter_ == "n" else ex.emit_natural(each) is not None
        good = pushed and good
    return good


def _maker(name: str, shape: str) -> Emit:
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        assert isinstance(of, StringType)
        place = begin_string(ex, of, call.span)
        good = _operands(ex, shape, arguments)
        ex.out.emit("builtin", f"string.{name}.{letter(of)}", call.span)
        ex.out.emit("addr", ("memory", place), call.span)
        return good
    return emit


def _concat(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
    """CONCAT of many: all operands first, since evaluating one may run the same text again."""
    assert isinstance(of, StringType)
    operands = [ex.out.new_local("u32") for _ in arguments]
    good = True
    for number, each in zip(operands, arguments, strict=True):
        good = ex.emit_natural(each) is not None and good
        ex.out.emit("set", number, each.span)
    place = ex.out.functions.temporary(of.size)
    joined = operands[0]
    for number in operands[1:]:
        ex.out.emit("addr", ("memory", place), call.span)
        ex.out.emit("const", ("i64", of.capacity), call.span)
        ex.out.emit("get", joined, call.span)
        ex.out.emit("get", number, call.span)
        ex.out.emit("builtin", f"string.concat.{letter(of)}", call.span)
        ex.out.emit("addr", ("memory", place), call.span)
        joined = operands[0]
        ex.out.emit("set", joined, call.span)
    ex.out.emit("get", joined, call.span)
    return good


def _asker(name: str) -> Emit:
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        kind = ex.infer(arguments[0])
        good = all([ex.emit_natural(each) is not None for each in arguments])  # noqa: C419
        assert isinstance(kind, StringType)
        ex.out.emit("builtin", f"string.{name}.{letter(kind)}", call.span)
        ex.convert(LINT, of, call.span)
        return good
    return emit


_MAKERS: tuple[tuple[str, tuple[str, ...], str, bool], ...] = (
    ("LEFT", ("IN", "L"), "tn", False), ("RIGHT", ("IN", "L"), "tn", False),
    ("MID", ("IN", "L", "P"), "tnn", False), ("INSERT", ("IN1", "IN2", "P"), "ttn", True),
    ("DELETE", ("IN", "L", "P"), "tnn", False),
    ("REPLACE", ("IN1", "IN2", "L", "P"), "ttnn", True),
)
"""Names, inputs, their shape, and whether the result holds all of the operands."""

ROWS = (
    *(Standard(name, inputs, False, None, _infer(shape, sums), _maker(name.lower(), shape))
      for name, inputs, shape, sums in _MAKERS),
    Standard("CONCAT", ("IN1", "IN2"), True, None, _infer("t", True), _concat),
    Standard("LEN", ("IN",), False, None, _infer("t", False, INT_LITERAL), _asker("len"),
             natural=INT),
    Standard("FIND", ("IN1", "IN2"), False, None, _infer("tt", False, INT_LITERAL),
             _asker("find"), natural=INT),
)
