"""What can go wrong between the PLC and a Modbus peer."""

from __future__ import annotations

from enum import IntEnum

from plcemu.base.errors import PlcemuError


class ExceptionCode(IntEnum):
    """Exception codes (application protocol, section 7)."""

    ILLEGAL_FUNCTION = 0x01
    ILLEGAL_DATA_ADDRESS = 0x02
    ILLEGAL_DATA_VALUE = 0x03
    SERVER_DEVICE_FAILURE = 0x04
    SERVER_DEVICE_BUSY = 0x06
    GATEWAY_TARGET_FAILED_TO_RESPOND = 0x0B


class ProtocolError(PlcemuError):
    """The peer broke the protocol; unless it is a `ModbusException`, its stream lost framing."""


class ModbusException(ProtocolError):
    """A request in good framing that is refused with an exception code."""

    def __init__(self, code: ExceptionCode) -> None:
        self.code = code
        super().__init__(code.name.replace("_", " ").lower())


class ListenError(PlcemuError):
    """The server cannot listen at its address: which one, why, and which setting to change."""


class UnmappedError(PlcemuError):
    """The address map does not show an address of the process image, or not for writing."""
