"""The address map: which Modbus number is which IEC address.

A map is a table of ranges. Reading and writing go through it in whole runs: bits travel packed,
lowest number in the lowest bit, registers as big-endian bytes, which is also how the exchange keeps
its areas, so that a run is a slice, or a shift of one large integer where bits are not aligned.
"""

from __future__ import annotations

import itertools
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal, NamedTuple

from plcemu.base.areas import AREA_ELEMENTS, AREAS, SIZES, Address
from plcemu.io.exchange import Port
from plcemu.modbus.errors import ExceptionCode, ModbusException, UnmappedError

NUMBERS = 65_536
"""Numbers of one object type: a request names them in 16 bits."""

REGISTER_BYTES = 2


class ObjectType(StrEnum):
    """The four primary tables (application protocol, section 4.3)."""

    DISCRETE = "discrete"
    COIL = "coil"
    INPUT = "input"
    HOLDING = "holding"

    @property
    def is_bits(self) -> bool:
        """Whether an object is one bit; else it is a register of 16."""
        return self in _BIT_TYPES

    @property
    def is_writable(self) -> bool:
        """Whether the protocol has a function code that writes it."""
        return self in _WRITABLE_TYPES


_BIT_TYPES = frozenset({ObjectType.DISCRETE, ObjectType.COIL})
_WRITABLE_TYPES = frozenset({ObjectType.COIL, ObjectType.HOLDING})


@dataclass(frozen=True, slots=True)
class MapRange:
    """Consecutive Modbus numbers that show consecutive elements of one area.

    Attributes:
        object_type: which of the four primary tables.
        first: its first number, from 0, as sent in a request.
        count: its numbers: bits, or registers of 16 bits.
        area: X areas for bits; W, D (two registers an element) and L (four) for registers.
        element: the area's first element shown, in an X area the bit, byte·8 + bit.
        access: `r`, or `rw` for coils and holding registers.
        is_field_window: whether it exists only while the field window is open.

    Raises:
        ValueError: with the range, what is wrong and what is expected.
    """

    object_type: ObjectType
    first: int
    count: int
    area: str
    element: int = 0
    access: Literal["r", "rw"] = "r"
    is_field_window: bool = False

    def __post_init__(self) -> None:
        # A configuration gives plain texts.
        object.__setattr__(self, "object_type", ObjectType(self.object_type))
        for wrong, text in self._mistakes():
            if wrong:
                raise ValueError(f"{self}: {text}")

    def _mistakes(self) -> Iterable[tuple[bool, str]]:
        yield self.area not in AREAS, f"there is no area {self.area}"
        sizes = "X" if self.object_type.is_bits else "WDL"
        yield self.area[1] not in sizes, f"{self.object_type} ranges show areas {', '.join(sizes)}"
        yield self.first < 0 or self.count < 1 or self.end > NUMBERS, \
            f"numbers go from 0 to {NUMBERS - 1}, and a range has at least one"
        yield self.count % self.per_element != 0, \
            f"an element of {self.area} takes {self.per_element} registers; count whole elements"
        elements = AREA_ELEMENTS * (8 if self.object_type.is_bits else 1)
        yield not 0 <= self.element <= elements - self.count // self.per_element, \
            f"it leaves area {self.area}, which ends with {Address(self.area, elements - 1)}"
        yield self.access not in ("r", "rw"), f"access is r or rw, not {self.access!r}"
        yield self.access == "rw" and not self.object_type.is_writable, \
            "only coils and holding registers can be written"

    def __str__(self) -> str:
        return f"{self.object_type} {self.first}-{self.end - 1} ({self.area})"

    @property
    def end(self) -> int:
        """The number after its last."""
        return self.first + self.count

    @property
    def per_element(self) -> int:
        """Numbers that one element of the area takes."""
        return 1 if self.object_type.is_bits else SIZES[self.area[1]] // REGISTER_BYTES

    def offset_of(self, number: int) -> int:
        """Where a number stands in the area: in bits, or in bytes for registers."""
        if self.object_type.is_bits:
            return self.element + number - self.first
        return self.element * SIZES[self.area[1]] + (number - self.first) * REGISTER_BYTES


_D, _C, _I, _H = ObjectType.DISCRETE, ObjectType.COIL, ObjectType.INPUT, ObjectType.HOLDING

DEFAULT_RANGES: tuple[MapRange, ...] = (
    MapRange(_D, 0, 8192, "IX"),
    MapRange(_C, 0, 8192, "QX", access="rw"),
    MapRange(_I, 0, 1024, "IW"),
    MapRange(_H, 0, 1024, "QW", access="rw"),
    MapRange(_H, 1024, 1024, "MW", access="rw"),
    MapRange(_H, 2048, 2048, "MD", access="rw"),
    MapRange(_H, 4096, 4096, "ML", access="rw"),
    MapRange(_C, 16384, 8192, "IX", access="rw", is_field_window=True),
    MapRange(_C, 24576, 8192, "MX", access="rw"),
    MapRange(_H, 16384, 1024, "IW", access="rw", is_field_window=True),
)
"""The map that SCADA set-ups for OpenPLC know, and the field window, where a plant writes."""


class Place(NamedTuple):
    """Where a peer finds an element: table, first number, and how many numbers it takes."""

    object_type: ObjectType
    number: int
    quantity: int


class Run(NamedTuple):
    """The part of a request that falls into one range.

    Attributes:
        area: of the exchange.
        offset: in the area, in bits or bytes (`MapRange.offset_of`).
        skip: numbers of the request before this part.
        quantity: numbers in this part.
    """

    area: str
    offset: int
    skip: int
    quantity: int


