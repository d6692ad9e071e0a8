"""The table of elementary types (IEC 61131-3, table 10): one row a type, from which all derives."""

from __future__ import annotations

import struct
from dataclasses import dataclass

Value = bool | int | float | str
"""A tag's value: BOOL as bool, integers, bit strings and times (ns) as int, REAL as float."""


_SIGNED = ("int", "time", "date", "tod", "dt")


@dataclass(frozen=True, slots=True)
class ElementaryType:
    """One elementary type.

    Attributes:
        name: the standard's keyword.
        kind: `bool`, `int` (signed), `uint` (unsigned), `bits` (bit string), `float`, `time`,
            `date`, `tod` (time of day) or `dt` (date and time).
        size: bytes in memory (little-endian).
        bits: significant bits.
        code: the `struct` letter.
        machine: the IR's machine type.
    """

    name: str
    kind: str
    size: int
    bits: int
    code: str
    machine: str

    @property
    def low(self) -> int:
        """The smallest integer value; 0 for kinds without one."""
        return -(1 << (self.bits - 1)) if self.kind in _SIGNED else 0

    @property
    def high(self) -> int:
        """The largest integer value."""
        return (1 << (self.bits - (self.kind in _SIGNED))) - 1

    def pack(self, value: Value) -> bytes:
        """Return the value's bytes in memory.

        Raises:
            ValueError: the value is outside the type's range or of another kind.
        """
        if isinstance(value, str):
            raise ValueError(f"{value!r} is not a value of type {self.name}")
        if self.kind == "float":
            try:
                return struct.pack("<" + self.code, float(value))
            except OverflowError:
                raise ValueError(f"{value} is outside the range of {self.name}") from None
        if isinstance(value, float):
            raise ValueError(f"{value} is not a value of type {self.name}")
        if self.kind == "bool" and value not in (0, 1):
            raise ValueError(f"{value} is not a value of type BOOL (use False or True)")
        if not self.low <= value <= self.high:
            raise ValueError(
                f"{value} is outside the range of {self.name} ({self.low} .. {self.high})")
        return struct.pack("<" + self.code, value)

    def unpack(self, data: bytes | bytearray | memoryview, offset: int = 0) -> Value:
        """Return the value at a byte offset of a block of memory."""
        value: Value = struct.unpack_from("<" + self.code, data, offset)[0]
        return value


def _row(name: str, kind: str, bits: int, code: str, machine: str) -> ElementaryType:
    return ElementaryType(name, kind, max(1, bits // 8), bits, code, machine)


ELEMENTARY: dict[str, ElementaryType] = {row.name: row for row in (
    _row("BOOL", "bool", 1, "?", "bool"),
    _row("SINT", "int", 8, "b", "i8"),
    _row("INT", "int", 16, "h", "i16"),
    _row("DINT", "int", 32, "i", "i32"),
    _row("LINT", "int", 64, "q", "i64"),
    _row("USINT", "uint", 8, "B", "u8"),
    _row("UINT", "uint", 16, "H", "u16"),
    _row("UDINT", "uint", 32, "I", "u32"),
    _row("ULINT", "uint", 64, "Q", "u64"),
    _row("BYTE", "bits", 8, "B", "u8"),
    _row("WORD", "bits", 16, "H", "u16"),
    _row("DWORD", "bits", 32, "I", "u32"),
    _row("LWORD", "bits", 64, "Q", "u64"),
    _row("REAL", "float", 32, "f", "f32"),
    _row("LREAL", "float", 64, "d", "f64"),
    _row("TIME", "time", 64, "q", "i64"),
    _row("LTIME", "time", 64, "q", "i64"),
    _row("DATE", "date", 64, "q", "i64"),
    _row("TIME_OF_DAY", "tod", 64, "q", "i64"),
    _row("DATE_AND_TIME", "dt", 64, "q", "i64"),
)}
"""Dates are ns since 1970-01-01, times of day ns since midnight."""

for _alias, _name in (("TOD", "TIME_OF_DAY"), ("DT", "DATE_AND_TIME"), ("LDATE", "DATE"),
                      ("LTOD", "TIME_OF_DAY"), ("LDT", "DATE_AND_TIME"),
                      ("LTIME_OF_DAY", "TIME_OF_DAY"), ("LDATE_AND_TIME", "DATE_AND_TIME")):
    ELEMENTARY[_alias] = ELEMENTARY[_name]


@dataclass(frozen=True, slots=True)
class StringType:
    """A string type with its capacity in characters.

    In memory: the length (16 bits, in characters), then room for the characters, one byte each for
    STRING (ISO 8859-1) and two for WSTRING (UTF-16).
    """

    capacity: int
    wide: bool = False

    @property
    def name(self) -> str:
        """As it is declared."""
        return f"{'W' if self.wide else ''}STRING[{self.capacity}]"

    @property
    def kind(self) -> str:
        """`string`."""
        return "string"

    @property
    def machine(self) -> str:
        """The machine type of its address, by which it is handed on."""
        return "u32"

    @property
    def size(self) -> int:
        """Bytes in memory."""
        return 2 + self.capacity * (2 if self.wide else 1)

    def pack(self, value: Value) -> bytes:
        """Return the value's bytes in memory.

        Raises:
            ValueError: the value is no text, too long, or has characters the type does not hold.
        """
        if not isinstance(value, str):
            raise ValueError(f"{value!r} is not a value of type {self.name}")
        try:
            data = value.encode("utf-16-le" if self.wide else "latin-1")
        except UnicodeEncodeError:
            raise ValueError(f"{value!r} has characters that {self.name} does not hold") from None
        length = len(data) // (2 if self.wide else 1)
        if length > self.capacity:
            raise ValueError(f"{value!r} is longer than {self.capacity} characters")
        return (struct.pack("<H", length) + data).ljust(self.size, b"\0")

    def unpack(self, data: bytes | bytearray | memoryview, offset: int = 0) -> Value:
        """Return the value at a byte offset of a block of memory."""
        (length,) = struct.unpack_from("<H", data, offset)
        width = 2 if self.wide else 1
        text = bytes(data[offset + 2:offset + 2 + min(length, self.capacity) * width])
        return text.decode("utf-16-le" if self.wide else "latin-1", "replace")


def type_of(name: str) -> ElementaryType | StringType:
    """Return the type of a tag by its name: an elementary type, `STRING[n]` or `WSTRING[n]`.

    Raises:
        KeyError: there is none.
    """
    if name in ELEMENTARY:
        return ELEMENTARY[name]
    head, bracket, rest = name.partition("[")
    if head not in ("STRING", "WSTRING") or not bracket:
        raise KeyError(name)
    return StringType(int(rest.rstrip("]")), head == "WSTRING")
