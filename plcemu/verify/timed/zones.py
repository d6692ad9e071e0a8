"""Time by zones: any amount of time passes; sets of clock values are bounded by differences.

A state is a place and a zone of all clock values that can be reached there, after any time that its
invariants allow. A zone that another one of the same place covers leads nowhere else and is taken
for it, so the states are finitely many, however long the times (Bengtsson and Yi, 2004).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from plant_sim.linear import Constraint, Constraints, Term
from plcemu.verify.hybrid.zones import Scale, Zone
from plcemu.verify.loop import State
from plcemu.verify.timed.loop import Entry, Happens, Limits, Place, TimedLoop

_ONE = (Fraction(1), Fraction(1))
_ZERO = (Fraction(0), Fraction(0))


class _Bounds(NamedTuple):
    """A place's bounds as constraints; kept, since zones know them by identity.

    Attributes:
        invariant: how long time may pass.
        guards: of the place's singles.
        chances: for each single constraints, and their negations, that hold together where it can
            happen, now or after a while.
        rates: of all clocks.
        idle: the clocks that mean nothing here.
    """

    invariant: Constraints
    guards: tuple[Constraints, ...]
    chances: tuple[tuple[tuple[Constraints, Constraints], ...], ...]
    rates: dict[str, tuple[Fraction, Fraction]]
    idle: tuple[str, ...]


class NothingCanHappen:
    """Leads to the state that stands for clock values at which nothing can happen any more."""

    def __str__(self) -> str:
        return "time passes"

    __repr__ = __str__


STUCK = NothingCanHappen()


class ZoneTime(TimedLoop):
    """Time passes by any amount; a state holds the number of its zone.

    One without stands for the part of a zone in which nothing can happen any more.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._scale = Scale(tuple(map(str, range(len(self.names)))), Fraction(1))
        self._zones: list[Zone] = []
        self._at: dict[State, list[int]] = {}
        self._bounds: dict[int, tuple[Place, _Bounds]] = {}
        self._resets: dict[frozenset[int], dict[str, tuple[Fraction, Fraction]]] = {}

    def initial(self) -> Iterator[State]:
        """The places after a cold start, and any time then."""
        for plant in self.plant.initial():
            entry = self.begin(plant)
            zero = Zone.of(self._scale, ()).assign(dict.fromkeys(self._scale.names, _ZERO))
            state = self._enter(zero, entry._replace(resets=frozenset(range(len(self.names)))))
            self.origins.setdefault(state, plant)
            self._starts[plant] = state
            yield state

    def _bounds_of(self, place: Place) -> _Bounds:
        known = self._bounds.get(id(place))
        if known is None:
            running = {self._scale.names[n] for n in place.clocks}
            bounds = _Bounds(
                tuple(_at_most(n, high) for n, high in place.latest),
                tuple(_constraints(s.guard) for s in place.singles),
                tuple(_chances(place, s.guard) for s in place.singles),
                dict.fromkeys(self._scale.names, _ONE),
                tuple(name for name in self._scale.names if name not in running))
            known = self._bounds[id(place)] = place, bounds
        return known[1]

    def _enter(self, zone: Zone, entry: Entry) -> State:
        """Return the state of a place that is entered with these clock values."""
        bare = entry.place
        if bare.fault:
            return bare
        bounds = self._bounds_of(self.place(bare))
        sets = self._resets.setdefault(
            entry.resets, {self._scale.names[n]: _ZERO for n in sorted(entry.resets)})
        zone = zone.assign(sets).forget(bounds.idle).meet(bounds.invariant)
        zone = zone.elapse(bounds.rates).meet(bounds.invariant).extrapolate(self.largest)
        for number in self._at.setdefault(bare, []):
            if self._zones[number].covers(zone):
                return bare._replace(clocks=(number,))
        self._at[bare].append(len(self._zones))
        self._zones.append(zone)
        return bare._replace(clocks=(len(self._zones) - 1,))

    def actions(self, state: State) -> Sequence[Any]:
        """What can happen at some of the clock values, alone and together."""
        if state.fault or not state.clocks:
            return ()
        place = self.place(state)
        bounds, zone = self._bounds_of(place), self._zones[state.clocks[0]]
        found: list[Any] = []
        level: dict[tuple[int, ...], Zone] = {(): zone}
        singles = range(len(place.singles))
        while level:
            level = {(*chosen, n): smaller for chosen, part in level.items()
                     for *_, n in self.larger(place, [chosen], singles)
                     if not (smaller := part.meet(bounds.guards[n])).is_empty()}
            for chosen in level:
                found += self.happenings(state, place, chosen)
        if self._has_dead_part(bounds, zone):
            self.dead(place, state)
            found.append(STUCK)
        return found

    def next(self, state: State, action: Any) -> State:
        """The state after what happens at the clock values at which it can."""
        if action is STUCK:
            return state._replace(clocks=(), seen=self.resting(state))
        assert isinstance(action, Happens)
        place = self.place(state)
        zone = self._zones[state.clocks[0]]
        guards = self._bounds_of(place).guards
        for n, single in enumerate(place.singles):
            if single.event in action.events if single.expired is None \
                    else single.expired in action.expired:
                zone = zone.meet(guards[n])
        return self._enter(zone, place.entries[action])

    @staticmethod
    def _has_dead_part(bounds: _Bounds, zone: Zone) -> bool:
        """Whether at some clock values nothing can happen, now or after a while.

        A single can if each lower bound is reached before the first upper one: the complement is a
        union of bounds of differences, which are taken from the zone one after the other.
        """
        parts = [zone]
        for chances in bounds.chances:
            rest: list[Zone] = []
            for part in parts:
                for inside, outside in chances:
                    beyond = part.meet(outside)
                    if not beyond.is_empty():
                        rest.append(beyond)
                    part = part.meet(inside)
            parts = rest
        return bool(parts)


def _chances(place: Place, guard: Limits) -> tuple[tuple[Constraints, Constraints], ...]:
    """Return the constraints under which a guard can be met before any upper bound ends."""
    ends = [*place.latest, *((n, high) for n, _, high in guard if high is not None)]
    found = [_in_time(n, low, m, high) for n, low, _ in guard
             for m, high in ends if low > 0 and n != m]
    found += [_at_most(n, high) for n, _, high in guard if high is not None]
    late = [n for n, low, _ in guard for m, high in ends if n == m and low > high]
    found += [_at_most(n, -1) for n in late]
    return tuple(((c,), c.negations) for c in found)


def _at_most(n: int, high: int) -> Constraint:
    return Constraint(Term.of({str(n): Fraction(1)}, Fraction(-high)), "<=")


def _at_least(n: int, low: int) -> Constraint:
    return Constraint(Term.of({str(n): Fraction(-1)}, Fraction(low)), "<=")


def _in_time(n: int, low: int, m: int, high: int) -> Constraint:
    """low - x_n <= high - x_m: the lower bound of one clock comes no later than the other's end."""
    return Constraint(Term.of({str(m): Fraction(1), str(n): Fraction(-1)},
                              Fraction(low - high)), "<=")


def _constraints(guard: Limits) -> Constraints:
    return tuple(c for n, low, high in guard
                 for c in ((_at_least(n, low),) if low > 0 else ()) +
                 ((_at_most(n, high),) if high is not None else ()))
