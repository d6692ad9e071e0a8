"""The table of function codes: how a request is laid out, its limits, and what it does.

A request's data is a fixed head, then what `Tail` says. Quantities and values in the head are
checked before any address, as in the state diagrams of the application protocol, section 6.
To serve another function code, add a row to `FUNCTION_CODES`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from functools import partial
from typing import Any, Protocol

from plcemu.io.exchange import Port
from plcemu.modbus.errors import ExceptionCode, ModbusException
from plcemu.modbus.identity import BASIC_OBJECTS, EXTENDED_OBJECTS, REGULAR_OBJECTS, Identity
from plcemu.modbus.map import AddressMap, ObjectType

PDU_BYTES = 253
"""The longest PDU (application protocol, section 4.1)."""

READ_BITS = range(1, 2000 + 1)
READ_REGISTERS = range(1, 125 + 1)
WRITE_BITS = range(1, 1968 + 1)
WRITE_REGISTERS = range(1, 123 + 1)
WRITE_REGISTERS_WITH_READ = range(1, 121 + 1)
"""Quantities a request may name (application protocol, sections 6.1 to 6.17)."""

COIL_VALUES = {0x0000: b"\x00", 0xFF00: b"\x01"}
"""The only values of Write Single Coil, and the bit that each one sets (section 6.5)."""

_EXCEPTION = 0x80
_QUANTITY, _WORDS = struct.Struct(">HH"), struct.Struct(">H")


class Device(Protocol):
    """What a request acts on."""

    @property
    def map(self) -> AddressMap:
        """Which number is which address."""

    @property
    def port(self) -> Port:
        """The client's door to the process image."""

    @property
    def identity(self) -> Identity:
        """The identification objects."""


class Tail(Enum):
    """What follows the head of a request."""

    NONE = auto()
    COUNTED = auto()
    """As many bytes as the head's last field says."""
    REST = auto()
    """Anything; the function itself judges it."""


@dataclass(frozen=True, slots=True)
class Function:
    """One function code.

    Attributes:
        code: 1 to 127.
        name: as in the application protocol.
        head: layout of the fixed fields after the code.
        tail: what follows them.
        limits: whether the fields, as arguments, are within the specification's limits.
        execute: takes the device, the fields and a tail's bytes; returns the data of the answer.
    """

    code: int
    name: str
    head: struct.Struct
    tail: Tail
    limits: Callable[..., bool]
    execute: Callable[..., bytes]

    def decode(self, data: bytes) -> tuple[Any, ...]:
        """Return the fields of a request and, if it has a tail, the tail's bytes.

        Raises:
            ModbusException: illegal data value: bytes are missing or left over, or beyond a limit.
        """
        size = self.head.size
        if len(data) < size:
            raise ModbusException(ExceptionCode.ILLEGAL_DATA_VALUE)
        fields, tail = self.head.unpack_from(data), data[size:]
        if self.tail is not Tail.REST:
            due = fields[-1] if self.tail is Tail.COUNTED else 0
            if len(tail) != due:
                raise ModbusException(ExceptionCode.ILLEGAL_DATA_VALUE)
        if not self.limits(*fields):
            raise ModbusException(ExceptionCode.ILLEGAL_DATA_VALUE)
        return fields if self.tail is Tail.NONE else (*fields, tail)


def answer(device: Device, request: bytes) -> bytes:
    """Execute a request PDU on a device and return the response PDU.

    Raises:
        ModbusException: the request is refused.
        LimitError: the process image takes no more writes before the next scan.
    """
    function = FUNCTION_CODES.get(request[0]) if request else None
    if function is None:
        raise ModbusException(ExceptionCode.ILLEGAL_FUNCTION)
    return request[:1] + function.execute(device, *function.decode(request[1:]))


def exception_response(request: bytes, code: ExceptionCode) -> bytes:
    """Return the response PDU that refuses a request PDU."""
    return bytes((_EXCEPTION | (request[0] if request else 0), code))


def _counted(data: bytes) -> bytes:
    return bytes((len(data),)) + data


def _read_bits(kind: ObjectType, device: Device, first: int, count: int) -> bytes:
    return _counted(device.map.read_bits(device.port, kind, first, count))


def _read_registers(kind: ObjectType, device: Device, first: int, count: int) -> bytes:
    return _counted(device.map.read_registers(device.port, kind, first, count))


def _write_coil(device: Device, number: int, value: int) -> bytes:
    device.map.write_bits(device.port, number, 1, COIL_VALUES[value])
    return _QUANTITY.pack(number, value)


def _write_register(device: Device, number: int, value: int) -> bytes:
    device.map.write_registers(device.port, number, _WORDS.pack(value))
    return _QUANTITY.pack(number, value)


def _write_coils(device: Device, first: int, count: int, _size: int, packed: bytes) -> bytes:
    device.map.write_bits(device.port, first, count, packed)
    return _QUANTITY.pack(first, count)


def _write_registers(device: Device, first: int, count: int, _size: int, data: bytes) -> bytes:
    device.map.write_registers(device.port, first, data)
    return _QUANTITY.pack(first, count)


def _mask_write(device: Device, number: int, and_mask: int, or_mask: int) -> bytes:
    # (current AND and_mask) OR (or_mask AND NOT and_mask), section 6.16: where and_mask is 0 the
    # bit becomes that of or_mask, elsewhere it stays. One masked write also leaves alone what the
    # program changes in the other bits before the write is latched.
    device.map.write_registers(device.port, number, _WORDS.pack(or_mask),
                               _WORDS.pack(and_mask ^ 0xFFFF))
    return struct.pack(">HHH", number, and_mask, or_mask)


