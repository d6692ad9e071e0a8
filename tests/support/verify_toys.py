"""Small transition systems, finite plants and oracles for the tests of `plcemu.verify`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

from hypothesis import strategies as st
from monitor_brute_force import Brute
from monitor_lasso import Lasso

from plant_sim.contract import Fact
from plcemu.monitor.formula import Formula
from plcemu.verify.check import Check, Evidence, Finding
from plcemu.verify.explore import Limits, explore
from plcemu.verify.loop import State
from plcemu.verify.ltl.check import Linear


@dataclass(frozen=True)
class Steps:
    """A transition system written down: state -> {action: next state}; 0 is the initial state.

    `waiting` says what is pending in a state; an action is done if it bears that name.
    """

    table: Mapping[int, Mapping[str, int]]
    waiting: Mapping[int, frozenset[str]]

    def initial(self) -> list[int]:
        return [0]

    def actions(self, state: int) -> list[str]:
        return list(self.table[state])

    def next(self, state: int, action: str) -> int:
        return self.table[state][action]

    def pending(self, state: int) -> Collection[str]:
        return self.waiting[state]

    def done(self, action: str) -> Collection[str]:
        return (action,)


NAMES = ("a", "b", "c")


@st.composite
def steps(draw: st.DrawFn) -> Steps:
    """Random systems of up to seven states with three actions; what can be done is pending."""
    size = draw(st.integers(1, 7))
    rows = st.dictionaries(st.sampled_from(NAMES), st.integers(0, size - 1))
    table = {n: draw(rows) for n in range(size)}
    more = st.frozensets(st.sampled_from(NAMES))
    return Steps(table, {n: draw(more) & frozenset(table[n]) for n in range(size)})


def can_avoid(system: Steps, good: Collection[int]) -> set[int]:
    """The states from which a weakly fair run never passes a good state, by fixed points.

    Emerson and Lei: the largest Z of bad states in which, for every name, Z can be left by a step
    inside the bad states towards a state of Z where the name is not pending, or by doing it; and
    the bad states from which such a Z, or a bad state at rest, is reached inside the bad ones.
    """
    bad = set(system.table) - set(good)
    z = set(bad)
    while True:
        smaller = z
        for name in NAMES:
            goal = {s for s in smaller if name not in system.waiting[s]}
            by_doing = {s for s in smaller if system.table[s].get(name) in smaller}
            smaller = {s for s in bad if _step_into(system, s, _reaching(
                system, bad, (goal | by_doing) & smaller)) or (s in by_doing and s in smaller)}
        if smaller >= z:
            break
        z &= smaller
    rests = {s for s in bad if not system.table[s]}
    return _reaching(system, bad, z | rests)


def _step_into(system: Steps, state: int, goal: Collection[int]) -> bool:
    return any(t in goal for t in system.table[state].values())


def _reaching(system: Steps, inside: Collection[int], goal: Collection[int]) -> set[int]:
    reached = set(goal)
    while True:
        more = {s for s in inside if s not in reached and _step_into(system, s, reached)}
        if not more:
            return reached
        reached |= more


# ---------------------------------------------------------------- timed systems


class Hop(NamedTuple):
    """A move of a timed system."""

    starts: tuple[str, ...]
    units: int
    batches: int
    after: int


@dataclass(frozen=True)
class Hops:
    """A timed system written down: state -> its moves; 0 is the initial state."""

    table: Mapping[int, Sequence[Hop]]

    def initial(self) -> list[int]:
        return [0]

    def moves(self, state: int) -> Sequence[Hop]:
        return self.table[state]


@st.composite
def hops(draw: st.DrawFn) -> Hops:
    """Random timed systems of up to six states."""
    size = draw(st.integers(1, 6))
    hop = st.builds(Hop, st.just(()), st.integers(1, 9), st.integers(0, 2),
                    st.integers(0, size - 1))
    return Hops({n: draw(st.lists(hop, max_size=3)) for n in range(size)})


def least_ratio(system: Hops) -> Fraction | None:
    """The least units per batch of all simple cycles that can be reached, one after the other."""
    reached, todo = {0}, [0]
    while todo:
        for hop in system.table[todo.pop()]:
            if hop.after not in reached:
                reached.add(hop.after)
                todo.append(hop.after)
    ratios = [Fraction(units, batches) for root in reached
              for units, batches in _simple_cycles(system, root, root, {root}, 0, 0) if batches]
    return min(ratios, default=None)


def _simple_cycles(system: Hops, root: int, here: int, on_way: set[int], units: int,
                   batches: int) -> Iterator[tuple[int, int]]:
    for hop in system.table[here]:
        sums = units + hop.units, batches + hop.batches
        if hop.after == root:
            yield sums
        elif hop.after not in on_way:
            yield from _simple_cycles(system, root, hop.after, on_way | {hop.after}, *sums)


# ---------------------------------------------------------------- a finite plant


class Tank:
    """A finite plant: a tank of three levels with a valve that fills it and a drain of its own.

    Levels 0, 1, 2; sensor `high` at level 2. While the valve is on, `rises` is pending.
    """

    facts = (Fact("overflow", "bool", "", "ran over"),)

    def initial(self) -> list[tuple[int, bool, bool]]:
        return [(0, False, False)]

    def name_of(self, state: Any) -> str:
        return f"level {state[0]}"

    def sense(self, state: Any) -> dict[str, Any]:
        return {"high": state[0] == 2}

    def actuate(self, state: Any, values: Mapping[str, Any]) -> Any:
        return state[0], bool(values["valve"]), state[2]

    def actions(self, state: Any) -> list[str]:
        level, valve, over = state
        up = ["rises"] if valve and not over else []
        return up + (["falls"] if level and not over else [])

    def after(self, state: Any, action: str) -> Any:
        level, valve, _ = state
        step = 1 if action == "rises" else -1
        return min(level + step, 2), valve, level + step > 2

    def observe(self, state: Any) -> dict[str, Any]:
        return {"overflow": state[2]}

    def pending(self, state: Any) -> list[str]:
        return ["rises"] if state[1] and not state[2] else []

    def done(self, action: str) -> list[str]:
        return [action]


# ---------------------------------------------------------------- a closed loop written down


Row = dict[str, bool | int | float | str]
"""What the tags a, b and n are in a scan."""


class Way(NamedTuple):
    """A step of a written loop: what it does, how long after the last scan, and where to."""

    name: str
    elapsed_ns: int
    after: int


@dataclass
class Written:
    """A closed loop written down: what each state's scan shows, and its ways on; 0 is initial.

    Each step is one scan. `tests` are the state formulas that checks ask about.
    """

    rows: Sequence[Row]
    ways: Sequence[Sequence[Way]]
    waiting: Sequence[frozenset[str]]
    fairness: str = "weak"
    tests: tuple[Formula, ...] = ()
    merge: str = "none"
    cycle_ns: int = 1
    starting: int = 1
    ever: int = 0

    @property
    def origins(self) -> dict[State, Any]:
        return {self.state(n): n for n in range(self.starting)}

    def state(self, n: int) -> State:
        return State(bytes([n]), None, self.watch(bytes([n]), ()))

    def initial(self) -> list[State]:
        return list(self.origins)

    def starts(self, number: Mapping[State, int]) -> list[tuple[Any, int]]:
        return [(n, number[state]) for state, n in self.origins.items()]

    def actions(self, state: State) -> Sequence[Way]:
        return self.ways[state.memory[0]]

    def next(self, state: State, action: Way) -> State:
        return self.state(action.after)

    def pending(self, state: State) -> frozenset[str]:
        return frozenset() if self.fairness == "none" else self.waiting[state.memory[0]]

    def done(self, action: Way) -> tuple[str, ...]:
        return (action.name,)

    def elapsed_ns(self, state: State, action: Way) -> int:
        return action.elapsed_ns

    def first_scans(self, plant: Any) -> Any:
        return [(self.state(plant).memory, None)], None, ""

    def facts(self, plant: Any) -> tuple[()]:
        return ()

    def watch(self, memory: bytes, facts: Any) -> int:
        brute = Brute([self.rows[memory[0]]], 0, 1)
        return sum(1 << k for k, test in enumerate(self.tests) if brute.three(test, 0))


def judged(loop: Written, formula: Formula,
           of: Callable[[Formula], Check | None] = Linear.of) -> tuple[Finding, Any]:
    """What a check of a formula finds in a written loop, and the loop's graph."""
    check = of(formula)
    assert check is not None
    loop.tests = (*check.watched, *check.tested)
    graph: Any = explore(loop)  # type: ignore[arg-type]
    evidence = Evidence(loop, graph, 0, len(check.watched), lambda n, s: bool(  # type: ignore[arg-type]
        loop.watch(s.memory, ()) >> n & 1), Limits(states=2000))
    return check.judge(evidence), graph