class AddressMap:
    """A checked set of ranges.

    Args:
        ranges: in any order; where several show one element, the earlier one is preferred.
        field_window: whether the ranges of the field window exist.

    Raises:
        ValueError: two ranges of one object type overlap.
    """

    def __init__(self, ranges: Iterable[MapRange] = DEFAULT_RANGES, *,
                 field_window: bool = True) -> None:
        self.field_window = field_window
        every = tuple(ranges)
        _check_overlaps(every)
        self.ranges = tuple(r for r in every if field_window or not r.is_field_window)
        """The ranges that exist, in the order given."""
        self._tables = {kind: _table(self.ranges, kind) for kind in ObjectType}

    def locate(self, address: Address, *, writing: bool = False) -> Place:
        """Return where a peer finds an element, preferably where it can also write it.

        Raises:
            UnmappedError: no range shows the address, or none for writing if that is asked for.
        """
        shown = [r for r in self.ranges if r.area == address.area
                 and 0 <= address.index - r.element < r.count // r.per_element]
        writable = [r for r in shown if r.access == "rw"]
        for r in writable if writing else writable + shown:
            number = r.first + (address.index - r.element) * r.per_element
            return Place(r.object_type, number, r.per_element)
        what = "for writing " if shown else ""
        window = "" if self.field_window else " (the field window is closed)"
        raise UnmappedError(f"the Modbus map does not show {address} {what}to a client{window}; "
                            "add a range to modbus.map")

    def runs(self, object_type: ObjectType, first: int, count: int, *,
             writing: bool = False) -> list[Run]:
        """Cut a request into the parts that each fall into one range.

        Raises:
            ModbusException: illegal data address: a number is in no range, or must not be written.
        """
        firsts, ranges = self._tables[object_type]
        number, end, found = first, first + count, []
        at = bisect_right(firsts, first) - 1
        while number < end:
            if not 0 <= at < len(ranges):
                raise ModbusException(ExceptionCode.ILLEGAL_DATA_ADDRESS)
            r = ranges[at]
            if not r.first <= number < r.end or (writing and r.access != "rw"):
                raise ModbusException(ExceptionCode.ILLEGAL_DATA_ADDRESS)
            part = min(end, r.end) - number
            found.append(Run(r.area, r.offset_of(number), number - first, part))
            number, at = number + part, at + 1
        return found

    def read_bits(self, port: Port, object_type: ObjectType, first: int, count: int) -> bytes:
        """Return bits packed from the lowest upwards; the rest of the last byte is 0."""
        runs = self.runs(object_type, first, count)
        if len(runs) == 1 and not (runs[0].offset | count) % 8:
            return port.read(runs[0].area, runs[0].offset // 8, count // 8)
        value = 0
        for run in runs:
            value |= _bits(port, run) << run.skip
        return value.to_bytes((count + 7) // 8, "little")

    def write_bits(self, port: Port, first: int, count: int, packed: bytes) -> None:
        """Queue bits for the coils from `first` on; bits of `packed` beyond `count` are ignored."""
        value = int.from_bytes(packed, "little")
        for run in self.runs(ObjectType.COIL, first, count, writing=True):
            _queue_bits(port, run, value >> run.skip)

    def read_registers(self, port: Port, object_type: ObjectType, first: int, count: int) -> bytes:
        """Return registers, each big-endian."""
        runs = self.runs(object_type, first, count)
        return b"".join([port.read(r.area, r.offset, r.quantity * REGISTER_BYTES) for r in runs])

    def write_registers(self, port: Port, first: int, data: bytes,
                        mask: bytes | None = None) -> None:
        """Queue big-endian holding registers; with a mask only the bits that are 1 in it."""
        count = len(data) // REGISTER_BYTES
        for run in self.runs(ObjectType.HOLDING, first, count, writing=True):
            part = slice(run.skip * REGISTER_BYTES, (run.skip + run.quantity) * REGISTER_BYTES)
            port.write(run.area, run.offset, data[part], None if mask is None else mask[part])


def _table(ranges: Iterable[MapRange], kind: ObjectType) -> tuple[list[int], list[MapRange]]:
    """Return the first numbers of one object type's ranges, rising, and the ranges beside them."""
    ordered = sorted((r for r in ranges if r.object_type is kind), key=lambda r: r.first)
    return [r.first for r in ordered], ordered


def _check_overlaps(ranges: Iterable[MapRange]) -> None:
    ordered = sorted(ranges, key=lambda r: (r.object_type, r.first))
    for low, high in itertools.pairwise(ordered):
        if low.object_type is high.object_type and high.first < low.end:
            raise ValueError(f"{high} overlaps {low}; "
                             "every number of an object type has one meaning")


def _bits(port: Port, run: Run) -> int:
    byte, shift = divmod(run.offset, 8)
    raw = port.read(run.area, byte, (shift + run.quantity + 7) // 8)
    return int.from_bytes(raw, "little") >> shift & ((1 << run.quantity) - 1)


def _queue_bits(port: Port, run: Run, value: int) -> None:
    byte, shift = divmod(run.offset, 8)
    ones = (1 << run.quantity) - 1
    size = (shift + run.quantity + 7) // 8
    data = ((value & ones) << shift).to_bytes(size, "little")
    whole = not (shift | run.quantity) % 8
    port.write(run.area, byte, data, None if whole else (ones << shift).to_bytes(size, "little"))
