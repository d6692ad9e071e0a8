"""The closed loop in time: the real scan and a plant with clocks, a closed timed automaton.

A *place* is the memory block at rest and the plant's discrete state. Clocks are those of the plant,
and the elapsed times that the program compares with constants (`plcemu.verify.timed.clocks`). Of
such a clock memory only keeps the class: between which two of its thresholds it is. A stand-in of
the class stands in the clock cell, so that the real scan gives the answers it always gives.

At one instant anything that is possible may happen, in any order or together, each time followed by
the scans up to the rest: an action of the plant, or that a clock's threshold is noticed, which must
be before time passes beyond it. Scans take no time. `IntegerTime` lets time pass by whole units,
`plcemu.verify.timed.zones` by any amount.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from math import gcd, lcm
from typing import Any, NamedTuple, Protocol

from plant_sim.linear_automaton import AutomatonError
from plcemu.base.errors import PlcemuError
from plcemu.base.time import format_duration
from plcemu.io.mapping import Point
from plcemu.verify.loop import ClosedLoop, Fairness, FinitePlant, State, Trail, nothing_watched
from plcemu.verify.machine import ScanMachine
from plcemu.verify.timed.clocks import Clock, Lookout

_CELL = struct.Struct("<qq")

TOGETHER = 10
"""Events that can happen at one instant before their combinations would be too many."""


class TimedPlant(FinitePlant, Protocol):
    """What is asked of a plant; `plant_sim.timed` says what each means."""

    @property
    def clocks(self) -> tuple[str, ...]: ...
    @property
    def joins(self) -> bool: ...
    def constants(self) -> Mapping[str, Collection[Fraction]]: ...
    def running(self, state: Any) -> Collection[str]: ...
    def latest(self, state: Any) -> Mapping[str, Fraction]: ...
    def guard(self, state: Any, action: Any) -> Mapping[str, tuple[Fraction, Fraction | None]]: ...
    def restarted(self, state: Any) -> Collection[str]: ...
    def settled(self, state: Any) -> Hashable: ...


class Happens(NamedTuple):
    """Something happens: actions of the plant, thresholds that clocks of the program reach.

    Attributes:
        events: of the plant, together.
        expired: numbers of the program's clocks whose thresholds are noticed.
        text: in words.
    """

    events: tuple[Any, ...]
    expired: tuple[int, ...]
    text: str

    def __str__(self) -> str:
        return self.text


class Passes(NamedTuple):
    """Time passes and nothing else, so many units of so many ns."""

    units: int
    unit_ns: Fraction

    def __str__(self) -> str:
        return f"{format_duration(int(self.units * self.unit_ns))} pass"


Limits = tuple[tuple[int, int, int | None], ...]
"""Bounds of clocks: number of the clock, least and largest value in units, both included."""


class Single(NamedTuple):
    """One event of the plant, or one of the program's clocks that reaches a threshold."""

    event: Any
    expired: int | None
    guard: Limits


class Entry(NamedTuple):
    """What something that happens leads to: a state but for its clocks, and those set to 0."""

    place: State
    resets: frozenset[int]


@dataclass(slots=True)
class Place:
    """The timed automaton around one place.

    Attributes:
        clocks: the numbers of those that matter here.
        latest: number of a clock and the value beyond which it cannot go, in units.
        singles: what can happen, one by one.
        combined: combinations by the numbers of their singles: what happens, by the order in
            which the plant's events come if that makes a difference; none if they exclude others.
        entries: what each leads to.
    """

    clocks: tuple[int, ...]
    latest: tuple[tuple[int, int], ...]
    singles: tuple[Single, ...]
    combined: dict[tuple[int, ...], list[Happens]] = field(default_factory=dict)
    entries: dict[Happens, Entry] = field(default_factory=dict)


