"""Tags by name: read, write and force values of a PLC from outside its scan."""

from __future__ import annotations

from plcemu.base.areas import Address, parse_address
from plcemu.base.errors import PlcemuError, UnknownNameError
from plcemu.base.time import DurationError, parse_duration_ns
from plcemu.base.types import ELEMENTARY, ElementaryType, StringType, Value
from plcemu.engine.memory import Memory
from plcemu.io.exchange import MEMORY, Exchange, Port
from plcemu.io.mapping import Point

_TYPE_OF_SIZE = {"X": "BOOL", "B": "BYTE", "W": "WORD", "D": "DWORD", "L": "LWORD"}


class ValueTypeError(PlcemuError, ValueError):
    """A value does not fit a tag's type."""


class TagAccess:
    """One client's access to tags in memory and to addresses of the image.

    Args:
        memory: of the resource.
        exchange: over that memory.
        name: of the client.
    """

    def __init__(self, memory: Memory, exchange: Exchange, name: str) -> None:
        self._memory = memory
        self._exchange = exchange
        self._port: Port = exchange.port(name)
        self._waiting: list[tuple[str, int, bytes, bytes | None]] = []

    def read(self, name: str) -> Value:
        """Return a value as this client sees it: last published, its own writes over it.

        Raises:
            UnknownNameError: neither a tag nor an address.
        """
        address, row, offset = self._find(name)
        if address is None:
            return row.unpack(self._port.read(MEMORY, offset, row.size))
        point = Point(name, address)
        raw = point.from_image(self._port.read(*point.image_place()))
        return row.unpack(raw.to_bytes(row.size, "little"))

    def type_of(self, name: str) -> str:
        """Return the name of a tag's or address's type; raises `UnknownNameError`."""
        return self._find(name)[1].name

    def is_of(self, memory: Memory) -> bool:
        """Whether it is for this memory, rather than that of a program before an online change."""
        return self._memory is memory

    def write(self, name: str, value: Value) -> None:
        """Queue a value; the next scan takes it.

        A duration may also be a text, such as `"1.5s"`.

        Raises:
            UnknownNameError: neither a tag nor an address.
            ValueTypeError: the value does not fit the type.
        """
        address, row, offset = self._find(name)
        data = self._pack(name, row, value)
        if address is None:
            self._queue(MEMORY, offset, data, None)
        else:
            self._queue(*Point(name, address).image_write(int.from_bytes(data, "little")))

    def check(self, name: str, value: Value) -> str:
        """Try a write without making it; return the address written, or an empty text.

        Raises:
            UnknownNameError: neither a tag nor an address.
            ValueTypeError: the value does not fit the type.
        """
        address, row, _ = self._find(name)
        self._pack(name, row, value)
        return str(address) if address is not None else ""

    def _queue(self, area: str, offset: int, data: bytes, mask: bytes | None) -> None:
        if not self._exchange.waiting:
            self._waiting.clear()
        self._port.write(area, offset, data, mask)
        self._waiting.append((area, offset, data, mask))

    def repeat(self, other: TagAccess) -> None:
        """Queue the writes of another client, of a PLC of the same program, that still wait."""
        for write in other._waiting if other._exchange.waiting else ():
            self._queue(*write)

    def force(self, name: str, value: Value) -> None:
        """Hold a tag at a value from the next scan on, whoever else writes it.

        Raises:
            UnknownNameError: no tag of the program.
            ValueTypeError: the value does not fit the type.
        """
        index = self._memory.tags.find(name)
        offset, row = self._memory.place(index)
        self._exchange.force(offset, self._pack(name, row, value))

    def unforce(self, name: str) -> None:
        """End a tag's force."""
        self._exchange.unforce(self._memory.place(self._memory.tags.find(name))[0])

    def _find(self, name: str) -> tuple[Address | None, ElementaryType | StringType, int]:
        if not isinstance(name, str):
            raise TypeError(f"{name!r} is no name; write the text of a tag or an address")
        try:
            index = self._memory.tags.find(name)
        except UnknownNameError:
            if not name.lstrip().startswith("%"):
                raise
            return self._unnamed(name)
        offset, row = self._memory.place(index)
        address = self._memory.tags[index].address
        return parse_address(address) if address else None, row, offset

    def _unnamed(self, name: str) -> tuple[Address, ElementaryType, int]:
        """Return an address that no tag has: the image holds what clients put there."""
        try:
            address = parse_address(name)
        except ValueError as problem:
            error = UnknownNameError("address", name, ())
            error.message = str(problem)
            raise error from None
        return address, ELEMENTARY[_TYPE_OF_SIZE[address.area[1]]], -1

    @staticmethod
    def _pack(name: str, row: ElementaryType | StringType, value: Value) -> bytes:
        try:
            if row.kind == "time" and isinstance(value, str):
                return row.pack(parse_duration_ns(value))
            return row.pack(value)
        except (ValueError, DurationError) as problem:
            raise ValueTypeError(f"{name}: {problem}") from None
        except TypeError:
            raise ValueTypeError(f"{name}: {value!r} is not a value of type {row.name}") from None
