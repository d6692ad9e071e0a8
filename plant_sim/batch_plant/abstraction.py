"""The batch plant with finitely many states: what each tank holds, and which processes run.

A process begins when its actuators are on and its tanks hold what it needs; from then on both
tanks are in transition, until the action that ends it. How long that takes is left open. Several
processes may end at the same instant. What no process accounts for - a valve opened onto a full
tank, a second component without the mixer, a valve closed half-way - ends the plant's good order
for good; the fact that says why is then true.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import cache, partial
from itertools import combinations, compress, product
from operator import itemgetter
from typing import NamedTuple

from plant_sim.abstraction import AbstractionError
from plant_sim.batch_plant.layout import TANKS, TRANSFERS
from plant_sim.batch_plant.loads import CONTENTS, content_of, read_tanks, tanks_of_load
from plant_sim.batch_plant.parameters import BatchParameters
from plant_sim.batch_plant.processes import PROCESSES, Change
from plant_sim.contract import Fact, FactValue, PortValue
from plant_sim.parameters import ParameterError

NAMES = tuple(tank.name for tank in TANKS)
_CAPACITY_L = [float(tank.capacity_l) for tank in TANKS]
_CHANGES = {p.name: [(NAMES.index(tank), change) for tank, change in p.changes.items()]
            for p in PROCESSES.values()}
"""Process -> for each of its tanks, the tank's place in `State.tanks` and what becomes of it."""
_ACTUATORS = tuple(sorted(frozenset().union(*(p.actuators for p in PROCESSES.values()))))
_states_of = itemgetter(*_ACTUATORS)

FACTS = (
    Fact("overflow", "bool", "", "some tank has overflowed"),
    Fact("forbidden_mixture", "bool", "", "a liquid went where it must not"),
    Fact("interrupted", "bool", "", "a process was stopped before its end"),
)

ORDER, OVERFLOW, MIXTURE, INTERRUPTED = "", "overflow", "forbidden_mixture", "interrupted"
_OBSERVED = {trouble: {fact.name: trouble == fact.name for fact in FACTS}
             for trouble in (ORDER, OVERFLOW, MIXTURE, INTERRUPTED)}


class Running(NamedTuple):
    """A process that has begun; `ended` while its actuators are still on after its end."""

    process: str
    ended: bool


class State(NamedTuple):
    """The plant: contents of B1 to B7 (in transition: those before), processes, what went wrong."""

    tanks: tuple[str, ...]
    running: tuple[Running, ...]
    trouble: str


_state: Callable[[tuple[tuple[str, ...], tuple[Running, ...], str]], State]
_state = partial(tuple.__new__, State)  # as State(...), in half the time


class Ends(tuple[str, ...]):
    """An action: these processes end together."""

    __slots__ = ()

    def __str__(self) -> str:
        return f"{' and '.join(self)} end{'s' if len(self) == 1 else ''}"


