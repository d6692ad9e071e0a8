"""Best schedules of a timed system: the least long-run time per batch, and the earliest Nth batch.

The long-run time per batch of a schedule that repeats itself is a ratio: the units of time of a
cycle by the batches that start on it. The least ratio over all cycles is found exactly, in whole
numbers: for a ratio p/q, a cycle of the weights q·units - p·batches below 0 is a better one; if
there is none, shortest distances under these weights are *potentials* that prove it (Lawler, 1967).
`plcemu.verify.schedules.certificate` checks such a proof knowing nothing of how it was found.
"""

from __future__ import annotations

import heapq
from array import array
from collections import deque
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Generic, NamedTuple, TypeVar

from plcemu.base.errors import LimitError
from plcemu.verify.system import Move, Timed

S = TypeVar("S", bound=Hashable)

STATES_LIMIT = 5_000_000
"""States of a timed system that are explored at most."""


class Taken(NamedTuple, Generic[S]):
    """A move taken: where, at which instant in units, and which."""

    state: S
    t: int
    move: Move[S]


@dataclass(frozen=True, slots=True)
class Certificate(Generic[S]):
    """A proof that no schedule takes less per batch in the long run.

    Attributes:
        period: units of time per batch, exactly; p/q.
        cycle: moves that begin and end in one state and have this ratio.
        potentials: for every state h, so that q·units - p·batches + h(before) >= h(after) for
            every move. Added up along any run, that bounds its time from below.
    """

    period: Fraction
    cycle: list[Taken[S]]
    potentials: dict[S, int]


class TimedGraph(Generic[S]):
    """All states and moves of a timed system.

    Raises:
        LimitError: there are more than `STATES_LIMIT` states.
    """

    def __init__(self, system: Timed[S]) -> None:
        self.system = system
        self.number: dict[S, int] = {}
        self.states: list[S] = []
        self.first = array("q", [0])
        self.target, self.units, self.batches = array("q"), array("q"), array("q")
        for state in system.initial():
            self._numbered(state)
        self.initial = list(range(len(self.states)))
        done = 0
        while done < len(self.states):
            for move in system.moves(self.states[done]):
                self.target.append(self._numbered(move.after))
                self.units.append(move.units)
                self.batches.append(move.batches)
            self.first.append(len(self.target))
            done += 1
            if done > STATES_LIMIT:
                raise LimitError(f"the timed system has more than {STATES_LIMIT:,} states")

    def _numbered(self, state: S) -> int:
        number = self.number.setdefault(state, len(self.states))
        if number == len(self.states):
            self.states.append(state)
        return number

    def move(self, source: int, edge: int) -> Move[S]:
        """Return the move of an edge of a state."""
        return self.system.moves(self.states[source])[edge - self.first[source]]

    def taken(self, edges: Sequence[tuple[int, int]], t: int = 0) -> list[Taken[S]]:
        """Return edges, as (source, edge), as moves that follow each other from an instant on."""
        found = []
        for source, edge in edges:
            found.append(Taken(self.states[source], t, self.move(source, edge)))
            t += self.units[edge]
        return found


def least_period(graph: TimedGraph[S]) -> Certificate[S] | None:
    """Return the least long-run time per batch with its proof; None if no cycle produces."""
    longest = max(graph.units, default=1)
    period = Fraction(len(graph.states) * longest + 1)
    best: list[tuple[int, int]] = []
    while True:
        distances, cycle = _shortest(graph, period)
        if cycle is None:
            break
        best = cycle
        units = sum(graph.units[edge] for _, edge in cycle)
        period = Fraction(units, sum(graph.batches[edge] for _, edge in cycle))
    if not best:
        return None
    return Certificate(period, graph.taken(best), dict(zip(graph.states, distances, strict=True)))


def _shortest(graph: TimedGraph[S], period: Fraction
              ) -> tuple[list[int], list[tuple[int, int]] | None]:
    """Return shortest distances under q·units - p·batches, begun anywhere at 0, or a cycle below 0.

    Bellman and Ford with a queue. The tree of last improvements is looked through for a cycle now
    and then; a cycle in it is below 0.
    """
    p, q = period.numerator, period.denominator
    weights = [q * units - p * made for units, made in
               zip(graph.units, graph.batches, strict=True)]
    first, target = graph.first, graph.target
    size = len(graph.states)
    distance = [0] * size
    came: list[tuple[int, int]] = [(-1, -1)] * size
    queue, waiting = deque(range(size)), bytearray(b"\1") * size
    improved = 0
    while queue:
        source = queue.popleft()
        waiting[source] = 0
        here = distance[source]
        for edge in range(first[source], first[source + 1]):
            there, reached = here + weights[edge], target[edge]
            if there < distance[reached]:
                distance[reached], came[reached] = there, (source, edge)
                improved += 1
                if not waiting[reached]:
                    waiting[reached] = 1
                    queue.append(reached)
        if improved > size:
            improved = 0
            cycle = _cycle_in(came)
            if cycle is not None:
                return distance, cycle
    return distance, None


