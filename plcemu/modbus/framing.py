"""MBAP framing: a TCP stream cut into application data units (messaging guide, 3.1). No sockets.

Header: transaction identifier, protocol identifier (0), length of what follows, unit identifier.
A header that cannot be right means that framing is lost; nothing in the stream marks where the next
frame starts, so the only cure is to close the connection.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from plcemu.modbus.errors import ProtocolError

_MBAP = struct.Struct(">HHHB")
_UP_TO_LENGTH = struct.Struct(">HHH")

LENGTHS = range(2, 255)
"""What the length field may say: the unit identifier and a PDU of 1 to 253 bytes."""


class Adu(NamedTuple):
    """An application data unit.

    Attributes:
        transaction: identifier that the answer repeats.
        unit: identifier of the server device behind the connection.
        pdu: function code and data.
    """

    transaction: int
    unit: int
    pdu: bytes


def encode(adu: Adu) -> bytes:
    """Return the bytes of an ADU."""
    return _MBAP.pack(adu.transaction, 0, len(adu.pdu) + 1, adu.unit) + adu.pdu


class MbapDecoder:
    """Takes bytes in any fragments and gives complete ADUs in order."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._start = 0

    def receive_data(self, data: bytes) -> None:
        """Add bytes from the stream."""
        # What was taken out is dropped here, once a delivery and not once an ADU: the cost of a
        # pipelined stream stays linear.
        del self._buffer[:self._start]
        self._start = 0
        self._buffer += data

    @property
    def pending(self) -> int:
        """Bytes received that are not yet part of an ADU taken out."""
        return len(self._buffer) - self._start

    @property
    def is_ready(self) -> bool:
        """Whether `next_adu` would give an ADU or raise."""
        try:
            return self._length() is not None
        except ProtocolError:
            return True

    def next_adu(self) -> Adu | None:
        """Take out the next complete ADU; None if more bytes are needed.

        Raises:
            ProtocolError: framing is lost; every later call raises again.
        """
        length = self._length()
        if length is None:
            return None
        transaction, _, _, unit = _MBAP.unpack_from(self._buffer, self._start)
        end = self._start + _UP_TO_LENGTH.size + length
        pdu = bytes(self._buffer[self._start + _MBAP.size:end])
        self._start = end
        return Adu(transaction, unit, pdu)

    def _length(self) -> int | None:
        """Return the length field of a complete ADU, None for an incomplete one."""
        if self.pending < _UP_TO_LENGTH.size:
            return None
        _, protocol, length = _UP_TO_LENGTH.unpack_from(self._buffer, self._start)
        if protocol != 0:
            raise ProtocolError(f"protocol identifier {protocol}, not 0 (Modbus)")
        if length not in LENGTHS:
            raise ProtocolError(f"length field {length}, not {LENGTHS[0]} to {LENGTHS[-1]}")
        return int(length) if self.pending >= _UP_TO_LENGTH.size + length else None
