"""The Modbus TCP server, in the event loop of the scan cycle (messaging guide, section 4)."""

from __future__ import annotations

import asyncio
import errno
import logging
import time
from collections import deque
from collections.abc import Callable, Container

from plcemu.io.exchange import Exchange
from plcemu.modbus.connection import Connection, Settings
from plcemu.modbus.errors import ListenError
from plcemu.modbus.identity import Identity
from plcemu.modbus.map import AddressMap
from plcemu.modbus.throttle import Throttle, logger
from plcemu.modbus.unit import Unit

COUNTERS = (
    "requests", "exceptions", "unknown_units", "protocol_errors", "bytes_received", "bytes_sent",
    "connections_accepted", "connections_open", "connections_refused",
    "closed_by_peer", "closed_by_server", "closed_for_idleness", "closed_for_newcomer",
    "closed_for_protocol_error",
)
"""What is counted from the construction of a server on; `connections_open` is the number now."""

LEAST_REQUESTS = 8
"""Requests served after a scan that left no time for any: a PLC that needs all its time for the
scan must still be heard."""

_HINTS = {
    errno.EADDRINUSE: "address already in use; another plcemu runs, or choose modbus.port",
    errno.EACCES: "permission denied; ports below 1024 need rights, or choose modbus.port",
    errno.EADDRNOTAVAIL: "not an address of this machine; choose modbus.host",
}