def _cycle_in(came: Sequence[tuple[int, int]]) -> list[tuple[int, int]] | None:
    """Return a cycle of a graph in which every node has one predecessor at most."""
    visited = bytearray(len(came))
    for root in range(len(came)):
        way, node = [], root
        while node >= 0 and not visited[node]:
            visited[node] = 1
            way.append(node)
            node = came[node][0]
        if node >= 0 and node in way:
            cycle, start = [], node
            while True:
                cycle.append(came[node])
                node = came[node][0]
                if node == start:
                    return cycle[::-1]
    return None


def earliest(graph: TimedGraph[S], batches: int,
             certificate: Certificate[S] | None) -> list[Taken[S]] | None:
    """Return the moves with which batch number `batches` starts as early as possible.

    The last one is the move that starts it. None if so many can never start. The search is A*;
    the certificate's potentials bound the time that is still needed.
    """
    if certificate is None:
        p, q, potentials, floor = 0, 1, [0] * len(graph.states), 0
    else:
        p, q = certificate.period.numerator, certificate.period.denominator
        potentials = [certificate.potentials[state] for state in graph.states]
        floor = min(potentials)

    most = max(graph.batches, default=0)

    def bound(state: int, made: int) -> int:
        """The least units, times q, until the last batch starts, at the beginning of a move."""
        return max(0, p * (batches - most - made) + floor - potentials[state])

    best: dict[tuple[int, int], int] = {}
    came: dict[tuple[int, int], tuple[tuple[int, int], int]] = {}
    heap = []
    for state in graph.initial:
        best[state, 0] = 0
        heap.append((bound(state, 0), 0, state, 0))
    while heap:
        _, t, state, made = heapq.heappop(heap)
        if t > best[state, made]:
            continue
        for edge in range(graph.first[state], graph.first[state + 1]):
            total = made + graph.batches[edge]
            if total >= batches:
                return graph.taken([*_edges_to(came, (state, made)), (state, edge)])
            key, then = (graph.target[edge], total), t + graph.units[edge]
            if then < best.get(key, then + 1):
                best[key], came[key] = then, ((state, made), edge)
                heapq.heappush(heap, (q * then + bound(*key), then, *key))
    return None


def _edges_to(came: dict[tuple[int, int], tuple[tuple[int, int], int]],
              key: tuple[int, int]) -> list[tuple[int, int]]:
    edges = []
    while key in came:
        key, edge = came[key]
        edges.append((key[0], edge))
    return edges[::-1]


def way_into(graph: TimedGraph[S], certificate: Certificate[S]) -> list[Taken[S]]:
    """Return moves from an initial state into the best cycle that lose least against it.

    They end in the state in which the cycle begins; the cycle may be begun at another of its
    states by turning it.
    """
    p, q = certificate.period.numerator, certificate.period.denominator
    on_cycle = {graph.number[taken.state] for taken in certificate.cycle}
    distance: dict[int, int] = dict.fromkeys(graph.initial, 0)
    came: dict[int, tuple[int, int]] = {}
    queue = deque(graph.initial)
    while queue:
        source = queue.popleft()
        for edge in range(graph.first[source], graph.first[source + 1]):
            there = distance[source] + q * graph.units[edge] - p * graph.batches[edge]
            reached = graph.target[edge]
            if there < distance.get(reached, there + 1):
                distance[reached], came[reached] = there, (source, edge)
                queue.append(reached)
    lost = _along(certificate)
    goal = min(on_cycle & distance.keys(), key=lambda n: (distance[n] - lost[graph.states[n]], n))
    edges: list[tuple[int, int]] = []
    while goal in came:
        edges.append(came[goal])
        goal = edges[-1][0]
    return graph.taken(edges[::-1])


def _along(certificate: Certificate[S]) -> dict[S, int]:
    """Return for each state of the cycle the weight from its beginning to there."""
    p, q = certificate.period.numerator, certificate.period.denominator
    weight, found = 0, {}
    for taken in certificate.cycle:
        found[taken.state] = weight
        weight += q * taken.move.units - p * taken.move.batches
    return found


def turned(cycle: Sequence[Taken[S]], state: S) -> list[Taken[S]]:
    """Return a cycle as it looks from one of its states."""
    n = next(n for n, taken in enumerate(cycle) if taken.state == state)
    return [*cycle[n:], *cycle[:n]]