class TimedLoop(ClosedLoop):
    """A program and a plant with clocks; its subclasses say how clocks are kept.

    Args:
        seen: what the program can see of its clocks; without problems.
        fairness: as `ClosedLoop`; of the plant: that time passes without end is always assumed.
        rest: as `ClosedLoop`.

    Raises:
        PlcemuError: the plant keeps no time, or a sensor is not among its readings.
    """

    def __init__(self, seen: Lookout, machine: ScanMachine, plant: TimedPlant,
                 inputs: Sequence[Point], outputs: Sequence[Point],
                 fairness: Fairness = "weak", watch: Any = nothing_watched,
                 watched: Any = None, told: int = -1) -> None:
        super().__init__(machine, plant, inputs, outputs, watch, watched, told, "timed",
                         fairness="strong" if fairness == "strong" else "weak", together=False)
        self._is_fair = fairness != "none"
        self.plant: TimedPlant = plant
        self.seen = seen
        self.own = seen.clocks
        names = [c.name for c in self.own]
        self.names = (*names, *plant.clocks)
        self._number = {name: n for n, name in enumerate(plant.clocks, len(names))}
        constants = plant.constants()
        self.unit_ns = common_unit([*(Fraction(t) for c in self.own for t in c.thresholds),
                                    *(v * 10**9 for each in constants.values() for v in each)])
        self.largest = (*(self._units_ns(max(c.thresholds, default=0)) for c in self.own),
                        *(max((self._units(v) for v in constants[name]), default=0)
                          for name in plant.clocks))
        self._standins = [_standins(clock) for clock in self.own]
        self._places_found: dict[tuple[bytes, Hashable], Place] = {}

    def _units(self, seconds: Fraction) -> int:
        return int(seconds * 10**9 / self.unit_ns)

    def _units_ns(self, ns: int) -> int:
        return int(ns / self.unit_ns)

    def elapsed_ns(self, state: Any, action: Any) -> int:
        """Return how much time passes in a step, in ns; exact if the unit is whole."""
        return int(action.units * self.unit_ns) if isinstance(action, Passes) else 0

    # ------------------------------------------------------------ places

    def place(self, state: Any) -> Place:
        """Return what can happen at a state's place."""
        key = state.memory, state.plant
        found = self._places_found.get(key)
        if found is None:
            found = self._places_found[key] = self._place(*key)
        return found

    def _place(self, memory: bytes, plant: Hashable) -> Place:
        due = {n: at for n in range(len(self.own)) if (at := self.due(memory, n)) is not None}
        latest = {n: self._units_ns(at) for n, at in due.items()}
        latest |= {self._number[name]: self._units(v)
                   for name, v in self.plant.latest(plant).items()}
        singles = [Single(event, None, self._guard(plant, event))
                   for event in self.plant.actions(plant)]
        singles += [Single(None, n, ((n, self._units_ns(at), None),)) for n, at in due.items()]
        clocks = {*due, *(self._number[name] for name in self.plant.running(plant))}
        found = Place(tuple(sorted(clocks)), tuple(sorted(latest.items())), tuple(singles))
        if singles and not self.deadlock_doubt and not any(_is_sure(s, found) for s in singles):
            self.deadlock_doubt = ("whether something can happen depends on the difference of "
                                   f"clocks ({'; '.join(map(self.text_of, singles))}), which whole "
                                   "units may miss: verify with verify.time: zones")
        return found

    def _guard(self, plant: Hashable, event: Any) -> Limits:
        return tuple((self._number[name], self._units(low), None if high is None
                      else self._units(high))
                     for name, (low, high) in self.plant.guard(plant, event).items())

    def due(self, memory: bytes, n: int) -> int | None:
        """Return the next threshold of one of the program's clocks, if it runs towards one."""
        elapsed, limit = _CELL.unpack_from(memory, self.own[n].offset)
        if elapsed >= limit:
            return None
        times = self.own[n].thresholds
        k = bisect_right(times, elapsed)
        return times[k] if k < len(times) and times[k] <= limit else None

    def text_of(self, single: Single) -> str:
        """Say what happens."""
        if single.expired is None:
            return str(single.event)
        n, low, _ = single.guard[0]
        return f"{self.names[n]} reaches {format_duration(int(low * self.unit_ns))}"

    # ------------------------------------------------------------ what happens

    def happenings(self, state: Any, place: Place, chosen: tuple[int, ...]) -> list[Happens]:
        """Return how some of a place's singles can happen together."""
        found = place.combined.get(chosen)
        if found is None:
            singles = [place.singles[n] for n in chosen]
            text = " and ".join(map(self.text_of, singles))
            expired = tuple(s.expired for s in singles if s.expired is not None)
            events = tuple(s.event for s in singles if s.expired is None)
            found = place.combined[chosen] = [
                Happens(order, expired, text) for order in self._orders(state.plant, events)]
            for each in found:
                memory, trail = self._trail(state, each)
                place.entries[each] = self._entry(place, memory, trail, text)
        return found

    def _orders(self, plant: Any, events: tuple[Any, ...]) -> Collection[tuple[Any, ...]]:
        """Return the orders in which events can come at one instant, one for each result."""
        results: dict[Hashable, tuple[Any, ...]] = {plant: ()}
        reached: dict[tuple[Hashable, frozenset[int]], tuple[Any, ...]] = {
            (plant, frozenset(range(len(events)))): ()}
        for _ in events:
            reached = {(self.plant.after(now, events[n]), left - {n}): (*order, events[n])
                       for (now, left), order in reached.items() for n in sorted(left)[::-1]
                       if self._can_come(now, events[n])}
            results = {now: order for (now, _), order in reached.items()}
        return results.values()

    def _can_come(self, plant: Any, event: Any) -> bool:
        """Whether an event that its guard allowed can still come after others at that instant."""
        if event not in self.plant.actions(plant):
            return False
        fresh = self.plant.restarted(plant)
        return not any(low > 0 for name, (low, _) in self.plant.guard(plant, event).items()
                       if name in fresh)

    def given(self, memory: bytes, expired: Collection[int]) -> bytes:
        """Return memory once thresholds have been reached."""
        block = bytearray(memory)
        for n in expired:
            clock = self.own[n]
            elapsed, limit = _CELL.unpack_from(memory, clock.offset)
            k = bisect_right(clock.thresholds, elapsed)
            at = clock.thresholds[k]
            reached = limit if limit <= at else self._standins[n][k + 1]
            _CELL.pack_into(block, clock.offset, reached, limit)
        return bytes(block)

    def _trail(self, state: Any, happens: Happens) -> tuple[bytes, Trail]:
        """Return memory and the scans once something has happened."""
        plant = state.plant
        for event in happens.events:
            plant = self.plant.after(plant, event)
        memory = self.given(state.memory, happens.expired)
        return memory, self._settle(memory, plant)

    def _entry(self, place: Place | None, given: bytes, trail: Trail, text: str) -> Entry:
        """Return where scans led, clocks of memory replaced by stand-ins of their classes."""
        last = self._settling.last(trail, given)
        plant = self.plant.settled(last.plant)
        memory, resets = self._normal(last.memory, given, text)
        resets |= {self._number[name] for name in self.plant.restarted(last.plant)}
        target = State(memory, plant, last.seen, last.fault)
        if place is not None and not last.fault:
            lost = [self.names[n] for n in self.place(target).clocks
                    if n not in place.clocks and n not in resets]
            if lost:
                raise PlcemuError(f"{text}: {', '.join(lost)} goes on from a value at which it "
                                  "stood still, which is not followed here: verify every scan "
                                  "(merge: none)")
        return Entry(target, frozenset(resets))

    def _normal(self, memory: bytes, given: bytes, text: str) -> tuple[bytes, set[int]]:
        block, resets = bytearray(memory), set()
        for n, clock in enumerate(self.own):
            elapsed, limit = _CELL.unpack_from(memory, clock.offset)
            before, before_limit = _CELL.unpack_from(given, clock.offset)
            if elapsed == 0:
                if limit > 0:
                    resets.add(n)
                    _CELL.pack_into(block, clock.offset, self._standins[n][0], limit)
            elif elapsed != before or (elapsed < limit and before >= before_limit):
                raise PlcemuError(f"{text}: {clock.name} goes on from a value at which it stood "
                                  "still, which is not followed here: verify every scan "
                                  "(merge: none)")
        return bytes(block), resets

    def begin(self, plant: Hashable) -> Entry:
        """Return the place after the scans of a cold start; all clocks are at 0 there."""
        return self._entry(None, self.machine.initial, self.first_scans(plant), "cold start")

    # ------------------------------------------------------------ as a closed loop

    def expand(self, states: Iterable[State]) -> Iterator[list[tuple[Any, State]]]:
        """For each state, its actions and the states after them."""
        for state in states:
            yield [(action, self.next(state, action)) for action in self.actions(state)]

    def future(self, state: State) -> Hashable:
        """What decides how a run goes on: all of a state but what was seen on the way to it."""
        return state._replace(seen=0) if state.seen else state

    def first_scans(self, plant: Hashable) -> Trail:
        """The scans from a cold start to the initial state of that plant."""
        return self._settle(self.machine.initial, plant)

    def _settle(self, memory: bytes, plant: Hashable) -> Trail:
        try:
            return self._settling.step(memory, plant, 0)
        except AutomatonError as problem:
            raise PlcemuError(f"the finite plant: {problem}") from None

    def scans(self, state: Any, action: Any) -> Trail:
        """The scans of a step; none if only time passes."""
        if isinstance(action, Passes):
            return [], state.plant, ""
        return self._trail(state, action)[1]

    def resting(self, state: Any) -> int:
        """Which of the told formulas hold while time passes at a place."""
        return self.outcome(state.memory, state.plant)[0] & self._settling.told

    def pending(self, state: Any) -> Collection[str]:
        """Time, which passes without end; and what is pending in the plant."""
        if state.fault:
            return ()
        return ("time", *self.plant.pending(state.plant)) if self._is_fair else ("time",)

    def done(self, action: Any) -> Collection[str]:
        """What of it a step brings about."""
        if isinstance(action, Passes):
            return ("time",)
        return [name for event in action.events for name in self.plant.done(event)]

    def larger(self, place: Place, chosen: Sequence[tuple[int, ...]],
               now: Sequence[int]) -> list[tuple[int, ...]]:
        """Return the combinations of singles that have one more of those that can happen now.

        Raises:
            PlcemuError: they have too many.
        """
        found = [(*each, n) for each in chosen for n in now
                 if (not each or n > each[-1]) and self._joins(place, each, n)]
        if found and len(found[0]) > TOGETHER:
            raise PlcemuError(f"more than {TOGETHER} events can happen at one instant; their "
                              "combinations are too many to be tried")
        return found

    def _joins(self, place: Place, chosen: Sequence[int], n: int) -> bool:
        """Whether an event can come together with others; clocks always expire together."""
        return self.plant.joins or place.singles[n].expired is not None or \
            all(place.singles[k].expired is not None for k in chosen)

    def dead(self, place: Place, state: Any) -> None:
        """Refuse a plant that lets neither anything happen nor time pass."""
        if place.latest:
            bounds = ", ".join(f"{self.names[n]} <= {self._seconds(v)} s" for n, v in place.latest)
            raise PlcemuError(f"the plant's model stops time: in {state.plant} nothing can happen, "
                              f"and its invariants end it ({bounds})")

    def _seconds(self, units: int) -> str:
        return f"{float(units * self.unit_ns / 10**9):g}"


