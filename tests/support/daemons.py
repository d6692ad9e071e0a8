"""Daemons forked from a warm process, so that hundreds of them can live and die in a test."""

from __future__ import annotations

import multiprocessing
import os
import signal
import socket
import struct
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from pathlib import Path

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(["plcemu.cli.run", "plcemu.runtime.daemon"])


def run(arguments: list[str], log: Path) -> None:
    """Be `plcemu run`, with the log in a file."""
    stream = log.open("a", encoding="utf-8")
    os.dup2(stream.fileno(), sys.stderr.fileno())
    os.dup2(stream.fileno(), sys.stdout.fileno())
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from plcemu.cli.main import main

    sys.exit(main(["run", *arguments]))


@contextmanager
def forked(arguments: list[str], log: Path) -> Iterator[BaseProcess]:
    """Give a daemon that is dead at the end of the block."""
    daemon = _CONTEXT.Process(target=run, args=(arguments, log))
    daemon.start()
    try:
        yield daemon
    finally:
        daemon.kill()
        daemon.join()
        daemon.close()


def free_port() -> int:
    """Return a port that nobody listens at."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port: int = taken.getsockname()[1]
        return port


class Registers:
    """A Modbus client of a few lines, which fails with `OSError` when the server dies."""

    def __init__(self, port: int, alive_until_s: float) -> None:
        while True:
            try:
                self._socket = socket.create_connection(("127.0.0.1", port), timeout=10)
                return
            except ConnectionRefusedError:
                if time.monotonic() > alive_until_s:
                    raise
                time.sleep(0.005)

    def __enter__(self) -> Registers:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def read_long(self, register: int) -> int:
        """Return the 64-bit value in four holding registers."""
        return int.from_bytes(self._ask(struct.pack(">BHH", 3, register, 4))[2:], "big")

    def write_long(self, register: int, value: int) -> None:
        """Write a 64-bit value into four holding registers."""
        self._ask(struct.pack(">BHHBQ", 16, register, 4, 8, value))

    def _ask(self, pdu: bytes) -> bytes:
        self._socket.sendall(struct.pack(">HHHB", 1, 0, len(pdu) + 1, 1) + pdu)
        head = self._receive(7)
        return self._receive(struct.unpack(">HHHB", head)[2] - 1)

    def _receive(self, n: int) -> bytes:
        data = b""
        while len(data) < n:
            part = self._socket.recv(n - len(data))
            if not part:
                raise ConnectionResetError("the server went away")
            data += part
        return data
