"""Small transition systems, finite plants and oracles for the tests of `plcemu.verify`."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

from hypothesis import strategies as st

from plant_sim.contract import Fact


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
