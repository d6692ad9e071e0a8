"""Conveyor and heating tank over Modbus give the run that they give in the process."""

import asyncio

import pytest
from lockstep import memory_frames, over_modbus, traced
from systems import ROOT, S

from plcemu.runtime.config import load_config
from plcemu.runtime.system import System


@pytest.mark.parametrize(("name", "overrides", "until_s", "least"), [
    ("conveyor", ("seed=3",), 10, 20),
    ("heating_tank", ("stop_at_s=15", "stop_every_s=40"), 60, 15),
])
def test_a_plant_behind_modbus_gives_the_run_of_a_plant_in_the_process(name, overrides, until_s,
                                                                       least):
    config = load_config(ROOT / "il_programs" / name, ("port=0", *overrides))
    inside, outside = System(config), System(config, with_plant=False)
    inside_trace, outside_trace = traced(inside), traced(outside)
    inside.cycle.run_virtual(until_s * S)
    asyncio.run(over_modbus(outside, until_s * S))
    frames = memory_frames(inside, inside_trace)
    assert frames == memory_frames(outside, outside_trace)
    assert len(frames) > least


@pytest.mark.parametrize(("name", "until_s"), [("conveyor", 10), ("heating_tank", 60)])
def test_a_dense_run_has_the_same_trace(name, until_s):
    config = load_config(ROOT / "il_programs" / name, ("stop_at_s=15",)
                         if name == "heating_tank" else ())
    runs = [System(config), System(config)]
    traces = [traced(system) for system in runs]
    runs[0].cycle.run_virtual(until_s * S)
    runs[1].cycle.run_virtual(until_s * S, dense=True)
    assert [f for f in traces[0].frames if f.changes] == [f for f in traces[1].frames if f.changes]
