"""A finite plant as the closed loop uses it: its states as bytes to be scanned, looked at once.

A plant is asked once what its sensors read in a state, and once what follows certain outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from operator import itemgetter
from typing import Any, NamedTuple, Protocol

from plcemu.base.types import Value
from plcemu.io.mapping import Point
from plcemu.verify.machine import ScanMachine, place_of


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


class Inputs(NamedTuple):
    """What a plant's sensors read.

    Attributes:
        raw: the raw bytes of each input.
        packed: the same as a batch of scans takes it.
    """

    raw: list[bytes]
    packed: bytes


class View:
    """A plant's state.

    Attributes:
        state: the plant's own.
        inputs: what its sensors read.
        facts: the values of its facts.
        outcomes: what scans that see it tell of memory -> what that means.
    """

    __slots__ = ("facts", "inputs", "outcomes", "state")

    def __init__(self, state: Hashable, inputs: Inputs, facts: tuple[Value, ...]) -> None:
        self.state, self.inputs, self.facts = state, inputs, facts
        self.outcomes: dict[bytes, Outcome] = {}


Outcome = tuple[int, View]
"""Which watched formulas hold after a scan, as bits, and the plant that follows its outputs."""


class Views:
    """All states of a plant that were looked at, and what scans meant to them.

    Args:
        machine: the program's scan.
        plant: the abstraction.
        inputs: where the plant's readings go.
        outputs: what its actuators follow.
        watch: which watched formulas hold in one scan, as bits.
        watched: the bytes of memory that `watch` looks at, by offset.
    """

    def __init__(self, machine: ScanMachine, plant: FinitePlant, inputs: Sequence[Point],
                 outputs: Sequence[Point], watch: Callable[[bytes, Sequence[Value]], int],
                 watched: Sequence[int]) -> None:
        self._machine, self._plant = machine, plant
        self._watch, self._watched = watch, watched
        self._actuators: list[tuple[Point, slice]] = []
        told: list[int] = []
        for point in outputs:
            at, begin = place_of(machine.resource.program, point), len(told)
            told.extend(range(at, at + point.width) if at is not None else ())
            self._actuators.append((point, slice(begin, len(told))))
        self._outputs = len(told)
        self.told = (*told, *watched)
        """The bytes of memory that must be known of every scan: outputs, then watched ones."""
        self.batch = machine.batch(self.told)
        self._readings = _getter([p.name for p in inputs])
        self._fact_values = _getter([f.name for f in plant.facts])
        self._views: dict[Hashable, View] = {}
        self._raw = [_Raw(point) for point in inputs]
        self._seen: dict[tuple[Any, ...], Inputs] = {}
        self._values: dict[bytes, dict[str, Any]] = {}
        self._holding: dict[tuple[bytes, tuple[Value, ...]], int] = {}
        self.ever = 0
        """Bits of the watched formulas that held in any scan so far."""

    def of(self, plant: Hashable) -> View:
        """Return a plant's state as the loop uses it."""
        found = self._views.get(plant)
        if found is None:
            readings = self._readings(self._plant.sense(plant))
            inputs = self._seen.get(readings)
            if inputs is None:
                raw = [table[value] for table, value in zip(self._raw, readings, strict=True)]
                packed = self.batch.image([raw[n] for n in self._machine.order])
                inputs = self._seen[readings] = Inputs(raw, packed)
            facts = self._fact_values(self._plant.observe(plant))
            found = self._views[plant] = View(plant, inputs, facts)
        return found

    def outcome(self, view: View, told: bytes) -> Outcome:
        """Return what a scan means that saw a plant's state.

        Args:
            view: the plant's state.
            told: the bytes of memory after the scan that `self.told` names.
        """
        found = view.outcomes.get(told)
        if found is None:
            outputs, watched = told[:self._outputs], told[self._outputs:]
            values = self._values.get(outputs)
            if values is None:
                values = self._values[outputs] = {
                    p.name: p.to_value(int.from_bytes(outputs[at], "little"))
                    for p, at in self._actuators}
            holding = self._holding.get((watched, view.facts))
            if holding is None:
                holding = self._holding[watched, view.facts] = self._judge(watched, view.facts)
            state = self._plant.actuate(view.state, values)
            found = holding, view if state is view.state else self.of(state)
            view.outcomes[told] = found
        return found

    def _judge(self, watched: bytes, facts: tuple[Value, ...]) -> int:
        """Ask which watched formulas hold; of memory they see nothing else."""
        memory = bytearray(self._machine.initial)
        for offset, byte in zip(self._watched, watched, strict=True):
            memory[offset] = byte
        holding = self._watch(bytes(memory), facts)
        self.ever |= holding
        return holding


class _Raw(dict[Any, bytes]):
    """Readings of an input -> their raw bytes."""

    def __init__(self, point: Point) -> None:
        super().__init__()
        self._point = point

    def __missing__(self, value: Any) -> bytes:
        point = self._point
        raw = self[value] = point.to_raw(value).to_bytes(point.width, "little")
        return raw


def _getter(names: Sequence[str]) -> Callable[[Mapping[str, Any]], tuple[Any, ...]]:
    """Return what takes the values of these names out of a mapping."""
    if len(names) > 1:
        return itemgetter(*names)
    return lambda values: tuple([values[name] for name in names])
