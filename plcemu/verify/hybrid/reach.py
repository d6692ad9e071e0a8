"""What a linear hybrid automaton can reach, exactly, alone or under a cyclic controller.

A symbolic state is a location, the controller's state, and a region: all values that the variables
may have there at any time. Regions are computed with whole numbers, so that no answer is spoiled by
rounding or overflow. The controller is a real program, scanned at the boundaries of its cycles.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import islice
from typing import NamedTuple, Protocol

from plant_sim.linear import Constraint, Constraints, Term
from plant_sim.linear_automaton import Automaton, AutomatonError, Interval, Location, Transition
from plcemu.base.errors import LimitError
from plcemu.verify.hybrid.polyhedra import Bounds
from plcemu.verify.hybrid.regions import Region, region_maker

STATE_LIMIT = 200_000
"""Symbolic states that one exploration may keep unless it is told otherwise."""

_CYCLE = "__cycle"
_NEW_CYCLE = {_CYCLE: (Fraction(0), Fraction(0))}
_CHAIN_LIMIT = 100

Values = tuple[tuple[str, bool], ...]
"""Named Boolean values, in a fixed order."""


class Controller(Protocol):
    """A program that is scanned in cycles."""

    def start(self) -> Hashable:
        """Return its state before the first scan."""

    def scan(self, state: Hashable, inputs: Mapping[str, bool]) -> tuple[Hashable, Values]:
        """Return the state after a scan with these sensor readings, and the actuator values."""


@dataclass(frozen=True, slots=True)
class Cyclic:
    """How a controller is coupled to an automaton.

    At each boundary of a cycle, first the outputs of the cycle that ends take effect, then the
    sensors are read and the program is scanned; its outputs take effect at the next boundary.

    Attributes:
        controller: the program.
        period: shortest and longest duration of a cycle, in the automaton's unit of time.
    """

    controller: Controller
    period: Interval


@dataclass(slots=True)
class Reached:
    """What an exploration found.

    Attributes:
        objectives: for each objective the bounds of every region in which its location was entered.
        locations: names of the locations reached.
        states: symbolic states kept.
        conclusive: whether everything reachable was seen.
        kind: of the regions.
        reason: why it is not conclusive.
    """

    objectives: dict[str, list[Bounds]]
    locations: set[str] = field(default_factory=set)
    states: int = 0
    conclusive: bool = True
    kind: str = ""
    reason: str = ""

    def bounds(self, objective: str) -> Bounds | None:
        """Return what all regions of an objective lie between, or None if it is never met."""
        return hull(self.objectives[objective])

    def pieces(self, objective: str) -> list[Bounds]:
        """Return the intervals that the regions of an objective make, those that touch joined."""
        return union(self.objectives[objective])


class _State(NamedTuple):
    """The part of a symbolic state that is not a region."""

    location: str
    program: Hashable = None
    effective: Values = ()
    pending: Values = ()


def reach(automaton: Automaton, cyclic: Cyclic | None = None, *, kind: str = "auto",
          limit: int = STATE_LIMIT, on_progress: Callable[[int], None] | None = None) -> Reached:
    """Explore everything that an automaton can reach.

    Args:
        automaton: the plant, or any automaton.
        cyclic: the controller that commands it, or None.
        kind: of regions, see `regions.KINDS`.
        limit: symbolic states to keep at most; then the result is not conclusive.
        on_progress: told the number of states now and then.

    Raises:
        AutomatonError: the automaton cannot be coupled or treated; says why.
    """
    return _Exploration(automaton, cyclic, kind, limit, on_progress).run()


class _Exploration:
    def __init__(self, automaton: Automaton, cyclic: Cyclic | None, kind: str, limit: int,
                 on_progress: Callable[[int], None] | None) -> None:
        self._cyclic = cyclic
        self._limit = limit
        self._on_progress = on_progress
        self._automaton = automaton if cyclic is None else _with_cycle(automaton, cyclic.period)
        self._places = {place.name: place for place in self._automaton.locations}
        self._free: dict[str, list[Transition]] = {name: [] for name in self._places}
        self._commanded: dict[str, list[Transition]] = {name: [] for name in self._places}
        for t in self._automaton.transitions:
            (self._commanded if t.command else self._free)[t.source].append(t)
            if t.command and (t.guard or cyclic is None):
                raise AutomatonError(f"transition {t.source} -> {t.target}: a commanded transition "
                                     "has no guard, and needs a controller")
        self._sensors = {name: _Sensors(place) for name, place in self._places.items()}
        self._ended = _at_least(cyclic.period[0]) if cyclic is not None else ()
        every = set(self._automaton.variables)
        self._unused = {name: sorted(every - set(place.rates))
                        for name, place in self._places.items()}
        try:
            self._kind, self._make = region_maker(self._automaton, kind)
        except ValueError as problem:
            raise AutomatonError(str(problem)) from None
        self._seen: dict[_State, tuple[list[tuple[int, int]], list[Region]]] = {}
        """The regions kept for each state, by their weight: only heavier ones can cover one."""
        self._ordered: dict[tuple[str, Values], Transition | None] = {}
        self._waiting: deque[tuple[_State, Region]] = deque()
        self._found = Reached({o.name: [] for o in automaton.objectives}, kind=self._kind)

    def run(self) -> Reached:
        found = self._found
        try:
            self._begin()
            while self._waiting:
                state, region = self._waiting.popleft()
                self._leave(state, region)
                if self._on_progress is not None and not found.states % 256:
                    self._on_progress(found.states)
        except LimitError as reached:
            found.conclusive, found.reason = False, str(reached)
        return found

    def _begin(self) -> None:
        region = self._make(self._automaton.start)
        name = self._automaton.initial
        if self._cyclic is None:
            self._enter(_State(name), self._confined(name, region))
            return
        first = _State(name, self._cyclic.controller.start())
        self._boundary(first, region)

    def _confined(self, name: str, region: Region) -> Region:
        """Return what of a region may be in a location; variables not in use there are free."""
        unused = self._unused[name]
        return (region.forget(unused) if unused else region).meet(self._places[name].invariant)

    def _enter(self, state: _State, region: Region) -> None:
        """Let time pass in a location, and keep what is new."""
        place = self._places[state.location]
        region = region.elapse(place.rates).meet(place.invariant)
        if region.is_empty():
            return
        weights, known = self._seen.setdefault(state, ([], []))
        weight = region.weight()
        at = bisect_left(weights, weight)
        if any(other.covers(region) for other in islice(known, at, None)):
            return
        if self._found.states >= self._limit:
            raise LimitError(f"{self._limit} symbolic states were kept, and there are more")
        weights.insert(at, weight)
        known.insert(at, region)
        self._found.states += 1
        self._found.locations.add(state.location)
        self._waiting.append((state, region))

    def _leave(self, state: _State, region: Region) -> None:
        for t in self._free[state.location]:
            moved = region.meet(t.guard)
            if not moved.is_empty():
                self._enter_obeying(state, *self._move(t, moved))
        if self._cyclic is not None:
            ended = region.meet(self._ended)
            if not ended.is_empty():
                self._boundary(state._replace(effective=state.pending), ended)

    def _move(self, t: Transition, region: Region) -> tuple[str, Region]:
        """Take a transition; note what an objective is on entering its location."""
        region = region.assign(t.sets)
        for goal in self._automaton.objectives:
            if goal.location == t.target and not region.is_empty():
                try:
                    bounds = region.ratio(goal.above, goal.below)
                except ValueError as problem:
                    raise AutomatonError(f"objective {goal.name}: {problem}") from None
                if bounds not in self._found.objectives[goal.name]:
                    self._found.objectives[goal.name].append(bounds)
        return t.target, self._confined(t.target, region)

    def _enter_obeying(self, state: _State, name: str, region: Region) -> None:
        name, region = self._obey(name, region, state.effective)
        self._enter(state._replace(location=name), region)

    def _obey(self, name: str, region: Region, outputs: Values) -> tuple[str, Region]:
        """Take the transitions that actuator values command, one after another."""
        for _ in range(_CHAIN_LIMIT):
            if (name, outputs) not in self._ordered:
                self._ordered[name, outputs] = self._order(name, outputs)
            t = self._ordered[name, outputs]
            if t is None:
                return name, region
            name, region = self._move(t, region)
        raise AutomatonError(f"location {name}: commanded transitions go round in a circle")

    def _order(self, name: str, outputs: Values) -> Transition | None:
        """Return the transition that actuator values command in a location."""
        ordered = [t for t in self._commanded[name] if t.command.items() <= set(outputs)]
        if len(ordered) > 1:
            raise AutomatonError(f"location {name}: two transitions are commanded at once")
        return ordered[0] if ordered else None

    def _boundary(self, state: _State, region: Region) -> None:
        """End a cycle: outputs take effect, sensors are read, the program is scanned."""
        assert self._cyclic is not None
        region = region.assign(_NEW_CYCLE)
        name, region = self._obey(state.location, region, state.effective)
        for inputs, part in self._sensors[name].divide(region):
            program, outputs = self._cyclic.controller.scan(state.program, inputs)
            self._enter(_State(name, program, state.effective, outputs), part)


def _with_cycle(automaton: Automaton, period: Interval) -> Automaton:
    """Return an automaton with a clock for the controller's cycle in every location."""
    if not 0 < period[0] <= period[1]:
        raise AutomatonError(f"a cycle of {period[0]} to {period[1]}: expected positive durations, "
                             "the shortest first")
    clock = Term(((_CYCLE, Fraction(1)),), -period[1])
    one = (Fraction(1), Fraction(1))
    places = tuple(replace(p, rates={**p.rates, _CYCLE: one},
                           invariant=(*p.invariant, Constraint(clock, "<=")))
                   for p in automaton.locations)
    return replace(automaton, locations=places)


