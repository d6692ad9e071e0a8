"""Built-in functions on memory: strings, and what needs the calendar.

A string in memory is its length (u16, in characters) and room for its characters: one byte each for
STRING (ISO 8859-1), two (u16) for WSTRING, whose characters are UTF-16 code units. A function that
makes a string is given the address and the capacity of its target; what does not fit is cut off, as
the standard has it. The target may be one of the operands.
"""

from __future__ import annotations

import re
import struct
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from plcemu.base import dates
from plcemu.base.time import DurationError, parse_duration_ns
from plcemu.ir.ops import Fault
from plcemu.ir.program import Block

STRING_HEAD = 2
"""Bytes of a string's length."""

_LENGTH = struct.Struct("<H")
_WIDTHS = {"s": 1, "w": 2}
_CODECS = {"s": "latin-1", "w": "utf-16-le"}


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


def read_string(block: Block, address: int, kind: str = "s") -> str:
    """Return the string at an address."""
    (length,) = _LENGTH.unpack_from(block, address)
    start = address + STRING_HEAD
    data = bytes(block[start:start + length * _WIDTHS[kind]])
    return "".join(map(chr, array("H", data))) if kind == "w" else data.decode("latin-1")


def write_string(block: Block, address: int, capacity: int, text: str, kind: str = "s") -> None:
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
    def run(block: Block, target: int, capacity: int, *operands: int) -> None:
        values = [read_string(block, o, kind) if s == "t" else o
                  for s, o in zip(shape, operands, strict=True)]
        write_string(block, target, capacity, fn(*values), kind)
    pops = tuple("u32" if s == "t" else "i64" for s in shape)
    return Builtin(f"string.{name}.{kind}", ("u32", "i64", *pops), "", run)


def _asker(name: str, kind: str, count: int, fn: Callable[..., int]) -> Builtin:
    def run(block: Block, *addresses: int) -> int:
        return fn(*(read_string(block, a, kind) for a in addresses))
    return Builtin(f"string.{name}.{kind}", ("u32",) * count, "i64", run)


def _compare(a: str, b: str) -> int:
    return (a > b) - (a < b)


_NUMBER = re.compile(r"([+-]?)(?:(2|8|16)#)?([0-9A-Fa-f]+)")


def _number(text: str) -> int:
    match = _NUMBER.fullmatch(text.strip(" ").replace("_", ""))
    try:
        if match is not None:
            return int(match[1] + match[3], int(match[2] or 10))
    except ValueError:
        pass
    raise Fault(f"the string {text[:80]!r} is no whole number")


_REAL = re.compile(r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|inf|nan)")


def _real(text: str) -> float:
    match = _REAL.fullmatch(text.strip(" ").replace("_", ""))
    if match is None:
        raise Fault(f"the string {text[:80]!r} is no number")
    return float(match[0])


_BOOLEANS = {"TRUE": True, "1": True, "FALSE": False, "0": False}


def _boolean(text: str) -> bool:
    value = _BOOLEANS.get(text.strip(" ").upper())
    if value is None:
        raise Fault(f"the string {text[:80]!r} is neither TRUE nor FALSE")
    return value


def _duration(text: str) -> int:
    return parse_duration_ns(text)


_CALENDAR: dict[str, tuple[str, tuple[str, ...], Callable[[int], str], Callable[[str], int]]] = {
    "time": ("T", ("T", "TIME", "LT", "LTIME"), dates.format_time, _duration),
    "ltime": ("LTIME", ("T", "TIME", "LT", "LTIME"), dates.format_time, _duration),
    "date": ("D", ("D", "DATE", "LD", "LDATE"), dates.format_date, dates.parse_date_ns),
    "tod": ("TOD", ("TOD", "TIME_OF_DAY", "LTOD", "LTIME_OF_DAY"), dates.format_tod,
            dates.parse_tod_ns),
    "dt": ("DT", ("DT", "DATE_AND_TIME", "LDT", "LDATE_AND_TIME"), dates.format_dt,
           dates.parse_dt_ns),
}
"""Times and dates as text: the prefix written, those read, which may be left out, and how."""


def _calendar_writer(name: str) -> Callable[[int], str]:
    prefix, _, write, _ = _CALENDAR[name]
    return lambda ns: f"{prefix}#{write(ns)}"


def _calendar_reader(name: str) -> Callable[[str], int]:
    _, prefixes, _, read = _CALENDAR[name]

    def value(text: str) -> int:
        head, hash_, rest = text.strip(" ").rpartition("#")
        try:
            if hash_ and head.upper() not in prefixes:
                raise ValueError
            return _within(read(rest), -(1 << 63), (1 << 63) - 1)
        except (ValueError, DurationError):
            raise Fault(f"the string {text[:80]!r} is no {prefixes[1]}") from None
    return value


