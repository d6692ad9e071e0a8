"""The Modbus face of the PLC: a server over the exchange, its protocol core free of sockets.

`pdu` is the table of function codes, `framing` cuts a TCP stream into frames, `map` says which
Modbus number is which IEC address, `unit` answers one request, `connection` and `server` carry the
bytes.

Rules and limits are those of the MODBUS Application Protocol Specification V1.1b3 (in the comments
"application protocol") and the MODBUS Messaging on TCP/IP Implementation Guide V1.0b ("messaging
guide").
"""

from plcemu.modbus.errors import ListenError, ModbusException, ProtocolError, UnmappedError
from plcemu.modbus.identity import FAULT_OBJECT, RUN_OBJECT, STATE_OBJECT, Identity
from plcemu.modbus.map import DEFAULT_RANGES, AddressMap, MapRange, ObjectType, Place
from plcemu.modbus.server import ModbusTcpServer
from plcemu.modbus.unit import Unit

__all__ = [
    "DEFAULT_RANGES",
    "FAULT_OBJECT",
    "RUN_OBJECT",
    "STATE_OBJECT",
    "AddressMap",
    "Identity",
    "ListenError",
    "MapRange",
    "ModbusException",
    "ModbusTcpServer",
    "ObjectType",
    "Place",
    "ProtocolError",
    "Unit",
    "UnmappedError",
]
