"""Random closed loops in time, and an oracle that lets time pass step by step.

The oracle knows nothing of classes, stand-ins or jumps: it keeps the program's real clock cells
and lets them count. A clock that has come to one of the program's constants stands a nanosecond
before it until that is noticed, which must be before time goes on.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, permutations
from typing import Any

from hypothesis import strategies as st

from plant_sim.linear_automaton import Automaton, Transition, location, transition
from plant_sim.timed import TimedNetwork
from plcemu.base.areas import parse_address
from plcemu.engine.resource import Resource
from plcemu.io.mapping import Point
from plcemu.lang.compile import compile_program
from plcemu.verify.cone import cone_of
from plcemu.verify.machine import ScanMachine, place_of

S = 1_000_000_000
INPUTS = [Point(f"i{n}", parse_address(f"%IX0.{n}"), Fraction(1)) for n in (0, 1)]
OUTPUTS = [Point(f"o{n}", parse_address(f"%QX0.{n}"), Fraction(1)) for n in (0, 1)]
HEAD = """PROGRAM MAIN
VAR i0 AT %IX0.0 : BOOL; i1 AT %IX0.1 : BOOL; o0 AT %QX0.0 : BOOL; o1 AT %QX0.1 : BOOL;
  a : TON; b : TOF; c : TP; m, n, j, k : BOOL; END_VAR
"""
_CELL = struct.Struct("<qq")


@dataclass
class Case:
    """A program with timers, and automata with clocks, all constants whole seconds."""

    program: str
    automata: dict[str, Automaton]

    def machine(self) -> tuple[ScanMachine, frozenset[int] | None]:
        program = compile_program(self.program)
        asked = {s.offset for s in program.layout.slots if s.tag.type == "BOOL"}
        kept = cone_of(program, asked)
        return ScanMachine(Resource(program, 10_000_000), self.inputs, kept), kept

    @property
    def inputs(self) -> list[Point]:
        return INPUTS[:len(self.automata)]

    def plant(self) -> TimedNetwork:
        return TimedNetwork(self.automata)


def shown(machine: ScanMachine, memory: bytes, plant: Any) -> tuple[Any, ...]:
    """What can be seen of a state: Boolean variables and the plant's locations."""
    slots = machine.resource.program.layout.slots
    return tuple(memory[s.offset] for s in slots if s.tag.type == "BOOL"), plant.locations


# ---------------------------------------------------------------- random cases

LITERALS = ("i0", "i1", "NOT i0", "NOT i1", "o0", "m", "a.Q", "b.Q", "c.Q", "NOT a.Q", "NOT b.Q",
            "NOT c.Q")


def conditions() -> st.SearchStrategy[str]:
    """What the program computes; it feeds itself back without NOT, so that most programs rest."""
    literal = st.sampled_from(LITERALS)
    return st.builds(lambda x, op, y: f"({x}) {op} ({y})", literal,
                     st.sampled_from(["AND", "OR"]), literal)


def coincidences() -> st.SearchStrategy[str]:
    """What a latch notes: edges and levels that may come together in one scan only."""
    edge = st.sampled_from(["i0 AND NOT j", "i1 AND NOT k", "NOT i0 AND j", "NOT i1 AND k"])
    return st.builds(lambda x, y, z: f"{x} AND ({y}) AND ({z})", edge,
                     edge | st.sampled_from(LITERALS), st.sampled_from(LITERALS))


@st.composite
def cases(draw: st.DrawFn) -> Case:
    lines = [f"{timer}(IN := {draw(conditions())}, PT := T#{draw(st.integers(1, 4))}s);"
             for timer in draw(st.lists(st.sampled_from("abc"), min_size=1, max_size=2,
                                        unique=True))]
    lines += [f"{name} := {draw(conditions())};" for name in ("o0", "o1")]
    lines += [f"{name} := {name} OR ({draw(coincidences())});" for name in ("m", "n")]
    lines.append("j := i0; k := i1;")
    automata = {f"p{n}": draw(automata_of(n)) for n in range(draw(st.sampled_from([2, 2, 1])))}
    return Case(HEAD + "\n".join(lines) + "\nEND_PROGRAM\n", automata)


@st.composite
def automata_of(draw: st.DrawFn, n: int) -> Automaton:
    """An automaton with the clock xn and the sensor in; time never stops."""
    size, clock = draw(st.integers(2, 3)), f"x{n}"
    places, moves = [], []
    for k in range(size):
        low = draw(st.integers(0, 4))
        end = draw(st.sampled_from([low, low + 1, low + 2, None]))
        places.append(location(f"l{k}", {clock: 1}, "" if end is None else f"{clock} <= {end}",
                               [("", {f"i{n}": draw(st.booleans())})]))
        if end is not None or draw(st.integers(0, 3)):
            moves.append(transition(f"l{k}", f"l{(k + draw(st.integers(1, size - 1))) % size}",
                                    f"{clock} >= {low}", {clock: 0}))
        moves += draw(st.lists(commanded(k, clock), max_size=1)) if k else []
    return Automaton(tuple(places), tuple(moves), "l0", ())