def format_real(value: float, digits: int) -> str:
    """Write a REAL (7 digits) or LREAL (15) as its conversion to a string does."""
    text = f"{value:.{digits}g}"
    return text if any(c in text for c in ".en") else text + ".0"


def _within(value: int, low: int, high: int) -> int:
    if not low <= value <= high:
        raise Fault(f"{value} is outside the range of the type")
    return value


_RANGES = {**{f"i{bits}": (-(1 << bits - 1), (1 << bits - 1) - 1) for bits in (8, 16, 32, 64)},
           **{f"u{bits}": (0, (1 << bits) - 1) for bits in (8, 16, 32, 64)}}


def _ranged(low: int, high: int) -> Callable[[str], int]:
    return lambda text: _within(_number(text), low, high)


_WRITERS: dict[str, tuple[str, Callable[[Any], str]]] = {
    "of.i64": ("i64", str), "of.u64": ("u64", str),
    "of.f32": ("f32", lambda v: format_real(v, 7)),
    "of.f64": ("f64", lambda v: format_real(v, 15)),
    "of.bool": ("bool", lambda v: "TRUE" if v else "FALSE"),
    **{f"of.{name}": ("i64", _calendar_writer(name)) for name in _CALENDAR},
}
"""Conversions of values to strings: the machine type of the value, its text."""

_READERS: dict[str, tuple[str, Callable[[str], Any]]] = {
    **{f"to.{m}": (m, _ranged(*limits)) for m, limits in _RANGES.items()},
    "to.f64": ("f64", _real), "to.bool": ("bool", _boolean),
    **{f"to.{name}": ("i64", _calendar_reader(name)) for name in _CALENDAR},
}
"""Conversions of strings to values: the machine type of the value, how it is read."""


def _to_text(kind: str) -> list[Builtin]:
    """Return the conversions of numbers to strings and back."""
    def maker(pops: str, write: Callable[[Any], str]) -> Callable[..., None]:
        def run(block: Block, target: int, capacity: int, value: Any) -> None:
            write_string(block, target, capacity, write(value), kind)
        return run

    made = [Builtin(f"string.{name}.{kind}", ("u32", "i64", m), "", maker(m, write))
            for name, (m, write) in _WRITERS.items()]
    for name, (machine, read) in _READERS.items():
        def run(block: Block, address: int, read: Callable[[str], Any] = read) -> Any:
            return read(read_string(block, address, kind))
        made.append(Builtin(f"string.{name}.{kind}", ("u32",), machine, run))
    return made


def _recode(source: str, target: str) -> Builtin:
    def run(block: Block, address: int, capacity: int, origin: int) -> None:
        write_string(block, address, capacity, read_string(block, origin, source), target)
    return Builtin(f"string.recode.{source}{target}", ("u32", "i64", "u32"), "", run)


def _date_number(block: Block, ns: int, part: int) -> int:
    """Return a part of a date: 0 year, 1 month, 2 day, 3 weekday (0 Sunday)."""
    date = dates.date_of_ns(ns)
    return (date.year, date.month, date.day, date.isoweekday() % 7)[part]


def _date_of(block: Block, year: int, month: int, day: int) -> int:
    try:
        return dates.date_ns(year, month, day)
    except ValueError as problem:
        raise Fault(str(problem)) from None


def _tod_of(block: Block, hour: int, minute: int, second: int, millisecond: int) -> int:
    try:
        return dates.tod_ns(hour, minute, second, millisecond * 1_000_000)
    except ValueError as problem:
        raise Fault(f"{problem}.{millisecond:03}") from None


def _bcd_to(block: Block, bits: int) -> int:
    """Return the number whose decimal digits are the groups of four bits (2.5.1.5.1)."""
    try:
        return int(f"{bits:x}")
    except ValueError:
        raise Fault(f"16#{bits:X} is no BCD number") from None


def _bcd_of(block: Block, value: int, digits: int) -> int:
    """Return a number as so many BCD digits."""
    if value >= 10 ** digits:
        raise Fault(f"{value} has more than {digits} BCD digits")
    return int(str(value), 16)


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
    rows.append(Builtin("tod.of", ("i64", "i64", "i64", "i64"), "i64", _tod_of))
    rows.append(Builtin("bcd.to", ("u64",), "u64", _bcd_to))
    rows.append(Builtin("bcd.of", ("u64", "i64"), "u64", _bcd_of))
    return {row.name: row for row in rows}


BUILTINS: dict[str, Builtin] = _build()
