"""The closed loop as a transition system: the real scan against a plant's finite abstraction.

A state is the memory block (what matters of it) and the plant's state. Two ways to look at it:

* `merge="stable"`: between two events of the plant the scan is iterated, with the plant following
  its outputs after each, until neither changes any more. A checker's state is such a rest. This
  assumes that no event comes while the loop settles, a few scans; what every single scan on the
  way shows is still judged, through `seen`.
* `merge="none"`: a state after every scan; in each the plant may do nothing or something, and the
  time of a cycle passes in timers. Nothing is assumed.

A third one, `merge="timed"`, is in `plcemu.verify.timed.loop`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, Literal

from plcemu.base.errors import PlcemuError
from plcemu.base.types import Value
from plcemu.io.mapping import Point
from plcemu.verify.machine import ScanMachine
from plcemu.verify.rounds import Rounds
from plcemu.verify.settle import DoesNotSettle, Settling, Start, State, Trail
from plcemu.verify.views import FinitePlant, Views

Merge = Literal["stable", "none", "timed"]
Fairness = Literal["weak", "strong", "none"]
"""What is assumed of the plant on runs without end, see `plcemu.verify.fair`."""

_ENOUGH = 128
"""Steps that are asked for at once."""


class Idle:
    """The action of a plant that does nothing during a scan."""

    def __str__(self) -> str:
        return "nothing happens"

    __repr__ = __str__


IDLE = Idle()


def nothing_watched(memory: bytes, facts: Sequence[Value]) -> int:
    """No formula is watched."""
    return 0


class ClosedLoop:
    """A program and a finite plant.

    `deadlock_doubt` says why it cannot be told that something can always happen; empty if it can.

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
        frozen: while it holds, the plant does nothing; None if it always may.
        fairness: what is assumed of runs without end: that what is pending without a break is done
            (`weak`), that what is pending again and again is (`strong`), or nothing (`none`).
        together: whether to make many steps at once, where many are asked for.

    Raises:
        PlcemuError: stable scans are to be merged although the program measures time.
    """

    def __init__(self, machine: ScanMachine, plant: FinitePlant, inputs: Sequence[Point],
                 outputs: Sequence[Point],
                 watch: Callable[[bytes, Sequence[Value]], int] = nothing_watched,
                 watched: Iterable[int] | None = None, told: int = -1,
                 merge: Merge = "stable", cycle_ns: int = 0,
                 frozen: Callable[[bytes, Sequence[Value]], bool] | None = None,
                 fairness: Fairness = "weak", together: bool = True) -> None:
        if merge == "stable" and machine.has_clocks:
            raise PlcemuError("the program reads timers or step times, so time matters between "
                              "two events of the plant: verify in time (merge: timed), or every "
                              "scan (merge: none)")
        self.machine, self.plant = machine, plant
        self.inputs, self.outputs = tuple(inputs), tuple(outputs)
        self.merge, self.cycle_ns = merge, cycle_ns
        self._frozen, self.fairness = frozen, fairness
        self.deadlock_doubt = ""
        self._elapsed_ns = cycle_ns if merge == "none" else 0
        looked_at = range(len(machine.initial)) if watched is None else sorted(watched)
        self._views = Views(machine, plant, self.inputs, self.outputs, watch, looked_at)
        self._settling: Settling = (Rounds if together else Settling)(
            machine, self._views, told, merge == "none")
        self._starts: dict[Hashable, State] = {}
        self.origins: dict[State, Hashable] = {}
        """For each initial state found, a plant's initial state that leads to it."""

    def watch(self, memory: bytes, facts: tuple[Value, ...]) -> int:
        """Which watched formulas hold with this memory and these facts, as bits."""
        return self._views.holding(memory, facts)

    @property
    def ever(self) -> int:
        """Bits of the watched formulas that held in any scan so far."""
        return self._views.ever

    # ------------------------------------------------------------ the transition system

    def initial(self) -> Iterator[State]:
        """The plant's initial states, each after the program's first scan or first rest."""
        plants = iter(self.plant.initial())
        while some := list(islice(plants, _ENOUGH)):
            starts = [(self.machine.initial, plant) for plant in some]
            for plant, state in zip(some, self._settling.settled(starts, 0), strict=True):
                self.origins.setdefault(state, plant)
                self._starts[plant] = state
                yield state

    def settled_from(self, plant: Hashable) -> State:
        """The state after a cold start of the program at a plant in that state."""
        return self._settling.last(self.first_scans(plant), self.machine.initial)

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
        return self._settling.last(self.scans(state, action), state.memory)

    def expand(self, states: Iterable[State]) -> Iterator[list[tuple[Any, State]]]:
        """For each state, its actions and the states after them."""
        rows: list[Sequence[Any]] = []
        starts: list[Start] = []
        for state in states:
            rows.append(self.actions(state))
            starts.extend([(state.memory, self._after(state, action)) for action in rows[-1]])
            if len(starts) >= _ENOUGH:
                yield from self._expanded(rows, starts)
                rows, starts = [], []
        yield from self._expanded(rows, starts)

    def _expanded(self, rows: list[Sequence[Any]],
                  starts: list[Start]) -> Iterator[list[tuple[Any, State]]]:
        found = self._settling.settled(starts, self._elapsed_ns)
        for actions in rows:
            yield list(zip(actions, found))  # noqa: B905 - the next row takes the rest

    def future(self, state: State) -> Hashable:
        """What decides how a run goes on: all of a state but what was seen on the way to it."""
        return state._replace(seen=0) if state.seen else state

    def _after(self, state: State, action: Any) -> Hashable:
        return state.plant if action is IDLE else self.plant.after(state.plant, action)

    def pending(self, state: State) -> Collection[str]:
        """What is under way in the plant."""
        if state.fault or self.fairness == "none" or self._stands_still(state):
            return ()
        return self.plant.pending(state.plant)

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
        return self._settling.step(self.machine.initial, plant, 0)

    def scans(self, state: State, action: Any) -> Trail:
        """The scans of a step, the plant in the end, and why the program faulted, if it did."""
        return self._settling.step(state.memory, self._after(state, action), self._elapsed_ns)

    def outcome(self, memory: bytes, plant: Hashable) -> tuple[int, Hashable]:
        """Which watched formulas hold after a scan that saw a plant and left memory so, as bits,
        and the plant once its actuators follow the outputs."""
        holding, following = self._settling.outcome(memory, self._views.of(plant))
        return holding, following.state

    def scan(self, memory: bytes, plant: Hashable, elapsed_ns: int) -> bytes:
        """Memory after one scan that sees a plant, once some time has passed."""
        return self.machine.scan(memory, self._views.image(self._views.of(plant)), elapsed_ns)

    def facts(self, plant: Hashable) -> tuple[Value, ...]:
        """The values of the plant's facts, in their order."""
        return self._views.of(plant).facts

    def raw_inputs(self, plant: Hashable) -> dict[str, int]:
        """The raw values of the inputs that a plant's state gives, by port name."""
        return {p.name: int.from_bytes(raw, "little")
                for p, raw in zip(self.inputs, self._views.raw(self._views.of(plant)), strict=True)}


__all__ = ["IDLE", "ClosedLoop", "DoesNotSettle", "FinitePlant", "Merge", "State", "Trail"]