class ModbusTcpServer:
    """Serves the process image to any number of clients, each with a port of its own.

    A connection is refused when `max_connections` are open and all of them are in use. If some have
    been silent for `gives_way_after_s`, the longest silent is closed for the newcomer instead, so
    that clients which vanished without closing cannot lock out the others.

    Args:
        exchange: the door to the process image.
        address_map: which number is which address.
        identity: what function code 43/14 tells.
        host: address or name to listen at.
        port: TCP port; 0 for any free one.
        units: unit identifiers that are answered; None for every one.
        is_silent_for_unknown_units: give no answer instead of exception 0x0B.
        max_connections: connections open at a time.
        idle_timeout_s: close a connection without a complete request for so long; None for never.
        gives_way_after_s: silence after which a connection may be closed for a newcomer.
        requests_per_turn: requests of one connection answered in one turn of the loop.
        budget: requests served between two scans (`new_scan`); None for no bound.
        clock: tells the time for `new_scan`, in s; that of the event loop.
    """

    def __init__(self, exchange: Exchange, address_map: AddressMap, identity: Identity, *,
                 host: str = "127.0.0.1", port: int = 5020,
                 units: Container[int] | None = None, is_silent_for_unknown_units: bool = False,
                 max_connections: int = 64, idle_timeout_s: float | None = 60.0,
                 gives_way_after_s: float = 5.0, requests_per_turn: int = 32,
                 budget: int | None = None,
                 clock: Callable[[], float] = time.monotonic) -> None:
        self.settings = Settings(units, is_silent_for_unknown_units, idle_timeout_s,
                                 requests_per_turn)
        self.host = host
        self.budget = budget
        """Requests served between two scans; a change counts from the next `new_scan` on."""
        self.counters: dict[str, int] = dict.fromkeys(COUNTERS, 0)
        self.throttle = Throttle()
        self._exchange, self._map, self._identity = exchange, address_map, identity
        self._port = port
        self._max_connections = max_connections
        self._gives_way_after_s = gives_way_after_s
        self._budget_left = budget
        self._clock = clock
        self._until_s: float | None = None
        self._spare = 0
        self._alive: set[Connection] = set()
        self._connections: set[Connection] = set()
        """Those of `_alive` that hold one of the `max_connections` places."""
        self._queue: deque[Connection] = deque()
        self._turn_due: asyncio.Handle | None = None
        self._server: asyncio.Server | None = None
        self._loop: asyncio.AbstractEventLoop

    @property
    def port(self) -> int:
        """The port listened at; before the start the one asked for."""
        return self._port

    async def start(self) -> None:
        """Listen.

        Raises:
            ListenError: the address is taken, not allowed or not of this machine.
        """
        self._loop = asyncio.get_running_loop()
        try:
            self._server = await self._loop.create_server(
                lambda: Connection(self, self._loop), self.host, self._port)
        except OSError as error:
            why = _HINTS.get(error.errno or 0) or error.strerror or str(error)
            raise ListenError(f"cannot listen on {self.host}:{self._port}: {why}") from error
        self._port = self._server.sockets[0].getsockname()[1]
        logger.info("listening on %s:%d", self.host, self._port)

    async def stop(self) -> None:
        """Stop listening and end every connection; when it returns, no socket is open."""
        if self._server is None:
            return
        server, self._server = self._server, None
        server.close()
        if self._turn_due is not None:
            self._turn_due.cancel()
            self._turn_due = None
        self._queue.clear()
        for connection in self._alive:
            connection.close("closed_by_server", at_once=True)
        await asyncio.gather(*(c.closed for c in self._alive))
        await server.wait_closed()
        logger.info("stopped listening on %s:%d", self.host, self._port)

    def new_scan(self, until_s: float | None = None) -> None:
        """Start the budget anew; the cycle calls it once a scan. It serves nothing itself.

        Args:
            until_s: the time, by the server's clock, from which on requests wait for the next
                scan; if it has passed already, `LEAST_REQUESTS` are served. None for no bound.
        """
        self._budget_left = self.budget
        self._until_s = until_s
        self._spare = LEAST_REQUESTS if until_s is not None and self._clock() >= until_s else 0
        self._plan_turn()

    def opened(self, connection: Connection) -> Unit | None:
        """Take a connection in and return its unit, or None to refuse it."""
        self.counters["connections_accepted"] += 1
        self._alive.add(connection)
        if self._server is None:  # accepted in the very turn in which the server was stopped
            return None
        if len(self._connections) >= self._max_connections and not self._make_room(connection):
            self.throttle.log(logging.WARNING, "refused", f"refused {connection.peer}: "
                              f"modbus.max_connections ({self._max_connections}) are in use")
            return None
        self._connections.add(connection)
        self.counters["connections_open"] = len(self._connections)
        self.throttle.log(logging.INFO, "opened", f"{connection.peer} connected")
        return Unit(self._map, self._exchange.port(f"modbus {connection.peer}"), self._identity,
                    counters=self.counters, throttle=self.throttle)

    def _make_room(self, newcomer: Connection) -> bool:
        """Close the longest silent connection, if it has been silent for long enough."""
        silent = min(self._connections, key=lambda c: c.last_request_s)
        if newcomer.last_request_s - silent.last_request_s < self._gives_way_after_s:
            return False
        self.throttle.log(logging.WARNING, "newcomer", f"closed {silent.peer}, the longest silent, "
                          f"for {newcomer.peer}: modbus.max_connections ({self._max_connections})")
        silent.close("closed_for_newcomer", at_once=True)
        # The transport tells of its end only in a later turn; the room must be there now.
        self._connections.discard(silent)
        return True

    def lost(self, connection: Connection) -> None:
        """Forget a connection."""
        self._alive.discard(connection)
        self._connections.discard(connection)
        self.counters["connections_open"] = len(self._connections)
        self.throttle.log(logging.INFO, "closed", f"{connection.peer} disconnected")

    def take_request(self) -> bool:
        """Take one request out of the budget of this scan; False if it is used up."""
        if not self._may_serve():
            return False
        self._spare -= 1
        if self._budget_left is not None:
            self._budget_left -= 1
        return True

    def _may_serve(self) -> bool:
        if self._budget_left == 0:
            return False
        return self._until_s is None or self._spare > 0 or self._clock() < self._until_s

    def is_waiting(self, connection: Connection) -> bool:
        """Whether a connection is queued for a turn."""
        return connection in self._queue

    def wants_turn(self, connection: Connection) -> None:
        """Queue a connection for another turn."""
        if connection not in self._queue:
            self._queue.append(connection)
        self._plan_turn()

    def _plan_turn(self) -> None:
        if self._turn_due is None and self._queue and self._may_serve():
            self._turn_due = self._loop.call_soon(self._next_turn)

    def _next_turn(self) -> None:
        """Give one connection a turn: in one turn of the loop only one backlog is worked at."""
        self._turn_due = None
        self._queue.popleft().turn()
        self._plan_turn()
