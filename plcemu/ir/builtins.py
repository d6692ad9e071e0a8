"""Built-in functions on memory: strings, and what needs the calendar.

A string in memory is its length (u16, in characters) and room for its characters: one byte each for
STRING (ISO 8859-1), two (u16) for WSTRING. A function that makes a string is given the address and
the capacity of its target; what does not fit is cut off, as the standard has it.
"""

from __future__ import annotations

import datetime
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from plcemu.ir.ops import Fault

STRING_HEAD = 2
"""Bytes of a string's length."""

_LENGTH = struct.Struct("<H")
_WIDTHS = {"s": 1, "w": 2}
_CODECS = {"s": "latin-1", "w": "utf-16-le"}
_DAY_NS = 86_400_000_000_000


@dataclass(frozen=True, slots=True)
class Builtin:
    """A built-in function.

    Attributes:
        name: with `.s` or `.w` for the kind of string it works on.
        pops: machine types it takes, the top last; addresses are u32.
        pushes: the machine type of its result, or empty.
        fn: its meaning; takes the memory block and the operands.
    """

    name: str
    pops: tuple[str, ...]
    pushes: str
    fn: Callable[..., Any]


def read_string(block: bytearray, address: int, kind: str = "s") -> str:
    """Return the string at an address."""
    (length,) = _LENGTH.unpack_from(block, address)
    start = address + STRING_HEAD
    data = bytes(block[start:start + length * _WIDTHS[kind]])
    return data.decode(_CODECS[kind], "surrogatepass" if kind == "w" else "strict")


