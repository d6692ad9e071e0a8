"""Every plant that is shipped: behind Modbus it gives the run that it gives in the process."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest
from systems import ROOT, S

from hil.modbus_plant import ModbusPlant
from plant_sim.registry import PLANTS
from plcemu.base.trace import Trace
from plcemu.lang.compile import compile_program
from plcemu.runtime.config import load_config
from plcemu.runtime.system import System
from plcemu.runtime.wiring import make_coupling, make_map

PROGRAMS = ROOT / "il_programs"
SYSTEMS = sorted(path.parent for path in PROGRAMS.glob("*/config.yaml")
                 if load_config(path).plant is not None)
UNTIL_S = {"batch_plant": 700, "evaporator": 28, "heating_tank": 120}
"""How long a system runs here; 20 s where nothing is said."""


def test_every_plant_of_the_registry_has_a_system() -> None:
    plants = {config.plant.model for config in map(load_config, SYSTEMS) if config.plant}
    assert set(PLANTS) <= plants


@pytest.mark.parametrize("folder", SYSTEMS, ids=lambda p: p.name)
def test_its_program_is_clean(folder: Path) -> None:
    assert list(compile_program(load_config(folder).program_paths).warnings) == []


def own_frames(system: System, trace: Trace) -> list[Any]:
    """What changed in the PLC's memory, and when."""
    own = len(system.resource.memory.tags)
    frames = [(f.t_ns, f.scan, tuple(c for c in f.changes if c[0] < own)) for f in trace.frames]
    return [frame for frame in frames if frame[2]]


async def over_modbus(system: System, until_ns: int) -> None:
    """Run a system without a plant, and its plant as a client, in lockstep."""
    server, cycle = system.server(), system.cycle
    await server.start()
    coupling = make_coupling(system.config)
    link = ModbusPlant(coupling, make_map(system.config), server.host, server.port)
    await link.connect()
    outputs = b""
    while cycle.t_ns < until_ns:
        await link.exchange(cycle.t_ns)
        cycle.lap()
        now = b"".join(system.exchange.published(area, 0, 16) for area in ("QX", "QW"))
        limit_ns = until_ns if now == outputs else cycle.t_ns
        cycle.skip_idle(min(limit_ns, coupling.next_event_ns() or until_ns))
        outputs = now
    link.close()
    await server.stop()


@pytest.mark.parametrize("folder", SYSTEMS, ids=lambda p: p.name)
def test_it_gives_the_same_run_behind_modbus_and_in_the_process(folder: Path) -> None:
    until_ns = UNTIL_S.get(folder.name, 20) * S
    config = load_config(folder, ("modbus.port=0", "properties=[]", "cycle=100ms"))
    inside, outside = System(config), System(config, with_plant=False)
    traces = [Trace(system.cycle.tags) for system in (inside, outside)]
    for system, trace in zip((inside, outside), traces, strict=True):
        system.cycle.observers.append(trace)
    inside.cycle.run_virtual(until_ns)
    asyncio.run(over_modbus(outside, until_ns))
    assert own_frames(inside, traces[0]) == own_frames(outside, traces[1])
    assert len(own_frames(inside, traces[0])) > 4
