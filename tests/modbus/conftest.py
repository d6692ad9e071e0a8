"""Fixtures of the Modbus tests: a unit without sockets, a server on the loopback, a raw peer."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
import tools

from plcemu.io.exchange import Exchange
from plcemu.modbus import AddressMap, Identity, ModbusTcpServer, Unit
from plcemu.modbus.connection import Connection

SCENARIO_S = 30.0
"""A scenario that takes longer hangs."""

IDENTITY = Identity(vendor="Example", product_code="PLC-1", revision="2.0",
                    product_name="Emulator", application_name="tank")

Scenario = Callable[[ModbusTcpServer], Awaitable[Any]]


def frame(pdu: bytes, transaction: int = 1, unit: int = 1) -> bytes:
    """Return a request ADU, written out here without the code under test."""
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu


class RawPeer:
    """A TCP client that sends any bytes."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    @classmethod
    async def connect(cls, server: ModbusTcpServer) -> RawPeer:
        return cls(*await asyncio.open_connection(server.host, server.port))

    async def send(self, data: bytes) -> None:
        self._writer.write(data)
        await self._writer.drain()

    async def receive(self) -> tuple[int, int, bytes]:
        """Return transaction, unit and PDU of the next answer."""
        transaction, _, length, unit = struct.unpack(">HHHB", await self._reader.readexactly(7))
        return transaction, unit, await self._reader.readexactly(length - 1)

    async def ask(self, pdu: bytes, *, unit: int = 1) -> bytes:
        await self.send(frame(pdu, unit=unit))
        return (await self.receive())[2]

    async def read_to_end(self) -> bytes:
        """Return what comes until the server ends the connection, orderly or not."""
        received = b""
        try:
            while chunk := await self._reader.read(65536):
                received += chunk
        except ConnectionResetError:
            pass
        return received

    async def close(self) -> None:
        self._writer.close()
        await asyncio.gather(self._writer.wait_closed(), return_exceptions=True)


class FakeTransport(asyncio.Transport):
    """Records what a connection does with it."""

    def __init__(self) -> None:
        super().__init__({"peername": ("192.0.2.1", 40000)})
        self.written = b""
        self.is_paused = False
        self._is_closing = False

    def write(self, data: Any) -> None:
        self.written += data

    def pause_reading(self) -> None:
        self.is_paused = True

    def resume_reading(self) -> None:
        self.is_paused = False

    def is_closing(self) -> bool:
        return self._is_closing

    def close(self) -> None:
        self._is_closing = True

    abort = close

    @property
    def transactions(self) -> list[int]:
        """The transaction identifiers of the answers, all of them to Read Coils of one coil."""
        answer_bytes = 7 + 3
        starts = range(0, len(self.written), answer_bytes)
        return [int.from_bytes(self.written[i:i + 2], "big") for i in starts]


class FakeConnection:
    """A connection of a running server over a fake transport, driven by hand."""

    def __init__(self, server: ModbusTcpServer) -> None:
        self.transport = FakeTransport()
        self.protocol = Connection(server, asyncio.get_running_loop())
        self.protocol.connection_made(self.transport)

    def receive_requests(self, *transactions: int) -> None:
        """Let requests to read one coil arrive in one piece."""
        pdu = bytes.fromhex("01 0000 0001")
        self.protocol.data_received(b"".join(frame(pdu, t) for t in transactions))

    def lose(self) -> None:
        self.protocol.connection_lost(None)


@pytest.fixture
def exchange() -> Exchange:
    return Exchange(bytearray())


@pytest.fixture
def unit(exchange: Exchange) -> Unit:
    return Unit(AddressMap(), exchange.port("test"), IDENTITY)


@pytest.fixture
def raw_peer() -> type[RawPeer]:
    return RawPeer


@pytest.fixture
def fake_connection() -> type[FakeConnection]:
    return FakeConnection


@pytest.fixture
def framed() -> Callable[..., bytes]:
    return frame


@pytest.fixture
def serve(exchange: Exchange) -> Callable[..., Any]:
    """Run a scenario beside a server on a free port of the loopback."""
    def run(scenario: Scenario, **settings: Any) -> Any:
        async def main() -> Any:
            server = ModbusTcpServer(exchange, settings.pop("address_map", AddressMap()),
                                     settings.pop("identity", IDENTITY), port=0, **settings)
            await server.start()
            try:
                async with asyncio.timeout(SCENARIO_S):
                    return await scenario(server)
            finally:
                await server.stop()
        return asyncio.run(main())
    return run


@pytest.fixture
def need_tool() -> Callable[[str], str]:
    """Return a function that finds a program; without it the test is skipped, in CI it fails."""
    return tools.need_tool