class BatchAbstraction:
    """The finite batch plant.

    Args:
        parameters: those of `BatchPlant`; besides `initial`, which names the states to begin in:
            `load` (the parameters load, half or tanks), `loads` (the 30 initial loads, see
            `initial_loads`) or `all` (the 8100 contents of all tanks).

    Raises:
        AbstractionError: a parameter does not exist or cannot have its value.
    """

    facts = FACTS

    def __init__(self, parameters: Mapping[str, object]) -> None:
        given = dict(parameters)
        which = given.pop("initial", "load")
        if which not in _INITIAL:
            raise AbstractionError(f"initial: found {which!r}, expected {', '.join(_INITIAL)}")
        try:
            self._parameters = BatchParameters.of(given)
        except ParameterError as problem:
            raise AbstractionError(str(problem)) from None
        self._names: dict[State, str] = {}
        for name, tanks in _INITIAL[str(which)](self._parameters):
            contents = tuple(tanks.get(tank, "empty") for tank in NAMES)
            self._names.setdefault(State(contents, (), ORDER), name)
        self._sensed: dict[tuple[tuple[str, ...], tuple[str, ...]], dict[str, PortValue]] = {}

    def initial(self) -> Iterator[State]:
        """The states to begin in."""
        yield from self._names

    def name_of(self, state: State) -> str:
        """An initial state in the user's words."""
        return self._names[state]

    # What the controller sees and does

    def sense(self, state: State) -> dict[str, PortValue]:
        """Levels and temperatures; in transition half-way between before and after."""
        key = state.tanks, _open(state.running)
        seen = self._sensed.get(key)
        if seen is None:
            tanks, busy = state.tanks, _busy(key[1])
            seen = self._sensed[key] = {**_readings(NAMES[:4], tanks[:4], busy[:4]),
                                        **_readings(NAMES[4:], tanks[4:], busy[4:])}
        return seen

    def actuate(self, state: State, values: Mapping[str, PortValue]) -> State:
        """Begin what is switched on and possible; note what must not be."""
        tanks, running, trouble = state
        switching = _switch(running, _states_of(values))
        if trouble or switching.after is running:
            return state
        if switching.trouble:
            return State(tanks, running, switching.trouble)
        for at, change in switching.needs:
            if tanks[at] not in change:
                break
        else:
            if not switching.clash:
                return _state((tanks, switching.after, ORDER))
        return _begin_in_turn(state, switching)

    # What happens by itself

    def actions(self, state: State) -> Sequence[Ends]:
        """Any of the processes under way end, alone or together."""
        return () if state.trouble else _endings(state.running)

    def after(self, state: State, action: Ends) -> State:
        """Contents change to what the processes leave."""
        running, changes = _end(state.running, action)
        tanks = list(state.tanks)
        for at, change in changes:
            tanks[at] = change[tanks[at]]
        return _state((tuple(tanks), running, state.trouble))

    def observe(self, state: State) -> Mapping[str, FactValue]:
        """The values of the facts."""
        return _OBSERVED[state.trouble]

    # Weak fairness: a process that runs does not run for ever

    def pending(self, state: State) -> Collection[str]:
        """The processes under way."""
        return () if state.trouble else _open(state.running)

    def done(self, action: Ends) -> Collection[str]:
        """The processes that end."""
        return tuple(action)


# ---------------------------------------------------------- what running processes decide alone

Rows = tuple[Running, ...]
Changes = tuple[tuple[int, Change], ...]


@cache
def _busy(open_: tuple[str, ...]) -> tuple[str, ...]:
    """The process in which each tank takes part; empty for none."""
    by_tank = {tank: name for name in open_ for tank in PROCESSES[name].changes}
    return tuple(by_tank.get(tank, "") for tank in NAMES)


@cache
def _readings(names: tuple[str, ...], contents: tuple[str, ...],
              busy: tuple[str, ...]) -> dict[str, float]:
    """What the sensors of some tanks read."""
    found = {}
    for tank, content, process in zip(names, contents, busy, strict=True):
        before = content_of(content)
        after = content_of(PROCESSES[process].changes[tank][content]) if process else before
        found[f"{tank}.level"] = float(before.volume_l + after.volume_l) / 2
        found[f"{tank}.temperature"] = (before.temperature_degC + after.temperature_degC) / 2
    return found


@cache
def _open(running: Rows) -> tuple[str, ...]:
    """The processes under way."""
    return tuple(row.process for row in running if not row.ended)


@cache
def _endings(running: Rows) -> tuple[Ends, ...]:
    """All that can end together."""
    open_ = _open(running)
    return tuple(Ends(some) for n in range(1, len(open_) + 1) for some in combinations(open_, n))


@cache
def _end(running: Rows, action: Ends) -> tuple[Rows, Changes]:
    """The processes after some have ended, and what becomes of which tank."""
    after = tuple(Running(r.process, r.ended or r.process in action) for r in running)
    return after, tuple(change for name in action for change in _CHANGES[name])


class _Switching(NamedTuple):
    """What becomes of the running processes when actuators are switched.

    Attributes:
        kept: those that go on.
        begins: what else is switched on.
        after: those that run if all of it can begin.
        needs: the tanks that decide whether it can.
        clash: whether it would share a tank with another process.
        trouble: what goes wrong whatever tanks hold; else empty.
    """

    kept: Rows
    begins: tuple[str, ...]
    after: Rows
    needs: Changes
    clash: bool
    trouble: str


