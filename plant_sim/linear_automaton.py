"""Linear hybrid automata: how a plant tells a checker what it can do, exactly.

A location has an invariant, and in it every variable in use changes at a rate that is a number or
lies in an interval (and may move within it). Time passes while the invariant holds. A transition
has a guard, sets variables to numbers or to anything in an interval, and may wait for a command: a
value of an actuator. What a sensor reads in a location is told by constraints. All numbers are
exact rationals (Alur et al., The algorithmic analysis of hybrid systems, 1995; linear automata with
rectangular rates).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Protocol

from plant_sim.linear import Constraints, LinearError, Term, parse_constraints, parse_term

Number = int | str | Fraction
Interval = tuple[Fraction, Fraction]


class AutomatonError(ValueError):
    """An automaton that does not make sense; says which part of it."""


ONE = Term((), Fraction(1))
"""The number 1 as a linear expression."""


@dataclass(frozen=True, slots=True)
class Reading:
    """What the sensors show where constraints hold."""

    where: Constraints
    values: Mapping[str, bool]


@dataclass(frozen=True, slots=True)
class Location:
    """A location.

    Attributes:
        name: unique in the automaton.
        rates: of the variables in use here, lowest and highest; others mean nothing here.
        invariant: time passes while it holds.
        readings: of the Boolean sensors; the first whose constraints hold counts.
    """

    name: str
    rates: Mapping[str, Interval]
    invariant: Constraints = ()
    readings: tuple[Reading, ...] = ()


@dataclass(frozen=True, slots=True)
class Transition:
    """A transition.

    Attributes:
        source, target: names of locations.
        guard: when it may be taken.
        sets: what variables become, lowest and highest.
        label: of automata composed with one another, those that know it move together.
        command: actuator values that make it happen at once where its guard holds.
    """

    source: str
    target: str
    guard: Constraints = ()
    sets: Mapping[str, Interval] = field(default_factory=dict)
    label: str = ""
    command: Mapping[str, bool] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Objective:
    """A quantity of interest: the value of `above / below` on entering a location.

    `below` must be positive there. A plain quantity has `below` = 1.
    """

    name: str
    location: str
    above: Term
    below: Term = ONE
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Automaton:
    """A linear hybrid automaton."""

    locations: tuple[Location, ...]
    transitions: tuple[Transition, ...]
    initial: str
    start: Constraints
    objectives: tuple[Objective, ...] = ()

    def __post_init__(self) -> None:
        names = [location.name for location in self.locations]
        if len(set(names)) != len(names):
            raise AutomatonError(f"two locations have one name: {', '.join(sorted(names))}")
        wanted = [self.initial, *(o.location for o in self.objectives),
                  *(n for t in self.transitions for n in (t.source, t.target))]
        for name in wanted:
            if name not in names:
                raise AutomatonError(f"there is no location {name!r}; there is {', '.join(names)}")
        for t in self.transitions:
            _check_uses(f"transition {t.source} -> {t.target}", t.guard,
                        self.location(t.source).rates)
        for location in self.locations:
            _check_uses(f"location {location.name}", location.invariant, location.rates)

    def location(self, name: str) -> Location:
        """Return the location of a name; raises `KeyError`."""
        for location in self.locations:
            if location.name == name:
                return location
        raise KeyError(name)

    @property
    def variables(self) -> tuple[str, ...]:
        """All variables, in order of first mention."""
        return tuple(dict.fromkeys(v for place in self.locations for v in place.rates))


class HasAutomaton(Protocol):
    """A plant that can be checked exactly."""

    def automaton(self) -> Automaton:
        """Return what the plant with its present parameters can do."""


def _check_uses(what: str, constraints: Constraints, rates: Mapping[str, Interval]) -> None:
    for constraint in constraints:
        unknown = constraint.term.names - set(rates)
        if unknown:
            raise AutomatonError(f"{what}: {', '.join(sorted(unknown))} is not in use there")


# ------------------------------------------------------------ writing automata by hand


def interval(value: Number | tuple[Number, Number]) -> Interval:
    """Return the interval of a number or a pair of numbers, exact; raises `AutomatonError`."""
    low, high = value if isinstance(value, tuple) else (value, value)
    pair = Fraction(low), Fraction(high)
    if pair[0] > pair[1]:
        raise AutomatonError(f"found the interval {low} to {high}, expected the lower bound first")
    return pair


def location(name: str, rates: Mapping[str, Number | tuple[Number, Number]], invariant: str = "",
             readings: Sequence[tuple[str, Mapping[str, bool]]] = ()) -> Location:
    """Return a location from texts; raises `AutomatonError`, naming it."""
    try:
        return Location(name, {v: interval(r) for v, r in rates.items()},
                        parse_constraints(invariant),
                        tuple(Reading(parse_constraints(w), dict(v)) for w, v in readings))
    except LinearError as problem:
        raise AutomatonError(f"location {name}: {problem}") from None


def transition(source: str, target: str, guard: str = "",
               sets: Mapping[str, Number | tuple[Number, Number]] | None = None, label: str = "",
               command: Mapping[str, bool] | None = None) -> Transition:
    """Return a transition from texts; raises `AutomatonError`, naming it."""
    try:
        return Transition(source, target, parse_constraints(guard),
                          {v: interval(r) for v, r in (sets or {}).items()}, label,
                          dict(command or {}))
    except LinearError as problem:
        raise AutomatonError(f"transition {source} -> {target}: {problem}") from None


def objective(name: str, location: str, above: str, below: str = "1", unit: str = "") -> Objective:
    """Return an objective from texts; raises `AutomatonError`."""
    try:
        return Objective(name, location, parse_term(above), parse_term(below), unit)
    except LinearError as problem:
        raise AutomatonError(f"objective {name}: {problem}") from None


# ------------------------------------------------------------ composition


def compose(first: Automaton, second: Automaton) -> Automaton:
    """Return the parallel composition: common labels move together, all else interleaves.

    Variables of both are shared by name; one that both use in a location must have a rate that
    both allow. Objectives of the first name a location `a.b` for every location b of the second.

    Raises:
        AutomatonError: rates of a shared variable contradict one another.
    """
    common = {t.label for t in first.transitions} & {t.label for t in second.transitions} - {""}
    places = tuple(_meet(a, b) for a in first.locations for b in second.locations)
    moves: list[Transition] = []
    for a in first.transitions:
        if a.label in common:
            moves += [_join(a, b) for b in second.transitions if b.label == a.label]
        else:
            moves += [_beside(a, f"{a.source}.{b.name}", f"{a.target}.{b.name}")
                      for b in second.locations]
    for b in second.transitions:
        if b.label not in common:
            moves += [_beside(b, f"{a.name}.{b.source}", f"{a.name}.{b.target}")
                      for a in first.locations]
    goals = tuple(Objective(o.name, f"{o.location}.{b.name}", o.above, o.below, o.unit)
                  for o in first.objectives for b in second.locations)
    goals += tuple(Objective(o.name, f"{a.name}.{o.location}", o.above, o.below, o.unit)
                   for o in second.objectives for a in first.locations)
    return Automaton(places, tuple(moves), f"{first.initial}.{second.initial}",
                     first.start + second.start, goals)


def _meet(a: Location, b: Location) -> Location:
    rates = dict(a.rates)
    for name, (low, high) in b.rates.items():
        other = rates.get(name, (low, high))
        rates[name] = max(low, other[0]), min(high, other[1])
        if rates[name][0] > rates[name][1]:
            raise AutomatonError(f"{a.name} and {b.name} give {name} rates that contradict")
    return Location(f"{a.name}.{b.name}", rates, a.invariant + b.invariant,
                    a.readings + b.readings)


def _join(a: Transition, b: Transition) -> Transition:
    return Transition(f"{a.source}.{b.source}", f"{a.target}.{b.target}", a.guard + b.guard,
                      {**a.sets, **b.sets}, a.label, {**a.command, **b.command})


def _beside(t: Transition, source: str, target: str) -> Transition:
    return Transition(source, target, t.guard, t.sets, t.label, t.command)
