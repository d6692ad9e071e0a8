"""Controllers that start everything they may, ties decided by fixed priorities, as in the paper.

A controller of this kind is an orientation of the conflict graph (Figure 5) without a cycle. Which
orientations behave differently from a given load is found by running with the ties undecided: only
where two processes that conflict could start at one instant, both decisions are followed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction

from plant_sim.batch_plant.processes import conflicts
from plant_sim.batch_plant.protocol import Protocol, State

Decisions = Mapping[tuple[str, str], str]
"""For a pair of conflicting processes, in the table's order, the one that goes first."""

PAPER: dict[tuple[str, str], str] = {
    pair: next(name for name in ("P7", "P8", "P6", "P5", "P1", "P3", "P9", "P10", "P2", "P4",
                                 "P11", "P12") if name in pair)
    for pair in conflicts()
}
"""Figure 8, whose order of evaluation it is: the process that is evaluated first goes first."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What some decisions lead to.

    Attributes:
        decisions: those that mattered.
        period: units of time per batch in the long run; None if production ends.
    """

    decisions: dict[tuple[str, str], str]
    period: Fraction | None

    def changes(self, against: Decisions) -> list[tuple[str, str]]:
        """The pairs decided otherwise than by some other decisions."""
        return [pair for pair, first in self.decisions.items() if against[pair] != first]


def outcomes(protocol: Protocol, decided: Decisions | None = None) -> Iterator[Outcome]:
    """Every behaviour that fixed priorities can lead to from the protocol's initial state.

    Args:
        protocol: not eager, so that everything possible may start at every instant.
        decided: decisions taken already; with all of them there is one outcome.
    """
    todo: list[dict[tuple[str, str], str]] = [dict(decided or {})]
    while todo:
        decisions = todo.pop()
        used: dict[tuple[str, str], str] = {}
        undecided = _run(protocol, decisions, used)
        if isinstance(undecided, Outcome):
            yield undecided
            continue
        for name in undecided:
            extended = {**decisions, undecided: name}
            if is_acyclic(extended):
                todo.append(extended)


def _run(protocol: Protocol, decisions: Decisions,
         used: dict[tuple[str, str], str]) -> Outcome | tuple[str, str]:
    """Run until a state recurs; or return the first pair on which a decision is missing."""
    pairs = conflicts()
    state = protocol.initial()[0]
    seen: dict[State, tuple[int, int]] = {}
    units = batches = 0
    while state not in seen:
        seen[state] = units, batches
        able = set(protocol.able(state))
        ties = [(a, b) for a, b in pairs if a in able and b in able]
        missing = next((pair for pair in ties if pair not in decisions), None)
        if missing is not None:
            return missing
        used.update((pair, decisions[pair]) for pair in ties)
        chosen = _by_priority(able, ties, decisions)
        move = next((m for m in protocol.moves(state) if set(m.starts) == chosen), None)
        if move is None:
            return Outcome(used, None)
        state, units, batches = move.after, units + move.units, batches + move.batches
    since, made = seen[state]
    made = batches - made
    return Outcome(used, Fraction(units - since, made) if made else None)


def _by_priority(able: set[str], ties: list[tuple[str, str]], decisions: Decisions) -> set[str]:
    """The processes that start: each unless one that goes before it starts."""
    before: dict[str, set[str]] = {name: set() for name in able}
    for pair in ties:
        first = decisions[pair]
        before[pair[0] if first == pair[1] else pair[1]].add(first)
    chosen: set[str] = set()
    open_ = set(able)
    while open_:
        ready = {name for name in open_ if not before[name] & open_}
        chosen |= {name for name in ready if not before[name] & chosen}
        open_ -= ready
    return chosen


def is_acyclic(decisions: Decisions) -> bool:
    """Whether no process comes, over others, before itself."""
    before: dict[str, set[str]] = {}
    for pair, first in decisions.items():
        before.setdefault(pair[0] if first == pair[1] else pair[1], set()).add(first)
    open_ = set(before)
    while open_:
        ready = {name for name in open_ if not before[name] & open_}
        if not ready:
            return False
        open_ -= ready
    return True