def write_string(block: bytearray, address: int, capacity: int, text: str, kind: str = "s") -> None:
    """Put a string at an address, cut to the capacity in characters; the rest becomes zero."""
    encoded = text.encode(_CODECS[kind], "surrogatepass" if kind == "w" else "replace")
    width = _WIDTHS[kind]
    data = encoded[:capacity * width]
    _LENGTH.pack_into(block, address, len(data) // width)
    start = address + STRING_HEAD
    block[start:start + capacity * width] = data.ljust(capacity * width, b"\0")


def _position(name: str, value: int, low: int, high: int) -> int:
    if not low <= value <= high:
        raise Fault(f"{name} is {value}, outside {low}..{high}")
    return value


def _left(text: str, count: int) -> str:
    return text[:_position("the length in LEFT", count, 0, 65535)]


def _right(text: str, count: int) -> str:
    _position("the length in RIGHT", count, 0, 65535)
    return text[max(0, len(text) - count):]


def _mid(text: str, count: int, at: int) -> str:
    _position("the length in MID", count, 0, 65535)
    at = _position("the position in MID", at, 1, 65535)
    return text[at - 1:at - 1 + count]


def _insert(text: str, other: str, after: int) -> str:
    after = _position("the position in INSERT", after, 0, len(text))
    return text[:after] + other + text[after:]


def _delete(text: str, count: int, at: int) -> str:
    _position("the length in DELETE", count, 0, 65535)
    at = _position("the position in DELETE", at, 1, 65535)
    return text[:at - 1] + text[at - 1 + count:]


def _replace(text: str, other: str, count: int, at: int) -> str:
    _position("the length in REPLACE", count, 0, 65535)
    at = _position("the position in REPLACE", at, 1, 65535)
    return text[:at - 1] + other + text[at - 1 + count:]


_MAKERS: dict[str, tuple[str, Callable[..., str]]] = {
    "copy": ("t", lambda text: text),
    "concat": ("tt", lambda a, b: a + b),
    "left": ("tn", _left), "right": ("tn", _right), "mid": ("tnn", _mid),
    "insert": ("ttn", _insert), "delete": ("tnn", _delete), "replace": ("ttnn", _replace),
}
"""Functions that make a string: their operands (t a string, n a number), their meaning."""


def _maker(name: str, kind: str, shape: str, fn: Callable[..., str]) -> Builtin:
    def run(block: bytearray, target: int, capacity: int, *operands: int) -> None:
        values = [read_string(block, o, kind) if s == "t" else o
                  for s, o in zip(shape, operands, strict=True)]
        write_string(block, target, capacity, fn(*values), kind)
    pops = tuple("u32" if s == "t" else "i64" for s in shape)
    return Builtin(f"string.{name}.{kind}", ("u32", "i64", *pops), "", run)


def _asker(name: str, kind: str, count: int, fn: Callable[..., int]) -> Builtin:
    def run(block: bytearray, *addresses: int) -> int:
        return fn(*(read_string(block, a, kind) for a in addresses))
    return Builtin(f"string.{name}.{kind}", ("u32",) * count, "i64", run)


def _compare(a: str, b: str) -> int:
    return (a > b) - (a < b)


def _number(text: str) -> int:
    stripped = text.strip().replace("_", "")
    sign = -1 if stripped.startswith("-") else 1
    base, hash_, digits = stripped.lstrip("+-").rpartition("#")
    try:
        return sign * (int(digits, int(base)) if hash_ else int(digits))
    except ValueError:
        raise Fault(f"the string {text!r} is no whole number") from None


def _real(text: str) -> float:
    try:
        return float(text.strip().replace("_", ""))
    except ValueError:
        raise Fault(f"the string {text!r} is no number") from None


def format_real(value: float, digits: int) -> str:
    """Write a REAL (7 digits) or LREAL (15) as its conversion to a string does."""
    text = f"{value:.{digits}g}"
    return text if any(c in text for c in ".en") else text + ".0"


def _to_text(kind: str) -> list[Builtin]:
    """Return the conversions of numbers to strings and back."""
    def maker(pops: str, write: Callable[[Any], str]) -> Callable[..., None]:
        def run(block: bytearray, target: int, capacity: int, value: Any) -> None:
            write_string(block, target, capacity, write(value), kind)
        return run

    rows: dict[str, tuple[str, Callable[[Any], str]]] = {
        "of.i64": ("i64", str), "of.u64": ("u64", str),
            "of.f32": ("f32", lambda v: format_real(v, 7)),
            "of.f64": ("f64", lambda v: format_real(v, 15)),
            "of.bool": ("bool", lambda v: "TRUE" if v else "FALSE")}
    made = [Builtin(f"string.{name}.{kind}", ("u32", "i64", m), "", maker(m, write))
            for name, (m, write) in rows.items()]
    readers: dict[str, tuple[str, Callable[[str], Any]]] = {
        "to.i64": ("i64", lambda t: _within(_number(t), -(1 << 63), (1 << 63) - 1)),
        "to.u64": ("u64", lambda t: _within(_number(t), 0, (1 << 64) - 1)),
        "to.f64": ("f64", _real),
        "to.bool": ("bool", lambda t: t.strip().upper() in ("TRUE", "1"))}
    for name, (machine, read) in readers.items():
        def run(block: bytearray, address: int, read: Callable[[str], Any] = read) -> Any:
            return read(read_string(block, address, kind))
        made.append(Builtin(f"string.{name}.{kind}", ("u32",), machine, run))
    return made


def _within(value: int, low: int, high: int) -> int:
    if not low <= value <= high:
        raise Fault(f"{value} is outside the range of the type")
    return value


def _recode(source: str, target: str) -> Builtin:
    def run(block: bytearray, address: int, capacity: int, origin: int) -> None:
        write_string(block, address, capacity, read_string(block, origin, source), target)
    return Builtin(f"string.recode.{source}{target}", ("u32", "i64", "u32"), "", run)


def _date_number(block: bytearray, ns: int, part: int) -> int:
    """Return a part of a date: 0 year, 1 month, 2 day, 3 weekday (0 Sunday)."""
    date = datetime.date(1970, 1, 1) + datetime.timedelta(days=ns // _DAY_NS)
    return (date.year, date.month, date.day, date.isoweekday() % 7)[part]


def _date_of(block: bytearray, year: int, month: int, day: int) -> int:
    try:
        days = (datetime.date(year, month, day) - datetime.date(1970, 1, 1)).days
    except (ValueError, OverflowError):
        raise Fault(f"there is no date {year}-{month}-{day}") from None
    return days * _DAY_NS


def _build() -> dict[str, Builtin]:
    rows: list[Builtin] = []
    for kind in _WIDTHS:
        rows += [_maker(name, kind, shape, fn) for name, (shape, fn) in _MAKERS.items()]
        rows.append(_asker("len", kind, 1, len))
        rows.append(_asker("compare", kind, 2, _compare))
        rows.append(_asker("find", kind, 2, lambda a, b: a.find(b) + 1 if b else 0))
        rows += _to_text(kind)
    rows += [_recode("s", "w"), _recode("w", "s")]
    rows.append(Builtin("date.part", ("i64", "i64"), "i64", _date_number))
    rows.append(Builtin("date.of", ("i64", "i64", "i64"), "i64", _date_of))
    return {row.name: row for row in rows}


BUILTINS: dict[str, Builtin] = _build()
