"""A plant behind Modbus TCP: the coupling worked as a client of any PLC.

One step reads the outputs, advances the plant and writes the inputs, as the coupling in the process
does. Nothing is replayed after an outage: only the present state is sent.
"""

from __future__ import annotations

from collections.abc import Awaitable, Sequence
from dataclasses import dataclass

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from hil.coupling import Coupling
from plcemu.base.errors import PlcemuError
from plcemu.io.mapping import Point
from plcemu.modbus import RUN_OBJECT, AddressMap, ObjectType
from plcemu.modbus.errors import ExceptionCode

READ_GAP = 16
"""Numbers between two wanted ones that a single read request may span."""

READ_LIMIT = {True: 2000, False: 125}
WRITE_LIMIT = {True: 1968, False: 123}
"""Bits (True) and registers (False) in one request (Modbus application protocol, section 6)."""


_READ = {ObjectType.COIL: "read_coils", ObjectType.DISCRETE: "read_discrete_inputs",
         ObjectType.HOLDING: "read_holding_registers", ObjectType.INPUT: "read_input_registers"}
"""The client's method for each table."""

_EXCEPTIONS = {code.value: code.name.replace("_", " ").lower() for code in ExceptionCode}


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

    def __str__(self) -> str:
        what = "" if self.kind.is_bits else " registers"
        return f"{self.kind}{what} {self.first} to {self.first + self.count - 1}"


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
        self._sent: dict[int, list[int]] = {}
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

    async def run_id(self) -> str:
        """Return what the PLC shows of its present run, or an empty text if it shows nothing.

        Raises:
            FieldLinkError: the PLC did not answer.
        """
        try:
            answer = await self._client.read_device_information(
                read_code=4, object_id=RUN_OBJECT, device_id=self._unit)
        except (ModbusException, OSError) as problem:
            raise FieldLinkError(f"{self._where}: {problem}") from None
        if answer.isError():
            return ""
        shown = getattr(answer, "information", {}).get(RUN_OBJECT, b"")
        return shown.decode("ascii", "replace") if isinstance(shown, bytes) else ""

    def close(self) -> None:
        """Close the connection, if there is one."""
        if self._open is not None:
            self._open.close()
            self._open = None

    @property
    def _client(self) -> AsyncModbusTcpClient:
        # The client itself would wait for an answer that cannot come.
        if self._open is None or not self._open.connected:
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

    async def _read_outputs(self) -> list[int]:
        raw = [0] * len(self.coupling.outputs)
        for block in self._reads:
            request = getattr(self._client, _READ[block.kind])
            answer = await self._ask(request(block.first, count=block.count,
                                             device_id=self._unit), f"reading {block}")
            numbers = [int(b) for b in answer.bits] if block.kind.is_bits else answer.registers
            if len(numbers) < block.count:
                raise FieldLinkError(f"{self._where}: reading {block}: the answer is too short")
            for n, wire in block.wires:
                start = wire.first - block.first
                raw[n] = _joined(numbers[start:start + wire.count])
        return raw

    async def _write_inputs(self) -> None:
        raw = self.coupling.give_inputs()
        for at, block in enumerate(self._writes):
            numbers = [v for n, wire in block.wires for v in _split(raw[n], wire.count)]
            if self._sent.get(at) == numbers:
                continue
            # A request that fails may have been executed: what the PLC holds is not known.
            self._sent.pop(at, None)
            pending = self._client.write_coils(
                block.first, [bool(v) for v in numbers], device_id=self._unit) \
                if block.kind.is_bits else \
                self._client.write_registers(block.first, numbers, device_id=self._unit)
            await self._ask(pending, f"writing {block}")
            self._sent[at] = numbers

    async def _ask(self, pending: Awaitable[ModbusPDU], what: str) -> ModbusPDU:
        try:
            answer = await pending
        except (ModbusException, OSError) as problem:
            raise FieldLinkError(f"{self._where}: {what}: {problem}") from None
        if answer.isError():
            code = getattr(answer, "exception_code", 0)
            name = _EXCEPTIONS.get(code, "unknown")
            raise FieldLinkError(f"{self._where}: {what}: unit {self._unit} refused with exception "
                                 f"{code} ({name})")
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
