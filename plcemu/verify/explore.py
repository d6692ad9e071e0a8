"""Explicit-state exploration: all states that can be reached, or an honest statement of a limit."""

from __future__ import annotations

import resource
import sys
import time
from array import array
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Generic, Literal

from plcemu.base.collector import paused_collector
from plcemu.verify.system import A, Expanding, OneByOne, S, TransitionSystem

Order = Literal["bfs", "dfs"]

_LOOK_EVERY = 256
"""States between two looks at clock and memory, which cost more than a state."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Where an exploration gives up.

    Attributes:
        states: how many may be found.
        seconds: how long it may take; None is without end.
        memory_mb: how large the process may become, in MB; None is without end.
    """

    states: int = 5_000_000
    seconds: float | None = None
    memory_mb: int | None = 4096


@dataclass(frozen=True, slots=True)
class Progress:
    """How far an exploration has come."""

    states: int
    edges: int
    frontier: int
    seconds: float
    memory_mb: int

    @property
    def rate(self) -> float:
        """States found in each second."""
        return self.states / self.seconds if self.seconds else 0.0

    def __str__(self) -> str:
        return (f"{self.states:,} states, {self.edges:,} transitions, {self.rate:,.0f} states/s, "
                f"frontier {self.frontier:,}, {self.memory_mb} MB")


@dataclass(slots=True)
class Graph(Generic[S, A]):
    """What has been explored; states are numbered in the order of their discovery.

    Attributes:
        states: by number.
        number: of each state.
        initial: the numbers of the initial states.
        complete: whether every state that can be reached is there, with all its transitions.
        reason: which limit was reached; empty if none.
        parent: for each state the one it was found from; -1 for initial ones. In a breadth-first
            exploration the way back over parents is a shortest one.
    """

    states: list[S] = field(default_factory=list)
    number: dict[S, int] = field(default_factory=dict)
    initial: list[int] = field(default_factory=list)
    complete: bool = False
    reason: str = ""
    parent: array[int] = field(default_factory=lambda: array("q"))
    seconds: float = 0.0
    _first: array[int] = field(default_factory=lambda: array("q"))
    _count: array[int] = field(default_factory=lambda: array("q"))
    _targets: array[int] = field(default_factory=lambda: array("q"))
    _labels: array[int] = field(default_factory=lambda: array("q"))
    _actions: list[A] = field(default_factory=list)
    _label_of: dict[A, int] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.states)

    @property
    def edges(self) -> int:
        """How many transitions there are."""
        return len(self._targets)

    def targets(self, source: int) -> Sequence[int]:
        """Return the numbers of a state's successors, one for each action."""
        first = self._first[source]
        return self._targets[first:first + self._count[source]] if first >= 0 else ()

    def actions(self, source: int) -> list[A]:
        """Return a state's actions, in the order of `targets`."""
        first = self._first[source]
        if first < 0:
            return []
        return [self._actions[n] for n in self._labels[first:first + self._count[source]]]

    def expanded(self, source: int) -> bool:
        """Whether a state's transitions are known."""
        return self._first[source] >= 0

    def path_to(self, target: int) -> list[int]:
        """Return the states from an initial one to `target`, as they were found."""
        path = [target]
        while self.parent[path[-1]] >= 0:
            path.append(self.parent[path[-1]])
        return path[::-1]

    def action_between(self, source: int, target: int) -> A:
        """Return the first action that leads from one state to the other.

        Raises:
            KeyError: none does.
        """
        for action, reached in zip(self.actions(source), self.targets(source), strict=True):
            if reached == target:
                return action
        raise KeyError((source, target))

    def _add(self, state: S, parent: int) -> int:
        number = self.number[state] = len(self.states)
        self.states.append(state)
        self.parent.append(parent)
        self._first.append(-1)
        self._count.append(0)
        return number

    def _expand(self, source: int, edges: Sequence[tuple[A, S]],
                discover: Callable[[S, int], int]) -> None:
        """Note a state's transitions; the states that are new are to be discovered."""
        self._first[source], self._count[source] = len(self._targets), len(edges)
        label_of, numbers = self._label_of, self.number
        for action, following in edges:
            label = label_of.get(action)
            self._labels.append(self._label(action) if label is None else label)
            target = numbers.get(following)
            self._targets.append(discover(following, source) if target is None else target)

    def _expand_like(self, source: int, twin: int) -> None:
        """Note that a state has the same transitions as another one."""
        first, count = self._first[twin], self._count[twin]
        self._first[source], self._count[source] = len(self._targets), count
        self._targets.extend(self._targets[first:first + count])
        self._labels.extend(self._labels[first:first + count])

    def _label(self, action: A) -> int:
        label = self._label_of[action] = len(self._actions)
        self._actions.append(action)
        return label


