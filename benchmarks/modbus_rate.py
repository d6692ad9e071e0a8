"""Requests a second and CPU time a request of our Modbus server beside pymodbus's, in one run.

Each server runs in a process of its own on the loopback and is asked the same number of requests,
each client waiting for its answer before it asks again. The ratios are what counts: both servers
see the same machine, the rounds alternate between them, and the median round is taken. CPU time is
the server process's own (`time.process_time_ns`), without its start.

    python benchmarks/modbus_rate.py [--requests N] [--rounds N]
"""

from __future__ import annotations

import argparse
import asyncio
import os
import socket
import statistics
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

SERVERS = ("plcemu", "pymodbus")
SHAPES = {
    "read 125 holding registers": bytes.fromhex("03 0000 007d"),
    "read 2000 coils": bytes.fromhex("01 0000 07d0"),
    "write 123 registers": bytes.fromhex("10 0000 007b f6") + bytes(246),
    "read 1 holding register": bytes.fromhex("03 0000 0001"),
}
CLIENTS = (1, 8)
SCAN_S = 0.01
"""The period at which waiting writes are latched, as a scan does."""


class Result(NamedTuple):
    """One round: requests per second, and microseconds of CPU per request."""

    rate_hz: float
    cpu_us: float


async def serve_plcemu() -> None:
    """Serve the default map, latching writes once a scan."""
    from plcemu.io.exchange import Exchange
    from plcemu.modbus import AddressMap, Identity, ModbusTcpServer

    exchange = Exchange(bytearray())
    server = ModbusTcpServer(exchange, AddressMap(), Identity(), port=0)
    await server.start()

    async def scan() -> None:
        while True:
            await asyncio.sleep(SCAN_S)
            exchange.update_inputs()
            server.new_scan()

    scans = asyncio.create_task(scan())
    await report(server.port)
    scans.cancel()
    await server.stop()


async def serve_pymodbus() -> None:
    """Serve the same numbers from pymodbus's data store."""
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice

    bits = SimData(0, count=8192, values=False, datatype=DataType.BITS)
    words = SimData(0, count=1024, values=0, datatype=DataType.REGISTERS)
    device = SimDevice(1, simdata=([bits], [bits], [words], [words]))
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    server = ModbusTcpServer(device, address=("127.0.0.1", port))
    await server.serve_forever(background=True)
    await report(port)
    await server.shutdown()  # type: ignore[no-untyped-call]


async def report(port: int) -> None:
    """Tell the port, then the CPU time used for every line read, until the end of input."""
    print(port, flush=True)
    while await asyncio.to_thread(sys.stdin.readline):
        print(time.process_time_ns(), flush=True)


class Server:
    """A server in a process of its own."""

    def __init__(self, name: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--serve", name], text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.port = self._line()

    def _line(self) -> int:
        assert self._process.stdout is not None
        return int(self._process.stdout.readline())

    def cpu_ns(self) -> int:
        """Return the CPU time used so far."""
        assert self._process.stdin is not None
        print(file=self._process.stdin, flush=True)
        return self._line()

    def stop(self) -> None:
        """End it by the end of its input."""
        self._process.communicate(timeout=30)


def receive(peer: socket.socket) -> bytes:
    """Return the next response PDU."""
    data = b""
    while len(data) < 6 or len(data) < 6 + struct.unpack_from(">H", data, 4)[0]:
        chunk = peer.recv(512)
        if not chunk:
            raise ConnectionError("the server closed the connection")
        data += chunk
    return data[7:]


def ask(port: int, pdu: bytes, clients: int, requests: int) -> float:
    """Ask so many requests over so many connections; return the seconds it took."""
    frame = struct.pack(">HHHB", 1, 0, len(pdu) + 1, 1) + pdu
    peers = [socket.create_connection(("127.0.0.1", port), timeout=30) for _ in range(clients)]
    for peer in peers:
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    start = time.perf_counter()
    for _ in range(requests // clients):
        for peer in peers:
            peer.sendall(frame)
        for peer in peers:
            if receive(peer)[0] != pdu[0]:
                raise ValueError("the server refused the request")
    took_s = time.perf_counter() - start
    for peer in peers:
        peer.close()
    return took_s


def measure(server: Server, pdu: bytes, clients: int, requests: int) -> Result:
    """Return one round."""
    before_ns = server.cpu_ns()
    took_s = ask(server.port, pdu, clients, requests)
    return Result(requests / took_s, (server.cpu_ns() - before_ns) / requests / 1000)


def median(rounds: list[Result]) -> Result:
    """Return the median rate and the median CPU time."""
    return Result(statistics.median(r.rate_hz for r in rounds),
                  statistics.median(r.cpu_us for r in rounds))


def compare(requests: int, rounds: int) -> None:
    """Print a line for each shape and number of clients."""
    servers = {name: Server(name) for name in SERVERS}
    print(f"{'':28}{'clients':>8}{'req/s':>16}{'CPU µs/req':>18}"
          f"{'rate ratio':>12}{'CPU ratio':>11}")
    try:
        for shape, pdu in SHAPES.items():
            for clients in CLIENTS:
                results: dict[str, list[Result]] = {name: [] for name in SERVERS}
                for _ in range(rounds):
                    for name, server in servers.items():
                        results[name].append(measure(server, pdu, clients, requests))
                ours, theirs = (median(results[name]) for name in SERVERS)
                print(f"{shape:28}{clients:>8}{ours.rate_hz:>8.0f}{theirs.rate_hz:>8.0f}"
                      f"{ours.cpu_us:>9.0f}{theirs.cpu_us:>9.0f}"
                      f"{ours.rate_hz / theirs.rate_hz:>12.1f}{theirs.cpu_us / ours.cpu_us:>11.1f}")
    finally:
        for server in servers.values():
            server.stop()
    print(f"ours, then pymodbus's; median of {rounds} rounds of {requests} requests; "
          f"{os.cpu_count()} CPUs, Python {sys.version.split()[0]}")


SERVE: dict[str, Callable[[], object]] = {
    "plcemu": lambda: asyncio.run(serve_plcemu()),
    "pymodbus": lambda: asyncio.run(serve_pymodbus()),
}


def main() -> None:
    """Read the arguments and compare, or be one of the servers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--requests", type=int, default=2000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--serve", choices=SERVERS, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        SERVE[arguments.serve]()
    else:
        compare(arguments.requests, arguments.rounds)


if __name__ == "__main__":
    main()
