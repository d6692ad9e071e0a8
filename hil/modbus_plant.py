"""A plant behind Modbus TCP: the coupling worked as a client of any PLC.

One step reads the outputs, advances the plant and writes the inputs, as the coupling in the process
does. Nothing is replayed after an outage: only the present state is sent.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from hil.coupling import Coupling
from plcemu.base.errors import PlcemuError
from plcemu.io.mapping import Point
from plcemu.modbus import AddressMap, ObjectType

_LOG = logging.getLogger("plcemu.plant")

READ_GAP = 16
"""Numbers between two wanted ones that a single read request may span."""

READ_LIMIT = {True: 2000, False: 125}
WRITE_LIMIT = {True: 1968, False: 123}
"""Bits (True) and registers (False) in one request (Modbus application protocol, section 6)."""


class FieldLinkError(PlcemuError):
    """The PLC did not answer, or refused a request."""


@dataclass(frozen=True, slots=True)
class _Wire:
    """A point as Modbus numbers: `count` bits or registers from `first`."""

    point: Point
    kind: ObjectType
    first: int
    count: int


@dataclass(frozen=True, slots=True)
class _Block:
    """Neighbouring wires that share one request."""

    kind: ObjectType
    first: int
    count: int
    wires: tuple[tuple[int, _Wire], ...]


class ModbusPlant:
    """Steps a coupled plant against a PLC's Modbus server.

    Args:
        coupling: the plant and its wiring.
        address_map: where the PLC shows inputs and outputs.
        host: of the PLC.
        port: of its Modbus server.
        unit: the unit identifier to ask.
        timeout_s: for one answer, in s.

    Raises:
        UnmappedError: the map does not show a wired address, or not for writing.
    """

    def __init__(self, coupling: Coupling, address_map: AddressMap, host: str, port: int,
                 unit: int = 1, timeout_s: float = 1.0) -> None:
        self.coupling = coupling
        self._unit = unit
        self._host, self._port, self._timeout_s = host, port, timeout_s
        self._where = f"{host}:{port}"
        self._reads = _blocks(_wires(coupling.outputs, address_map, False), READ_GAP, READ_LIMIT)
        self._writes = _blocks(_wires(coupling.inputs, address_map, True), 0, WRITE_LIMIT)
        self._sent: dict[_Block, list[int]] = {}
        self._open: AsyncModbusTcpClient | None = None

    async def connect(self) -> None:
        """Connect; raises `FieldLinkError` if the PLC is not there."""
        self.close()
        self._sent.clear()
        # Its own retries and reconnecting are off: the plant decides when to try again.
        client = AsyncModbusTcpClient(self._host, port=self._port, timeout=self._timeout_s,
                                      retries=0, reconnect_delay=0)
        if not await client.connect():
            client.close()
            raise FieldLinkError(f"no Modbus server answers at {self._where}")
        self._open = client

    def close(self) -> None:
        """Close the connection, if there is one."""
        if self._open is not None:
            self._open.close()
            self._open = None

    @property
    def _client(self) -> AsyncModbusTcpClient:
        if self._open is None:
            raise FieldLinkError(f"{self._where}: not connected")
        return self._open

    async def exchange(self, t_ns: int, everything: bool = False) -> None:
        """Read the outputs, bring the plant to an instant, write the inputs that changed.

        The outputs act from the instant of the last step on, as they do in the process.

        Args:
            t_ns: the PLC's time.
            everything: write all inputs, also those that did not change.

        Raises:
            FieldLinkError: the PLC did not answer or refused.
        """
        raw = await self._read_outputs()
        self.coupling.take_outputs(raw)
        self.coupling.advance(t_ns)
        if everything:
            self._sent.clear()
        await self._write_inputs()

    async def publish(self) -> None:
        """Write the inputs as they are, without reading or advancing (before the first scan)."""
        await self._write_inputs()

    async def _read_outputs(self) -> list[int]:
        raw = [0] * len(self.coupling.outputs)
        for block in self._reads:
            request = self._client.read_coils if block.kind.is_bits \
                else self._client.read_holding_registers
            answer = await self._ask(request(block.first, count=block.count,
                                             device_id=self._unit))
            numbers = [int(b) for b in answer.bits] if block.kind.is_bits else answer.registers
            for n, wire in block.wires:
                start = wire.first - block.first
                raw[n] = _joined(numbers[start:start + wire.count])
        return raw

    async def _write_inputs(self) -> None:
        raw = self.coupling.give_inputs()
        for block in self._writes:
            numbers = [v for n, wire in block.wires for v in _split(raw[n], wire.count)]
            if self._sent.get(block) == numbers:
                continue
            if block.kind.is_bits:
                await self._ask(self._client.write_coils(
                    block.first, [bool(v) for v in numbers], device_id=self._unit))
            else:
                await self._ask(self._client.write_registers(
                    block.first, numbers, device_id=self._unit))
            self._sent[block] = numbers

    async def _ask(self, pending: object) -> ModbusPDU:
        try:
            answer: ModbusPDU = await pending  # type: ignore[misc]
        except (ModbusException, OSError, TimeoutError) as problem:
            raise FieldLinkError(f"{self._where}: {problem}") from None
        if answer.isError():
            raise FieldLinkError(f"{self._where}: the PLC refused a request: {answer}")
        return answer


def _wires(wired: Sequence[Point], address_map: AddressMap, writing: bool) -> list[_Wire]:
    wires = []
    for point in wired:
        place = address_map.locate(point.address, writing=writing)
        wires.append(_Wire(point, place.object_type, place.number, place.quantity))
    return wires


def _blocks(wires: list[_Wire], gap: int, limits: dict[bool, int]) -> list[_Block]:
    """Join wires that stand close together into requests."""
    blocks: list[_Block] = []
    order = sorted(enumerate(wires), key=lambda item: (item[1].kind, item[1].first))
    for n, wire in order:
        last = blocks[-1] if blocks else None
        span = wire.first + wire.count - last.first if last else 0
        if last and last.kind is wire.kind and span <= limits[wire.kind.is_bits] \
                and wire.first - (last.first + last.count) <= gap:
            blocks[-1] = _Block(last.kind, last.first, max(span, last.count),
                                (*last.wires, (n, wire)))
        else:
            blocks.append(_Block(wire.kind, wire.first, wire.count, ((n, wire),)))
    return blocks


def _joined(registers: Sequence[int]) -> int:
    """Join registers, high word first."""
    value = 0
    for register in registers:
        value = value << 16 | register
    return value


def _split(raw: int, count: int) -> list[int]:
    return [raw >> 16 * (count - 1 - i) & 0xFFFF for i in range(count)]
