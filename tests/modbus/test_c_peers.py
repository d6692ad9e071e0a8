"""Peers written in C, with libraries of their own: libmodbus and mbpoll."""

from __future__ import annotations

import asyncio
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from plcemu.io.exchange import Exchange
from plcemu.modbus import ModbusTcpServer

Serve = Callable[..., Any]
SOURCE = Path(__file__).with_name("libmodbus_peer.c")


async def output_of(*command: str) -> str:
    process = await asyncio.create_subprocess_exec(
        *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT)
    output, _ = await process.communicate()
    assert process.returncode == 0, output.decode()
    return output.decode()


def value_lines(output: str) -> list[str]:
    """Return mbpoll's lines of results, such as `[5]: 1`, without blanks."""
    return ["".join(line.split()) for line in output.splitlines() if line.startswith("[")]


@pytest.fixture
def libmodbus_peer(need_tool: Callable[[str], str], tmp_path: Path) -> str:
    """The path of the compiled client."""
    compiler, pkg_config = need_tool("gcc"), need_tool("pkg-config")
    need_tool("mbpoll")  # comes with libmodbus; one without the other is a broken set-up
    flags = subprocess.run([pkg_config, "--cflags", "--libs", "libmodbus"],
                           capture_output=True, text=True, check=True).stdout.split()
    program = tmp_path / "peer"
    subprocess.run([compiler, "-Wall", "-Werror", str(SOURCE), "-o", str(program), *flags],
                   check=True)
    return str(program)


@pytest.fixture
def inputs(exchange: Exchange) -> None:
    """Set the inputs that the clients read."""
    field = exchange.port("field")
    field.write("IX", 0, bytes.fromhex("f003"))
    field.write("IW", 0, bytes.fromhex("dead beef"))
    exchange.update_inputs()


@pytest.mark.usefixtures("inputs")
def test_libmodbus_understands_every_function_code_it_has(serve: Serve,
                                                          libmodbus_peer: str) -> None:
    async def scenario(server: ModbusTcpServer) -> str:
        return await output_of(libmodbus_peer, str(server.port))
    assert serve(scenario).splitlines() == [
        "write_bit 1",
        "write_bits 11",
        "read_bits 17 0 0 1 0 0 1 0 1 1 0 0 1 0 1 1 1 0",
        "read_input_bits 9 0 1 1 1 1 1 1 0 0",
        "write_register 1",
        "mask_write 1",
        "write_registers 3",
        "read_registers 4 0017 1111 2222 3333",
        "read_input_registers 2 dead beef",
        "write_and_read 4 0017 1111 1111 2222",
        "largest 2000 125",
        "unmapped -1 Illegal data address",
    ]


@pytest.mark.usefixtures("inputs")
def test_mbpoll_writes_and_reads_all_four_tables(serve: Serve, exchange: Exchange,
                                                 need_tool: Callable[[str], str]) -> None:
    mbpoll = need_tool("mbpoll")

    async def scenario(server: ModbusTcpServer) -> list[list[str]]:
        async def poll(*options: str, values: tuple[str, ...] = ()) -> list[str]:
            output = await output_of(mbpoll, "-0", "-1", "-p", str(server.port), *options,
                                     server.host, *values)
            exchange.update_inputs()
            return value_lines(output)
        await poll("-t", "0", "-r", "6", values=("1", "0", "1"))
        await poll("-t", "4", "-r", "1023", values=("258", "772"))
        await poll("-t", "4:int", "-B", "-r", "2048", values=("305419896",))
        return [await poll("-t", "0", "-r", "5", "-c", "4"),
                await poll("-t", "1", "-r", "3", "-c", "2"),
                await poll("-t", "3:hex", "-r", "0", "-c", "2"),
                await poll("-t", "4", "-r", "1023", "-c", "2")]
    assert serve(scenario) == [["[5]:0", "[6]:1", "[7]:0", "[8]:1"], ["[3]:0", "[4]:1"],
                               ["[0]:0xDEAD", "[1]:0xBEEF"], ["[1023]:258", "[1024]:772"]]
    assert exchange.published("MD", 0, 4) == (305419896).to_bytes(4, "big")
