"""plcemu: a PLC you can pip install.

    program = plcemu.compile(source)
    plc = plcemu.Plc(program, cycle="10ms")
    plc["start"] = True
    plc.scan()

The names here are loaded when they are first used, so that a part can be imported without the rest.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from plcemu.base.errors import CompileError, PlcemuError
    from plcemu.base.trace import Frame, Trace
    from plcemu.monitor.suite import Monitor
    from plcemu.runtime.debugger import Debugger
    from plcemu.runtime.plc import Plc, compile

__version__ = "0.1.0"

_HOMES = {
    "CompileError": "plcemu.base.errors", "PlcemuError": "plcemu.base.errors",
    "Frame": "plcemu.base.trace", "Trace": "plcemu.base.trace",
    "Monitor": "plcemu.monitor.suite",
    "Debugger": "plcemu.runtime.debugger",
    "Plc": "plcemu.runtime.plc", "compile": "plcemu.runtime.plc",
}

__all__ = ["CompileError", "Debugger", "Frame", "Monitor", "Plc", "PlcemuError", "Trace",
           "__version__", "compile"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'plcemu' has no attribute {name!r}")
