"""A unit: one Modbus server device as one client sees it."""

from __future__ import annotations

import logging

from plcemu.base.errors import LimitError
from plcemu.io.exchange import Port
from plcemu.modbus.errors import ExceptionCode, ModbusException
from plcemu.modbus.identity import Identity
from plcemu.modbus.map import AddressMap
from plcemu.modbus.pdu import answer, exception_response
from plcemu.modbus.throttle import Throttle


class Unit:
    """Answers request PDUs from the process image; knows nothing of sockets.

    Args:
        address_map: which number is which address.
        port: the client's own, so that its reads see its waiting writes.
        identity: what function code 43/14 tells.
        counters: where `requests` and `exceptions` are counted, if shared with others.
        throttle: limits the log lines about failures, if shared with others.
    """

    def __init__(self, address_map: AddressMap, port: Port, identity: Identity, *,
                 counters: dict[str, int] | None = None, throttle: Throttle | None = None) -> None:
        self.map = address_map
        self.port = port
        self.identity = identity
        self.counters = counters if counters is not None else {}
        self._throttle = throttle if throttle is not None else Throttle()
        for name in ("requests", "exceptions"):
            self.counters.setdefault(name, 0)

    def handle(self, request: bytes) -> bytes:
        """Return the response PDU to a request PDU; whatever the bytes are, it raises nothing.

        A write that spans ranges and finds the queue full half-way is answered *busy*; the peer's
        repetition then writes the same values again.
        """
        self.counters["requests"] += 1
        try:
            return answer(self, request)
        except ModbusException as refusal:
            return self.refuse(request, refusal.code)
        except LimitError as limit:
            self._throttle.log(logging.WARNING, "busy", f"{self.port.name} answered busy: {limit}")
            return self.refuse(request, ExceptionCode.SERVER_DEVICE_BUSY)
        except Exception as error:
            # A defect of ours must not end the connection, let alone the scan.
            self._throttle.log(logging.ERROR, "failure", f"function code {request[0]} of "
                               f"{self.port.name} failed: {type(error).__name__}: {error}")
            return self.refuse(request, ExceptionCode.SERVER_DEVICE_FAILURE)

    def refuse(self, request: bytes, code: ExceptionCode) -> bytes:
        """Return the response PDU that refuses a request, and count it."""
        self.counters["exceptions"] += 1
        return exception_response(request, code)
