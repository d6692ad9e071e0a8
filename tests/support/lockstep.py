"""One run both ways: a plant in the process, and the same plant as a Modbus client in lockstep."""

from __future__ import annotations

from typing import Any

from hil.modbus_plant import ModbusPlant
from plcemu.base.trace import Trace
from plcemu.runtime.system import System
from plcemu.runtime.wiring import make_coupling, make_map


def memory_frames(system: System, trace: Trace) -> list[Any]:
    """Return what changed in memory, and when."""
    own = len(system.resource.memory.tags)
    frames = [(f.t_ns, f.scan, tuple(c for c in f.changes if c[0] < own)) for f in trace.frames]
    return [frame for frame in frames if frame[2]]


def traced(system: System) -> Trace:
    trace = Trace(system.cycle.tags)
    system.cycle.observers.append(trace)
    return trace


async def over_modbus(system: System, until_ns: int) -> None:
    """Run a system without a plant, and its plant as a client, in lockstep.

    Where outputs stay as they are, time jumps to the plant's next event as it does in the process.
    """
    server, cycle = system.server(), system.cycle
    await server.start()
    coupling = make_coupling(system.config)
    link = ModbusPlant(coupling, make_map(system.config), server.host, server.port)
    await link.connect()
    outputs = b""
    while cycle.t_ns < until_ns:
        await link.exchange(cycle.t_ns)
        cycle.lap()
        now = system.exchange.published("QX", 0, 8)
        limit_ns = until_ns if now == outputs else cycle.t_ns
        cycle.skip_idle(min(limit_ns, coupling.next_event_ns() or until_ns))
        outputs = now
    link.close()
    await server.stop()