@paused_collector()
def explore(system: TransitionSystem[S, A], limits: Limits = Limits(), *,
            order: Order = "bfs",
            found: Callable[[int, S], bool] | None = None,
            on_progress: Callable[[Progress], None] | None = None) -> Graph[S, A]:
    """Explore a transition system.

    Args:
        system: what to explore.
        limits: where to give up; the graph then says so and is not complete.
        order: breadth first (shortest ways) or depth first (small frontier).
        found: asked about every new state; exploration ends when it returns True.
        on_progress: told now and then how far it is.
    """
    graph: Graph[S, A] = Graph()
    frontier: deque[int] = deque()
    begin = time.monotonic()
    many = system if isinstance(system, Expanding) else OneByOne(system)
    twins: dict[Hashable, int] = {}

    def discover(state: S, parent: int) -> int:
        number = graph._add(state, parent)
        frontier.append(number)
        if found is not None and found(number, state):
            graph.reason = "the search ended at what it looked for"
        return number

    def first_alike(number: int) -> int:
        """Return the first state that was taken up and has the same future."""
        return twins.setdefault(many.future(graph.states[number]), number)

    for state in system.initial():
        number = graph.number.get(state)
        graph.initial.append(discover(state, -1) if number is None else number)
    looked = 0
    while frontier and not graph.reason:
        taken = [frontier.popleft() for _ in range(min(len(frontier), _LOOK_EVERY))] \
            if order == "bfs" else [frontier.pop()]
        pairs = [(source, first_alike(source)) for source in taken]
        rows = many.expand([graph.states[source] for source, twin in pairs if source == twin])
        for at, (source, twin) in enumerate(pairs, 1):
            if source == twin:
                graph._expand(source, next(rows), discover)
            else:
                graph._expand_like(source, twin)
            looked += 1
            if looked % _LOOK_EVERY == 0 or len(graph) > limits.states:
                progress = Progress(len(graph), graph.edges, len(frontier) + len(pairs) - at,
                                    time.monotonic() - begin, used_mb())
                if on_progress is not None:
                    on_progress(progress)
                graph.reason = graph.reason or _reached(limits, progress)
            if graph.reason:
                break
    graph.seconds = time.monotonic() - begin
    graph.complete = not frontier and not graph.reason
    return graph


def _reached(limits: Limits, now: Progress) -> str:
    """Return which limit has been reached, in words; empty if none."""
    if now.states > limits.states:
        return f"the limit of {limits.states:,} states was reached"
    if limits.seconds is not None and now.seconds > limits.seconds:
        return f"the limit of {limits.seconds:g} s was reached"
    if limits.memory_mb is not None and now.memory_mb > limits.memory_mb:
        return f"the limit of {limits.memory_mb} MB was reached"
    return ""


def used_mb() -> int:
    """Return the largest size that this process has had, in MB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak // (1024 if sys.platform != "darwin" else 1024 * 1024)


def backwards(graph: Graph[S, A], goal: Iterable[int]) -> set[int]:
    """Return the states from which one of the goal's can be reached."""
    sources: dict[int, list[int]] = {}
    for number in range(len(graph)):
        for target in graph.targets(number):
            sources.setdefault(target, []).append(number)
    reached, todo = set(goal), list(goal)
    while todo:
        for source in sources.get(todo.pop(), ()):
            if source not in reached:
                reached.add(source)
                todo.append(source)
    return reached


def terminal(graph: Graph[S, A]) -> Iterator[int]:
    """Yield the states in which nothing can happen any more."""
    return (n for n in range(len(graph)) if graph.expanded(n) and not graph.targets(n))
