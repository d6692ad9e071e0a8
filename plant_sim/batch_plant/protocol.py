"""The batch plant's processes with their durations, for a scheduler: who starts when is free.

The variable time advance of the paper: time jumps from one end of a process to the next; at each
end - and at the beginning - any set of processes may start whose tanks are idle and hold what is
needed, or none, to wait for the next end. Starting only when something ends loses nothing: a start
moved forward to the last end before it stays possible, and makes nothing later (paper, 3.2, Claim).

The same argument gives more. Whether a process can start depends on its own tanks alone, so its
start can be moved forward to the last end of a process *with which it shares a tank*. A process
that is passed over while its tanks are just free need not be thought of again until one of them is
touched. This `eager` protocol has the same best schedules as the paper's and some 20 times fewer
states; the other one stays to compare with.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from math import gcd, lcm
from typing import NamedTuple

from plant_sim.batch_plant.abstraction import NAMES
from plant_sim.batch_plant.loads import CONTENTS
from plant_sim.batch_plant.parameters import BatchParameters
from plant_sim.batch_plant.processes import PROCESSES

COUNTED = "P5"
"""A batch counts when its transfer from the mixer B3 to B4 starts."""

Running = tuple[tuple[int, int], ...]
"""Processes under way by their number in the table, each with the units of time it still takes."""


class State(NamedTuple):
    """An instant right after processes have ended.

    Attributes:
        contents: number of the contents of all tanks (in transition: those before); digits of the
            places of the words in `CONTENTS`, B7 first.
        running: what is under way.
        startable: the processes, by number, that may start now.
    """

    contents: int
    running: Running
    startable: tuple[int, ...]


class Move(NamedTuple):
    """Some processes start, then time goes on to the next end.

    Attributes:
        starts: the processes by name; perhaps none.
        units: how long it is to the next end.
        batches: how many batches start.
        after: the state at that end.
    """

    starts: tuple[str, ...]
    units: int
    batches: int
    after: State


class Protocol:
    """The processes of a plant with given contents.

    Args:
        parameters: the durations.
        tanks: the initial contents; tanks left out are empty.
        eager: whether a process may start only when one of its own tanks has just become free.

    Attributes:
        unit_s: the unit of time in s: the largest of which every duration is a whole multiple.
    """

    def __init__(self, parameters: BatchParameters, tanks: Mapping[str, str],
                 eager: bool = True) -> None:
        self.eager = eager
        self._rows = list(PROCESSES.values())
        durations = [row.duration_s(parameters) for row in self._rows]
        self.unit_s = _common(durations)
        self.units = [int(d / self.unit_s) for d in durations]
        self._start = _number_of({tank: tanks.get(tank, "empty") for tank in NAMES})
        self._sets: dict[tuple[int, ...], list[tuple[Running, tuple[str, ...], int]]] = {}
        self._ends: dict[tuple[int, tuple[int, ...], tuple[int, ...]],
                         tuple[int, tuple[int, ...]]] = {}

    def initial(self) -> list[State]:
        """The one initial state: nothing runs."""
        return [State(self._start, (), self._startable(self._start, (), NAMES))]

    def moves(self, state: State) -> list[Move]:
        """All moves; none in a state where nothing runs and nothing can start."""
        contents, running, startable = state
        found = []
        for starts, names, batches in self._choices(startable):
            under_way = sorted(running + starts)
            if not under_way:
                continue
            units = min([left for _, left in under_way])
            ended = tuple([n for n, left in under_way if left == units])
            rest = tuple([(n, left - units) for n, left in under_way if left > units])
            following, may = self._after(contents, ended, tuple([n for n, _ in rest]))
            found.append(Move(names, units, batches, State(following, rest, may)))
        return found

    def tanks(self, state: State) -> dict[str, str]:
        """The contents by tank; in transition those before."""
        return _contents(state.contents)

    def under_way(self, state: State) -> dict[str, int]:
        """The processes under way, each with the units of time it still takes."""
        return {self._rows[n].name: left for n, left in state.running}

    def able(self, state: State) -> list[str]:
        """The processes that may start, by name."""
        return [self._rows[n].name for n in state.startable]

    def _choices(self, startable: tuple[int, ...]) -> list[tuple[Running, tuple[str, ...], int]]:
        """The sets of processes that may start together, their names, the batches they count."""
        if startable not in self._sets:
            sets: list[tuple[Running, set[str]]] = [((), set())]
            for n in startable:
                sets += [((*chosen, (n, self.units[n])), used | self._rows[n].changes.keys())
                         for chosen, used in sets if used.isdisjoint(self._rows[n].changes)]
            named = [(chosen, tuple([self._rows[n].name for n, _ in chosen]))
                     for chosen, _ in sets]
            self._sets[startable] = [(chosen, names, names.count(COUNTED))
                                     for chosen, names in named]
        return self._sets[startable]

    def _startable(self, contents: int, running: Iterable[int],
                   free: Iterable[str]) -> tuple[int, ...]:
        """The processes that may start if these tanks have just become free."""
        busy = {tank for n in running for tank in self._rows[n].changes}
        tanks = _contents(contents)
        fresh = set(free) if self.eager else set(NAMES)
        return tuple(n for n, row in enumerate(self._rows)
                     if busy.isdisjoint(row.changes) and not fresh.isdisjoint(row.changes)
                     and all(tanks[tank] in change for tank, change in row.changes.items()))

    def _after(self, contents: int, ended: tuple[int, ...],
               left: tuple[int, ...]) -> tuple[int, tuple[int, ...]]:
        """Contents after processes have ended while others are left, and what may start then."""
        key = (contents, ended, left)
        if key not in self._ends:
            tanks = _contents(contents)
            changes = [item for n in ended for item in self._rows[n].changes.items()]
            for tank, change in changes:
                tanks[tank] = change[tanks[tank]]
            number = _number_of(tanks)
            self._ends[key] = number, self._startable(number, left, [tank for tank, _ in changes])
        return self._ends[key]


def _number_of(tanks: Mapping[str, str]) -> int:
    number = 0
    for tank in reversed(NAMES):
        number = number * len(CONTENTS[tank]) + CONTENTS[tank].index(tanks[tank])
    return number


def _contents(number: int) -> dict[str, str]:
    tanks = {}
    for tank in NAMES:
        number, place = divmod(number, len(CONTENTS[tank]))
        tanks[tank] = CONTENTS[tank][place]
    return tanks


def _common(durations: Sequence[Fraction]) -> Fraction:
    """The largest duration of which all are whole multiples."""
    below = lcm(*(d.denominator for d in durations))
    return Fraction(gcd(*(int(d * below) for d in durations)), below)
