"""Many steps at once come to the same graph as one step after the other, state by state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from systems import ROOT

from plant_sim.contract import Fact
from plcemu.base.areas import parse_address
from plcemu.engine.resource import Resource
from plcemu.io.mapping import Point
from plcemu.lang.compile import compile_program
from plcemu.monitor import parse_properties
from plcemu.runtime.config import load_config
from plcemu.runtime.verification import make_prover
from plcemu.verify.check import StateGraph
from plcemu.verify.explore import Limits, explore
from plcemu.verify.loop import ClosedLoop, DoesNotSettle, Merge
from plcemu.verify.prove import Prover


class Readable:
    """A closed loop as a transition system that makes one step after the other."""

    def __init__(self, loop: ClosedLoop) -> None:
        self.initial, self.actions, self.next = loop.initial, loop.actions, loop.next


def found_in(loop: ClosedLoop, graph: StateGraph) -> list[Any]:
    """All that an exploration finds."""
    numbers = range(len(graph))
    return [graph.states, graph.initial, list(graph.parent), graph.complete, graph.reason,
            [list(graph.targets(n)) for n in numbers], [graph.actions(n) for n in numbers],
            [graph.expanded(n) for n in numbers], graph.edges, loop.origins]


def both(make: Callable[[bool], ClosedLoop],
         limits: Limits = Limits()) -> tuple[ClosedLoop, ClosedLoop]:  # noqa: B008
    """Explore in both ways, and expect the same."""
    together, one = make(True), make(False)
    assert found_in(together, explore(together, limits)) \
        == found_in(one, explore(Readable(one), limits))
    return together, one


# ---------------------------------------------------------------- the systems that come with it


def of_system(folder: str, *overrides: str) -> Callable[[bool], ClosedLoop]:
    config = load_config(ROOT / "il_programs" / folder, list(overrides))

    def make(together: bool) -> ClosedLoop:
        return make_prover(config, together=together).loop
    return make


@pytest.mark.parametrize("load", ["0.5", "2", "7.5"])
def test_the_batch_plants_graph_is_the_same(load: str) -> None:
    together, one = both(of_system("batch_plant", f"load={load}"))
    assert together.ever == one.ever
    assert 0 < together.machine.scans <= one.machine.scans


@pytest.mark.parametrize("version", [1, 2, 3, 4, 5])
def test_the_heating_tanks_graphs_are_the_same(version: int) -> None:
    together, one = both(of_system("heating_tank", f"program=version{version}.sipn"))
    assert together.ever == one.ever


@pytest.mark.parametrize("states", [1, 100, 186])
def test_a_limit_is_reached_in_the_same_state(states: int) -> None:
    make = of_system("batch_plant", "load=2")
    both(make, Limits(states=states))
    assert explore(make(True), Limits(states=states)).complete == (states == 186)


def test_states_that_differ_only_in_what_was_seen_are_not_expanded_twice() -> None:
    together, one = both(of_system("batch_plant", "load=4"))
    assert together.machine.scans < one.machine.scans


# ---------------------------------------------------------------- random programs and plants

INPUTS = [Point(f"s{n}", parse_address(f"%IX0.{n}"), Fraction(1)) for n in range(2)]
OUTPUTS = [Point(f"v{n}", parse_address(f"%QX0.{n}"), Fraction(1)) for n in range(2)]
DEMANDS = "a: G !(x & v0)\nb: G F v1\nc: G !plant.last\nd: EF n = 3\ne: G (s0 -> v1)"

HEAD = """PROGRAM MAIN
VAR s0 AT %IX0.0 : BOOL; s1 AT %IX0.1 : BOOL; v0 AT %QX0.0 : BOOL; v1 AT %QX0.1 : BOOL;
    x : BOOL; y : BOOL; n : INT; unused : DINT; END_VAR
unused := unused + 1;
"""
CONDITIONS = ("s0", "s1", "x", "NOT y", "v0 XOR s1", "s0 AND NOT x", "n > 2", "y OR v1")
STATEMENTS = ("v0 := {};", "v1 := {};", "x := {};", "y := NOT ({});",
              "IF {} THEN n := n + 1; END_IF;", "IF {} THEN n := 0; END_IF;",
              "IF {} THEN n := 6 / n; END_IF;", "IF {} AND n < 5 THEN n := n + 1; END_IF;",
              "IF {} THEN WHILE n > 3 DO x := NOT x; END_WHILE; END_IF;")

PROGRAMS = st.lists(st.builds(str.format, st.sampled_from(STATEMENTS), st.sampled_from(CONDITIONS)),
                    min_size=1, max_size=6).map(lambda lines: HEAD + "\n".join(lines)
                                                + "\nEND_PROGRAM\n")


@dataclass(frozen=True)
class Written:
    """A finite plant written down: what its states' sensors read, what follows outputs, actions."""

    reads: tuple[tuple[bool, bool], ...]
    follows: tuple[tuple[int, ...], ...]
    goes: tuple[tuple[int, ...], ...]
    first: tuple[int, ...]
    facts = (Fact("last", "bool", "", "it is in its last state"),)

    def initial(self) -> tuple[int, ...]:
        return self.first

    def name_of(self, state: int) -> str:
        return str(state)

    def sense(self, state: int) -> dict[str, bool]:
        return dict(zip(("s0", "s1"), self.reads[state], strict=True))

    def actuate(self, state: int, values: Mapping[str, bool]) -> int:
        return self.follows[state][values["v0"] + 2 * values["v1"]]

    def actions(self, state: int) -> range:
        return range(len(self.goes[state]))

    def after(self, state: int, action: int) -> int:
        return self.goes[state][action]

    def observe(self, state: int) -> dict[str, bool]:
        return {"last": state == len(self.reads) - 1}

    def pending(self, state: int) -> tuple[str, ...]:
        return ()

    def done(self, action: int) -> tuple[str, ...]:
        return ()


