"""The control socket: requests and answers as JSON lines over a Unix socket of the daemon.

Only the user whom the daemon runs as may connect (mode 0600). Every request is an object with
`command`; every answer is one with `ok`, and with `error` if that is false.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import logging
import os
import socket
import stat
import tempfile
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from plcemu.base.errors import PlcemuError
from plcemu.runtime.config import Config

_LOG = logging.getLogger("plcemu.control")

MESSAGE_BYTES = 65_536
"""The longest request, in bytes."""

CLIENTS = 16
"""Connections open at a time."""

PATH_BYTES = 107
"""The longest path that a Unix socket can have."""

Handler = Callable[[dict[str, Any]], Awaitable[dict[str, Any]]]


class ControlError(PlcemuError):
    """The control socket cannot be used: which, and why."""


def socket_path(config: Config) -> Path:
    """Return the socket of a configuration: its `control.socket`, or one in the runtime folder.

    The folder is `$XDG_RUNTIME_DIR/plcemu`, or one of the user's own in the temporary folder; the
    name holds a mark of the configuration's path.

    Raises:
        ControlError: the folder is another user's.
    """
    if config.control.socket is not None:
        return Path(config.control.socket)
    base = os.environ.get("XDG_RUNTIME_DIR", "")
    folder = Path(base) / "plcemu" if base.startswith("/") \
        else Path(tempfile.gettempdir()) / f"plcemu-{os.getuid()}"
    if folder.exists() and folder.stat().st_uid != os.getuid():
        raise ControlError(f"{folder} belongs to another user; choose a socket by control.socket")
    full = config.file_path.resolve()
    return folder / f"{hashlib.blake2b(str(full).encode(), digest_size=8).hexdigest()}.sock"


class ControlServer:
    """Serves the socket in the event loop of the cycle.

    Args:
        path: of the socket.
        handle: makes the answer to a request; a `PlcemuError` becomes an answer with `error`.
    """

    def __init__(self, path: Path, handle: Handler) -> None:
        self.path = path
        self._handle = handle
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.Task[None]] = set()

    async def start(self) -> None:
        """Listen.

        Raises:
            ControlError: another process listens there, or the socket cannot be made.
        """
        try:
            listening = _listen(self.path)
        except OSError as problem:
            raise ControlError(f"control socket {self.path}: {problem.strerror or problem}; "
                               "choose another by control.socket, or set control.enabled=false"
                               ) from None
        self._server = await asyncio.start_unix_server(self._serve, sock=listening,
                                                       limit=MESSAGE_BYTES)
        _LOG.info("control socket %s", self.path)

    async def stop(self) -> None:
        """Close the socket and every connection."""
        if self._server is None:
            return
        self._server.close()
        with contextlib.suppress(OSError):
            self.path.unlink()
        for client in list(self._clients):
            client.cancel()
        await asyncio.gather(*self._clients, return_exceptions=True)
        self._server = None

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._clients.add(task)
        try:
            if len(self._clients) > CLIENTS:
                await _answer(writer, _refusal(f"{CLIENTS} clients are connected already"))
                return
            while await self._serve_one(reader, writer):
                pass
        except (ConnectionError, asyncio.CancelledError):
            pass
        finally:
            self._clients.discard(task)
            writer.close()

    async def _serve_one(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bool:
        try:
            line = await reader.readuntil(b"\n")
        except asyncio.IncompleteReadError:
            return False
        except asyncio.LimitOverrunError:
            await _answer(writer, _refusal(f"a request has at most {MESSAGE_BYTES} bytes"))
            return False
        await _answer(writer, await self._response(line))
        return True

    async def _response(self, line: bytes) -> dict[str, Any]:
        try:
            request = json.loads(line)
        except (ValueError, RecursionError) as problem:
            return _refusal(f"the request is no JSON: {problem}")
        if not isinstance(request, dict):
            return _refusal("the request is no JSON object with a command")
        try:
            return {"ok": True, **await self._handle(request)}
        except PlcemuError as problem:
            return _refusal(str(problem))


def _refusal(why: str) -> dict[str, Any]:
    return {"ok": False, "error": why}


async def _answer(writer: asyncio.StreamWriter, document: dict[str, Any]) -> None:
    writer.write(json.dumps(document, default=str).encode() + b"\n")
    await writer.drain()


def _listen(path: Path) -> socket.socket:
    """Return a listening socket; one that a dead process left is removed."""
    check_length(path)
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    if path.exists():
        if not stat.S_ISSOCK(path.stat().st_mode):
            raise OSError(17, "there is a file of that name that is no socket")
        if _answers(path):
            raise OSError(98, "another process listens there")
        path.unlink()
    made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    before = os.umask(0o177)
    try:
        made.bind(str(path))
    except OSError:
        made.close()
        raise
    finally:
        os.umask(before)
    return made


def check_length(path: Path) -> None:
    """Raise `OSError` if a path is too long for a socket."""
    if len(os.fsencode(path)) > PATH_BYTES:
        raise OSError(36, f"the path is longer than {PATH_BYTES} bytes")


def _answers(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(1)
        try:
            probe.connect(str(path))
        except OSError:
            return False
        return True


def ask(path: Path, request: dict[str, Any], patience_s: float = 30.0) -> dict[str, Any]:
    """Send one request to a daemon and return its answer.

    Raises:
        ControlError: nobody listens, or there is no answer in time.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(patience_s)
        try:
            check_length(path)
            client.connect(str(path))
        except OSError as problem:
            raise ControlError(
                f"no PLC of this configuration listens at {path} ({problem.strerror or problem}); "
                "start one by `plcemu run`, or name its socket by --socket") from None
        try:
            client.sendall(json.dumps(request).encode() + b"\n")
            with client.makefile("rb") as answers:
                line = answers.readline()
        except TimeoutError:
            raise ControlError(f"the PLC at {path} has not answered within {patience_s:g} s"
                               ) from None
        except OSError as problem:
            raise ControlError(f"the PLC at {path} went away: {problem.strerror}") from None
    if not line:
        raise ControlError(f"the PLC at {path} ended without an answer")
    answer: dict[str, Any] = json.loads(line)
    return answer