@st.composite
def commanded(draw: st.DrawFn, k: int, clock: str) -> Transition:
    command = {draw(st.sampled_from(["o0", "o1"])): draw(st.booleans())}
    return transition(f"l{k}", f"l{draw(st.integers(0, k - 1))}", sets={clock: 0},
                      command=command)


# ---------------------------------------------------------------- the oracle


class Restless(Exception):
    """Program and plant go on changing without end at one instant."""


class Oracle:
    """All that can be seen of a case if time passes in steps of 1/fine s.

    Args:
        case: the program and the automata.
        fine: steps of time in a second.
    """

    def __init__(self, case: Case, fine: int = 1) -> None:
        self.step_ns, self.fine = S // fine, fine
        self.case = case
        self.machine, _ = case.machine()
        self.plant = case.plant()
        program = self.machine.resource.program
        self.outputs = {p.name: place_of(program, p) for p in OUTPUTS}
        self.cells = [c.offset for c in self.machine.resource.program.layout.clocks if c.observed]

    def seen(self, limit: int = 20_000) -> set[tuple[Any, ...]] | None:
        """Return everything that can be seen; None if there is too much."""
        first = next(iter(self.plant.initial()))
        todo = [self.rest(self.machine.initial, first, {})]
        known, found = set(todo), set()
        while todo:
            state = todo.pop()
            found.add(shown(self.machine, state[0], state[1]))
            for following in self.after(state):
                if following not in known:
                    if len(known) > limit:
                        return None
                    known.add(following)
                    todo.append(following)
        return found

    def rest(self, memory: bytes, plant: Any, clocks: dict[str, int]) -> Any:
        """Scan until nothing changes; plant clocks that were set stand at 0."""
        for _ in range(100):
            sensed = self.plant.sense(plant)
            image = self.machine.image([bytes([sensed[p.name]]) for p in self.case.inputs])
            after = self.machine.scan(memory, image)
            following = self.plant.actuate(plant, {n: bool(after[at])
                                                   for n, at in self.outputs.items() if at})
            if after == memory and following == plant:
                clocks = {**clocks, **dict.fromkeys(plant.restarted, 0)}
                return (self.machine.reduced(memory), self.plant.settled(plant),
                        tuple(sorted(clocks.items())))
            memory, plant = after, following
        raise Restless

    def after(self, state: Any) -> Iterator[Any]:
        memory, plant, clock_rows = state
        clocks = dict(clock_rows)
        due = [c for c in self.cells if self.is_due(memory, c)]
        events = [e for e in self.plant.actions(plant) if self.may(clocks, plant, e)]
        for noticed in subsets(due):
            for chosen in subsets(events):
                for order in permutations(chosen):
                    if noticed or order:
                        yield from self.happen(state, noticed, order)
        late = {c: v + 1 for c, v in clocks.items()}
        ends = self.plant.latest(plant)
        if not due and all(late[c] <= v * self.fine for c, v in ends.items()):
            yield (self.later(memory), plant,
                   tuple((c, min(v, 7 * self.fine)) for c, v in sorted(late.items())))

    def may(self, clocks: dict[str, int], plant: Any, event: Any) -> bool:
        return all(low * self.fine <= clocks[c] and (high is None or clocks[c] <= high * self.fine)
                   for c, (low, high) in self.plant.guard(plant, event).items())

    def happen(self, state: Any, noticed: Sequence[int], order: Sequence[Any]) -> Iterator[Any]:
        memory, plant, clock_rows = state
        clocks = dict(clock_rows)
        for event in order:
            if event not in self.plant.actions(plant) or not self.may(clocks, plant, event):
                return
            plant = self.plant.after(plant, event)
            clocks.update(dict.fromkeys(plant.restarted, 0))
        block = bytearray(memory)
        for cell in noticed:
            elapsed, limit = _CELL.unpack_from(block, cell)
            _CELL.pack_into(block, cell, elapsed + 1, limit)
        yield self.rest(bytes(block), plant, clocks)

    def is_due(self, memory: bytes, cell: int) -> bool:
        elapsed, limit = _CELL.unpack_from(memory, cell)
        return elapsed == limit - 1

    def later(self, memory: bytes) -> bytes:
        block = bytearray(memory)
        for cell in self.cells:
            elapsed, limit = _CELL.unpack_from(block, cell)
            if elapsed < limit:
                elapsed = min(elapsed + self.step_ns, limit)
                _CELL.pack_into(block, cell, elapsed - (elapsed == limit), limit)
        return bytes(block)


def subsets(items: Sequence[Any]) -> Iterator[tuple[Any, ...]]:
    for size in range(len(items) + 1):
        yield from combinations(items, size)
