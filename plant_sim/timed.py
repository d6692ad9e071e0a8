"""Finite plants that keep time: networks of closed timed automata.

The automata are those of `plant_sim.linear_automaton`, in the form in which time can be treated
exactly by whole units or zones: every variable is a clock (rate 1, set to 0 only), and every bound
is closed (`<=`, `>=`, `==`) and of one clock (Alur and Dill, A theory of timed automata, 1994).

Transitions with a *command* are taken at once when the actuators have these values; all others are
taken by themselves at any instant their guard allows, at the latest when the location's invariant
ends. Automata that know a label take their transitions of it together.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import product
from typing import Any, NamedTuple, Protocol, cast

from plant_sim.abstraction import Abstraction
from plant_sim.contract import Fact, FactValue, PortValue
from plant_sim.linear import Constraints
from plant_sim.linear_automaton import Automaton, AutomatonError, Transition

Bounds = Mapping[str, tuple[Fraction, Fraction | None]]
"""For clocks by name the least and the largest value, both included, in s; None is without end."""

COMMANDS_LIMIT = 100
"""Commanded transitions that may follow one another at one instant."""


class TimedAbstraction(Abstraction, Protocol):
    """A finite plant with clocks, all bounds of which are closed.

    A state says which clocks were set to 0 at the present instant (`restarted`); `settled` is the
    same state without this note. Clocks that are not `running` in a state mean nothing there.
    """

    @property
    def clocks(self) -> tuple[str, ...]:
        """The names of its clocks."""

    @property
    def joins(self) -> bool:
        """Whether several actions can come at one instant; if not, each is all that then comes."""

    def constants(self) -> Mapping[str, Collection[Fraction]]:
        """For each clock all values that it is compared with, in s."""

    def running(self, state: Any) -> Collection[str]:
        """The clocks whose values matter in a state."""

    def latest(self, state: Any) -> Mapping[str, Fraction]:
        """The values, in s, beyond which clocks cannot go in a state."""

    def guard(self, state: Any, action: Any) -> Bounds:
        """Between which values of clocks an action is possible."""

    def restarted(self, state: Any) -> Collection[str]:
        """The clocks that were set to 0 since the state was last settled."""

    def settled(self, state: Any) -> Any:
        """The state without the note of which clocks were set to 0."""


class Truth(NamedTuple):
    """A fact that is true while an automaton is in one of some locations."""

    fact: Fact
    automaton: str
    locations: tuple[str, ...]


class State(NamedTuple):
    """The location of each automaton, and the clocks set to 0 at this instant."""

    locations: tuple[str, ...]
    restarted: frozenset[str] = frozenset()


class Action(NamedTuple):
    """An action: transitions that are taken together; one per automaton, by its number."""

    name: str
    taken: tuple[tuple[int, int], ...]

    def __str__(self) -> str:
        return self.name


class _Step(NamedTuple):
    """A transition as the network uses it."""

    target: str
    guard: Bounds
    sets: frozenset[str]
    label: str
    command: Mapping[str, bool]
    name: str


class _Commanded(NamedTuple):
    """An action, and the values of actuators that bring it about."""

    action: Action
    wanted: tuple[tuple[str, bool], ...]


class TimedNetwork:
    """Closed timed automata beside one another: a plant that can be verified in time.

    Args:
        automata: by name. In a location, a sensor that its readings do not name reads FALSE.
        truths: the facts; what each sensor reads is a fact, too.

    Raises:
        AutomatonError: a variable is no clock, or a bound is open or not one of a single clock.
    """

    joins = True

    def __init__(self, automata: Mapping[str, Automaton], truths: Sequence[Truth] = ()) -> None:
        self._names = tuple(automata)
        self._automata = tuple(automata.values())
        self._truths = tuple(truths)
        self.clocks = tuple(dict.fromkeys(v for a in self._automata for v in a.variables))
        self._running, self._latest, self._readings = {}, {}, {}
        self._steps: list[dict[str, list[_Step]]] = []
        for n, (name, automaton) in enumerate(automata.items()):
            for place in automaton.locations:
                where = f"{name}.{place.name}"
                self._running[n, place.name] = _clocks(where, place.rates)
                self._latest[n, place.name] = _invariant(where, place.invariant)
                if any(r.where for r in place.readings):
                    raise AutomatonError(f"{where}: what sensors read must not depend on clocks")
                self._readings[n, place.name] = {s: v for r in place.readings[::-1]
                                                 for s, v in r.values.items()}
            self._steps.append({place.name: [_step(name, t) for t in automaton.transitions
                                             if t.source == place.name]
                                for place in automaton.locations})
            for constraint in automaton.start:
                if constraint.relation != "==" or constraint.term.constant:
                    raise AutomatonError(f"{name}: clocks start at 0")
        self._knows = [{s.label for each in rows.values() for s in each} - {""}
                       for rows in self._steps]
        self._sensors = tuple(dict.fromkeys(s for r in self._readings.values() for s in r))
        self.facts = (*(t.fact for t in self._truths),
                      *(Fact(s, "bool", "", f"what {s} reads") for s in self._sensors))
        self._possible: dict[tuple[str, ...], tuple[list[Action], list[_Commanded]]] = {}

    # ------------------------------------------------------------ a finite plant

    def initial(self) -> Iterator[State]:
        """Every automaton in its initial location, all clocks at 0."""
        yield State(tuple(a.initial for a in self._automata), frozenset(self.clocks))

    def name_of(self, state: State) -> str:
        """The locations, in words."""
        return ", ".join(f"{n}: {p}" for n, p in zip(self._names, state.locations, strict=True))

    def sense(self, state: State) -> Mapping[str, PortValue]:
        """What the sensors read."""
        read: dict[str, PortValue] = dict.fromkeys(self._sensors, False)
        for key in enumerate(state.locations):
            read.update(self._readings[key])
        return read

    def observe(self, state: State) -> Mapping[str, FactValue]:
        """The facts."""
        facts: dict[str, FactValue] = {
            t.fact.name: state.locations[self._names.index(t.automaton)] in t.locations
            for t in self._truths}
        return {**facts, **self.sense(state)}

    def actuate(self, state: State, values: Mapping[str, PortValue]) -> State:
        """Take commanded transitions, the first of those possible, until none is any more."""
        for _ in range(COMMANDS_LIMIT):
            move = next((move for move, wanted in self._all(state)[1]
                         if all(bool(values.get(k, False)) == v for k, v in wanted)), None)
            if move is None:
                return state
            state = self.after(state, move)
        raise AutomatonError(f"the commands {dict(values)} lead from one transition to the next "
                             f"without end: {self.name_of(state)}")

    def actions(self, state: State) -> Sequence[Action]:
        """What may happen by itself, if clocks allow it."""
        return self._all(state)[0]

    def after(self, state: State, action: Action) -> State:
        """The state once transitions have been taken."""
        places, sets = list(state.locations), set(state.restarted)
        for n, step in self._taken(state, action):
            places[n] = step.target
            sets |= step.sets
        return State(tuple(places), frozenset(sets))

    def pending(self, state: State) -> Collection[str]:
        """Nothing: what must happen is said by invariants."""
        return ()

    def done(self, action: Action) -> Collection[str]:
        """Nothing."""
        return ()

    # ------------------------------------------------------------ time

    def constants(self) -> Mapping[str, Collection[Fraction]]:
        """For each clock all values that it is compared with."""
        found: dict[str, set[Fraction]] = {clock: set() for clock in self.clocks}
        for latest in self._latest.values():
            for clock, bound in latest.items():
                found[clock].add(bound)
        for step in (s for rows in self._steps for each in rows.values() for s in each):
            for clock, ends in step.guard.items():
                found[clock].update(e for e in ends if e is not None)
        return found

    def running(self, state: State) -> Collection[str]:
        """The clocks in use in the locations."""
        return frozenset().union(*(self._running[key] for key in enumerate(state.locations)))

    def latest(self, state: State) -> Mapping[str, Fraction]:
        """The invariants of the locations."""
        found: dict[str, Fraction] = {}
        for key in enumerate(state.locations):
            for clock, bound in self._latest[key].items():
                found[clock] = min(bound, found.get(clock, bound))
        return found

    def guard(self, state: State, action: Action) -> Bounds:
        """The guards of its transitions together."""
        return meet(*(step.guard for _, step in self._taken(state, action)))

    def restarted(self, state: State) -> Collection[str]:
        """The clocks set to 0 at this instant."""
        return state.restarted

    def settled(self, state: State) -> State:
        """The state without that note."""
        return State(state.locations)

    # ------------------------------------------------------------ transitions taken together

    def _all(self, state: State) -> tuple[list[Action], list[_Commanded]]:
        """What may happen by itself, and what commands bring about."""
        found = self._possible.get(state.locations)
        if found is None:
            found = self._possible[state.locations] = [], []
            for move in self._moves(state.locations):
                wanted = {(k, v) for _, step in self._taken(state, move)
                          for k, v in step.command.items()}
                if wanted:
                    found[1].append(_Commanded(move, tuple(wanted)))
                else:
                    found[0].append(move)
        return found

    def _moves(self, places: tuple[str, ...]) -> Iterator[Action]:
        """Yield what can be taken in locations, if guards and commands allow it."""
        told: set[str] = set()
        for n, place in enumerate(places):
            for k, step in enumerate(self._steps[n][place]):
                if not step.label:
                    yield Action(step.name, ((n, k),))
                elif step.label not in told:
                    told.add(step.label)
                    yield from self._together(places, step.label)

    def _together(self, places: tuple[str, ...], label: str) -> Iterator[Action]:
        knowing = [n for n, labels in enumerate(self._knows) if label in labels]
        choices = [[(n, k) for k, s in enumerate(self._steps[n][places[n]]) if s.label == label]
                   for n in knowing]
        return (Action(label, taken) for taken in product(*choices))

    def _taken(self, state: State, move: Action) -> Iterator[tuple[int, _Step]]:
        return ((n, self._steps[n][state.locations[n]][k]) for n, k in move.taken)


class AtAnyTime:
    """A finite plant without clocks as one in time: what may happen may happen at any time.

    Args:
        plant: the finite plant.
    """

    clocks = ()
    joins = False

    def __init__(self, plant: Abstraction) -> None:
        self.facts, self.initial, self.name_of = plant.facts, plant.initial, plant.name_of
        self.sense, self.actuate, self.observe = plant.sense, plant.actuate, plant.observe
        self.actions, self.after = plant.actions, plant.after
        self.pending, self.done = plant.pending, plant.done

    def constants(self) -> Mapping[str, Collection[Fraction]]:
        """None."""
        return {}

    def running(self, state: Any) -> Collection[str]:
        """None."""
        return ()

    def latest(self, state: Any) -> Mapping[str, Fraction]:
        """None."""
        return {}

    def guard(self, state: Any, action: Any) -> Bounds:
        """None."""
        return {}

    def restarted(self, state: Any) -> Collection[str]:
        """None."""
        return ()

    def settled(self, state: Any) -> Any:
        """The state."""
        return state


def in_time(plant: Abstraction) -> TimedAbstraction:
    """Return a finite plant as one in time; one without clocks does what it may at any time."""
    return cast(TimedAbstraction, plant if hasattr(plant, "constants") else AtAnyTime(plant))


def meet(*bounds: Bounds) -> dict[str, tuple[Fraction, Fraction | None]]:
    """Return the bounds that hold where all of some do."""
    found: dict[str, tuple[Fraction, Fraction | None]] = {}
    for clock, (low, high) in (item for each in bounds for item in each.items()):
        low0, high0 = found.get(clock, (low, high))
        highs = [h for h in (high, high0) if h is not None]
        found[clock] = max(low, low0), min(highs, default=None)
    return found


def _clocks(where: str, rates: Mapping[str, tuple[Fraction, Fraction]]) -> frozenset[str]:
    for name, rate in rates.items():
        if set(rate) != {1}:
            raise AutomatonError(f"{where}: {name} is no clock; its rate must be 1")
    return frozenset(rates)


def _bounds(where: str, constraints: Constraints) -> Bounds:
    """Return constraints as closed bounds of single clocks."""
    found: dict[str, tuple[Fraction, Fraction | None]] = {}
    for constraint in constraints:
        if len(constraint.term.factors) != 1:
            raise AutomatonError(f"{where}: expected bounds of one clock each")
        (clock, factor), = constraint.term.factors
        value = -constraint.term.constant / factor
        if constraint.relation == "<":
            raise AutomatonError(f"{where}: the bound {value} of {clock} is open; with open bounds "
                                 "whole units of time would not be exact: use <= or >=")
        low = value if constraint.relation == "==" or factor < 0 else Fraction(0)
        high = value if constraint.relation == "==" or factor > 0 else None
        found = meet(found, {clock: (low, high)})
    return found


def _invariant(where: str, constraints: Constraints) -> Mapping[str, Fraction]:
    bounds = _bounds(where, constraints)
    if any(low > 0 or high is None for low, high in bounds.values()):
        raise AutomatonError(f"{where}: an invariant may only bound clocks from above")
    return {clock: high for clock, (_, high) in bounds.items() if high is not None}


def _step(automaton: str, transition: Transition) -> _Step:
    name = transition.label or f"{automaton}: {transition.source} -> {transition.target}"
    where = f"{automaton}: {transition.source} -> {transition.target}"
    guard = _bounds(where, transition.guard)
    if transition.command and guard:
        raise AutomatonError(f"{where}: a commanded transition is taken at once, so it may have "
                             "no guard")
    if any(set(ends) != {0} for ends in transition.sets.values()):
        raise AutomatonError(f"{where}: clocks may only be set to 0")
    return _Step(transition.target, guard, frozenset(transition.sets), transition.label,
                 transition.command, name)


__all__ = ["Bounds", "State", "TimedAbstraction", "TimedNetwork", "Truth", "in_time"]
