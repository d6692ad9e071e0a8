"""Time by whole units and by zones, against an oracle that lets it pass step by step."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, reject, settings
from timed_toys import HEAD, INPUTS, OUTPUTS, Case, Oracle, cases, shown

from plant_sim.linear_automaton import Automaton, location, transition
from plant_sim.timed import TimedNetwork
from plcemu.base.errors import PlcemuError
from plcemu.engine.resource import Resource
from plcemu.lang.compile import compile_program
from plcemu.monitor import parse_properties
from plcemu.verify.explore import Graph, Limits, explore, terminal
from plcemu.verify.loop import DoesNotSettle
from plcemu.verify.prove import Prover
from plcemu.verify.timed.loop import IntegerTime, TimedLoop
from plcemu.verify.timed.timing import Time, timed_loop
from plcemu.verify.timed.zones import ZoneTime

RANDOM = settings(max_examples=30, deadline=None,
                  suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])


def explored(case: Case, time: Time) -> tuple[TimedLoop, Graph[Any, Any]]:
    machine, kept = case.machine()
    loop = timed_loop(time, machine.resource.program, kept, machine, case.plant(), case.inputs,
                      OUTPUTS)
    return loop, explore(loop, Limits(states=5000))


def settled(case: Case, time: Time) -> tuple[TimedLoop, Graph[Any, Any]]:
    """All of a random case; one that does not come to rest, or is too large, is no case."""
    try:
        loop, graph = explored(case, time)
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
    loop, graph = settled(case, "integer")
    by_units = seen(case, loop, graph)
    assert by_units == oracle(case, 1)
    zones, zone_graph = settled(case, "zones")
    assert seen(case, zones, zone_graph) == by_units
    assert loop.deadlock_doubt or deadlocks(graph) == deadlocks(zone_graph)


@given(cases())
@RANDOM
def test_finer_time_shows_nothing_that_whole_units_do_not(case: Case) -> None:
    assert oracle(case, 2) == seen(case, *settled(case, "integer"))


# ---------------------------------------------------------------- what may happen at one instant


def pulse(sensor: str, at_s: int) -> Automaton:
    """A sensor that comes on at an instant, exactly."""
    return Automaton((location("off", {sensor: 1}, f"{sensor} <= {at_s}", [("", {sensor: False})]),
                      location("on", {}, readings=[("", {sensor: True})])),
                     (transition("off", "on", f"{sensor} >= {at_s}"),), "off", ())


def program(*lines: str) -> str:
    return HEAD + "".join(f"{line}\n" for line in lines) + "END_PROGRAM\n"


WHO_IS_FIRST = program("m := m OR i0 AND NOT i1;", "n := n OR i1 AND NOT i0;",
                       "j := i0;", "k := i1;", "o0 := FALSE; o1 := FALSE;")
EVENT_OR_TIMER = program("a(IN := TRUE, PT := T#2s);", "m := m OR i0 AND NOT a.Q;",
                         "n := n OR a.Q AND NOT i0;", "o0 := FALSE; o1 := FALSE;")


def flags(case: Case, time: Time) -> set[tuple[bool, bool]]:
    """The values that m and n have in the end."""
    loop, graph = explored(case, time)
    slots = {s.tag.name: s.offset for s in loop.machine.resource.program.layout.slots}
    return {(bool(graph.states[n].memory[slots["MAIN.m"]]),
             bool(graph.states[n].memory[slots["MAIN.n"]])) for n in terminal(graph)}


BOTH_TIMES = pytest.mark.parametrize("time", ["integer", "zones"])


@BOTH_TIMES
def test_two_events_at_one_instant_come_in_either_order_or_together(time: Time) -> None:
    case = Case(WHO_IS_FIRST, {"p": pulse("i0", 3), "q": pulse("i1", 3)})
    assert flags(case, time) == {(True, False), (False, True), (False, False)}


@BOTH_TIMES
def test_an_event_an_instant_later_is_second(time: Time) -> None:
    case = Case(WHO_IS_FIRST, {"p": pulse("i0", 3), "q": pulse("i1", 4)})
    assert flags(case, time) == {(True, False)}


@BOTH_TIMES
@pytest.mark.parametrize(("at_s", "found"), [
    (1, {(True, False)}), (2, {(True, False), (False, True), (False, False)}),
    (3, {(False, True)})])
def test_an_event_and_a_timer_at_one_instant_come_in_either_order_or_together(
        at_s: int, found: set[tuple[bool, bool]], time: Time) -> None:
    assert flags(Case(EVENT_OR_TIMER, {"p": pulse("i0", at_s)}), time) == found


# ---------------------------------------------------------------- deadlocks between whole units


def too_late() -> Automaton:
    """First y0 begins at some time within the first s; then the end comes only if it began at 0 or
    at 1 s, exactly. In between nothing can happen any more."""
    return Automaton(
        (location("begin", {"x": 1}, "x <= 1", [("", {"i0": False})]),
         location("mid", {"x": 1, "y": 1}), location("end", {})),
        (transition("begin", "mid", sets={"y": 0}), transition("mid", "end", "y >= 1 & x <= 1"),
         transition("mid", "end", "x >= 1 & y <= 0"), transition("end", "end", "")), "begin", ())


IDLE = program("o0 := i0; o1 := FALSE;")


def test_a_deadlock_between_whole_units_is_found_by_zones_and_doubted_by_units() -> None:
    case = Case(IDLE, {"p": too_late()})
    assert deadlocks(explored(case, "zones")[1])
    assert explored(case, "integer")[0].deadlock_doubt


def test_a_plant_that_stops_time_is_refused() -> None:
    stuck = Automaton((location("a", {"x": 1}, "x <= 3", [("", {"i0": False})]),), (), "a", ())
    for time in ("integer", "zones"):
        with pytest.raises(PlcemuError, match="stops time"):
            explored(Case(IDLE, {"p": stuck}), time)  # type: ignore[arg-type]


def test_many_units_are_kept_as_zones() -> None:
    kinds = {ms: type(explored(Case(program(f"a(IN := i0, PT := T#{ms}ms);", "o0 := a.Q;",
                                            "o1 := FALSE;"), {"p": pulse("i0", 1)}), "auto")[0])
             for ms in (1000, 10, 9)}
    assert kinds == {1000: IntegerTime, 10: IntegerTime, 9: ZoneTime}


# ---------------------------------------------------------------- durations and runs without end


ANSWER = program("a(IN := i0, PT := T#2s);", "o0 := a.Q; o1 := FALSE;")


def verdicts(text: str, plant: TimedNetwork, demands: str, **options: Any) -> dict[str, str]:
    prover = Prover(Resource(compile_program(text), 10_000_000), plant, INPUTS[:1], OUTPUTS,
                    10_000_000, parse_properties(demands), "timed", **options)
    return {p.name: p.finding.verdict for p in prover.prove(Limits(states=5000)).proofs}


@pytest.mark.parametrize(("within", "verdict"), [
    ("2s", "holds"), ("1s", "violated"), ("1999ms", "violated"), ("3s", "holds")])
def test_an_answer_at_the_very_end_of_its_time_is_in_time(within: str, verdict: str) -> None:
    plant = Case(ANSWER, {"p": pulse("i0", 3)}).plant()
    assert verdicts(ANSWER, plant, f"it: G (MAIN.i0 -> F[0s,{within}] o0)\n",
                    time="integer") == {"it": verdict}


def test_two_durations_are_left_undecided() -> None:
    plant = Case(ANSWER, {"p": pulse("i0", 3)}).plant()
    assert verdicts(ANSWER, plant, "two: G (MAIN.i0 -> F[1s,2s] o0)\n") == {"two": "inconclusive"}


def test_time_always_goes_on() -> None:
    """The sensor must come on at 3 s, though nothing but time makes it."""
    plant = Case(ANSWER, {"p": pulse("i0", 3)}).plant()
    demands = "comes: F o0\nagain: G F o0\nearlier: G (o0 -> O MAIN.i0)\n"
    assert set(verdicts(ANSWER, plant, demands).values()) == {"holds"}
    assert set(verdicts(ANSWER, plant, demands, fairness="none").values()) == {"holds"}


def test_zones_leave_runs_without_end_undecided() -> None:
    plant = Case(ANSWER, {"p": pulse("i0", 3)}).plant()
    assert verdicts(ANSWER, plant, "a: EF o0\nb: G F o0\n", time="zones") == {
        "a": "holds", "b": "inconclusive"}


def test_a_property_that_reads_an_elapsed_time_is_undecided() -> None:
    plant = Case(ANSWER, {"p": pulse("i0", 3)}).plant()
    assert verdicts(ANSWER, plant, "it: G (a.ET <= T#2s)\n") == {"it": "inconclusive"}


def test_a_program_that_calculates_with_elapsed_times_is_refused_with_the_place() -> None:
    text = program("a(IN := i0, PT := T#2s);", "o0 := a.ET * 2 > T#1s; o1 := FALSE;")
    plant = Case(text, {"p": pulse("i0", 3)}).plant()
    with pytest.raises(PlcemuError, match=r"<text>:5:\d+: calculates with MAIN.a"):
        verdicts(text, plant, "it: G !o1\n")