def _is_sure(single: Single, place: Place) -> bool:
    """Whether something can happen, now or after a while, whatever the values of the clocks are."""
    ends = dict(place.latest)
    if any(high is not None and ends.get(n, high + 1) > high for n, _, high in single.guard):
        return False
    return all(low <= 0 or (not ends.keys() - {n} and low <= ends.get(n, low))
               for n, low, _ in single.guard)


def _standins(clock: Clock) -> list[int]:
    """Return a value for each class of a clock, none of which is 0."""
    times = clock.thresholds
    return [*(at - 1 for at in times), times[-1]] if times else [1]


def common_unit(values: Sequence[Fraction]) -> Fraction:
    """Return the greatest unit of which all values are whole multiples; 1 s if there are none."""
    known = [v for v in values if v]
    if not known:
        return Fraction(10**9)
    below = lcm(*(v.denominator for v in known))
    return Fraction(gcd(*(int(v * below) for v in known)), below)


class IntegerTime(TimedLoop):
    """Time passes by whole units, up to the next instant at which anything can happen."""

    def initial(self) -> Iterator[State]:
        """The places after a cold start."""
        for plant in self.plant.initial():
            entry = self.begin(plant)
            state = self._state(entry, {})
            self.origins.setdefault(state, plant)
            self._starts[plant] = state
            yield state

    def _state(self, entry: Entry, values: Mapping[int, int]) -> State:
        place = entry.place
        if place.fault:
            return place
        clocks = tuple(0 if n in entry.resets else values.get(n, 0)
                       for n in self.place(place).clocks)
        return place._replace(clocks=clocks)

    def actions(self, state: State) -> Sequence[Any]:
        """What can happen now, alone and together; and that time passes."""
        if state.fault:
            return ()
        place = self.place(state)
        values = dict(zip(place.clocks, state.clocks, strict=True))
        now = [n for n, s in enumerate(place.singles) if _in(values, s.guard, 0)]
        found: list[Any] = []
        chosen: list[tuple[int, ...]] = [()]
        while chosen:
            chosen = self.larger(place, chosen, now)
            for each in chosen:
                found += self.happenings(state, place, each)
        wait = self._wait(place, values, bool(now))
        if wait:
            found.append(Passes(wait, self.unit_ns))
        elif not now:
            self.dead(place, state)
        return found

    def _wait(self, place: Place, values: Mapping[int, int], now: bool) -> int:
        """Return after how many units something can happen again; 0 if time must not pass."""
        room = min((high - values[n] for n, high in place.latest), default=None)
        if room is not None and room <= 0:
            return 0
        starts = [start for s in place.singles
                  if (start := _first(values, s.guard)) is not None]
        if not starts:
            return 1 if now else 0 if room is None else room
        return min(starts) if room is None else min(*starts, room)

    def next(self, state: State, action: Any) -> State:
        """The state after a step."""
        place = self.place(state)
        if isinstance(action, Passes):
            clocks = tuple(min(v + action.units, self.largest[n] + 1)
                           for n, v in zip(place.clocks, state.clocks, strict=True))
            return state._replace(clocks=clocks, seen=self.resting(state))
        return self._state(place.entries[action],
                           dict(zip(place.clocks, state.clocks, strict=True)))


def _in(values: Mapping[int, int], guard: Limits, later: int) -> bool:
    """Whether a guard holds so many units later."""
    return all(low <= values[n] + later and (high is None or values[n] + later <= high)
               for n, low, high in guard)


def _first(values: Mapping[int, int], guard: Limits) -> int | None:
    """Return the number of units, at least 1, after which a guard first holds."""
    first = max([1, *(low - values[n] for n, low, _ in guard)])
    return first if _in(values, guard, first) else None
