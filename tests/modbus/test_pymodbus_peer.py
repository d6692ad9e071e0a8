"""pymodbus's client as an independent peer: every function code over the loopback."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from pymodbus.client import AsyncModbusTcpClient
from pymodbus.pdu import ModbusPDU

from plcemu.io.exchange import Exchange
from plcemu.modbus import ModbusTcpServer

Serve = Callable[..., Any]
Talk = Callable[[AsyncModbusTcpClient], Coroutine[Any, Any, Any]]


@pytest.fixture
def talk(serve: Serve) -> Callable[[Talk], Any]:
    """Run a conversation of pymodbus's client with a server."""
    def run(conversation: Talk) -> Any:
        async def scenario(server: ModbusTcpServer) -> Any:
            client = AsyncModbusTcpClient(server.host, port=server.port, retries=0)
            assert await client.connect()
            try:
                return await conversation(client)
            finally:
                client.close()
        return serve(scenario)
    return run


@pytest.fixture
def image(exchange: Exchange) -> Exchange:
    """An exchange whose inputs are set."""
    field = exchange.port("field")
    field.write("IX", 0, bytes.fromhex("55aa"))
    field.write("IW", 0, bytes.fromhex("0001 0203 fffe"))
    exchange.update_inputs()
    return exchange


def test_coils_written_one_by_one_and_together_are_read_back(talk: Any) -> None:
    async def conversation(client: AsyncModbusTcpClient) -> list[bool]:
        await client.write_coil(3, True)
        await client.write_coils(5, [True, False, True, True, True, False, False, True, True])
        await client.write_coil(6, True)
        await client.write_coil(7, False)
        return (await client.read_coils(2, count=13)).bits[:13]
    coils = {n for n, is_on in enumerate(talk(conversation), 2) if is_on}
    assert coils == {3, 5, 6, 8, 9, 12, 13}


def test_discrete_inputs_are_read(talk: Any, image: Exchange) -> None:
    async def conversation(client: AsyncModbusTcpClient) -> list[bool]:
        return (await client.read_discrete_inputs(6, count=4)).bits[:4]
    assert talk(conversation) == [True, False, False, True]


def test_input_registers_are_read(talk: Any, image: Exchange) -> None:
    async def conversation(client: AsyncModbusTcpClient) -> list[int]:
        return (await client.read_input_registers(0, count=3)).registers
    assert talk(conversation) == [0x0001, 0x0203, 0xFFFE]


def test_registers_written_one_by_one_and_together_are_read_back(talk: Any) -> None:
    async def conversation(client: AsyncModbusTcpClient) -> list[int]:
        await client.write_register(1022, 1)
        await client.write_registers(1023, [2, 3, 65535])
        return (await client.read_holding_registers(1022, count=4)).registers
    assert talk(conversation) == [1, 2, 3, 65535]


def test_a_register_is_written_by_masks(talk: Any) -> None:
    async def conversation(client: AsyncModbusTcpClient) -> list[int]:
        await client.write_register(4, 0x12)
        await client.mask_write_register(address=4, and_mask=0xF2, or_mask=0x25)
        return (await client.read_holding_registers(4)).registers
    assert talk(conversation) == [0x17]


def test_registers_are_written_and_read_in_one_request(talk: Any) -> None:
    async def conversation(client: AsyncModbusTcpClient) -> list[int]:
        return (await client.readwrite_registers(
            read_address=0, read_count=4, write_address=1, values=[7, 8])).registers
    assert talk(conversation) == [0, 7, 8, 0]


def test_the_identity_is_read(talk: Any) -> None:
    async def conversation(client: AsyncModbusTcpClient) -> dict[int, bytes]:
        return (await client.read_device_information(read_code=2)).information
    assert talk(conversation) == {0: b"Example", 1: b"PLC-1", 2: b"2.0", 4: b"Emulator", 6: b"tank"}


def test_a_plant_writes_its_sensors_through_the_field_window(talk: Any, exchange: Exchange) -> None:
    async def conversation(client: AsyncModbusTcpClient) -> None:
        await client.write_coils(16384 + 3, [True] * 10)
        await client.write_registers(16384 + 2, [0x1234])
    talk(conversation)
    exchange.update_inputs()
    assert exchange.published("IX", 0, 2) == bytes.fromhex("f81f")
    assert exchange.published("IW", 0, 6) == bytes.fromhex("0000 0000 1234")
    assert all(name.startswith("modbus 127.0.0.1:") for name in exchange.writers)


def test_refusals_come_with_their_function_and_exception_codes(talk: Any) -> None:
    async def conversation(client: AsyncModbusTcpClient) -> list[ModbusPDU]:
        return [await client.read_coils(40000), await client.write_register(9000, 1),
                await client.read_holding_registers(65535)]
    answers = talk(conversation)
    assert [(a.function_code, a.exception_code) for a in answers] == [
        (0x81, 2), (0x86, 2), (0x83, 2)]


def test_sixteen_clients_are_served_side_by_side(serve: Serve) -> None:
    async def one(server: ModbusTcpServer, number: int) -> list[int]:
        client = AsyncModbusTcpClient(server.host, port=server.port, retries=0)
        assert await client.connect()
        for value in range(20):
            await client.write_register(number, value + number)
        registers = (await client.read_holding_registers(number)).registers
        client.close()
        return registers

    async def scenario(server: ModbusTcpServer) -> list[list[int]]:
        return await asyncio.gather(*(one(server, n) for n in range(16)))
    assert serve(scenario) == [[19 + n] for n in range(16)]
