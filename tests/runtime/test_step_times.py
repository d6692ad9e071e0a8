"""Properties may speak of a step's time that the program itself does not read."""

from __future__ import annotations

import pytest

import plcemu
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
