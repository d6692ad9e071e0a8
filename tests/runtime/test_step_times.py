"""Properties may speak of a step's time that the program itself does not read."""

from __future__ import annotations

import pytest

import plcemu
from plcemu.base.trace import Trace
from plcemu.engine.resource import Resource
from plcemu.monitor import parse_properties
from plcemu.runtime.cycle import Cycle
from plcemu.runtime.plc import make_exchange

CHART = """
PROGRAM MAIN
VAR go : BOOL := TRUE; b : BOOL; END_VAR
INITIAL_STEP S0: END_STEP
STEP FILL: b(N); END_STEP
TRANSITION FROM S0 TO FILL := go; END_TRANSITION
TRANSITION FROM FILL TO S0 := NOT go; END_TRANSITION
END_PROGRAM
"""


@pytest.mark.parametrize("dense", [False, True])
def test_a_step_that_lasts_too_long_is_told_in_the_scan_that_shows_it(dense: bool) -> None:
    resource = Resource(plcemu.compile(CHART), 10_000_000, "auto", None, None)
    cycle = Cycle(resource, make_exchange(resource), None, parse_properties("t: G FILL.T < 1s"))
    cycle.run_virtual(3_000_000_000, dense=dense)
    assert cycle.suite.results()[0].decided_at_ns == 1_010_000_000


def judged_cycle() -> tuple[Cycle, Trace]:
    resource = Resource(plcemu.compile(CHART), 10_000_000, "auto", None, None)
    cycle = Cycle(resource, make_exchange(resource), None, parse_properties("t: G FILL.T < 1s"))
    trace = Trace(cycle.tags)
    cycle.observers.append(trace)
    return cycle, trace


def test_a_lap_that_is_repeated_tells_the_step_time_again() -> None:
    cycle, trace = judged_cycle()
    cycle.run_virtual(200_000_000)
    point = cycle.checkpoint()
    cycle.lap()
    once = trace.frames.pop()
    cycle.return_to(point)
    cycle.lap()
    assert once.changes and trace.frames.pop() == once


def test_a_fork_does_not_tell_a_step_time_that_stands() -> None:
    cycle, _ = judged_cycle()
    cycle.run_virtual(500_000_000)
    offset, row = cycle.resource.memory.place(cycle.resource.memory.tags.find("go"))
    cycle.exchange.port("test").write("MEMORY", offset, row.pack(False))
    cycle.run_virtual(1_000_000_000)
    fork, told = judged_cycle()
    fork.return_to(cycle.checkpoint())
    fork.run_virtual(1_200_000_000)
    assert fork.values()[fork.tags.find("FILL.T")] == 490_000_000
    assert [change for frame in told.frames for change in frame.changes] == []
