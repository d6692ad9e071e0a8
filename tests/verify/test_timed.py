"""Time by whole units and by zones, against an oracle that lets it pass step by step."""

from __future__ import annotations

from typing import Any

from hypothesis import HealthCheck, assume, given, reject, settings
from timed_toys import OUTPUTS, Case, Oracle, cases, shown

from plcemu.verify.explore import Graph, Limits, explore, terminal
from plcemu.verify.loop import DoesNotSettle
from plcemu.verify.timed import TimedLoop
from plcemu.verify.timing import Time, timed_loop

RANDOM = settings(max_examples=50, deadline=None,
                  suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])


def explored(case: Case, time: Time) -> tuple[TimedLoop, Graph[Any, Any]]:
    """All of a random case; one that does not come to rest, or is too large, is no case."""
    machine, kept = case.machine()
    loop = timed_loop(time, machine.resource.program, kept, machine, case.plant(), case.inputs,
                      OUTPUTS)
    try:
        graph = explore(loop, Limits(states=5000))
    except DoesNotSettle:
        reject()
    assume(graph.complete)
    return loop, graph


def seen(case: Case, loop: TimedLoop, graph: Graph[Any, Any]) -> set[Any]:
    return {shown(loop.machine, s.memory, s.plant) for s in graph.states}


def deadlocks(graph: Graph[Any, Any]) -> set[Any]:
    return {(graph.states[n].memory, graph.states[n].plant) for n in terminal(graph)}


def oracle(case: Case, fine: int) -> set[Any]:
    found = Oracle(case, fine).seen()
    assume(found is not None)
    return found or set()


@given(cases())
@RANDOM
def test_whole_units_and_zones_see_what_time_shows_step_by_step(case: Case) -> None:
    loop, graph = explored(case, "integer")
    by_units = seen(case, loop, graph)
    assert by_units == oracle(case, 1)
    zones, zone_graph = explored(case, "zones")
    assert seen(case, zones, zone_graph) == by_units
    assert loop.deadlock_doubt or deadlocks(graph) == deadlocks(zone_graph)


@given(cases())
@RANDOM
def test_finer_time_shows_nothing_that_whole_units_do_not(case: Case) -> None:
    assert oracle(case, 2) == seen(case, *explored(case, "integer"))
