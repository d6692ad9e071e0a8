"""The closed loop as a transition system: the real scan against a plant's finite abstraction.

A state is the memory block (what matters of it) and the plant's state. Two ways to look at it:

* `merge="stable"`: between two events of the plant the scan is iterated, with the plant following
  its outputs after each, until neither changes any more. A checker's state is such a rest. This
  assumes that no event comes while the loop settles, a few scans; what every single scan on the
  way shows is still judged, through `seen`.
* `merge="none"`: a state after every scan; in each the plant may do nothing or something, and the
  time of a cycle passes in timers. Nothing is assumed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple, Protocol

from plcemu.base.errors import PlcemuError, ProgramFault
from plcemu.base.types import Value
from plcemu.io.mapping import Point
from plcemu.verify.machine import ScanMachine, mask_of, place_of

Merge = Literal["stable", "none"]
Fairness = Literal["weak", "strong", "none"]
"""What is assumed of the plant on runs without end, see `plcemu.verify.fair`."""


class FinitePlant(Protocol):
    """What is asked of a plant; `plant_sim.abstraction` says what each means."""

    @property
    def facts(self) -> tuple[Any, ...]: ...
    def initial(self) -> Any: ...
    def name_of(self, state: Any) -> str: ...
    def sense(self, state: Any) -> Mapping[str, Any]: ...
    def actuate(self, state: Any, values: Mapping[str, Any]) -> Hashable: ...
    def actions(self, state: Any) -> Sequence[Hashable]: ...
    def after(self, state: Any, action: Any) -> Hashable: ...
    def observe(self, state: Any) -> Mapping[str, Any]: ...
    def pending(self, state: Any) -> Collection[str]: ...
    def done(self, action: Any) -> Collection[str]: ...


class State(NamedTuple):
    """A state of the closed loop.

    Attributes:
        memory: the block, reduced to what matters.
        plant: the plant's state.
        seen: bit n is set if the watched formula n held in a scan of the step that led here.
        fault: why the program stopped; else empty.
    """

    memory: bytes
    plant: Hashable
    seen: int = 0
    fault: str = ""


Trail = tuple[list[tuple[bytes, Hashable]], Hashable, str]
"""Scans as (memory after it, the plant whose readings it saw), the plant after them, and why the
program faulted in the one after the last; empty if it did not."""


class _View:
    """A plant's state as the loop uses it: its inputs and facts, and what follows which outputs."""

    __slots__ = ("facts", "follows", "image", "raw", "state")

    def __init__(self, state: Hashable, raw: list[bytes], image: list[tuple[slice, bytes]],
                 facts: tuple[Value, ...]) -> None:
        self.state, self.raw, self.image, self.facts = state, raw, image, facts
        self.follows: dict[bytes, _View] = {}


class Idle:
    """The action of a plant that does nothing during a scan."""

    def __str__(self) -> str:
        return "nothing happens"

    __repr__ = __str__


IDLE = Idle()


SETTLES_WITHIN = 1000
"""Scans after which the loop must rest if nothing happens by itself."""


_PATIENCE = 16
"""Scans before it is looked whether only what does not matter still changes."""


class DoesNotSettle(PlcemuError):
    """The loop goes on changing although nothing happens by itself, so scans cannot be merged."""


def nothing_watched(memory: bytes, facts: Sequence[Value]) -> int:
    """No formula is watched."""
    return 0