@cache
def _switch(running: Rows, states: tuple[PortValue, ...]) -> _Switching:
    """What happens when actuators take these states, given in the order of their names."""
    wanted = _wanted(frozenset(compress(_ACTUATORS, states)))
    kept = tuple(row for row in running if row.process in wanted)
    begins = tuple(sorted(wanted - {row.process for row in running}, key=_place_in_table))
    stopped = any(not row.ended for row in running if row.process not in wanted)
    needs = tuple(change for name in begins for change in _CHANGES[name])
    if not begins and len(kept) == len(running):
        return _Switching(running, (), running, (), False, ORDER)
    used = [at for at, _ in needs] + [at for name in _open(kept) for at, _ in _CHANGES[name]]
    after = tuple(sorted((*kept, *(Running(name, False) for name in begins))))
    return _Switching(kept, begins, after, needs, len(set(used)) < len(used),
                      INTERRUPTED if stopped else ORDER)


def _place_in_table(process: str) -> int:
    return int(process[1:])


def _wanted(on: frozenset[str]) -> set[str]:
    """The processes whose actuators are on; of two on one path the one with the mixer."""
    wanted = {p.name for p in PROCESSES.values() if p.actuators <= on}
    for transfer in TRANSFERS:
        if transfer.process_second in wanted:
            wanted.discard(transfer.process)
    return wanted


def _begin_in_turn(state: State, switching: _Switching) -> State:
    """The state after what is switched on has begun one after the other, as far as it can."""
    now = list(switching.kept)
    for name in switching.begins:
        trouble = _obstacle(name, state.tanks, now)
        if trouble is None:
            now.append(Running(name, False))
        elif trouble:
            return State(state.tanks, state.running, trouble)
    return State(state.tanks, tuple(sorted(now)), ORDER)


def _obstacle(process: str, tanks: Sequence[str], running: Sequence[Running]) -> str | None:
    """Why a process cannot begin as it should: None if it can, "" if nothing happens at all."""
    changes = _CHANGES[process]
    busy = {at for row in running if not row.ended for at, _ in _CHANGES[row.process]}
    if any(at in busy for at, _ in changes):
        return MIXTURE
    if all(tanks[at] in change for at, change in changes):
        return None
    (source, _), *sinks = changes
    if tanks[source] == "empty" or not sinks:
        return ORDER
    sink, _ = sinks[0]
    added = content_of(tanks[source]).volume_l / (2 if _is_double(tanks[source]) else 1)
    full = float(content_of(tanks[sink]).volume_l + added) > _CAPACITY_L[sink]
    return OVERFLOW if full else MIXTURE


def _is_double(content: str) -> bool:
    return content[:-1] in ("sol84", "water56", "sol140")


# ---------------------------------------------------------------- where a run may begin

Named = Iterator[tuple[str, Mapping[str, str]]]


def _of_load(parameters: BatchParameters) -> Named:
    if parameters.tanks:
        tanks = read_tanks(parameters.tanks)
        yield ", ".join(f"{tank}={word}" for tank, word in tanks.items()), tanks
        return
    yield load_name(parameters.load, parameters.half), tanks_of_load(parameters.load,
                                                                     parameters.half)


def load_name(load: float, half: str) -> str:
    """A load in words, such as `load 2` or `load 2.5 (half: water)`."""
    return f"load {load:g}" + ("" if load == int(load) else f" (half: {half})")


def initial_loads() -> Named:
    """The 30 loads filled in from the top: 9 whole, 8 halves of either kind, and 5 more.

    The paper counts 30 and does not list them. The five more are the half loads from 3.5 on whose
    half of solution stands hot in the first tank that takes it so: B5, or B7 once B5 is taken.
    """
    for halves in range(17):
        load = halves / 2
        kinds = ("solution", "water") if halves % 2 else ("solution",)
        for half in kinds:
            yield load_name(load, half), tanks_of_load(load, half)
        if halves % 2 and load > 3:
            tanks = dict(tanks_of_load(int(load), "solution"))
            tank = "B5" if "B5" not in tanks else "B7"
            hot = {"sol42C": "sol84H"}.get(tanks.get(tank, ""), "sol42H")
            yield load_name(load, "hot solution"), {**tanks, tank: hot}


def _loads(parameters: BatchParameters) -> Named:
    yield from initial_loads()


def _all(parameters: BatchParameters) -> Named:
    for words in product(*CONTENTS.values()):
        tanks = dict(zip(CONTENTS, words, strict=True))
        held = [f"{tank}={word}" for tank, word in tanks.items() if word != "empty"]
        yield ", ".join(held) or "all tanks empty", tanks


_INITIAL = {"load": _of_load, "loads": _loads, "all": _all}