@st.composite
def written(draw: st.DrawFn, longest_ns: int = 1, fairness: str = "none") -> Written:
    """Random loops of up to four states, each with a way on; what can be done may be pending."""
    size = draw(st.integers(1, 4))
    way = st.builds(Way, st.sampled_from(NAMES), st.integers(1, longest_ns),
                    st.integers(0, size - 1))
    ways = [draw(st.lists(way, min_size=1, max_size=3, unique_by=lambda w: (w.name, w.after)))
            for _ in range(size)]
    row = st.fixed_dictionaries({"a": st.booleans(), "b": st.booleans(), "n": st.integers(0, 2)})
    more = st.frozensets(st.sampled_from(NAMES))
    return Written([draw(row) for _ in range(size)], ways,
                   [draw(more) & {w.name for w in ways[n]} for n in range(size)], fairness)


class Round(NamedTuple):
    """A run of a written loop: ways in, and ways that are repeated for ever."""

    begin: list[Way]
    loop: list[Way]


def rounds(loop: Written, longest: int) -> Iterator[Round]:
    """Yield all runs of up to so many steps in and round together, from state 0."""
    def walks(here: int, left: int) -> Iterator[list[Way]]:
        yield []
        if left:
            for way in loop.ways[here]:
                yield from ([way, *rest] for rest in walks(way.after, left - 1))

    for walk in walks(0, longest):
        at = [0, *(way.after for way in walk)]
        yield from (Round(walk[:k], walk[k:]) for k in range(len(walk)) if at[k] == at[-1])


def is_fair(loop: Written, run: Round) -> bool:
    """Whether a run is fair, by the definition: what is pending and what is done in its round."""
    if loop.fairness == "none":
        return True
    states = [way.after for way in run.loop]
    done = {way.name for way in run.loop}
    joined = all if loop.fairness == "weak" else any
    return all(name in done or not joined(name in loop.waiting[s] for s in states)
               for name in NAMES)


def truth(loop: Written, run: Round, formula: Formula) -> bool:
    """Whether a run satisfies a formula, instant by instant, by the definitions alone."""
    states = [0, *(way.after for way in (*run.begin, *run.loop))]
    ways = [*run.begin, *run.loop, run.loop[0]]
    lengths = [way.elapsed_ns for way in ways]
    scans = [sum(lengths[:n]) for n in range(len(ways))]
    rows = [loop.rows[s] for s, length in zip(states, lengths, strict=True) for _ in range(length)]
    # The scan at which the round closes stands as long as the next round's first step takes.
    enter = len(run.begin) + 1
    begin = sum(lengths[:enter])
    return Lasso(rows[:begin], rows[begin:], formula, scans).holds(formula, 0)
