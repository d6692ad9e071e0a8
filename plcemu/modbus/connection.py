"""One client's connection: bytes in, requests answered in order, bytes out.

The server lives in the event loop of the scan cycle, so a connection works in turns. A turn answers
at most `Settings.requests_per_turn` requests; while more wait, nothing is read from the socket, the
peer feels TCP's back-pressure, and the connection queues for its next turn.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Container
from dataclasses import dataclass
from typing import Protocol, cast

from plcemu.modbus.errors import ExceptionCode, ProtocolError
from plcemu.modbus.framing import Adu, MbapDecoder, encode
from plcemu.modbus.throttle import Throttle
from plcemu.modbus.unit import Unit


@dataclass(frozen=True, slots=True)
class Settings:
    """How connections are served.

    Attributes:
        units: the unit identifiers that are answered; None for every one.
        is_silent_for_unknown_units: give no answer instead of exception 0x0B.
        idle_timeout_s: close after this time without a complete request; None for never.
        requests_per_turn: requests that one connection has answered in one turn of the loop.
    """

    units: Container[int] | None
    is_silent_for_unknown_units: bool
    idle_timeout_s: float | None
    requests_per_turn: int


class Host(Protocol):
    """What a connection needs of its server."""

    settings: Settings
    counters: dict[str, int]
    throttle: Throttle

    def opened(self, connection: Connection) -> Unit | None:
        """Take a connection in and return its unit, or None to refuse it."""

    def lost(self, connection: Connection) -> None:
        """Forget a connection."""

    def take_request(self) -> bool:
        """Take one request out of the budget of this scan; False if it is used up."""

    def wants_turn(self, connection: Connection) -> None:
        """Queue a connection for another turn."""

    def is_waiting(self, connection: Connection) -> bool:
        """Whether a connection is queued."""


READ_BYTES = 16_384
"""The most that is read from a socket at once: over a thousand requests. A reading costs by this
size, and near a release all connections together must cost little."""

_BUFFER = memoryview(bytearray(READ_BYTES))
"""Where every connection reads to: what came is taken out before the next one reads."""


class Connection(asyncio.BufferedProtocol):
    """The transport's other half.

    Attributes:
        peer: its address, for log lines.
        last_request_s: loop time at which it was opened or last had a request answered.
        closed: done when the transport is gone.
    """

    def __init__(self, host: Host, loop: asyncio.AbstractEventLoop) -> None:
        self.peer = "unknown peer"
        self.last_request_s = loop.time()
        self.closed: asyncio.Future[None] = loop.create_future()
        self._host = host
        self._loop = loop
        self._decoder = MbapDecoder()
        self._can_write = True
        self._closed_as = "closed_by_peer"
        self._idle_timer: asyncio.TimerHandle | None = None
        self._unit: Unit
        self._transport: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Ask the server for a unit; without one the connection ends."""
        # A cast: the transports of other event loops are none of asyncio's classes.
        self._transport = cast(asyncio.Transport, transport)
        self.peer = _peer_text(transport.get_extra_info("peername"))
        unit = self._host.opened(self)
        if unit is None:
            self._closed_as = "connections_refused"
            self._transport.abort()
            return
        self._unit = unit
        self._watch_idleness()

    def get_buffer(self, sizehint: int) -> memoryview:
        """Return where to read to."""
        return _BUFFER

    def buffer_updated(self, nbytes: int) -> None:
        """Take what was read."""
        self.data_received(bytes(_BUFFER[:nbytes]))

    def data_received(self, data: bytes) -> None:
        """Answer what has come, unless the connection is ending."""
        self._host.counters["bytes_received"] += len(data)
        if not self._transport.is_closing():
            self._decoder.receive_data(data)
            self.turn()

    def turn(self) -> None:
        """Answer waiting requests within the limits, then read on or queue for the next turn."""
        if self._transport.is_closing():
            return
        answers: list[bytes] = []
        mistake = self._serve(answers)
        if answers:
            data = b"".join(answers)
            self._host.counters["bytes_sent"] += len(data)
            self._transport.write(data)
        if mistake is not None:
            self._end_for(mistake)
        else:
            self._schedule()

    def _serve(self, answers: list[bytes]) -> ProtocolError | None:
        """Collect answers within the limits of a turn; return what ends the connection, if so."""
        try:
            for _ in range(self._host.settings.requests_per_turn):
                if not (self._can_write and self._decoder.is_ready and self._host.take_request()):
                    return None
                adu = self._decoder.next_adu()
                if adu is not None:
                    answers.append(self._answer(adu))
        except ProtocolError as mistake:
            return mistake
        return None

    def _answer(self, adu: Adu) -> bytes:
        self.last_request_s = self._loop.time()
        settings = self._host.settings
        if settings.units is None or adu.unit in settings.units:
            return encode(Adu(adu.transaction, adu.unit, self._unit.handle(adu.pdu)))
        self._host.counters["requests"] += 1
        self._host.counters["unknown_units"] += 1
        if settings.is_silent_for_unknown_units:
            return b""
        refusal = ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND
        return encode(Adu(adu.transaction, adu.unit, self._unit.refuse(adu.pdu, refusal)))

    def _schedule(self) -> None:
        # pause_reading and resume_reading may be repeated at will (Python 3.7).
        if self._can_write and not self._decoder.is_ready:
            self._transport.resume_reading()
            return
        self._transport.pause_reading()
        if self._can_write:
            self._host.wants_turn(self)

    def _end_for(self, mistake: ProtocolError) -> None:
        self._host.counters["protocol_errors"] += 1
        self._host.throttle.log(logging.WARNING, "protocol", f"closed {self.peer}: {mistake}")
        self.close("closed_for_protocol_error")

    def pause_writing(self) -> None:
        """The peer does not take its answers: answer no more."""
        self._can_write = False

    def resume_writing(self) -> None:
        """The peer has taken its answers: go on."""
        self._can_write = True
        self._host.wants_turn(self)

    def close(self, why: str, *, at_once: bool = False) -> None:
        """End the connection, counted under the counter `why`.

        Answers already given are still sent, unless it ends at once.
        """
        if not self._transport.is_closing():
            self._closed_as = why
        if at_once:
            self._transport.abort()
        else:
            self._transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        """Count how it ended and let go of everything."""
        self._host.counters[self._closed_as] += 1
        if self._idle_timer is not None:
            self._idle_timer.cancel()
        self._host.lost(self)
        self.closed.set_result(None)

    def _watch_idleness(self) -> None:
        """Close if no request was complete for the idle timeout; else look again when it may be.

        One timer a connection, set anew only when it fires, costs a request nothing. A peer whose
        requests wait for the budget of a scan is not idle. A closing connection whose peer takes no
        answers is ended here too.
        """
        timeout_s = self._host.settings.idle_timeout_s
        if timeout_s is None:
            return
        if self._host.is_waiting(self):
            self.last_request_s = self._loop.time()
        left_s = self.last_request_s + timeout_s - self._loop.time()
        if left_s > 0:
            self._idle_timer = self._loop.call_later(left_s, self._watch_idleness)
            return
        half = f", {self._decoder.pending} bytes of a request" if self._decoder.pending else ""
        self._host.throttle.log(logging.INFO, "idle",
                                f"closed {self.peer}: no request for {timeout_s:g} s{half}")
        self.close("closed_for_idleness", at_once=True)


def _peer_text(peername: object) -> str:
    """Return `host:port` of a socket's address."""
    if not isinstance(peername, tuple):
        return "unknown peer"
    host = f"[{peername[0]}]" if ":" in peername[0] else peername[0]
    return f"{host}:{peername[1]}"
