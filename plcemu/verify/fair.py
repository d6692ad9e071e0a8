"""Fair cycles: what a run may do for ever, if nothing stays pending for ever without being done.

A run violates `G F p` if from some state on it stays where p is false. Such a run exists exactly if
there is, among the states without p, a state where nothing can happen, or a strongly connected
component with a fair cycle through all of it.

Weak fairness: what is pending without a break is done. A component has a fair cycle if every name
is somewhere in it not pending or somewhere done (Emerson and Lei, 1987).
Strong fairness: what is pending again and again is done again and again, a Streett condition. A
name that is pending somewhere in a component and done nowhere in it must not be met for ever: the
states where it is pending are taken away, and what is left is decomposed anew (Lichtenstein and
Pnueli, 1985).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
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
        origin: the plant's initial state that it begins with; None if any that leads to `start`.
    """

    start: int
    stem: list[Step]
    cycle: list[Step]
    origin: Any = None


def components(graph: Graph[S, A], inside: Callable[[int], bool],
               among: Iterable[int] | None = None) -> Iterator[list[int]]:
    """Yield the strongly connected components of the states inside (Tarjan, 1972), iteratively.

    Those of the states that `among` yields, if it is given, which must be all inside.
    """
    index: dict[int, int] = {}
    low: dict[int, int] = {}
    stack: list[int] = []
    on_stack: set[int] = set()
    for root in range(len(graph)) if among is None else among:
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


def fair_components(graph: Graph[S, A], fair: Fair[S, A] | None, inside: Callable[[int], bool],
                    strong: bool = False, among: Iterable[int] | None = None,
                    ) -> Iterator[list[int]]:
    """Yield the components of the states inside in which a fair run can move for ever.

    Without fairness, every component with a transition in it. States in which nothing can happen
    are not among them; `explore.terminal` yields those.
    """
    for component in components(graph, inside, among):
        members = set(component)
        alone = len(component) == 1
        if alone and component[0] not in graph.targets(component[0]):
            continue
        owed = set() if fair is None else _owed(graph, fair, members, strong)
        if not owed:
            yield component
        elif strong and fair is not None:
            rest = {n for n in component if owed.isdisjoint(fair.pending(graph.states[n]))}
            yield from fair_components(graph, fair, rest.__contains__, strong, sorted(rest))


def _owed(graph: Graph[S, A], fair: Fair[S, A], members: Collection[int],
          strong: bool) -> set[str]:
    """Return what is pending in every state of a component, or under strong fairness in some, and
    done on none of its transitions."""
    owed: set[str] | None = None
    for number in members:
        pending = set(fair.pending(graph.states[number]))
        owed = pending if owed is None else owed | pending if strong else owed & pending
        if not owed and not strong:
            return set()
    for number in members:
        for step in _steps(graph, number, members):
            owed = (owed or set()) - set(fair.done(step.action))
    return owed or set()


def run_to(graph: Graph[S, A], target: int) -> tuple[int, list[Step]]:
    """Return an initial state and the steps from it to a state, the shortest ones if breadth
    came first in the exploration."""
    path = graph.path_to(target)
    steps = [Step(graph.action_between(a, b), b) for a, b in pairwise(path)]
    return path[0], steps


def lasso(graph: Graph[S, A], fair: Fair[S, A] | None, component: Sequence[int],
          strong: bool = False) -> Lasso:
    """Return a run into a fair component and a fair cycle in it, which takes the nearest thing
    that it still has to pass or to do, one after the other."""
    members = set(component)
    start = min(component)
    origin, stem = run_to(graph, start)
    cycle: list[Step] = []
    if graph.targets(start):
        pending = {n: set(fair.pending(graph.states[n])) if fair else set() for n in members}
        todo: set[str] = set().union(*pending.values())
        todo = todo if strong else todo & pending[start]

        def settles(step: Step) -> set[str]:
            """What a step does, or passes where it is not pending."""
            done = todo & set(fair.done(step.action)) if fair else set()
            return done if strong else done | (todo - pending[step.target])

        here = start
        while todo:
            for step in way(graph, members, here, lambda step: bool(settles(step))):
                cycle.append(step)
                todo -= settles(step)
                here = step.target
        if not cycle or here != start:
            cycle += way(graph, members, here, lambda step: step.target == start)
    return Lasso(origin, stem, cycle)


def _steps(graph: Graph[S, A], source: int, members: Collection[int]) -> Iterator[Step]:
    """Yield the steps from a state that stay inside the members."""
    for action, target in zip(graph.actions(source), graph.targets(source), strict=True):
        if target in members:
            yield Step(action, target)


def way(graph: Graph[S, A], members: Collection[int], start: int,
        goal: Callable[[Step], bool]) -> list[Step]:
    """Return a shortest way, of one step at least, inside the members, whose last step is one of
    the goal's."""
    came: dict[int, tuple[int, Step]] = {}
    level = [start]
    while level:
        following = []
        for number in level:
            for step in _steps(graph, number, members):
                if goal(step):
                    way = [step]
                    while number != start:
                        number, step = came[number]
                        way.append(step)
                    return way[::-1]
                if step.target not in came:
                    came[step.target] = number, step
                    following.append(step.target)
        level = following
    raise AssertionError("a component is strongly connected")
