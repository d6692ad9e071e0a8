"""Commands in processes of their own, with their output as it comes."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

PATIENCE_S = 30.0
"""What takes longer than this has failed."""


class Command:
    """A running `plcemu` command; as a context manager it never outlives its block."""

    BEGIN: tuple[str, ...] = ("-m", "plcemu")

    def __init__(self, *arguments: object, **environment: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, *self.BEGIN, *map(str, arguments)], text=True, errors="replace",
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, **environment})
        self.log: list[str] = []
        self._out: list[str] = []
        self._readers = [threading.Thread(target=_gather, args=pair) for pair in (
            (self._process.stderr, self.log), (self._process.stdout, self._out))]
        for reader in self._readers:
            reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._process.kill()
        self._end()

    def _end(self) -> None:
        self._process.wait(PATIENCE_S)
        for reader in self._readers:
            reader.join(PATIENCE_S)

    @property
    def text(self) -> str:
        """All log lines so far."""
        return "".join(self.log)

    @property
    def pid(self) -> int:
        """Its process identifier."""
        return self._process.pid

    @property
    def is_running(self) -> bool:
        """Whether the process lives."""
        return self._process.poll() is None

    def wait_for(self, pattern: str) -> re.Match[str]:
        """Return the first match of a pattern in the log; wait until there is one."""
        until(lambda: re.search(pattern, self.text) or not self.is_running,
              f"{pattern!r} in the log")
        match = re.search(pattern, self.text)
        assert match is not None, f"the process ended with:\n{self.text}"
        return match

    @property
    def port(self) -> int:
        """The port that it listens at."""
        return int(self.wait_for(r"listening on \S+:(\d+)")[1])

    def kill(self) -> None:
        """End it without notice."""
        self._process.kill()
        self._end()

    def send(self, number: signal.Signals) -> None:
        """Send a signal."""
        self._process.send_signal(number)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> tuple[int, Any]:
        """Send a signal, and return the exit code and the JSON document on stdout."""
        self._process.send_signal(number)
        return self.result()

    def code(self) -> int:
        """Wait for the end and return the exit code."""
        self._end()
        return self._process.returncode

    def result(self) -> tuple[int, Any]:
        """Wait for the end; return the exit code and the JSON document on stdout, if any."""
        self._end()
        out = "".join(self._out)
        return self._process.returncode, json.loads(out) if out else None


class Python(Command):
    """A running Python program: a script or `-m module` with its arguments."""

    BEGIN = ()


def _gather(stream: Iterator[str], lines: list[str]) -> None:
    for line in stream:
        lines.append(line)
    stream.close()  # type: ignore[attr-defined]


def until(condition: Callable[[], Any], what: str) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, f"not within {PATIENCE_S:g} s: {what}"
        time.sleep(0.02)


@contextmanager
def modbus_client(port: int) -> Iterator[Any]:
    """Give a pymodbus client of a server on the loopback."""
    from pymodbus.client import ModbusTcpClient

    client = ModbusTcpClient("127.0.0.1", port=port, timeout=5, retries=0)
    assert client.connect()
    try:
        yield client
    finally:
        client.close()
