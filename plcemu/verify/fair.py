"""Fair cycles: what a run may do for ever, if nothing stays pending for ever without being done.

A run violates `G F p` if from some state on it stays where p is false. Under weak fairness such a
run exists exactly if there is, among the states without p, a state where nothing can happen, or a
strongly connected component in which every pending thing is somewhere not pending or somewhere
done (Emerson and Lei, 1987; for weak fairness one pass over the components suffices).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from plcemu.verify.explore import Graph
from plcemu.verify.system import A, Fair, S


class Step(NamedTuple):
    """A transition of a run: the action, and the number of the state it leads to."""

    action: Any
    target: int


class Lasso(NamedTuple):
    """A run without end.

    Attributes:
        start: the number of the initial state.
        stem: the steps to the cycle's first state.
        cycle: the steps that are repeated for ever; none if the run stays where the stem ends.
    """

    start: int
    stem: list[Step]
    cycle: list[Step]


def components(graph: Graph[S, A], inside: Callable[[int], bool]) -> Iterator[list[int]]:
    """Yield the strongly connected components of the states inside (Tarjan, 1972), iteratively."""
    index: dict[int, int] = {}
    low: dict[int, int] = {}
    stack: list[int] = []
    on_stack: set[int] = set()
    for root in range(len(graph)):
        if root in index or not inside(root):
            continue
        index[root] = low[root] = len(index)
        stack.append(root)
        on_stack.add(root)
        work = [(root, iter(graph.targets(root)))]
        while work:
            node, successors = work[-1]
            for target in successors:
                if not inside(target):
                    continue
                if target not in index:
                    index[target] = low[target] = len(index)
                    stack.append(target)
                    on_stack.add(target)
                    work.append((target, iter(graph.targets(target))))
                    break
                if target in on_stack:
                    low[node] = min(low[node], index[target])
            else:
                work.pop()
                if work:
                    above = work[-1][0]
                    low[above] = min(low[above], low[node])
                if low[node] == index[node]:
                    component = []
                    while True:
                        member = stack.pop()
                        on_stack.discard(member)
                        component.append(member)
                        if member == node:
                            break
                    yield component


def fair_components(graph: Graph[S, A], fair: Fair[S, A] | None,
                    inside: Callable[[int], bool]) -> Iterator[list[int]]:
    """Yield the components of the states inside in which a fair run can move for ever.

    Without fairness, every component with a transition in it. States in which nothing can happen
    are not among them; `explore.terminal` yields those.
    """
    for component in components(graph, inside):
        members = set(component)
        alone = len(component) == 1
        if alone and component[0] not in graph.targets(component[0]):
            continue
        if fair is None or not _owed(graph, fair, members):
            yield component


def _owed(graph: Graph[S, A], fair: Fair[S, A], members: Collection[int]) -> set[str]:
    """Return what is pending in every state of a component and done on none of its transitions."""
    owed: set[str] | None = None
    for number in members:
        pending = set(fair.pending(graph.states[number]))
        owed = pending if owed is None else owed & pending
        if not owed:
            return set()
    for number in members:
        for action, target in zip(graph.actions(number), graph.targets(number), strict=True):
            if target in members:
                owed = (owed or set()) - set(fair.done(action))
    return owed or set()


def run_to(graph: Graph[S, A], target: int) -> tuple[int, list[Step]]:
    """Return an initial state and the steps from it to a state, the shortest ones if breadth
    came first in the exploration."""
    path = graph.path_to(target)
    steps = [Step(graph.action_between(a, b), b) for a, b in pairwise(path)]
    return path[0], steps


def lasso(graph: Graph[S, A], fair: Fair[S, A] | None, component: Sequence[int]) -> Lasso:
    """Return a run into a fair component and a fair cycle in it."""
    members = set(component)
    start = min(component)
    origin, stem = run_to(graph, start)
    cycle: list[Step] = []
    if graph.targets(start):
        for goal in _goals(graph, fair, members):
            cycle += _through(graph, members, cycle[-1].target if cycle else start, goal)
        here = cycle[-1].target if cycle else start
        if not cycle or here != start:
            cycle += way(graph, members, here, {start})
    return Lasso(origin, stem, cycle)


Goal = set[int] | tuple[int, Step]
"""States one of which is to be passed, or a step to be taken from a state."""


def _goals(graph: Graph[S, A], fair: Fair[S, A] | None, members: Collection[int]) -> list[Goal]:
    """Return, for each thing that is pending somewhere, where a fair cycle must go for it."""
    if fair is None:
        return []
    pending = {n: set(fair.pending(graph.states[n])) for n in members}
    goals: list[Goal] = []
    for name in sorted(set().union(*pending.values())):
        free = {n for n in members if name not in pending[n]}
        goals.append(free or next(
            (n, step) for n in sorted(members) for step in _steps(graph, n, members)
            if name in fair.done(step.action)))
    return goals


def _steps(graph: Graph[S, A], source: int, members: Collection[int]) -> Iterator[Step]:
    """Yield the steps from a state that stay inside the members."""
    for action, target in zip(graph.actions(source), graph.targets(source), strict=True):
        if target in members:
            yield Step(action, target)


def _through(graph: Graph[S, A], members: Collection[int], start: int, goal: Goal) -> list[Step]:
    if isinstance(goal, set):
        return [] if start in goal else way(graph, members, start, goal)
    source, step = goal
    return [*([] if start == source else way(graph, members, start, {source})), step]


def way(graph: Graph[S, A], members: Collection[int], start: int,
         goal: Collection[int]) -> list[Step]:
    """Return a shortest way, of one step at least, inside the members to a goal."""
    came: dict[int, tuple[int, Step]] = {}
    level = [start]
    while level:
        following = []
        for number in level:
            for step in _steps(graph, number, members):
                if step.target in came:
                    continue
                came[step.target] = number, step
                if step.target in goal:
                    way = [step]
                    while number != start:
                        number, step = came[number]
                        way.append(step)
                    return way[::-1]
                following.append(step.target)
        level = following
    raise AssertionError("a component is strongly connected")
