"""The table of elementary types (IEC 61131-3, table 10): one row a type, from which all derives."""

from __future__ import annotations

import struct
from dataclasses import dataclass

Value = bool | int | float | str
"""A tag's value: BOOL as bool, integers, bit strings and times (ns) as int, REAL as float."""


@dataclass(frozen=True, slots=True)
class ElementaryType:
    """One elementary type.

    Attributes:
        name: the standard's keyword.
        kind: `bool`, `int` (signed), `uint` (unsigned), `bits` (bit string), `float` or `time`.
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
        return -(1 << (self.bits - 1)) if self.kind in ("int", "time") else 0

    @property
    def high(self) -> int:
        """The largest integer value."""
        return (1 << (self.bits - (self.kind in ("int", "time")))) - 1

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
)}