def _at_least(shortest: Fraction) -> Constraints:
    return (Constraint(Term(((_CYCLE, Fraction(-1)),), shortest), "<="),)


class _Sensors:
    """Divides regions by what the sensors of a location read there.

    A sensor of which nothing is said reads FALSE.
    """

    def __init__(self, place: Location) -> None:
        self._steps = [(reading.values, reading.where,
                        [([(n,) for n in constraint.negations], (constraint,))
                         for constraint in reading.where])
                       for reading in place.readings]

    def divide(self, region: Region) -> list[tuple[dict[str, bool], Region]]:
        """Return the readings that are possible, each with the part of the region it comes from."""
        parts: list[tuple[dict[str, bool], Region]] = [({}, region)]
        for values, where, outsides in self._steps:
            divided = []
            for known, part in parts:
                inside = part.meet(where)
                if not inside.is_empty():
                    divided.append(({**values, **known}, inside))
                for negations, constraint in outsides:
                    outside = [p for n in negations if not (p := part.meet(n)).is_empty()]
                    if outside:
                        divided += [(known, p) for p in outside]
                        part = part.meet(constraint)
            parts = divided
        return parts


# ------------------------------------------------------------ intervals


def hull(pieces: list[Bounds]) -> Bounds | None:
    """Return the smallest interval around intervals, or None if there are none."""
    if not pieces:
        return None
    lowest = min(pieces, key=_low_key)
    highest = max(pieces, key=_high_key)
    return Bounds(lowest.low, highest.high, lowest.low_reached, highest.high_reached)


def union(pieces: list[Bounds]) -> list[Bounds]:
    """Return disjoint intervals that hold the same points, in order."""
    found: list[Bounds] = []
    for piece in sorted(pieces, key=_low_key):
        if found and _touches(found[-1], piece):
            joined = hull([found[-1], piece])
            assert joined is not None
            found[-1] = joined
        else:
            found.append(piece)
    return found


def _touches(first: Bounds, second: Bounds) -> bool:
    if first.high is None or second.low is None or second.low < first.high:
        return True
    return second.low == first.high and (first.high_reached or second.low_reached)


def _low_key(piece: Bounds) -> tuple[bool, Fraction, bool]:
    return piece.low is not None, piece.low or Fraction(0), not piece.low_reached


def _high_key(piece: Bounds) -> tuple[bool, Fraction, bool]:
    return piece.high is None, piece.high or Fraction(0), piece.high_reached