class ClosedLoop:
    """A program and a finite plant.

    Args:
        machine: the program's scan, with the inputs that `inputs` names.
        plant: the abstraction.
        inputs: where the plant's readings go.
        outputs: what its actuators follow.
        watch: which watched formulas hold in one scan, as bits; asked of every scan.
        watched: the bytes of memory that `watch` looks at; all if None.
        told: the bits that are told for every step, in `State.seen`; all are kept in `ever`.
        merge: which scans are states of their own.
        cycle_ns: the time that passes between two scans; used by `merge="none"`.
        frozen: whether the plant stands still; None if it never does.
        fairness: what is assumed of runs without end: that what is pending without a break is done
            (`weak`), that what is pending again and again is (`strong`), or nothing (`none`).

    Raises:
        PlcemuError: stable scans are to be merged although the program measures time.
    """

    def __init__(self, machine: ScanMachine, plant: FinitePlant, inputs: Sequence[Point],
                 outputs: Sequence[Point],
                 watch: Callable[[bytes, Sequence[Value]], int] = nothing_watched,
                 watched: Iterable[int] | None = None, told: int = -1,
                 merge: Merge = "stable", cycle_ns: int = 0,
                 frozen: Callable[[bytes, Sequence[Value]], bool] | None = None,
                 fairness: Fairness = "weak") -> None:
        if merge == "stable" and machine.has_clocks:
            raise PlcemuError("the program reads timers or step times, so time matters between "
                              "two events of the plant: verify every scan (merge: none), or with "
                              "a timed model")
        self.machine, self.plant = machine, plant
        self.inputs, self.outputs = tuple(inputs), tuple(outputs)
        self.watch, self.told, self.merge, self.cycle_ns = watch, told, merge, cycle_ns
        self._frozen, self.fairness = frozen, fairness
        self._elapsed_ns = cycle_ns if merge == "none" else 0
        self.ever = 0
        """Bits of the watched formulas that held in any scan so far."""
        program = machine.resource.program
        self._places = [(p, place_of(program, p)) for p in self.outputs]
        self._raw: dict[tuple[int, Any], bytes] = {}
        self._names = [p.name for p in self.inputs]
        self._hull = _hull(self._places)
        self._views: dict[Hashable, _View] = {}
        self._images: dict[tuple[Any, ...], tuple[list[bytes], list[tuple[slice, bytes]]]] = {}
        self._values: dict[bytes, dict[str, Any]] = {}
        self._watched_mask = mask_of(len(machine.initial), watched)
        self._holding: dict[tuple[int, tuple[Value, ...]], int] = {}
        self._starts: dict[Hashable, State] = {}
        self.origins: dict[State, Hashable] = {}
        """For each initial state found, a plant's initial state that leads to it."""

    # ------------------------------------------------------------ the transition system

    def initial(self) -> Iterator[State]:
        """The plant's initial states, each after the program's first scan or first rest."""
        for plant in self.plant.initial():
            state = self.settled_from(plant)
            self.origins.setdefault(state, plant)
            self._starts[plant] = state
            yield state

    def settled_from(self, plant: Hashable) -> State:
        """The state after a cold start of the program at a plant in that state."""
        return self._last(self.first_scans(plant))

    def starts(self, number: Mapping[State, int]) -> Iterator[tuple[Hashable, int]]:
        """The plant's initial states, each with the number of the loop's initial state."""
        return ((plant, number[state]) for plant, state in self._starts.items())

    def actions(self, state: State) -> Sequence[Any]:
        """What the plant may do; in `merge="none"` also nothing."""
        if state.fault:
            return ()
        if self._stands_still(state):
            return (IDLE,)
        own = self.plant.actions(state.plant)
        return own if self.merge == "stable" else (IDLE, *own)

    def next(self, state: State, action: Any) -> State:
        """The state after the plant's action and the scans that follow it."""
        return self._last(self.scans(state, action))

    def pending(self, state: State) -> Collection[str]:
        """What is under way in the plant."""
        return () if state.fault or self._stands_still(state) else self.plant.pending(state.plant)

    def done(self, action: Any) -> Collection[str]:
        """What of it an action brings about."""
        return () if action is IDLE else self.plant.done(action)

    def elapsed_ns(self, state: State, action: Any) -> int:
        """The time from the last scan before an action to the next; 0 where it is left open."""
        return self._elapsed_ns

    def _stands_still(self, state: State) -> bool:
        return self._frozen is not None and self._frozen(state.memory, self.facts(state.plant))

    # ------------------------------------------------------------ the scans of a step

    def first_scans(self, plant: Hashable) -> Trail:
        """The scans from a cold start to the initial state of that plant."""
        return self._step(self.machine.initial, plant, 0)

    def scans(self, state: State, action: Any) -> Trail:
        """The scans of a step, the plant in the end, and why the program faulted, if it did."""
        plant = state.plant if action is IDLE else self.plant.after(state.plant, action)
        return self._step(state.memory, plant, self._elapsed_ns)

    def facts(self, plant: Hashable) -> tuple[Value, ...]:
        """The values of the plant's facts, in their order."""
        return self._view(plant).facts

    def raw_inputs(self, plant: Hashable) -> dict[str, int]:
        """The raw values of the inputs that a plant's state gives, by port name."""
        return {p.name: int.from_bytes(raw, "little")
                for p, raw in zip(self.inputs, self._view(plant).raw, strict=True)}

    def _last(self, step: Trail) -> State:
        scans, plant, fault = step
        seen = 0
        for memory, seen_plant in scans:
            seen |= self._holds(memory, seen_plant)
        last = self.machine.reduced(scans[-1][0]) if scans else self.machine.initial
        return State(last, plant, seen & self.told, fault)

    def _holds(self, memory: bytes, plant: Hashable) -> int:
        """Return which watched formulas hold in a scan; what they look at has few values."""
        facts = self._views[plant].facts
        key = (int.from_bytes(memory, "little") & self._watched_mask, facts)
        holds = self._holding.get(key)
        if holds is None:
            holds = self._holding[key] = self.watch(memory, facts)
            self.ever |= holds
        return holds

    def _step(self, memory: bytes, plant: Hashable, elapsed_ns: int) -> Trail:
        """Scan until the loop rests, or once: the plant follows the outputs after each scan."""
        scans: list[tuple[bytes, Hashable]] = []
        scan, hull, once = self.machine.scan, self._hull, self.merge == "none"
        view = self._view(plant)
        try:
            for n in range(SETTLES_WITHIN):
                after = scan(memory, view.image, elapsed_ns)
                scans.append((after, view.state))
                outputs = after[hull]
                following = view.follows.get(outputs) or self._follow(view, outputs)
                rests = following is view and (after == memory or (
                    n > _PATIENCE and self._same(after, memory)))
                memory, view = after, following
                if rests or once:
                    return scans, view.state, ""
        except ProgramFault as fault:
            return scans, view.state, fault.reason + (f" in {fault.pou}" if fault.pou else "")
        raise DoesNotSettle(f"the loop still changes after {SETTLES_WITHIN} scans in which nothing "
                            "happens by itself; verify every scan: merge: none")

    def _same(self, a: bytes, b: bytes) -> bool:
        """Whether two memories differ in nothing that matters."""
        return self.machine.reduced(a) == self.machine.reduced(b)

    def _view(self, plant: Hashable) -> _View:
        found = self._views.get(plant)
        if found is None:
            sensed, facts = self.plant.sense(plant), self.plant.observe(plant)
            key = tuple([sensed[name] for name in self._names])
            if key not in self._images:
                raw = [self._raw_of(n, value) for n, value in enumerate(key)]
                self._images[key] = raw, self.machine.image(raw)
            found = self._views[plant] = _View(plant, *self._images[key],
                                               tuple([facts[f.name] for f in self.plant.facts]))
        return found

    def _raw_of(self, number: int, value: Any) -> bytes:
        """Return a reading as the raw bytes of its input."""
        raw = self._raw.get((number, value))
        if raw is None:
            point = self.inputs[number]
            raw = self._raw[number, value] = point.to_raw(value).to_bytes(point.width, "little")
        return raw

    def _follow(self, view: _View, outputs: bytes) -> _View:
        """Return the plant once its actuators follow the outputs, given as they stand in memory."""
        values = self._values.get(outputs)
        if values is None:
            values = self._values[outputs] = {p.name: self._actuator(p, at, outputs)
                                              for p, at in self._places}
        found = view.follows[outputs] = self._view(self.plant.actuate(view.state, values))
        return found

    def _actuator(self, point: Point, at: int | None, outputs: bytes) -> bool | float:
        """Return an actuator's value; one whose output the program does not use stays off."""
        if at is None:
            return point.to_value(0)
        at -= self._hull.start
        return point.to_value(int.from_bytes(outputs[at:at + point.width], "little"))


def _hull(places: Sequence[tuple[Point, int | None]]) -> slice:
    """Return the stretch of memory in which all outputs stand."""
    used = [(at, at + p.width) for p, at in places if at is not None]
    return slice(min((a for a, _ in used), default=0), max((b for _, b in used), default=0))
