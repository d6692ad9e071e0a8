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

from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple, Protocol

from plcemu.base.errors import PlcemuError, ProgramFault
from plcemu.base.types import Value
from plcemu.io.mapping import Point
from plcemu.verify.machine import ScanMachine, place_of

Merge = Literal["stable", "none"]


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


class Scan(NamedTuple):
    """One scan: memory after it, and the plant whose readings it saw."""

    memory: bytes
    plant: Hashable


class Idle:
    """The action of a plant that does nothing during a scan."""

    def __str__(self) -> str:
        return "nothing happens"

    __repr__ = __str__


IDLE = Idle()


SETTLES_WITHIN = 1000
"""Scans after which the loop must rest if nothing happens by itself."""


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
        told: the bits that are told for every step, in `State.seen`; all are kept in `ever`.
        merge: which scans are states of their own.
        cycle_ns: the time that passes between two scans; used by `merge="none"`.

    Raises:
        PlcemuError: stable scans are to be merged although the program measures time.
    """

    def __init__(self, machine: ScanMachine, plant: FinitePlant, inputs: Sequence[Point],
                 outputs: Sequence[Point],
                 watch: Callable[[bytes, Sequence[Value]], int] = nothing_watched, told: int = -1,
                 merge: Merge = "stable", cycle_ns: int = 0) -> None:
        if merge == "stable" and machine.has_clocks:
            raise PlcemuError("the program reads timers or step times, so time matters between "
                              "two events of the plant: verify every scan (merge: none), or with "
                              "a timed model")
        self.machine, self.plant = machine, plant
        self.inputs, self.outputs = tuple(inputs), tuple(outputs)
        self.watch, self.told, self.merge, self.cycle_ns = watch, told, merge, cycle_ns
        self.ever = 0
        """Bits of the watched formulas that held in any scan so far."""
        program = machine.resource.program
        self._places = [(p, place_of(program, p)) for p in self.outputs]
        self._seen: dict[Hashable, tuple[list[bytes], tuple[Value, ...]]] = {}
        self._moved: dict[tuple[Hashable, tuple[bytes, ...]], Hashable] = {}
        self._watched: dict[Scan, int] = {}
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
        own = self.plant.actions(state.plant)
        return own if self.merge == "stable" else (IDLE, *own)

    def next(self, state: State, action: Any) -> State:
        """The state after the plant's action and the scans that follow it."""
        return self._last(self.scans(state, action))

    def pending(self, state: State) -> Collection[str]:
        """What is under way in the plant."""
        return () if state.fault else self.plant.pending(state.plant)

    def done(self, action: Any) -> Collection[str]:
        """What of it an action brings about."""
        return () if action is IDLE else self.plant.done(action)

    # ------------------------------------------------------------ the scans of a step

    def first_scans(self, plant: Hashable) -> tuple[list[Scan], Hashable, str]:
        """The scans from a cold start to the initial state of that plant."""
        return self._step(self.machine.initial, plant, 0)

    def scans(self, state: State, action: Any) -> tuple[list[Scan], Hashable, str]:
        """The scans of a step, the plant in the end, and why the program faulted, if it did."""
        plant = state.plant if action is IDLE else self.plant.after(state.plant, action)
        return self._step(state.memory, plant, self.cycle_ns)

    def facts(self, plant: Hashable) -> tuple[Value, ...]:
        """The values of the plant's facts, in their order."""
        return self._look(plant)[1]

    def raw_inputs(self, plant: Hashable) -> dict[str, int]:
        """The raw values of the inputs that a plant's state gives, by port name."""
        return {p.name: int.from_bytes(raw, "little")
                for p, raw in zip(self.inputs, self._look(plant)[0], strict=True)}

    def _last(self, step: tuple[list[Scan], Hashable, str]) -> State:
        scans, plant, fault = step
        seen, known = 0, self._watched
        for scan in scans:
            holds = known.get(scan)
            if holds is None:
                holds = known[scan] = self.watch(scan.memory, self.facts(scan.plant))
                self.ever |= holds
            seen |= holds
        last = scans[-1].memory if scans else self.machine.initial
        return State(last, plant, seen & self.told, fault)

    def _step(self, memory: bytes, plant: Hashable,
              elapsed_ns: int) -> tuple[list[Scan], Hashable, str]:
        scans: list[Scan] = []
        scan, look, follow = self.machine.scan, self._look, self._follow
        try:
            for _ in range(SETTLES_WITHIN):
                after = scan(memory, look(plant)[0], elapsed_ns)
                scans.append(Scan(after, plant))
                following = follow(after, plant)
                rests = after == memory and following == plant
                memory, plant = after, following
                if rests or self.merge == "none":
                    return scans, plant, ""
        except ProgramFault as fault:
            return scans, plant, fault.reason + (f" in {fault.pou}" if fault.pou else "")
        raise DoesNotSettle(f"the loop still changes after {SETTLES_WITHIN} scans in which nothing "
                            "happens by itself; verify every scan: merge: none")

    def _look(self, plant: Hashable) -> tuple[list[bytes], tuple[Value, ...]]:
        """Return the raw inputs and the facts of a plant's state."""
        found = self._seen.get(plant)
        if found is None:
            sensed, facts = self.plant.sense(plant), self.plant.observe(plant)
            raw = [p.to_raw(sensed[p.name]).to_bytes(p.width, "little") for p in self.inputs]
            found = self._seen[plant] = raw, tuple(facts[f.name] for f in self.plant.facts)
        return found

    def _follow(self, memory: bytes, plant: Hashable) -> Hashable:
        """Return the plant's state once its actuators follow the outputs in memory."""
        raw = tuple([memory[at:at + p.width] if at is not None else bytes(p.width)
                     for p, at in self._places])
        key = (plant, raw)
        found = self._moved.get(key)
        if found is None:
            values = {p.name: p.to_value(int.from_bytes(r, "little"))
                      for p, r in zip(self.outputs, raw, strict=True)}
            found = self._moved[key] = self.plant.actuate(plant, values)
        return found
