"""A finite plant as the closed loop uses it: its states as bytes to be scanned, each looked at once.

A plant is asked once what its sensors read in a state, and once what follows certain outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from operator import itemgetter
from typing import Any, Protocol

from plcemu.base.types import Value
from plcemu.io.mapping import Point
from plcemu.verify.machine import ScanMachine, place_of

Image = list[tuple[slice, bytes]]
"""Inputs as stretches of memory to be written; see `ScanMachine.image`."""


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
        raw: what its sensors read as the raw bytes of each input.
        image: the same as it is written into memory.
        packed: the same as a batch of scans takes it.
        facts: the values of the plant's facts.
        holding: watched bytes of memory -> which watched formulas hold; one for all views with these
            facts.
        follows: outputs as they stand in memory -> the plant once its actuators follow them.
    """

    __slots__ = ("facts", "follows", "holding", "image", "packed", "raw", "state")

    def __init__(self, state: Hashable, inputs: tuple[list[bytes], Image, bytes],
                 facts: tuple[Value, ...], holding: dict[bytes, int]) -> None:
        self.state, self.facts, self.holding = state, facts, holding
        self.raw, self.image, self.packed = inputs
        self.follows: dict[bytes, View] = {}


class Views:
    """All states of a plant that were looked at.

    Args:
        machine: the program's scan.
        plant: the abstraction.
        inputs: where the plant's readings go.
        outputs: what its actuators follow.
        watched: the bytes of memory that are told apart in a batch of scans.
    """

    def __init__(self, machine: ScanMachine, plant: FinitePlant, inputs: Sequence[Point],
                 outputs: Sequence[Point], watched: Sequence[int]) -> None:
        self._machine, self._plant, self._inputs = machine, plant, inputs
        self.batch = machine.batch(watched)
        places = [(p, place_of(machine.resource.program, p)) for p in outputs]
        self.outputs = _outputs(places)
        """The stretch of memory in which all outputs stand."""
        self._places = [(p, None if at is None else at - self.outputs.start) for p, at in places]
        self._readings = _getter([p.name for p in inputs])
        self._fact_values = _getter([f.name for f in plant.facts])
        self._views: dict[Hashable, View] = {}
        self._raw: dict[tuple[int, Any], bytes] = {}
        self._images: dict[tuple[Any, ...], tuple[list[bytes], Image, bytes]] = {}
        self._values: dict[bytes, dict[str, Any]] = {}
        self._holding: dict[tuple[Value, ...], dict[bytes, int]] = {}

    def of(self, plant: Hashable) -> View:
        """Return a plant's state as the loop uses it."""
        found = self._views.get(plant)
        if found is None:
            readings = self._readings(self._plant.sense(plant))
            inputs = self._images.get(readings)
            if inputs is None:
                raw = [self._raw_of(n, value) for n, value in enumerate(readings)]
                image = self._machine.image(raw)
                packed = self.batch.image([data for _, data in image])
                inputs = self._images[readings] = raw, image, packed
            facts = self._fact_values(self._plant.observe(plant))
            holding = self._holding.get(facts)
            if holding is None:
                holding = self._holding[facts] = {}
            found = self._views[plant] = View(plant, inputs, facts, holding)
        return found

    def following(self, view: View, memory: bytes) -> View:
        """Return the plant once its actuators follow the outputs in memory."""
        outputs = memory[self.outputs]
        return view.follows.get(outputs) or self.follow(view, outputs)

    def follow(self, view: View, outputs: bytes) -> View:
        """Ask the plant what follows outputs, given as they stand in memory."""
        values = self._values.get(outputs)
        if values is None:
            values = self._values[outputs] = {p.name: _actuator(p, at, outputs)
                                              for p, at in self._places}
        found = view.follows[outputs] = self.of(self._plant.actuate(view.state, values))
        return found

    def _raw_of(self, number: int, value: Any) -> bytes:
        """Return a reading as the raw bytes of its input."""
        raw = self._raw.get((number, value))
        if raw is None:
            point = self._inputs[number]
            raw = self._raw[number, value] = point.to_raw(value).to_bytes(point.width, "little")
        return raw


def _getter(names: Sequence[str]) -> Callable[[Mapping[str, Any]], tuple[Any, ...]]:
    """Return what takes the values of these names out of a mapping."""
    if len(names) > 1:
        return itemgetter(*names)
    return lambda values: tuple([values[name] for name in names])


def _actuator(point: Point, at: int | None, outputs: bytes) -> bool | float:
    """Return an actuator's value; one whose output the program does not use stays off."""
    raw = b"" if at is None else outputs[at:at + point.width]
    return point.to_value(int.from_bytes(raw, "little"))


def _outputs(places: Sequence[tuple[Point, int | None]]) -> slice:
    """Return the stretch of memory in which all outputs stand."""
    used = [(at, at + p.width) for p, at in places if at is not None]
    return slice(min((a for a, _ in used), default=0), max((b for _, b in used), default=0))