def _read_write(device: Device, first: int, count: int, to: int, _count: int, _size: int,
                data: bytes) -> bytes:
    # The write comes first (section 6.17), but not if the read will be refused.
    device.map.runs(ObjectType.HOLDING, first, count)
    device.map.write_registers(device.port, to, data)
    return _read_registers(ObjectType.HOLDING, device, first, count)


READ_DEVICE_IDENTIFICATION = 0x0E
ONE_OBJECT = 0x04

STREAMS: Mapping[int, range] = {0x01: BASIC_OBJECTS, 0x02: REGULAR_OBJECTS,
                                0x03: range(EXTENDED_OBJECTS.stop)}
"""Objects that each Read Device ID code of stream access shows (section 6.21)."""

_IDENTIFICATION_HEAD = struct.Struct(">BBBBBB")


def _encapsulated(device: Device, mei_type: int, data: bytes) -> bytes:
    execute = MEI_TYPES.get(mei_type)
    if execute is None:
        raise ModbusException(ExceptionCode.ILLEGAL_FUNCTION)
    return execute(device, data)


def _identify(device: Device, data: bytes) -> bytes:
    if len(data) != 2:
        raise ModbusException(ExceptionCode.ILLEGAL_DATA_VALUE)
    access, wanted = data
    if access == ONE_OBJECT:
        return _one_object(device.identity, wanted)
    if access not in STREAMS:
        raise ModbusException(ExceptionCode.ILLEGAL_DATA_VALUE)
    shown = [n for n in device.identity.objects if n in STREAMS[access]]
    start = shown.index(wanted) if wanted in shown else 0
    return _stream(device.identity, access, shown[start:])


def _one_object(identity: Identity, number: int) -> bytes:
    if number not in identity.objects:
        raise ModbusException(ExceptionCode.ILLEGAL_DATA_ADDRESS)
    return _identification(identity, ONE_OBJECT, [number], 0)


def _stream(identity: Identity, access: int, numbers: list[int]) -> bytes:
    """Answer with as many objects as fit, and where to go on."""
    room = PDU_BYTES - 1 - _IDENTIFICATION_HEAD.size
    for fitting, number in enumerate(numbers):
        room -= 2 + len(identity.objects[number])
        if room < 0:
            return _identification(identity, access, numbers[:fitting], number)
    return _identification(identity, access, numbers, 0)


def _identification(identity: Identity, access: int, numbers: list[int], following: int) -> bytes:
    more = 0xFF if following else 0x00
    head = _IDENTIFICATION_HEAD.pack(READ_DEVICE_IDENTIFICATION, access, identity.conformity_level,
                                     more, following, len(numbers))
    return head + b"".join(bytes((n,)) + _counted(identity.objects[n]) for n in numbers)


MEI_TYPES: Mapping[int, Callable[[Device, bytes], bytes]] = {READ_DEVICE_IDENTIFICATION: _identify}
"""MODBUS Encapsulated Interface types of function code 43 (section 6.19)."""


def _quantity_in(allowed: range, _first: int, count: int) -> bool:
    return count in allowed


def _any_value(*_fields: int) -> bool:
    return True


def _is_coil_value(_number: int, value: int) -> bool:
    return value in COIL_VALUES


def _coils_fit(_first: int, count: int, size: int) -> bool:
    return count in WRITE_BITS and size == (count + 7) // 8


def _registers_fit(_first: int, count: int, size: int) -> bool:
    return count in WRITE_REGISTERS and size == 2 * count


def _both_fit(_first: int, count: int, _to: int, written: int, size: int) -> bool:
    return count in READ_REGISTERS and written in WRITE_REGISTERS_WITH_READ and size == 2 * written


def _row(code: int, name: str, head: str, tail: Tail, limits: Callable[..., bool],
         execute: Callable[..., bytes]) -> Function:
    return Function(code, name, struct.Struct(">" + head), tail, limits, execute)


_BITS, _REGISTERS = partial(_quantity_in, READ_BITS), partial(_quantity_in, READ_REGISTERS)

FUNCTION_CODES: Mapping[int, Function] = {row.code: row for row in (
    _row(1, "Read Coils", "HH", Tail.NONE, _BITS, partial(_read_bits, ObjectType.COIL)),
    _row(2, "Read Discrete Inputs", "HH", Tail.NONE, _BITS,
         partial(_read_bits, ObjectType.DISCRETE)),
    _row(3, "Read Holding Registers", "HH", Tail.NONE, _REGISTERS,
         partial(_read_registers, ObjectType.HOLDING)),
    _row(4, "Read Input Registers", "HH", Tail.NONE, _REGISTERS,
         partial(_read_registers, ObjectType.INPUT)),
    _row(5, "Write Single Coil", "HH", Tail.NONE, _is_coil_value, _write_coil),
    _row(6, "Write Single Register", "HH", Tail.NONE, _any_value, _write_register),
    _row(15, "Write Multiple Coils", "HHB", Tail.COUNTED, _coils_fit, _write_coils),
    _row(16, "Write Multiple Registers", "HHB", Tail.COUNTED, _registers_fit, _write_registers),
    _row(22, "Mask Write Register", "HHH", Tail.NONE, _any_value, _mask_write),
    _row(23, "Read/Write Multiple Registers", "HHHHB", Tail.COUNTED, _both_fit, _read_write),
    _row(43, "Encapsulated Interface Transport", "B", Tail.REST, _any_value, _encapsulated),
)}
"""The function codes that are served, by code."""