@st.composite
def plants(draw: st.DrawFn) -> Written:
    """Random plants of up to four states; some never come to rest with some outputs."""
    size = draw(st.integers(1, 4))
    state = st.integers(0, size - 1)

    def rows(each: st.SearchStrategy[Any]) -> Any:
        return tuple(draw(st.lists(each, min_size=size, max_size=size)))
    return Written(rows(st.tuples(st.booleans(), st.booleans())),
                   rows(st.tuples(state, state, state, state)),
                   rows(st.lists(state, max_size=3).map(tuple)),
                   tuple(draw(st.lists(state, min_size=1, max_size=3))))


def explored(text: str, plant: Written, merge: Merge, engine: str, together: bool,
             states: int) -> Any:
    """All that an exploration finds, or why there can be none."""
    resource = Resource(compile_program(text), 10_000_000, engine, budget=300)
    loop = Prover(resource, plant, INPUTS, OUTPUTS, 10_000_000, parse_properties(DEMANDS), merge,
                  together=together).loop
    system = loop if together else Readable(loop)
    try:
        graph = explore(system, Limits(states=states))
    except DoesNotSettle as reason:
        return str(reason)
    return [*found_in(loop, graph), loop.ever if graph.complete else None]


PULSING = Written(((False, True), (True, False)), ((1, 1, 1, 1), (0, 0, 0, 0)), ((), ()), (0,))
BLINKING = HEAD + "v0 := NOT v0;\nEND_PROGRAM\n"
DIVIDING = HEAD + "n := 6 / n;\nEND_PROGRAM\n"
ENDLESS = HEAD + "IF s0 THEN WHILE n > -1 DO x := NOT x; END_WHILE; END_IF;\nEND_PROGRAM\n"
STILL = Written(((True, False), (False, False)), ((0,) * 4, (1,) * 4), ((1,), (0, 1)), (1, 0))


@settings(deadline=None, max_examples=60)
@given(PROGRAMS, plants(), st.sampled_from(("stable", "none")), st.sampled_from((1, 4, 200)))
@example(BLINKING, STILL, "stable", 200)
@example(DIVIDING, STILL, "stable", 200)
@example(ENDLESS, STILL, "none", 200)
@example(HEAD + "\nEND_PROGRAM\n", PULSING, "stable", 200)
def test_of_any_program_and_plant_every_way_finds_the_same(
        text: str, plant: Written, merge: Merge, states: int) -> None:
    readable = explored(text, plant, merge, "interpreter", False, states)
    assert explored(text, plant, merge, "wasm", True, states) == readable
    assert explored(text, plant, merge, "interpreter", True, states) == readable


def test_the_examples_are_what_they_are_called() -> None:
    assert "still changes" in explored(BLINKING, STILL, "stable", "wasm", True, 200)
    assert "still changes" in explored(HEAD + "\nEND_PROGRAM\n", PULSING, "stable", "wasm", True,
                                       200)
    faults = {s.fault for s in explored(DIVIDING, STILL, "stable", "wasm", True, 200)[0]}
    assert faults == {"division by zero in MAIN"}
    ends = {s.fault for s in explored(ENDLESS, STILL, "none", "wasm", True, 200)[0]}
    assert len(ends) == 2 and "" in ends


def test_where_few_copies_of_memory_find_room_the_graph_is_the_same() -> None:
    text = HEAD.replace("END_VAR", "big : ARRAY[1..15000] OF DINT; END_VAR") + (
        "big[n + 1] := big[n + 1] + 1;\nv0 := big[n + 1] > 2;\n"
        "IF s0 AND n < 2 THEN n := n + 1; END_IF;\nEND_PROGRAM\n")
    readable = explored(text, STILL, "none", "wasm", False, 4)
    assert explored(text, STILL, "none", "wasm", True, 4) == readable


def test_scans_are_counted_when_the_engine_executes_them() -> None:
    make = of_system("batch_plant", "load=2")
    counted = []
    for together in (True, False):
        loop = make(together)
        explore(loop)
        counted.append(loop.machine.scans)
    assert counted[0] == counted[1]
