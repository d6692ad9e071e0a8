"""A finite plant as the closed loop uses it: its states as bytes to be scanned, looked at once.

A plant is asked once what its sensors read in a state, and once what follows certain outputs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from operator import itemgetter
from typing import Any, Protocol

from plcemu.base.types import Value
from plcemu.io.mapping import Point
from plcemu.verify.machine import Image, ScanMachine, place_of


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


class View:
    """A plant's state.

    Attributes:
        state: the plant's own.
        packed: what its sensors read, as a batch of scans takes it.
        facts: the values of its facts.
        holding: watched bytes of memory -> which watched formulas hold, with these facts.
        outcomes: what scans that see it tell of memory -> what that means.
    """

    __slots__ = ("facts", "holding", "outcomes", "packed", "state")

    def __init__(self, state: Hashable, packed: bytes, facts: tuple[Value, ...],
                 holding: dict[bytes, int]) -> None:
        self.state, self.packed, self.facts, self.holding = state, packed, facts, holding
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
        in_memory = [inputs[n] for n in machine.order]
        self._tables = [_Raw(point) for point in in_memory]
        self._readings = _getter([p.name for p in in_memory])
        self._fact_values = _getter([f.name for f in plant.facts])
        self._views: dict[Hashable, View] = {}
        self._packed: dict[tuple[Any, ...], bytes] = {}
        self._images: dict[bytes, Image] = {}
        self._told: dict[bytes, tuple[bytes, dict[str, Any], bytes]] = {}
        self._holding: dict[tuple[Value, ...], dict[bytes, int]] = defaultdict(dict)
        self.ever = 0
        """Bits of the watched formulas that held in any scan so far."""

    def of(self, plant: Hashable) -> View:
        """Return a plant's state as the loop uses it."""
        found = self._views.get(plant)
        if found is None:
            readings = self._readings(self._plant.sense(plant))
            packed = self._packed.get(readings)
            if packed is None:
                packed = self._packed[readings] = self.batch.image(
                    [table[value] for table, value in zip(self._tables, readings, strict=True)])
            facts = self._fact_values(self._plant.observe(plant))
            holding = self._holding[facts]
            found = self._views[plant] = View(plant, packed, facts, holding)
        return found

    def image(self, view: View) -> Image:
        """Return what a plant's sensors read as a single scan takes it."""
        image = self._images.get(view.packed)
        if image is None:
            image = self._images[view.packed] = self._machine.image(self.raw(view))
        return image

    def raw(self, view: View) -> list[bytes]:
        """Return what a plant's sensors read: the raw bytes of each input."""
        raw, at = [b""] * len(self._machine.order), 0
        for number, table in zip(self._machine.order, self._tables, strict=True):
            raw[number] = view.packed[at:at + table.point.width]
            at += table.point.width
        return raw

    def outcome(self, view: View, told: bytes) -> Outcome:
        """Return what a scan means that saw a plant's state.

        Args:
            view: the plant's state.
            told: the bytes of memory after the scan that `self.told` names.
        """
        found = view.outcomes.get(told)
        if found is None:
            parts = self._told.get(told)
            if parts is None:
                parts = self._told[told] = told, self._values(told), told[self._outputs:]
            told, values, watched = parts
            holding = view.holding.get(watched)
            if holding is None:
                holding = self._judge(watched, view.facts)
            state = self._plant.actuate(view.state, values)
            found = view.outcomes[told] = holding, view if state is view.state else self.of(state)
        return found

    def holding(self, memory: bytes, facts: tuple[Value, ...]) -> int:
        """Return which watched formulas hold with this memory and these facts."""
        watched = bytes([memory[n] for n in self._watched])
        found = self._holding[facts].get(watched)
        return self._judge(watched, facts) if found is None else found

    def _values(self, told: bytes) -> dict[str, Any]:
        """Return the actuators' values; one whose output the program does not use stays off."""
        return {p.name: p.to_value(int.from_bytes(told[at], "little"))
                for p, at in self._actuators}

    def _judge(self, watched: bytes, facts: tuple[Value, ...]) -> int:
        """Ask which watched formulas hold; of memory they see nothing else."""
        memory = bytearray(self._machine.initial)
        for offset, byte in zip(self._watched, watched, strict=True):
            memory[offset] = byte
        holding = self._holding[facts][watched] = self._watch(bytes(memory), facts)
        self.ever |= holding
        return holding


class _Raw(dict[Any, bytes]):
    """Readings of an input -> their raw bytes."""

    def __init__(self, point: Point) -> None:
        super().__init__()
        self.point = point

    def __missing__(self, value: Any) -> bytes:
        point = self.point
        raw = self[value] = point.to_raw(value).to_bytes(point.width, "little")
        return raw


def _getter(names: Sequence[str]) -> Callable[[Mapping[str, Any]], tuple[Any, ...]]:
    """Return what takes the values of these names out of a mapping."""
    if len(names) > 1:
        return itemgetter(*names)
    return lambda values: tuple([values[name] for name in names])
