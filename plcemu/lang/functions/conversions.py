"""Type conversions (2nd edition, table 22; 3rd edition, tables 22 to 29): every pair of types.

The standard leaves the unit of a number that stands for a time to the implementation. Here it is
what most controllers have: a TIME and a TIME_OF_DAY count ms, a DATE and a DATE_AND_TIME seconds,
and the long forms (LTIME, LTOD, LDATE, LDT) ns. Bit strings and numbers convert by their value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

from plcemu.base.spans import Span
from plcemu.base.types import ELEMENTARY, ElementaryType, StringType
from plcemu.lang import syntax as s
from plcemu.lang.functions.numbers import truncated
from plcemu.lang.functions.rows import NUMBER, Arguments, Emit, Infer, Standard, fixed, wrong
from plcemu.lang.functions.strings import LONGEST, begin_string, letter
from plcemu.lang.operators import within_day
from plcemu.lang.types import LINT, LREAL, Type, root

if TYPE_CHECKING:
    from plcemu.lang.expressions import Expressions

TEXT_LENGTH = 40
"""Capacity of the string that a value is written to; the longest text has 38 characters."""

_MS, _S = 1_000_000, 1_000_000_000
_UNITS_NS = {"TIME": _MS, "TOD": _MS, "TIME_OF_DAY": _MS, "DATE": _S, "DT": _S,
             "DATE_AND_TIME": _S}
"""What 1 stands for, in ns, where a number becomes a time; 1 for the long forms."""

_NUMBERS = ("bool", "int", "uint", "bits", "float", "enum")


@dataclass(frozen=True, slots=True)
class _End:
    """One end of a conversion: a type, and the ns that 1 stands for where it is a time."""

    type: ElementaryType | StringType
    unit_ns: int = 1

    @property
    def group(self) -> str:
        """`number`, `string`, or the kind of a time."""
        return "number" if self.type.kind in _NUMBERS else self.type.kind


def _end(name: str) -> _End | None:
    if name in ("STRING", "WSTRING"):
        return _End(StringType(LONGEST, name == "WSTRING"))
    return _End(ELEMENTARY[name], _UNITS_NS.get(name, 1)) if name in ELEMENTARY else None


# ---------------------------------------------------------------- between values


def _number_to_time(ex: Expressions, source: _End, target: _End, span: Span) -> None:
    """A number of units; of a REAL rounded to ns. Times of day stay in a day, dates at midnight."""
    out, machine = ex.out, "f64" if source.type.kind == "float" else "i64"
    ex.convert(source.type, LREAL if machine == "f64" else LINT, span)
    if target.unit_ns != 1:
        unit = float(target.unit_ns) if machine == "f64" else target.unit_ns
        out.emit("const", (machine, unit), span)
        out.emit(f"mul.{machine}", None, span)
    if machine == "f64":
        out.emit("to.f64.i64", None, span)
    _normalise(ex, target, span)


def _normalise(ex: Expressions, target: _End, span: Span) -> None:
    if target.group == "tod":
        within_day(ex.out, span)
    elif target.group == "date":
        _midnight(ex, target, target, span)


def _time_to_number(ex: Expressions, source: _End, target: _End, span: Span) -> None:
    """The number of units; whole numbers drop the fraction, a BOOL is FALSE for nothing at all."""
    out, kind = ex.out, target.type.kind
    machine = "f64" if kind == "float" else "i64"
    if machine == "f64":
        ex.convert(LINT, LREAL, span)
    if source.unit_ns != 1 and kind != "bool":
        unit = float(source.unit_ns) if machine == "f64" else source.unit_ns
        out.emit("const", (machine, unit), span)
        out.emit(f"div.{machine}", None, span)
    ex.convert(LREAL if machine == "f64" else LINT, target.type, span)


def _keep(ex: Expressions, source: _End, target: _End, span: Span) -> None:
    """The same ns stand for both."""


def _clock(ex: Expressions, source: _End, target: _End, span: Span) -> None:
    """The time of day of a date and time, or of a duration."""
    within_day(ex.out, span)


def _midnight(ex: Expressions, source: _End, target: _End, span: Span) -> None:
    """The date of a date and time: its midnight."""
    whole = ex.out.new_local("i64")
    ex.out.emit("set", whole, span)
    ex.out.emit("get", whole, span)
    ex.out.emit("get", whole, span)
    within_day(ex.out, span)
    ex.out.emit("sub.i64", None, span)


def _value(ex: Expressions, source: _End, target: _End, span: Span) -> None:
    ex.convert(source.type, target.type, span)


# ---------------------------------------------------------------- strings

_WRITTEN = {"bool": ("of.bool", ELEMENTARY["BOOL"]), "int": ("of.i64", LINT),
            "enum": ("of.i64", LINT), "uint": ("of.u64", ELEMENTARY["ULINT"]),
            "bits": ("of.u64", ELEMENTARY["ULINT"]), "date": ("of.date", LINT),
            "tod": ("of.tod", LINT), "dt": ("of.dt", LINT)}
"""By kind: the built-in that writes a value, and the type it takes."""

_BY_NAME = {"REAL": ("of.f32", ELEMENTARY["REAL"]), "LREAL": ("of.f64", LREAL),
            "TIME": ("of.time", LINT), "LTIME": ("of.ltime", LINT)}


def _to_string(ex: Expressions, source: _End, target: _End, span: Span) -> None:
    name, taken = _BY_NAME.get(source.type.name) or _WRITTEN[source.type.kind]
    assert isinstance(target.type, StringType)
    ex.convert(source.type, taken, span)
    value = ex.out.new_local(taken.machine)
    ex.out.emit("set", value, span)
    place = begin_string(ex, target.type, span)
    ex.out.emit("get", value, span)
    ex.out.emit("builtin", f"string.{name}.{letter(target.type)}", span)
    ex.out.emit("addr", ("memory", place), span)


def _from_string(ex: Expressions, source: _End, target: _End, span: Span) -> None:
    assert isinstance(source.type, StringType)
    of = target.type
    name = of.kind if of.kind in ("date", "tod", "dt", "time", "bool") else of.machine
    read = LREAL if of.kind == "float" else of
    ex.out.emit("builtin", f"string.to.{'f64' if of.kind == 'float' else name}."
                f"{letter(source.type)}", span)
    ex.convert(read, of, span)


def _recode(ex: Expressions, source: _End, target: _End, span: Span) -> None:
    assert isinstance(source.type, StringType) and isinstance(target.type, StringType)
    if source.type.wide == target.type.wide:
        return
    value = ex.out.new_local("u32")
    ex.out.emit("set", value, span)
    place = begin_string(ex, target.type, span)
    ex.out.emit("get", value, span)
    ex.out.emit("builtin", f"string.recode.{letter(source.type)}{letter(target.type)}", span)
    ex.out.emit("addr", ("memory", place), span)


_Convert = Callable[["Expressions", _End, _End, Span], None]
_TIMES = ("time", "date", "tod", "dt")
_PAIRS: dict[tuple[str, str], _Convert] = {
    ("number", "number"): _value,
    **{("number", kind): _number_to_time for kind in _TIMES},
    **{(kind, "number"): _time_to_number for kind in _TIMES},
    **{(kind, kind): _keep for kind in _TIMES},
    ("tod", "time"): _keep, ("date", "dt"): _keep,
    ("time", "tod"): _clock, ("dt", "tod"): _clock, ("dt", "date"): _midnight,
    **{(kind, "string"): _to_string for kind in ("number", *_TIMES)},
    **{("string", kind): _from_string for kind in ("number", *_TIMES)},
    ("string", "string"): _recode,
}
"""How a value of one group becomes one of another, which is on the stack."""


# ---------------------------------------------------------------- calls


def _converted(source: _End | None, target: _End) -> Emit:
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        natural = source.type if source else ex.emit_natural(arguments[0])
        if natural is None or (source and not ex.emit(arguments[0], natural)):
            return False
        origin = source or _natural_end(natural)
        if origin is None or (origin.group, target.group) not in _PAIRS:
            wrong(ex, call, natural, f"what converts to {target.type.name}")
            return False
        assert isinstance(of, ElementaryType | StringType)
        _PAIRS[origin.group, target.group](ex, origin, _End(of, target.unit_ns), call.span)
        return True
    return emit


def _natural_end(of: Type) -> _End | None:
    of = root(of)
    if not isinstance(of, ElementaryType | StringType):
        return None
    return _End(of, _UNITS_NS.get(of.name, 1))


def _text(wide: bool) -> Infer:
    """A string is as long as the one it comes from, or as long as values get."""
    def infer(ex: Expressions, call: s.Call, arguments: Arguments) -> Type | None:
        of = ex.infer(arguments[0])
        capacity = of.capacity if isinstance(of, StringType) else TEXT_LENGTH
        return None if of is None else StringType(capacity, wide)
    return infer


def _row(name: str, source: _End | None, target: _End) -> Standard:
    of = target.type
    rule = _text(of.wide) if isinstance(of, StringType) else fixed(of)
    return Standard(name, ("IN",), False, None, rule, _converted(source, target))


# ---------------------------------------------------------------- BCD

_ULINT = ELEMENTARY["ULINT"]


def _bits(name: str) -> ElementaryType | None:
    found = ELEMENTARY.get(name)
    return found if found is not None and found.kind == "bits" else None


def _whole(name: str) -> ElementaryType | None:
    found = ELEMENTARY.get(name)
    return found if found is not None and found.kind in ("int", "uint") else None


def _from_bcd(source: ElementaryType | None) -> Emit:
    """WORD_BCD_TO_UINT and BCD_TO_UINT: the number that the digits write."""
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        origin = ex.infer(arguments[0]) if source is None else source
        if origin is None or origin.kind != "bits":
            if origin is not None:
                wrong(ex, call, origin, "a BYTE, WORD, DWORD or LWORD")
            return False
        good = ex.emit(arguments[0], origin)
        ex.convert(origin, _ULINT, call.span)
        ex.out.emit("builtin", "bcd.to", call.span)
        ex.convert(_ULINT, of, call.span)
        return good
    return emit


def _to_bcd(source: ElementaryType | None) -> Emit:
    """UINT_TO_BCD_WORD and TO_BCD_WORD: as many digits as the bit string holds."""
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        if source is None:
            origin = ex.emit_natural(arguments[0])
        else:
            origin = source if ex.emit(arguments[0], source) else None
        if origin is None:
            return False
        if origin.kind not in ("int", "uint"):
            wrong(ex, call, origin, "a whole number")
            return False
        ex.convert(origin, _ULINT, call.span)
        ex.out.emit("const", ("i64", of.size * 2), call.span)
        ex.out.emit("builtin", "bcd.of", call.span)
        ex.convert(_ULINT, of, call.span)
        return True
    return emit


def _bcd(name: str, left: str, right: str) -> Standard | None:
    if left == "BCD" or left.endswith("_BCD"):
        source, target = _bits(left.removesuffix("BCD").removesuffix("_")), _whole(right)
        if target is None or (source is None and left != "BCD"):
            return None
        return Standard(name, ("IN",), False, None, fixed(target), _from_bcd(source))
    origin, made = _whole(left), _bits(right.removeprefix("BCD_"))
    if made is None or (origin is None and left):
        return None
    return Standard(name, ("IN",), False, None, fixed(made), _to_bcd(origin))


# ---------------------------------------------------------------- names


def _splits(name: str, word: str) -> Iterator[tuple[str, str]]:
    """Yield what stands left and right of `_TO_` or another word, wherever it stands."""
    if name.startswith(word + "_"):
        yield "", name.removeprefix(word + "_")
    at = name.find(f"_{word}_")
    while at >= 0:
        yield name[:at], name[at + len(word) + 2:]
        at = name.find(f"_{word}_", at + 1)


def near_conversions(name: str) -> list[str]:
    """Return the conversions that share one of their types with an unknown name, for a hint."""
    types = [*ELEMENTARY, "STRING", "WSTRING"]
    found: list[str] = []
    for left, right in _splits(name, "TO"):
        found += [f"{left}_TO_{each}".removeprefix("_") for each in types if left in ["", *types]]
        found += [f"{each}_TO_{right}" for each in types if right in types]
    return found


@lru_cache(4096)
def find_conversion(name: str) -> Standard | None:
    """Return A_TO_B, TO_B, A_TRUNC_B, TRUNC_B, A_BCD_TO_B or A_TO_BCD_B, if A and B are types."""
    for left, right in _splits(name, "TO"):
        if left == "BCD" or left.endswith("_BCD") or right.startswith("BCD_"):
            return _bcd(name, left, right)
        source, target = _end(left), _end(right)
        if target is None or (left and source is None):
            continue
        if source is None or (source.group, target.group) in _PAIRS:
            return _row(name, source, target)
    for left, right in _splits(name, "TRUNC"):
        whole = _whole(right)
        if whole is not None and left in ("", "REAL", "LREAL"):
            return Standard(name, ("IN",), False, None, fixed(whole), _truncation(left),
                            kinds=(NUMBER,))
    return None


def _truncation(source: str) -> Emit:
    def emit(ex: Expressions, call: s.Call, arguments: Arguments, of: Type) -> bool:
        if not source:
            return truncated(ex, call, arguments, of)
        origin = ELEMENTARY[source]
        good = ex.emit(arguments[0], origin)
        ex.out.emit(f"trunc.{origin.machine}.{of.machine}", None, call.span)
        return good
    return emit
